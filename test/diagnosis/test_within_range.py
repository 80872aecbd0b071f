"""Whatever was fitted, the answer is a verdict: sizes out of an effect's range are notes, never an error of the axis file."""

import pytest

from microstage_ros.diagnosis import batch
from microstage_ros.diagnosis.report.within_range import within_range
from microstage_ros.diagnosis.result import Cause, Diagnosis, Improvement, Parameter
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.effects import check_effects
from microstage_ros.places import config_file

AXIS = load_axis(config_file("axis.yaml"))


def cause(name, effect):
    return Cause(name, {}, effect, 0.99, 0.5, Improvement(1.0, 0.5, "V"), "torque")


def test_an_impossible_size_is_not_named():
    good, bad = cause("backlash", {"width_rad": 0.005}), cause("amplifier_gain", {"factor": 0.0041})
    both = within_range(Diagnosis("explained", (good, bad)), AXIS)
    assert both.verdict == "partly_explained" and [c.id for c in both.causes] == ["backlash"]
    assert "amplifier_gain.factor was fitted as 0.0041" in both.notes[0]
    assert within_range(Diagnosis("explained", (bad,)), AXIS).verdict == "unexplained"
    kept = Diagnosis("explained", (good,))
    assert within_range(kept, AXIS) is kept


def test_an_impossible_number_of_the_axis_file_is_left_as_given():
    found = within_range(Diagnosis("agrees", identified={"stage.mass": Parameter(-1.0, 0.1, "kg")}), AXIS)
    assert found.identified == {} and "stage.mass was fitted as -1.0" in found.notes[0] and found.verdict == "agrees"


def test_a_size_out_of_range_while_fitting_ends_in_a_verdict(monkeypatch):
    monkeypatch.setattr(batch, "diagnose_case", lambda *_: check_effects({"amplifier_gain": {"factor": 0.0041}}))
    found = batch.diagnose_records(AXIS, [], [], [], 7)
    assert found.verdict == "unexplained" and found.seed == 7 and "amplifier_gain.factor came out as 0.0041" in found.notes[0]


def test_other_errors_pass(monkeypatch):
    from microstage_ros.quantities.errors import InputError

    def bad(*_):
        raise InputError("rec.csv: line 3", "x", "a number")

    monkeypatch.setattr(batch, "diagnose_case", bad)
    with pytest.raises(InputError, match="rec.csv"):
        batch.diagnose_records(AXIS, [], [], [], 0)
