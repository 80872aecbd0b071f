"""A size that enters non-linearly is found beyond the catalogue's grid, with its error; on rows made by hand."""

import dataclasses
import math
import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue.form import Form
from microstage_ros.diagnosis.residuals.evidence import gather
from microstage_ros.diagnosis.residuals.evidence_set import Choice
from microstage_ros.diagnosis.selection import refinement
from microstage_ros.diagnosis.selection.refinement import FAMILIES, Family, refine

ROWS, LEVEL = 2000, 30.0
TIME = np.linspace(0.0, 3.0, ROWS)
OFFSET = Form("gravity_tilt", "torque", "", lambda channel, frame: np.ones((ROWS, 1)))


def columns(size):
    """LEVEL (1 − e^(−t/size)): linear in no size, and all of it there with a factor of one."""
    return lambda channel, frame: LEVEL * -np.expm1(-TIME / size)[:, None]


FAMILY = Family(columns, "time_s", "s", lambda size, frame: 10.0 * size)


class Rows:
    def __init__(self, size, offset=0.0, seed=1):
        self.residual = columns(size)(None, None)[:, 0] + offset + np.random.default_rng(seed).normal(size=ROWS)

    def whiten(self, matrix):
        return matrix, 0.0


def refined(size, start, offset=0.0, beside=(), seed=1, variant=None):
    """The form after refinement, of a size that is there and one to begin with."""
    collection = types.SimpleNamespace(frame=None, gather=lambda channel, forms, group: gather(Rows(size, offset, seed), forms, None))
    form = Form("frictional_lag", "torque", variant or f"{start:g}", columns(start), None)
    choices = [Choice("frictional_lag", (form,)), *beside]
    return form, refine(collection, choices)


@pytest.fixture(autouse=True)
def one_family(monkeypatch):
    monkeypatch.setattr(refinement, "FAMILIES", {("frictional_lag", "torque"): FAMILY})


@pytest.mark.parametrize(("size", "start"), [(0.5, 0.5), (0.5, 0.46), (0.5, 0.7), (0.5, 0.26), (0.5, 1.0), (1.3, 1.2)])
def test_the_size_is_found_from_up_to_twice_as_far(size, start):
    _, (choice,) = refined(size, start)
    (value, stderr, unit), effect = choice.forms[0].sizes(None, None, None)[0]["time_s"], choice.forms[0].sizes(None, None, None)[1]
    assert value == pytest.approx(10.0 * size, abs=4.0 * stderr) and unit == "s" and effect == {"time_s": value}
    assert float(choice.forms[0].variant) == pytest.approx(value / 10.0, rel=1e-4)
    assert choice.forms[0].columns(None, None) == pytest.approx(columns(value / 10.0)(None, None), rel=1e-4)


def test_the_error_is_that_of_least_squares_and_half_a_per_cent():
    _, (choice,) = refined(0.5, 0.5)
    slope = (columns(0.505)(None, None) - columns(0.495)(None, None)) / math.log(0.505 / 0.495)
    expected = math.hypot(1.0 / np.linalg.norm(slope), 5.0e-3)
    value, stderr, _ = choice.forms[0].sizes(None, None, None)[0]["time_s"]
    assert stderr / value == pytest.approx(expected, rel=0.1)


def test_the_part_of_the_noise_alone_is_that_of_least_squares(monkeypatch):
    monkeypatch.setattr(refinement, "LEAST_FORM_ERROR", 0.0)
    _, (choice,) = refined(0.5, 0.5)
    slope = (columns(0.505)(None, None) - columns(0.495)(None, None)) / math.log(0.505 / 0.495)
    value, stderr, _ = choice.forms[0].sizes(None, None, None)[0]["time_s"]
    assert stderr / value == pytest.approx(1.0 / np.linalg.norm(slope), rel=0.1)


def test_a_size_on_which_nothing_depends_is_known_no_better_than_its_steps(monkeypatch):
    nothing = Family(lambda size: lambda channel, frame: np.zeros((ROWS, 1)), "time_s", "s", lambda size, frame: size)
    monkeypatch.setattr(refinement, "FAMILIES", {("frictional_lag", "torque"): nothing})
    _, (choice,) = refined(0.5, 0.5)
    value, stderr, _ = choice.forms[0].sizes(None, None, None)[0]["time_s"]
    assert stderr / value == pytest.approx(math.hypot(0.05, 0.005))


