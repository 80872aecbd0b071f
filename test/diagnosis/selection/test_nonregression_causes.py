"""Causes that are no matter of regression carry the sizes, errors and gains that were found for them; by hand."""

import math
import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue.form import Form, one
from microstage_ros.diagnosis.prerequisites.lines import Line
from microstage_ros.diagnosis.prerequisites.lost_motion import Gap
from microstage_ros.diagnosis.prerequisites.timing import Timing
from microstage_ros.diagnosis.residuals.evidence_set import Choice
from microstage_ros.diagnosis.result import Cause, Parameter
from microstage_ros.diagnosis.selection import nonregression_causes as made
from microstage_ros.diagnosis.selection.ledger import Ledger
from microstage_ros.diagnosis.selection.sizes import before_the_gain, offset_of


def unstated(*causes):
    """Whether probability and share are left to who calibrates them."""
    return all((cause.probability, cause.share) == (0.0, 0.0) for cause in causes)


def slowness(effect="transport_delay", rival=False, **lag):
    return types.SimpleNamespace(effect=effect, time=3.0e-4, stderr=2.0e-6, rival=rival, held=900.0, held_before=1000.0, held_rows=100,
                                 noise=2.0e-3, **{"lag": 0.0, "lag_stderr": 0.0, "lag_held": 0.0, **lag})


@pytest.mark.parametrize(("effect", "name"), [("transport_delay", "delay_s"), ("actuator_lag", "time_s")])
def test_a_slow_amplifier_by_its_name(effect, name):
    book, unsure = Ledger(before=50.0), []
    cause, = made._slowness(slowness(effect), book, unsure)
    assert cause.id == effect and cause.effect == {name: 3.0e-4} and not unsure
    assert (cause.parameters[name].value, cause.parameters[name].stderr, cause.parameters[name].unit) == (3.0e-4, 2.0e-6, "s")
    assert (cause.gain.before, cause.gain.after) == pytest.approx((2.0e-3 * 10.0**0.5, 2.0e-3))
    assert book.before == 950.0 and book.parts == {effect: 900.0} and unstated(cause)


def test_an_amplifier_that_delays_and_lags_is_two_causes_that_share_what_they_hold():
    slow = slowness("transport_delay", lag=5.0e-4, lag_stderr=8.0e-6, lag_held=300.0)
    book = Ledger(before=50.0)
    delay, lag = made._slowness(slow, book, [])
    assert (delay.id, delay.effect, lag.id, lag.effect) == ("transport_delay", {"delay_s": 3.0e-4}, "actuator_lag", {"time_s": 5.0e-4})
    assert lag.parameters["time_s"].stderr == 8.0e-6 and book.before == 950.0
    assert book.parts == {"transport_delay": 600.0, "actuator_lag": 300.0}
    assert (delay.gain.after, lag.gain.after) == (lag.gain.after, delay.gain.after) and lag.gain.before < delay.gain.before


def test_a_slow_amplifier_that_may_be_either_is_an_open_question():
    unsure = []
    assert made._slowness(slowness(rival=True), Ledger(), unsure) == []
    assert unsure[0].ids == ("transport_delay", "actuator_lag")


@pytest.mark.parametrize(("after", "part"), [(400.0, 600.0), (1200.0, 0.0)])
def test_a_gap_as_an_angle_of_the_screw(after, part):
    """One whose replay lost its place in the held-out record holds nothing there."""
    gap = Gap(width=6.0e-6, stderr=3.0e-8, held_before=1000.0, held_after=after, held_rows=10, noise=1.0e-9, taken=0.0)
    book = Ledger(before=5.0)
    cause = made._lost_motion(gap, 3.0e-4, book)
    width = cause.parameters["width_rad"]
    assert (width.value, width.stderr, cause.effect["width_rad"]) == pytest.approx((0.02, 1.0e-4, 0.02)) and width.unit == "rad"
    assert book.parts["backlash"] == part and book.before == 5.0 + part
    assert (cause.gain.before, cause.gain.after) == pytest.approx((1.0e-8, 1.0e-9 * (after / 10.0) ** 0.5)) and unstated(cause)


@pytest.mark.parametrize(("damping", "says"), [(0.9, "drive_compliance"), (0.05, "open")])
def test_a_soft_drive_behind_a_gap_unless_its_damping_is_off_by_the_same_factor(damping, says):
    """A mass m (1/k − 1) makes both seem k times as large: then the rattle alone leaves it open."""
    gap = Gap(width=6.0e-6, stderr=3.0e-8, held_before=9000.0, held_after=1000.0, held_rows=1000.0, noise=1.0e-9, taken=0.0,
              stiffness=0.05, damping=damping, stiffness_stderr=1.0e-4, held_loose=5000.0)
    book, unsure = Ledger(before=5.0), []
    causes = made._drive_behind(gap, book, unsure)
    assert gap.far and gap.scales == (says == "open")
    if says == "open":
        assert causes == [] and set(unsure[0].ids) == {"drive_compliance", "payload_change"} and book.before == 5.0
        return
    assert [cause.id for cause in causes] == [says] and not unsure
    assert causes[0].effect == {"stiffness_factor": 0.05, "damping_factor": 0.9}
    assert book.parts == {"drive_compliance": 4000.0} and book.before == 4005.0 and unstated(*causes)
    assert (causes[0].gain.before, causes[0].gain.after) == pytest.approx((5.0**0.5 * 1.0e-9, 1.0e-9))      # beside the gap
    assert causes[0].parameters["stiffness_factor"].stderr == pytest.approx(np.hypot(1.0e-4, made.STIFFNESS_ERROR * 0.05))
    assert causes[0].parameters["damping_factor"].stderr == pytest.approx(made.DAMPING_ERROR * 0.9)


