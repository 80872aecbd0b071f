"""The stage's swing and the regulator that allows for it."""

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from microstage_ros.control.feedforward import axis as feedforward
from microstage_ros.control.observer import flexible_mode as swing
from microstage_ros.control.friction_observer import FrictionObserver
from microstage_ros.control.design.rules import observer_gains
from microstage_ros.solver.plant import NoiseSpec


@pytest.fixture
def model(axis):
    record = np.zeros(1, feedforward.PARAMETERS)[0]
    feedforward.fill_model(record, axis)
    return record


@pytest.mark.parametrize("period", [3e-4, 5e-4, 1e-3])
def test_gains_are_those_of_the_riccati_equation(model, period):
    a, b, push = swing.held_axis(model, period)
    weight = np.outer([1, 0, 1, 0], [1, 0, 1, 0]).astype(float)
    effort = np.array([[(swing.EFFORT**2 * push) ** 2]])
    cost = solve_discrete_are(a, b, weight, effort)
    expected = np.linalg.solve(effort + b.T @ cost @ b, b.T @ cost @ a)[0]
    np.testing.assert_allclose(swing.held_gains(model, period), expected, rtol=1e-5)
    assert np.abs(np.linalg.eigvals(a - b @ expected[None])).max() < 1.0


def test_a_voltage_without_drive_or_friction_is_held(model):
    """Without friction and back-EMF the rotor is a free mass, and the swing that of an undamped spring."""
    model["has_actuator"], model["volts_per_velocity"], model["drive_damping"] = 0, 0.0, 0.0
    period = 7e-4
    a, b, push = swing.held_axis(model, period)
    omega = np.sqrt(swing.swing_rates(model)[0])
    np.testing.assert_allclose(a[2:, 2:], [[1.0, period], [0.0, 1.0]], atol=1e-15)
    assert b[2:, 0] == pytest.approx([push * period**2 / 2, push * period])
    assert b[0, 0] == pytest.approx(-push * (1 - np.cos(omega * period)) / omega**2)
    assert a[0, 0] == pytest.approx(np.cos(omega * period))


@pytest.mark.parametrize("size", [1e-9, 1.0, 300.0])
def test_exponential(size):
    a = np.random.default_rng(1).normal(size=(4, 4)) * size
    np.testing.assert_allclose(swing.exponential(a), expm(a), rtol=1e-9, atol=1e-9 * np.abs(expm(a)).max())


def test_swing_is_what_the_stage_does_beyond_the_screw(axis, run):
    """Against the simulator: stage less motor, without what is slow, is what is dead-reckoned from the current."""
    columns = run("self_tuning_observer", [{"move_to_m": 1e-5, "dwell_s": 0.3}], seed=1, period_s=1e-3, noise=NoiseSpec.none().as_dict())
    observer, got = FrictionObserver(axis, period=1e-3), []
    voltage = np.concatenate([[0.0], columns["voltage_V"][:-1]])
    for row in zip(columns["encoder_m"], voltage, columns["current_A"]):
        observer.advance(*row)
        got.append(float(observer.memory["swing"]))
    ahead = columns["stage_m"] - columns["motor_angle_rad"] * 2e-3 / 2 / np.pi / 19
    true = np.diff(ahead, 3)  # whatever is slow is small in it
    assert np.corrcoef(true, np.diff(got, 3))[0, 1] > 0.9


def test_a_rigid_drive_and_short_periods_have_none(axis, model):
    assert not np.any(FrictionObserver(axis).parameters["swing_matrix"])
    assert np.any(FrictionObserver(axis, period=1e-3).parameters["swing_matrix"])
    model["compliance"] = 0.0
    assert "swing_share" not in observer_gains(model, 1e-3)
