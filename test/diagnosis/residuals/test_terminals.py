"""Torque and resonance with the voltage that the motor had at its terminals; records and channels made by hand."""

import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue.electrical import FORMS
from microstage_ros.diagnosis.catalogue.form import Form
from microstage_ros.diagnosis.prerequisites.law import OwnLaw
from microstage_ros.diagnosis.prerequisites.prerequisites import _amplified
from microstage_ros.diagnosis.residuals import terminals
from microstage_ros.diagnosis.residuals.evidence_set import Choice, Evidences
from microstage_ros.diagnosis.residuals.terminals import at_terminals

TIME = np.arange(200) * 1e-2
COMMAND = 2.0 * np.sin(9.0 * TIME)
TILT = Form("gravity_tilt", "torque", "", None)
OWN = Form("generic:velocity", "torque", "own", lambda channel, frame: np.ones((3, 1)))
FRAME = types.SimpleNamespace(drive=types.SimpleNamespace(offset=0.0, resistance=3.0))


def windup(effect, variant):
    return next(f for f in FORMS if (f.effect, f.channel, f.variant) == (effect, "windup", variant))


class Fitted:
    """Evidence whose fit says the given sizes."""

    def __init__(self, said):
        self.said = said

    def sizes(self, keys):
        return {key: self.said[key] for key in keys}


class Torque:
    def __init__(self, name):
        self.name, self.residual, self.random, self.taken = name, np.zeros(3), 1.0, []

    def take_out(self, torque):
        self.taken.append(torque)


@pytest.fixture
def case(monkeypatch):
    """A collection of a learning and a held-out record, and what they were prepared anew with."""
    prepared = [types.SimpleNamespace(time=TIME, period=1e-2, answered=COMMAND, settled=0.1 * COMMAND, name=n) for n in "ab"]
    channels = {group: [{"torque": Torque("old"), "windup": "kept"}] for group in ("learn", "held")}
    for group in channels.values():
        group[0]["torque"].random = 0.3
    made = types.SimpleNamespace(asked=[])
    collection = types.SimpleNamespace(
        frame=FRAME, prepared={"learn": prepared[:1], "held": prepared[1:], "base": []}, channels=channels,
        healthy=[(OWN, np.array([2.0]))], gather=lambda *what: what, growing=lambda *what: what)

    def prepare(groups, drive, before, more):
        made.asked += more
        return {"learn": ["anew"], "held": ["anew"]}

    made.known = types.SimpleNamespace(gap=None, prepare=prepare)
    made.collection = collection
    monkeypatch.setattr(terminals, "channels_of", lambda one, drive: {"torque": Torque(one), "windup": "not kept"})
    return made


def found(case, faults, sizes, law=None):
    choices = [Choice(form.effect, (form,)) for form in faults]
    tables = {"windup": Fitted({form.key: np.atleast_1d(s) for form, s in zip(faults, sizes)}), "torque": "before"}
    evidences = Evidences(tables, dict(tables), {}, [TILT, *faults], {}, None)
    return evidences, at_terminals(case.collection, evidences, choices, {}, case.known, law)


def test_nothing_changes_without_a_fault_or_behind_a_gap(case):
    evidences, after = found(case, [windup("drive_compliance", "")], [0.1])
    assert after is evidences
    case.known.gap = "a gap"
    evidences, after = found(case, [windup("amplifier_gain", "")], [0.1])
    assert after is evidences and case.asked == []


def test_the_voltage_is_the_commands_and_what_all_faults_add(case):
    faults = [windup("amplifier_offset", ""), windup("drive_compliance", ""), windup("amplifier_gain", ""), windup("amplifier_deadband", "0.04")]
    found(case, faults, [0.02, 0.7, -0.1, 0.05])
    expected = 0.02 - 0.1 * COMMAND - np.clip(COMMAND, -0.05, 0.05)      # a dead band of its own width, not the grid's
    assert len(case.asked) == 2 and case.asked[0] == pytest.approx(expected) and case.asked[1] == pytest.approx(expected)


def test_a_warm_winding_takes_its_voltage(case):
    found(case, [windup("resistance_rise", "6")], [[0.1, 0.0]])
    assert case.asked[0] == pytest.approx(-0.1 * 3.0 * 0.1 * COMMAND * np.exp(-TIME / 6.0))


def test_torque_and_resonance_alone_are_made_anew(case, monkeypatch):
    before = case.collection.channels["held"][0]["torque"]
    _, after = found(case, [windup("amplifier_gain", "")], [0.1])
    assert case.collection.channels["held"][0]["torque"] is before      # forms that records suggest know their channels
    for group in ("learn", "held"):
        (record,) = case.collection.channels[group]
        assert record["windup"] == "kept" and record["torque"].name == "anew" and record["torque"].random == 0.3
        assert record["torque"].taken[0] == pytest.approx(2.0 * np.ones(3))      # what the healthy axis shows, too
        assert getattr(after, group)["torque"] == ("torque", [TILT], group) and isinstance(getattr(after, group)["windup"], Fitted)
    law = OwnLaw("leuven", "Leuven", "exponent", 6.0)
    monkeypatch.setattr(OwnLaw, "replayed", lambda self, prepared, drive: [f"{one} by {self.name}" for one in prepared])
    found(case, [windup("amplifier_gain", "")], [0.1], law)
    assert case.collection.channels["held"][0]["torque"].name == "anew by leuven"


def test_what_is_more_is_added_to_what_a_slow_amplifier_makes():
    assert _amplified(None, None) is None
    slow = types.SimpleNamespace(apply=lambda command, period: 0.5 * command)
    assert _amplified(slow, None) is slow.apply
    assert _amplified(None, 0.2)(COMMAND, 1e-4) == pytest.approx(COMMAND + 0.2)
    assert _amplified(slow, 0.2)(COMMAND, 1e-4) == pytest.approx(0.5 * COMMAND + 0.2)
