"""What a further step must not lose or invent: stretches after a drift is taken out, a gap that is none, late readings that
are rounding, and a mass that the baseline shows too; by hand, without a simulation."""

import dataclasses
import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue.form import Form, one
from microstage_ros.diagnosis.prerequisites import lost_motion, slow_drift, timing
from microstage_ros.diagnosis.prerequisites.slow_drift import Course
from microstage_ros.diagnosis.residuals.evidence_set import Choice, Evidences
from microstage_ros.diagnosis.residuals.growing import Growing
from microstage_ros.diagnosis.selection import mass_or_drive

FORM = Form("scale_error", "position", "", lambda channel, frame: channel.signal[:, None], one("size", "1"))
MASS = Form("payload_change", "torque", "", None, one("mass_kg", "kg"))


class Reading:
    """A signal in unit noise, and a drift, which a channel that ``drifts`` holds as its nuisance."""

    def __init__(self, seed):
        generator = np.random.default_rng(seed)
        self.time, self.drifts = 0.01 * np.arange(3000), False
        self.signal, self.drift = generator.normal(size=3000), np.sin(self.time / 5.0)
        self.residual = 0.3 * self.signal + 5.0 * self.drift + generator.normal(size=3000)

    def nuisance(self):
        return np.stack([np.ones(3000), self.drift], axis=1) if self.drifts else np.ones((3000, 1))

    def whiten(self, matrix):
        return matrix, 0.0


def test_a_drift_that_is_taken_out_leaves_what_is_asked_stretch_by_stretch():
    """Without it a wave of friction of 1.5 %, half of the healthy axis's own, was named beside a drift (seed 3313, case 6)."""
    channels = {group: [{"position": Reading([number, 7])}] for number, group in enumerate(("learn", "held", "base"))}

    def growing(name, forms, group):
        return Growing([one[name] for one in channels[group]], forms, None)

    collection = types.SimpleNamespace(channels=channels, gather=growing, growing=growing)
    tables = ({"position": growing("position", [FORM], group)} for group in channels)
    case = Evidences(*tables, [FORM], {"position": 1.0}, None, lambda name: growing(name, [FORM], "learn"), own_profile=0.03)
    course = Course(**{field.name: 0.0 for field in dataclasses.fields(Course)})
    free, course = slow_drift.take_out(collection, case, course)
    assert course.held_before > 5.0 * course.held_after and free.own_profile == 0.03
    for group in ("learn", "held"):
        share, stderr, _ = free.agreement(Choice("scale_error", (FORM,)), [], group)
        assert share == pytest.approx(1.0, abs=4.0 * stderr) and stderr < 0.2, group


@pytest.mark.parametrize(("left", "found"), [(3.0, True), (5.0, False)])
def test_a_gap_that_makes_the_held_out_record_much_worse_is_none(monkeypatch, left, found):
    """Of a payload on a machine of another law: twenty times as much was left behind the gap (seed 3313, case 16)."""
    channel = types.SimpleNamespace(residual=np.zeros(100), noise=1.0e-9)
    monkeypatch.setattr(lost_motion, "Deflection", lambda prepared, drive: channel)
    monkeypatch.setattr(lost_motion, "_rattling", lambda prepared, drive: None)
    for name, value in (("_loss", 0.7), ("_spread", 1.0e-5), ("_followed", 0.5), ("_explained", 0.9), ("_refined", 5.0e-6),
                        ("_wound_up", 9.0), ("_bounded", np.ones(100)), ("_behind", None)):
        monkeypatch.setattr(lost_motion, name, lambda *_, value=value: value)
    monkeypatch.setattr(lost_motion, "_losses", lambda channels, gap: 5.0 if gap == 0.0 else 1.0)
    monkeypatch.setattr(lost_motion, "_energy", lambda channel, gap: 1.0 if gap == 0.0 else left)
    record = types.SimpleNamespace(has_current=True)
    gap = lost_motion.find_gap({"learn": [record], "held": [record], "base": []}, None)
    assert (gap is not None) == found


@pytest.mark.parametrize(("healthy", "late"), [(0.0, True), (1.0e-11, True), (-4.9e-11, False), (4.9e-11, False)])
def test_rounding_that_the_baseline_shows_with_either_sign_is_no_jitter(monkeypatch, healthy, late):
    """An encoder of 50 nm without noise: variances of 6 and −5·10⁻¹¹ s² (seed 3313, case 10)."""
    made = {"record": 6.2e-11, "base": healthy}
    monkeypatch.setattr(timing, "timing_of", lambda group, sde=None: timing.Timing(made[group[0]], 4.0e-12, 0.0, 100.0, 2.2e-16, 2.1e-3))
    assert (timing.readings_late(["record"], ["record"], ["base"]) is not None) == late


@pytest.mark.parametrize(("learn", "base", "decided"), [
    ((1.0, 1.2, 170.0), (-6.8, 1.4, 40.0), True),      # 0.5 kg, where the healthy axis shows −3.4
    ((1.0, 1.2, 170.0), (0.0, 1.4, 40.0), False),
    ((1.0, 1.2, 170.0), (-6.8, 12.0, 40.0), False),    # not certain
    ((7.0, 0.5, 170.0), (7.0, 1.4, 40.0), False),      # the healthy axis shows it, too
])
def test_a_mass_is_told_beyond_the_one_that_the_baseline_shows(monkeypatch, learn, base, decided):
    sizes = {"learn": learn, "held": learn, "base": base}
    monkeypatch.setattr(mass_or_drive, "torque_mass", lambda *_: (0.5, 0.2, 3.8, 0.4))
    case = types.SimpleNamespace(agreement=lambda choice, others, group: sizes[group], base={"torque": None}, forms=[MASS])
    assert mass_or_drive.mass_beyond_baseline(case, Choice("payload_change", (MASS,)), []) == decided
    assert not mass_or_drive.mass_beyond_baseline(types.SimpleNamespace(base={}), None, [])