def test_a_drift_of_every_records_own():
    course = types.SimpleNamespace(held_before=900.0, held_after=100.0, size=4.0e-8, size_stderr=1.0e-9, rate=2.0e-9, rate_stderr=3.0e-10)
    channels = [types.SimpleNamespace(scatter=2.0e-9, residual=np.zeros(60)), types.SimpleNamespace(scatter=4.0e-9, residual=np.zeros(40))]
    collection, book = types.SimpleNamespace(channels={"held": [{"position": one} for one in channels]}), Ledger()
    cause = made._drift(course, collection, book)
    assert {name: (one.value, one.stderr) for name, one in cause.parameters.items()} == {
        "drift_rms_m": (4.0e-8, 1.0e-9), "rate_m_s": (2.0e-9, 3.0e-10)}
    assert cause.effect == {"rate_m_s": 2.0e-9} and book.parts == {"thermal_drift": 800.0} and book.before == 800.0
    assert (cause.gain.before, cause.gain.after) == pytest.approx((9.0e-9, 3.0e-9)) and unstated(cause)


def test_lines_of_the_floor_and_how_far_their_amplitudes_hold():
    """Two learning records and one held out, where the lines are 4 and 3 nm: √((16 + 9)/2) before, √((1 + 0)/2) after."""
    lines = [Line(33.0, 5.0e-9, 1.0e-10, 0.3, 80.0, 60.0, (5.0e-9, 5.0e-9, 4.0e-9j), 0.01),
             Line(60.0, 3.0e-9, 2.0e-10, 1.3, 70.0, 50.0, (3.0e-9, 3.0e-9, -3.0e-9), 0.02)]
    book = Ledger()
    cause = made._vibration(lines, 1, book)
    assert cause.effect == {"frequencies_hz": [33.0, 60.0], "amplitudes_m": [5.0e-9, 3.0e-9], "phases_rad": [0.3, 1.3]}
    assert cause.parameters["frequency_2_hz"].stderr == 0.02 and cause.parameters["amplitude_1_m"].stderr == 1.0e-10
    assert (cause.gain.before, cause.gain.after) == pytest.approx((12.5e-18**0.5, 0.5e-18**0.5))
    assert book.before == 110.0 and book.parts == {"floor_vibration": 110.0} and unstated(cause)


def test_late_readings_and_what_jitter_explains():
    taught = Timing(4.0e-10, 4.0e-12, 0.7, 0.0, 1.0e-16, 2.0e-3, samples=1000)
    again = Timing(4.4e-10, 4.0e-12, 0.01, 500.0, 1.0e-16, 2.0e-3, mean_square=5.0e-16, mean_speed_square=1.0e-6)
    book = Ledger(before=1.0, parts={"sampling_jitter": 20.0})
    cause = made._late((taught, again), book, None, 1e-4)
    jitter = 2.0e-5 / math.sqrt(1.0 - 2.0 / math.pi)        # the standard deviation of |jitter N(0, 1)| is 20 us
    assert cause.parameters["jitter_s"].value == pytest.approx(jitter) and cause.parameters["jitter_s"].stderr == pytest.approx(jitter * math.hypot(1.0 / 200.0, made.JITTER_ERROR))
    assert cause.parameters["lost_fraction"].value == 0.7 and cause.effect["lost_fraction"] == 0.5     # no effect loses more
    assert (cause.gain.before, cause.gain.after) == pytest.approx((5.0e-16**0.5, 1.0e-8))
    assert book.before == 501.0 and book.parts == {"sampling_jitter": 520.0} and "late_s" not in cause.parameters and unstated(cause)


def test_the_constant_part_of_the_lateness_is_the_mean_without_jitter_and_lost_samples():
    timing = Timing(4.0e-10, 4.0e-12, 0.02, 0.0, 1.0e-16, 2.0e-3, samples=1000000)
    jitter = 2.0e-5 / math.sqrt(1.0 - 2.0 / math.pi)
    mean = Parameter(3.0e-4 + math.sqrt(2.0 / math.pi) * jitter - 0.02 * 1e-4, 1.0e-6, "s")
    cause = made._late((timing, timing), Ledger(), mean, 1e-4)
    late = cause.parameters["late_s"]
    assert late.value == cause.effect["late_s"] == pytest.approx(3.0e-4)
    assert late.stderr == pytest.approx(math.hypot(1.0e-6, math.sqrt(2.0 / math.pi) * cause.parameters["jitter_s"].stderr), rel=0.01)
    # what is late by its jitter alone has no constant part, and no effect reads ahead
    none = made._late((timing, timing), Ledger(), Parameter(mean.value - 3.1e-4, 1.0e-6, "s"), 1e-4)
    assert none.parameters["late_s"].value == pytest.approx(-1.0e-5) and none.effect["late_s"] == 0.0


