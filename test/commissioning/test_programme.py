"""The programme of the identification: inside the travel wherever the axis stands, and what it tells of the friction."""

import pytest
from machines import random_axis

from microstage_ros.commands.analysis import tune
from microstage_ros.commissioning.design.programme import run_about, segments
from microstage_ros.control.runs.run_file import Run
from microstage_ros.control.runs.simulate import simulated_record
from microstage_ros.identification.pipeline import identify
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError


@pytest.mark.parametrize("place", [-0.0249, 0.0, 0.0249])
def test_programme_stays_in_the_travel(place):
    axis = load_axis(config_file("axis.yaml")).with_values({"period": 1e-3}, source="derived")
    program, centre = run_about(place, axis)
    reference = Run(program=program, start_m=centre).tables(1e-3)["reference"]
    assert axis.value("travel.minimum") < reference.min() and reference.max() < axis.value("travel.maximum")
    assert reference[0] == centre and len(reference) * 1e-3 < 60.0


@pytest.mark.parametrize("words", [["--running"], ["--record", "x"], ["--running", "--record", "x", "--response", "r.csv"]])
def test_running_and_record_go_together(words):
    with pytest.raises(InputError, match="--record"):
        tune.main(["--axis", str(config_file("axis.yaml")), *words])


def test_friction_that_varies_slowly_is_in_the_intervals():
    """The part of the variability that goes with time, 20 s, is one value per record: of two records it leaves at least
    0.06 sqrt(0.2 / 2) = 1.9 % times the 0.8 of a record of 30 s; blocks of a second said 0.9 %."""
    sketch = load_axis(config_file("axis.yaml")).with_controller({"type": "self_tuning"})
    truth, friction = random_axis(sketch, 7514), "contacts.actuator."
    motor = ("drive.resistance", "drive.back_emf", "drive.torque_constant", "drive.rotor_inertia", "transmission.stiffness", "transmission.damping")
    known = sketch.with_values({key: truth.value(key) for key in motor}, source="estimate")
    records = [simulated_record(truth, Run(program=segments(place, 0.05, 3e-3), start_m=place), 75140 + k) for k, place in enumerate((-0.01, 0.005))]
    found = identify(iter(records), known, 1).estimates
    coulomb = found[friction + "coulomb"]
    assert coulomb.stderr > 0.015 * coulomb.value
    for name in ("static", "stribeck_velocity", "viscous"):
        estimate = found[friction + name]
        assert abs(estimate.value - truth.value(friction + name)) < 4.0 * estimate.stderr, name
