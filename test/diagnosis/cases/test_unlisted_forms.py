"""What no list of the analysis foresees: periods, courses of a drift, damping, delays next to a whole number of periods."""

import types

import numpy as np
import pytest

from microstage_ros.diagnosis.case import diagnose_case
from microstage_ros.diagnosis.preprocessing.preparation import prepare
from microstage_ros.diagnosis.prerequisites import resonant
from microstage_ros.diagnosis.prerequisites.amplifier import find_slowness
from microstage_ros.diagnosis.prerequisites.drive import drive_of
from microstage_ros.diagnosis.prerequisites.periods import both_ways, periods
from microstage_ros.diagnosis.prerequisites.prerequisites import find_known
from microstage_ros.diagnosis.prerequisites.slow_drift import MEANS, _trend
from microstage_ros.diagnosis.residuals.position import course_columns
from microstage_ros.diagnosis.validation.simulated_records import Hidden, make_case

GROUPS = ("learn", "held", "base")


def walk_along(generator, rows=8000):
    """Positions of a stage that goes out and back in pieces, and its speed."""
    speed = np.repeat(generator.uniform(1e-4, 2e-3, 20) * np.tile([1.0, -1.0], 10), rows // 20)
    return np.cumsum(speed) * 2.0e-3, speed


def test_periods_are_found_to_a_thousandth_and_noise_has_none():
    generator = np.random.default_rng(1)
    position, speed = walk_along(generator)
    noise = generator.normal(size=len(position))
    assert periods(both_ways(position, noise, speed), 4e-6, 2e-4) == []
    wave = 0.4 * np.sin(2 * np.pi * position / 17.3e-6) + 0.3 * np.cos(2 * np.pi * position / 41.1e-6 + 0.4)
    found = periods(both_ways(position, noise + wave, speed), 4e-6, 2e-4)
    assert found == pytest.approx([17.3e-6, 41.1e-6], rel=2e-3)


def test_noise_rarely_has_a_period():
    """No line in fifty times white noise: the stated chance is a millionth."""
    for seed in range(50):
        generator = np.random.default_rng([2, seed])
        position, speed = walk_along(generator, 4000)
        assert periods(both_ways(position, generator.normal(size=len(position)), speed), 4e-6, 2e-4) == []


def test_a_smooth_course_predicts_what_was_left_out_and_a_wave_of_the_stroke_does_not():
    generator = np.random.default_rng(3)
    time = np.arange(1250) * 0.02
    noise = 1e-9 * generator.normal(size=len(time))
    drift = 2e-7 * np.sin(2 * np.pi * time / 19.0) + 1e-8 * time
    assert _trend(drift + noise, time).share > 0.99
    assert _trend(2e-7 * np.sin(2 * np.pi * time / 0.9) + noise, time).share < 0.3
    assert np.linalg.matrix_rank(course_columns(time)) == course_columns(time).shape[1]
    assert MEANS * 5 == 200     # the same 20 ms from blocks as from samples


@pytest.mark.parametrize("delay", [1.99e-4, 3.989e-4])
def test_a_delay_just_short_of_whole_periods_keeps_its_size(axis, delay):
    drive = drive_of(axis)
    groups = make_case(axis, Hidden("late", ("transport_delay",), {"transport_delay": {"delay_s": delay}}), 5, friction=0.03)
    slow = find_slowness({name: [prepare(r, drive) for r in group] for name, group in zip(GROUPS, groups)}, drive)
    assert slow.effect == "transport_delay"
    assert slow.time == pytest.approx(delay, abs=3.0e-6)


def other_course_in_every_record(columns, generator):
    """A drift of some 100 nm that no other record repeats."""
    t = columns["t_s"]
    for _ in range(4):
        columns["interferometer_m"] += 1.5e-7 * generator.normal() * np.sin(
            2 * np.pi * t / generator.uniform(9.0, 40.0) + generator.uniform(0.0, 6.28))


def test_a_ripple_a_signal_period_and_a_drift_that_are_on_no_list(axis):
    """Cogs of 13 and 26 a turn, a signal period of 8 µm, and every record with a drift of its own, at once."""
    effects = {"torque_ripple": {"amplitude_Nm": [1.5e-5, 7e-6], "cycles_per_turn": [13.0, 26.0], "phase_rad": [0.3, 1.0]},
               "encoder_sde": {"period_m": 8e-6, "amplitude1_m": 2e-8, "phase1_rad": 1.0}}
    hidden = Hidden("unlisted", (*effects, "thermal_drift"), effects, after=other_course_in_every_record)
    records, holdout, baseline = make_case(axis, hidden, 51, 0.03)
    answer = diagnose_case(axis, records, holdout, baseline)
    named = {cause.id: cause.parameters for cause in answer.causes}
    assert set(named) == {*effects, "thermal_drift"}
    assert named["torque_ripple"]["cycles_per_turn"].value == 13.0
    assert named["torque_ripple"]["amplitude_Nm"].value == pytest.approx(1.5e-5, rel=0.05)
    assert named["encoder_sde"]["period_m"].value == pytest.approx(8e-6, rel=1e-3)
    assert named["encoder_sde"]["amplitude1_m"].value == pytest.approx(2e-8, rel=0.03)
    assert answer.gain.after < 1.1 * answer.gain.floor
    axis.with_effects(answer.effects)
    shown = {picture.cause: picture.x_label for picture in answer.pictures}
    assert shown["thermal_drift"] == "time [s]" and "signal period" in shown["encoder_sde"] and "turn" in shown["torque_ripple"]


def test_a_soft_drive_with_more_damping(axis):
    effects = {"drive_compliance": {"stiffness_factor": 0.15, "damping_factor": 2.0}}
    records, holdout, baseline = make_case(axis, Hidden("soft", tuple(effects), effects), 52, 0.04)
    answer = diagnose_case(axis, records, holdout, baseline)
    assert [cause.id for cause in answer.causes] == ["drive_compliance"]
    fitted = answer.causes[0].parameters
    assert fitted["stiffness_factor"].value == pytest.approx(0.15, rel=0.1)
    assert fitted["damping_factor"].value == pytest.approx(2.0, rel=0.25)


def test_a_drive_that_swings_is_no_slow_amplifier(axis):
    """A lightly damped drive under a loop that shakes it: its ringing looks like a lag of 5 ms until the drive is told."""
    effects = {"drive_compliance": {"stiffness_factor": 0.068, "damping_factor": 0.33}}
    groups = make_case(axis, Hidden("swings", tuple(effects), effects), 55, friction=0.05)   # of four seeds, the one with which it does
    prepared, known = find_known(dict(zip(GROUPS, groups)), drive_of(axis))
    assert known.slow is None
    assert known.train.stiffness == pytest.approx(0.068, rel=0.05)


def test_a_search_for_a_drive_train_ends_where_nothing_depends_on_it(monkeypatch):
    """χ² that falls for ever with the stiffness: the pair stays within the factors that the effect takes."""
    seen = []

    def energy(channels, stiffness, damping):
        seen.append((stiffness, damping))
        return 1e6 / (4.0 + np.log10(stiffness))

    monkeypatch.setattr(resonant, "_energy", energy)
    train = resonant.fit_train([types.SimpleNamespace(residual=np.zeros(1000))], [])
    assert np.isfinite(seen).all() and np.max(seen) <= 1000.0 and 1.0 < train.stiffness <= 1000.0


@pytest.mark.parametrize(("near", "stiffness"), [(None, 0.3), (resonant.Train(0.4, 1.0, 2e4, 1e4, 1e4), 0.6)])
def test_a_drive_train_that_is_refined_is_fitted_with_the_load_that_it_carries(monkeypatch, near, stiffness):
    """A payload's load drew the stiffness away from its mass's, and was called a soft drive (pairs, seed 9901, cases 29, 46)."""
    cost = lambda best: lambda k, d: 1e4 * (1.0 + (np.log(k / best) ** 2 + np.log(d) ** 2))
    alone, loaded = cost(0.3), cost(0.6)
    monkeypatch.setattr(resonant, "_energy", lambda channels, k, d: alone(k, d))
    monkeypatch.setattr(resonant, "_left_with_load", lambda channels, stiffness, damping: (loaded(stiffness, damping), 1.2))
    train = resonant.fit_train([types.SimpleNamespace(residual=np.zeros(1000))], [], near)
    assert train.stiffness == pytest.approx(stiffness, rel=0.02)
