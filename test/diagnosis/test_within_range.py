"""Whatever was fitted, the answer is a verdict: sizes out of an effect's range are notes, never an error of the axis file."""

import math

import numpy as np
import pytest

from microstage_ros.diagnosis import batch
from microstage_ros.diagnosis.catalogue import FORMS
from microstage_ros.diagnosis.report.within_range import within_range
from microstage_ros.diagnosis.result import Cause, Diagnosis, Improvement, Parameter
from microstage_ros.diagnosis.selection.sizes import pooled, with_payload
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


def test_a_size_that_several_channels_tell_is_their_weighted_mean_and_knows_how_they_disagree():
    """A mass of 4.8 ± 0.3 kg was stated, by the resonance alone, where torque and wind-up told 5.5 ± 0.5 and 5.7 ± 0.4 of 5.86 kg."""
    alone, agreed, apart = (pooled([Parameter(v, e, "kg") for v, e in told]) for told in (
        [(5.0, 0.3)], [(5.0, 0.3), (5.1, 0.4)], [(4.0, 0.3), (6.0, 0.3)]))
    assert (alone.value, alone.stderr) == (5.0, 0.3)
    assert agreed.value == pytest.approx((5.0 / 0.09 + 5.1 / 0.16) / (1 / 0.09 + 1 / 0.16)) and agreed.stderr == 0.3
    assert apart.value == pytest.approx(5.0) and apart.stderr == pytest.approx(1.0)      # the scatter of the mean of two
    assert apart.unit == "kg"


def test_other_errors_pass(monkeypatch):
    from microstage_ros.quantities.errors import InputError

    def bad(*_):
        raise InputError("rec.csv: line 3", "x", "a number")

    monkeypatch.setattr(batch, "diagnose_case", bad)
    with pytest.raises(InputError, match="rec.csv"):
        batch.diagnose_records(AXIS, [], [], [], 0)


def test_a_cable_pulls_back():
    """Asymmetric friction along the stroke was called a cable of −730 N/m (pairs, seed 8505, case 12)."""
    cable = next(form for form in FORMS if form.effect == "cable_spring" and form.channel == "torque")
    assert cable.possible(np.array([730.0, -1.0]), None) and not cable.possible(np.array([-730.0, -1.0]), None)


@pytest.mark.parametrize("added", [2.5, -1.0])
def test_a_tilt_pulls_at_the_payload_too(added):
    """(m + M) g sin α is the force that was fitted; without the payload's mass 0.076 rad were told as 0.140 (pairs, seed 8305, case 7)."""
    mass, angle, gain = 3.06, 0.08, Improvement(2.0, 1.0, "N m")
    fitted = math.asin(math.sin(angle) * (mass + added) / mass)
    tilt = Cause("gravity_tilt", {"angle_rad": Parameter(fitted, 0.002, "rad")}, {"angle_rad": fitted}, 1.0, 1.0, gain, "torque")
    payload = Cause("payload_change", {"mass_kg": Parameter(added, 0.1, "kg")}, {"mass_kg": added}, 1.0, 1.0, gain, "torque")
    one, other = with_payload([tilt, payload], mass)
    assert one.effect["angle_rad"] == one.parameters["angle_rad"].value == pytest.approx(angle) and other is payload
    spread = angle * 0.1 / (mass + added)
    assert one.parameters["angle_rad"].stderr == pytest.approx(math.hypot(0.002 * mass / (mass + added), spread), rel=0.01)
    assert with_payload([tilt], mass) == [tilt]
