"""What a control period allows, and that the page says so."""

import math

import pytest

from microstage_ros.commissioning.design.period import allowed, beside_usual
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file


@pytest.mark.parametrize("name", ["axis.yaml", "emps.yaml", "axes/current_motor.yaml", "axes/voice_coil.yaml"])
def test_phase_stiffness_and_friction(name):
    """1.5 periods of delay take 45° at the crossover; the stage is as stiff as its mass there, and friction acts on that."""
    axis = load_axis(config_file(name))
    one, double = allowed(axis, 1e-3), allowed(axis, 2e-3)
    assert 360.0 * 1.5e-3 * one.crossover == pytest.approx(45.0)
    assert one.stiffness == pytest.approx(4.0 * double.stiffness) and double.aside == pytest.approx(4.0 * one.aside)
    assert [row.period for row in beside_usual(axis)] == sorted({1e-4, 2.5e-4, 5e-4, 1e-3, axis.value("period")})


def test_by_hand():
    """The force drive: m (2π/(12 T))², and twice its Coulomb friction over that; the motor's rotor counts as J/(r/N)²."""
    force, motor = load_axis(config_file("emps.yaml")), load_axis(config_file("axis.yaml"))
    stiffness = force.value("stage.mass") * (2.0 * math.pi / 12e-3) ** 2
    assert allowed(force, 1e-3).stiffness == pytest.approx(stiffness)
    assert allowed(force, 1e-3).aside == pytest.approx(2.0 * force.value("contacts.guideway.coulomb") / stiffness, rel=1e-6)
    ratio = motor.value("transmission.pitch") / (2.0 * math.pi * motor.value("transmission.gear_ratio"))
    mass = motor.value("stage.mass") + motor.value("drive.rotor_inertia") / ratio**2
    assert allowed(motor, 1e-4).stiffness == pytest.approx(mass * (2.0 * math.pi / 12e-4) ** 2, rel=1e-3)
