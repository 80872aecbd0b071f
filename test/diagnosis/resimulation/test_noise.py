"""What noise that outlasts a block makes of sizes and of records: nothing of it is a cause."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

from microstage_ros.control.runs.run_file import run_from_dict
from microstage_ros.control.runs.simulate import simulated_record
from microstage_ros.diagnosis.batch import diagnose_records
from microstage_ros.diagnosis.resimulation.closed_loop import ClosedLoop, measured
from microstage_ros.diagnosis.resimulation.fit import solve, standard_errors
from microstage_ros.diagnosis.resimulation.folds import make_folds
from microstage_ros.diagnosis.resimulation.noise import AT_THE_FLOOR, DRAWN, noise_of
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file

ROWS, BLOCK, CASES = 4000, 500, 200
MOVES = [{"move_to_m": way, "dwell_s": rest} for way, rest in ((5e-6, 0.5), (-5e-6, 0.5), (2e-6, 0.3), (-3e-6, 0.8))]


def lasting(generator, count, rows_long):
    """``count`` courses of noise of unit size that is forgotten after ``rows_long`` rows, from its steady state."""
    keeps = np.exp(-1.0 / rows_long)
    white = generator.standard_normal((count, ROWS)) * np.sqrt(1.0 - keeps**2)
    white[:, 0] = generator.standard_normal(count)
    return signal.lfilter([1.0], [1.0, -keeps], white)


@pytest.mark.parametrize("rows_long", [1, 4 * BLOCK])
def test_a_size_is_as_uncertain_as_the_noise_of_its_length_makes_it(rows_long):
    """A drift fitted to noise alone: its errors are those that the noise makes, and blocks alone state too little where it outlasts them."""
    generator = np.random.default_rng(5)
    columns = np.linspace(0.0, 1.0, ROWS)[:, None]
    drawn, seen = lasting(generator, 400, rows_long), lasting(generator, CASES, rows_long)
    alone, with_noise = [], []
    for residual in seen:
        drift = solve(columns, residual)[0]
        alone.append(drift / standard_errors(columns, residual, BLOCK)[0])
        with_noise.append(drift / standard_errors(columns, residual, BLOCK, drawn)[0])
    assert np.abs(with_noise).max() < 4.0 and np.std(with_noise) <= 1.15
    if rows_long > BLOCK:
        assert np.std(alone) > 1.5       # what it is there for


class _Loop:
    """The calls of a `ClosedLoop` that `noise_of` makes: noise of one length, without a motion that repeats itself."""

    def __init__(self, rows_long, generator):
        self.rows_long, self.generator = rows_long, generator
        part = {"reference": np.linspace(0.0, 1e-6, ROWS), "tells": np.ones(ROWS, bool), "law": 0.0}
        self.parts = [SimpleNamespace(**part)]
        self.tells = part["tells"]

    def residual(self, axis):
        return lasting(self.generator, 1, self.rows_long)[0]

    def stated_noise(self, axis, draws):
        return lasting(self.generator, draws, self.rows_long)


@pytest.mark.parametrize(("rows_long", "least", "most"), [(1, AT_THE_FLOOR, AT_THE_FLOOR), (2000, 1.6, 12.0)])
def test_records_that_hold_few_values_of_their_noise_may_be_louder_by_chance(rows_long, least, most):
    generator, axis = np.random.default_rng(7), load_axis(config_file("axes/piezo.yaml"))
    learn = np.arange(ROWS) < ROWS // 2
    noise = noise_of(axis, _Loop(rows_long, generator), SimpleNamespace(learn=learn, held=~learn), healthy=1.0)
    assert least <= noise.limit / noise.floor <= most and noise.drawn.shape == (DRAWN, ROWS)


def test_noise_that_a_hysteresis_keeps_is_no_drift_of_the_sensor():
    """Of twelve healthy piezos one had a drift, and one in twenty was `unexplained`: noise stays in the hysteresis for longer than the
    blocks of half a second by which a residual was resampled. The records of the one that had a drift."""
    axis = load_axis(config_file("axes/piezo.yaml"))
    parts = [[simulated_record(axis, run_from_dict({"program": MOVES}), seed)] for seed in (1035, 1036, 1037)]
    answer = diagnose_records(axis, *parts, seed=0)
    assert (answer.verdict, answer.causes, answer.rivals) == ("agrees", (), ())


def test_rows_of_the_noise_are_those_of_the_records():
    """Each record is drawn anew in each draw, and no draw is like another."""
    axis = load_axis(config_file("axes/piezo.yaml"))
    parts = [measured(simulated_record(axis, run_from_dict({"program": MOVES[:1]}), seed), axis) for seed in (1, 2)]
    loop, folds = ClosedLoop(parts), make_folds(parts, [False, True])
    noise = noise_of(axis, loop, folds, healthy=0.0)
    assert noise.drawn.shape == (DRAWN, sum(map(len, parts)))
    likeness = np.corrcoef(np.vstack([noise.drawn[:2, : len(parts[0])], noise.drawn[:2, len(parts[0]):]]))
    assert np.abs(likeness[np.triu_indices(4, 1)]).max() < 0.9
    assert noise.limit >= AT_THE_FLOOR * noise.floor > 0.0


def test_a_drift_far_below_the_noise_is_sought_where_noise_alone_is_left():
    """An LVDT that drifts by 30 nm/s leaves less than the noise floor does, but has one course. Where the noise of the file is all
    that a healthy axis leaves, its own length says how certain that is. It was overlooked before. Named alone in 9 of 9 records, 0.77 to
    1.05 of its size."""
    axis = load_axis(config_file("axes/stepper.yaml"))
    program = [{"scan": {"to_m": way, "speed_m_s": 2e-3}, "dwell_s": 0.6} for way in (1e-3, -1e-3, 1e-3)]
    hidden = axis.with_effects({"sensor_drift": {"rate_m_s": 3e-8}})
    records = [[simulated_record(machine, run_from_dict({"program": program}), seed)]
               for seed, machine in enumerate((hidden, hidden, axis), 1)]
    answer = diagnose_records(axis, *records, seed=0)
    assert [cause.id for cause in answer.causes] == ["sensor_drift"]
    assert answer.causes[0].parameters["rate_m_s"].value == pytest.approx(3e-8, rel=0.4)


def test_an_axis_file_without_noise_says_nothing_of_its_length():
    """Nothing drawn is nothing to scale: sizes get their errors from the blocks alone, as before."""
    class Still(_Loop):
        def stated_noise(self, axis, draws):
            return np.zeros((draws, ROWS))

    axis, learn = load_axis(config_file("emps.yaml")), np.arange(ROWS) < ROWS // 2
    noise = noise_of(axis, Still(1, np.random.default_rng(3)), SimpleNamespace(learn=learn, held=~learn), healthy=1.0)
    assert noise.drawn is None and noise.limit == AT_THE_FLOOR * noise.floor


def test_what_a_second_cause_leaves_unlike_is_no_rival_any_more():
    """A gain of a piezo beside a drift of its sensor: beside the drift, a hysteresis is not a gain. Before it was found they were alike,
    and all three were left open; pairs were whole in 13 of 20."""
    axis = load_axis(config_file("axes/piezo.yaml"))
    hidden = axis.with_effects({"piezo_gain": {"change": -0.1}, "sensor_drift": {"rate_m_s": 3e-8}})
    records = [[simulated_record(machine, run_from_dict({"program": MOVES}), seed)]
               for seed, machine in enumerate((hidden, hidden, axis), 1)]
    answer = diagnose_records(axis, *records, seed=0)
    assert {cause.id for cause in answer.causes} == {"piezo_gain", "sensor_drift"} and not answer.rivals
