"""The scale of the encoder: what the measurements of the first minute can tell of it, and what they cannot."""

import dataclasses
import math

import pytest
from machines import random_axis

from microstage_ros.commissioning.design.law_choice import encoder_laws, gentle_law
from microstage_ros.commissioning.estimation.plant_fit import PlantFit, held_response, volts_per_acceleration
from microstage_ros.commissioning.experiments.encoder_scale import scale_check
from microstage_ros.commissioning.experiments.open_loop import Strokes
from microstage_ros.commissioning.findings import Refused
from microstage_ros.commissioning.sketch import load_sketch
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.model.transmission import motor_ratio
from microstage_ros.places import config_file

SKETCH = load_sketch(config_file("axis.yaml"))


def shown(truth, scale=1.0, has_current=False, seen=1.0):
    """`Strokes` of a machine whose encoder counts ``scale`` times too many, of the inertia the share ``seen``."""
    feedforward = controller_parameters("pid_feedforward", truth, {})["feedforward"]
    q, resistance = motor_ratio(truth), truth.value("drive.resistance")
    emf = truth.value("drive.back_emf") / q
    volts = emf if has_current else float(feedforward["volts_per_velocity"])
    inertia = resistance * (truth.value("drive.rotor_inertia") / q + q * truth.value("stage.mass"))
    inertia *= seen / truth.value("drive.torque_constant")
    return Strokes(resistance, volts / scale, inertia / scale, 0.1, 0.0, 0.0, has_current, 1e-3)


def judged(found, sliding=None):
    """Whether `scale_check` passes."""
    try:
        return scale_check(found, SKETCH, sliding).passed
    except Refused as end:
        assert end.check.id == "encoder_scale"
        return False


def test_friction_that_hides_inertia_is_no_wrong_scale():
    """Without a current, strokes at 1 ms showed 0.28 to 0.71 of the inertia: none of these machines counts wrong."""
    for seed in range(1, 61):
        found = shown(random_axis(SKETCH.axis, seed), seen=0.28)
        assert judged(found), seed


def test_right_counts_pass_with_the_inertia_of_the_response():
    for seed in range(1, 61):
        found = shown(random_axis(SKETCH.axis, seed))
        assert judged(found, found.inertia), seed


@pytest.mark.parametrize("scale", [4.0, 0.25])
def test_wrong_counts_are_refused_where_the_sketch_allows_to_tell(scale):
    """Four times wrong lies within the tolerances of few machines (twice and half of each number)."""
    missed = 0
    for seed in range(1, 61):
        truth = random_axis(SKETCH.axis, seed)
        missed += judged(shown(truth, scale, has_current=True))
        without = shown(truth, scale)
        assert judged(without) or not judged(without, without.inertia), seed  # the response only adds
    assert missed <= 6
    assert not judged(shown(SKETCH.axis, scale))


def test_the_inertia_of_a_response_in_volts():
    """Far above all corners the response of a rigid axis tends to 1/(s² V), V the voltage per acceleration."""
    axis = SKETCH.axis.with_values({"drive.inductance": 1e-12, "transmission.stiffness": 1e15}, source="estimate")
    fit = PlantFit({key: axis.value(key) for key in ("drive.rotor_inertia", "drive.back_emf")}, {}, 0.0, 0.0, 0.0, 0.0, 0.0)
    frequency, period = 1e4, 1e-9
    response = held_response(axis, {}, frequency * (1 + 0j), period, 0.0, 0.0)
    assert abs(response) * (2 * math.pi * frequency) ** 2 * volts_per_acceleration(axis, fit) == pytest.approx(1.0, rel=1e-3)


def test_the_first_loop_has_no_feedforward():
    """What is hardly known is not fed forward; where the law that backs off rests beside its target, gains that stay follow."""
    assert gentle_law(SKETCH.axis) == "self_tuning" and encoder_laws(SKETCH.axis)[:2] == ("self_tuning_feedforward", "pid_feedforward")
    force = load_sketch(config_file("emps.yaml"))
    assert gentle_law(force.axis) == "pid" == encoder_laws(force.axis)[-1]


@pytest.mark.parametrize("factor, ready", [(3.0, True), (1000.0, False)])
def test_a_number_in_another_unit_is_refused_and_one_beyond_its_tolerance_is_told(factor, ready):
    """A back-EMF in mV s/rad where V s/rad are asked made a machine ready, whose encoder "counts 1e+03 times" too many; three times
    what the sketch allows may be a motor's."""
    found = shown(SKETCH.axis, has_current=True)
    sketch = dataclasses.replace(SKETCH, axis=SKETCH.axis.with_values({"drive.back_emf": factor * SKETCH.axis.value("drive.back_emf")}),
                                 tolerance=SKETCH.tolerance | dict.fromkeys(SKETCH.tolerance, 0.1))
    if ready:
        assert "beyond its tolerance" in scale_check(found, sketch).says
    else:
        with pytest.raises(Refused, match="another unit"):
            scale_check(found, sketch)