@pytest.mark.parametrize(("start", "tried"), [(0.5, 3), (0.46, 3), (0.43, 4), (0.61, 4)])
def test_a_size_is_looked_for_in_steps_of_eight_per_cent(start, tried, monkeypatch):
    """Five sizes at a time: two steps to either side, and again from the end at which the best lies."""
    sizes = []
    monkeypatch.setattr(refinement, "FAMILIES", {("frictional_lag", "torque"): dataclasses.replace(
        FAMILY, columns=lambda size: sizes.append(size) or columns(size))})
    refined(0.5, start)
    assert len(sizes) == 5 * tried + 1      # and the one that was found
    assert sizes[:5] == pytest.approx(start * np.exp(0.08 * np.arange(-2.0, 3.0)))


def test_the_errors_of_many_seeds_hold():
    errors = []
    for seed in range(20):
        value, stderr, _ = refined(0.5, 0.55, seed=seed)[1][0].forms[0].sizes(None, None, None)[0]["time_s"]
        errors.append((value - 5.0) / stderr)
    assert 0.1 < np.std(errors) < 1.5 and abs(np.mean(errors)) < 0.6


def test_what_others_explain_is_fitted_along():
    alone = refined(0.5, 0.5, offset=4.0)[1][0].forms[0].sizes(None, None, None)[0]["time_s"][0]
    beside = refined(0.5, 0.5, offset=4.0, beside=[Choice("gravity_tilt", (OFFSET,))])[1]
    assert abs(alone - 5.0) > 0.3 and beside[0].forms[0].sizes(None, None, None)[0]["time_s"][0] == pytest.approx(5.0, abs=0.15)
    assert beside[1].forms == (OFFSET,)         # no family: as it was


def test_a_form_of_two_sizes_stays_as_it_was_fitted():
    form, (choice,) = refined(0.5, 0.7, variant="0.7,1.2")
    assert choice.forms == (form,)


def test_a_payload_is_the_mass_beyond_the_drives_own():
    frame = types.SimpleNamespace(drive=types.SimpleNamespace(mass=3.0))
    assert FAMILIES["payload_change", "resonance"].value(1.5, frame) == pytest.approx(1.5)
    assert FAMILIES["drive_compliance", "resonance"].value(0.4, frame) == FAMILIES["frictional_lag", "torque"].value(0.4, frame) == 0.4


class Resonance:
    """Rows of a record whose stretches of a quarter of a second fit best at one of ``sizes`` in turn, each of them cleanly."""

    def __init__(self, sizes):
        self.time = np.arange(ROWS) * 1.0e-3
        self.best = np.log(np.resize(sizes, ROWS // 250)).repeat(250)
        self.residual = np.zeros(ROWS)

    def whiten(self, matrix):
        return matrix, 0.0


def valley(size):
    """What a size leaves in every row: how far its logarithm is from the best one there."""
    return lambda channel, frame: (channel.best - math.log(size))[:, None]


def test_the_scatter_of_a_size_is_by_how_stretches_disagree():
    """Two sizes, half of the stretches each: the mean of eight has a standard deviation of half their distance over the root of eight."""
    family = Family(valley, "stiffness_factor", "1", lambda size, frame: size)
    assert refinement._bootstrap_error([Resonance([0.5]), Resonance([0.5])], family, math.log(0.5), None) == 0.0
    two = refinement._bootstrap_error([Resonance([0.4, 0.6])], family, math.log(0.5), None)
    assert two == pytest.approx(0.5 * math.log(1.5) / math.sqrt(8.0), rel=0.15)
    assert two == refinement._bootstrap_error([Resonance([0.4, 0.6])], family, math.log(0.5), None)      # no other draws


def test_a_resonance_with_two_valleys_is_known_no_better_than_they_are_apart(monkeypatch):
    """The bend of the deepest valley stated 3.6 to 5.5 kg, with an error of 0.3, of a payload of 5.9 kg on moves that hardly excite it."""
    monkeypatch.setattr(refinement, "_bootstrap_error", lambda *given: 0.12)
    family = Family(columns, "time_s", "s", lambda size, frame: 10.0 * size)
    monkeypatch.setattr(refinement, "FAMILIES", {("drive_compliance", "resonance"): family})
    collection = types.SimpleNamespace(frame=None, channels={"learn": [{"resonance": None}]},
                                       gather=lambda channel, forms, group: gather(Rows(0.5), forms, None))
    form = Form("drive_compliance", "resonance", "0.5", columns(0.5), None)
    (choice,) = refine(collection, [Choice("drive_compliance", (form,))])
    value, stderr, _ = choice.forms[0].sizes(None, None, None)[0]["time_s"]
    assert stderr / value == pytest.approx(0.12, rel=0.02)