def test_a_jitter_that_was_not_told_is_not_stated():
    timing = Timing(0.0, math.inf, 0.02, 10.0, 1.0e-16, 2.0e-3, mean_square=5.0e-16, mean_speed_square=1.0e-6, growth=2.0e-10)
    cause = made._late((timing, timing), Ledger(), None, 1e-4)
    assert set(cause.parameters) == set(cause.effect) == {"lost_fraction"}
    assert cause.gain.after == pytest.approx(3.0e-16**0.5)      # what the lost samples made is explained


@pytest.mark.parametrize("known", [(), ("slow",), ("gap",), ("lines",), ("slow", "gap", "lines")])
def test_each_that_is_known_becomes_a_cause(monkeypatch, known):
    names = {"slow": "_slowness", "gap": "_lost_motion", "lines": "_vibration"}
    for name, function in names.items():
        monkeypatch.setattr(made, function, lambda *_, name=name: [name] if name == "slow" else name)
    monkeypatch.setattr(made, "_drift", lambda *_: "course")
    monkeypatch.setattr(made, "readings_late", lambda *_, sde: sde)
    periods = []
    monkeypatch.setattr(made, "_late", lambda late, book, mean, period: periods.append(period) or late)
    has = types.SimpleNamespace(**{name: [1] if name in known else [] if name == "lines" else None for name in names})
    has.gap = types.SimpleNamespace(far=False) if "gap" in known else None
    collection = types.SimpleNamespace(prepared={"learn": [types.SimpleNamespace(period=1e-4), types.SimpleNamespace(period=2e-4)], "held": [1], "base": []},
                                       frame=types.SimpleNamespace(drive=types.SimpleNamespace(radius=1.0)))
    others = [types.SimpleNamespace(id="gravity_tilt", effect="tilt"), types.SimpleNamespace(id="encoder_sde", effect="sde")]
    found = made.nonregression_causes(collection, has, "course", others, Ledger(), [])
    assert periods == [1e-4] and found == [*known, "course", "sde"]       # jitter is looked for without the encoder's own error
    assert made.nonregression_causes(collection, has, None, others[:1], Ledger(), []) == list(known)
    if "gap" in known:      # a rattle tells the drive behind it, unless a payload is named
        monkeypatch.setattr(made, "_drive_behind", lambda *_: ["drive"])
        has.gap.far, payload = True, types.SimpleNamespace(id="payload_change", effect="mass")
        assert "drive" in made.nonregression_causes(collection, has, None, others[:1], Ledger(), [])
        assert "drive" not in made.nonregression_causes(collection, has, None, [payload], Ledger(), [])


def test_offset_and_dead_band_are_those_of_the_amplifiers_input():
    """u_a = gain · dead(u + offset): behind a gain of 1.25 a dead band of 40 mV is one of 50."""
    def cause(effect, name, value):
        return Cause(effect, {name: Parameter(value, 0.01 * value, "V")}, {name: value}, 0.0, 0.0, None, "windup")

    found = [cause("amplifier_deadband", "half_width_V", 0.05), cause("amplifier_offset", "offset_V", -0.01), cause("gravity_tilt", "angle_rad", 0.02)]
    assert before_the_gain(found) == found
    band, offset, tilt, gain = before_the_gain([*found, cause("amplifier_gain", "factor", 1.25)])
    assert (band.parameters["half_width_V"].value, band.parameters["half_width_V"].stderr) == pytest.approx((0.04, 4.0e-4))
    assert band.effect == {"half_width_V": pytest.approx(0.04)} and offset.effect == {"offset_V": pytest.approx(-0.008)}
    assert tilt is found[2] and gain.effect == {"factor": 1.25}


def test_the_offset_is_that_of_the_amplifiers_input():
    windup = types.SimpleNamespace(sizes=lambda keys: {key: np.array([size]) for key, size in (
        (("amplifier_offset", ""), -0.05), (("amplifier_gain", ""), 0.25)) if key in keys})
    choice = {name: Choice(name, (Form(name, "windup", "", None, one("size", "V")),)) for name in ("amplifier_offset", "amplifier_gain")}
    evidences = types.SimpleNamespace(learn={"windup": windup})
    assert offset_of(evidences, [choice["amplifier_gain"]]) == 0.0
    assert offset_of(evidences, [choice["amplifier_offset"]]) == pytest.approx(-0.05)
    assert offset_of(evidences, [*choice.values()]) == pytest.approx(-0.04)
