"""The observer's covariance against matrices, and its gain against a solver of others."""

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from microstage_ros.control.feedforward import axis as feedforward
from microstage_ros.control.observer import motion_filter
from microstage_ros.control.friction_observer import FrictionObserver
from microstage_ros.control.design.linear_loop import sliding_slope
from microstage_ros.numerics.compiled import compiled


@compiled
def settle(p, s, period, variance, count):
    for _ in range(count):
        motion_filter.widen(p, s, period)
        motion_filter.take_readings(s, variance)


@compiled
def linearise(model, s, speed):
    s.v = speed
    motion_filter.linearise(model, s)


def filter_of(axis, period, stiffness, slope):
    """(parameters, model, memory) of an observer whose filter stands at these slopes, and the variance of its speed."""
    observer = FrictionObserver(axis, period=period)
    p, s = observer.parameters, observer.memory
    s["stiffness"], s["slope"] = stiffness, slope
    speed = float(p["voltage_noise"]) / float(observer.model["volts_per_velocity"])
    return p, observer.model, s, speed * speed


REGIMES = [(1e-4, 0.0, -270.0), (1e-3, 0.0, -270.0), (1e-3, 3e4, 0.0), (5e-4, 0.0, 5.0)]


@pytest.mark.parametrize("period, stiffness, slope", REGIMES)
def test_gain_settles_where_the_riccati_equation_says(axis, period, stiffness, slope):
    p, model, s, variance = filter_of(axis, period, stiffness, slope)
    a, q = motion_filter.motion_matrices(p, period, stiffness, slope)
    units = np.array([1e-9, 1e-6, 1e-3])  # m, m/s, m/s^2: the equation solved in numbers of one size
    scaled, noise = a * units / units[:, None], q / np.outer(units, units)
    c = np.eye(3)[:2]
    r = np.diag([float(p["encoder_noise"]) ** 2, variance]) / np.outer(units[:2], units[:2])
    cov = solve_discrete_are(scaled.T, c.T, noise + 1e-16 * np.eye(3), r)
    expected = cov @ c.T @ np.linalg.inv(c @ cov @ c.T + r) * units[:, None] / units[:2]
    settle(p, s, period, variance, 30000)
    np.testing.assert_allclose(s["gain"], expected, rtol=1e-4)
    np.testing.assert_allclose(motion_filter.steady_gain(p, model, period, stiffness, slope), expected, rtol=1e-4)


@pytest.mark.parametrize("period, stiffness, slope", REGIMES)
def test_steps_of_a_period_are_the_equation_of_motion(axis, period, stiffness, slope):
    a, _ = motion_filter.motion_matrices(FrictionObserver(axis).parameters, period, stiffness, slope)
    exact = expm(np.array([[0.0, 1.0, 0.0], [-stiffness, -slope, -1.0], [0.0, 0.0, 0.0]]) * period)
    error = np.array([1e-9, 1e-6, 1e-3])
    assert np.all(np.abs((a - exact) @ error) < 0.05 * np.abs(exact) @ error)


def test_covariance_stays_one_whatever_is_read(axis):
    random = np.random.default_rng(3)
    p, _, s, variance = filter_of(axis, 1e-3, 0.0, 0.0)
    units = np.array([1e-9, 1e-6, 1e-3])
    for _ in range(3000):
        s["stiffness"], s["slope"] = random.choice([0.0, 3e4]), random.uniform(-450.0, 10.0)
        settle(p, s, 1e-3, variance * 10.0 ** random.uniform(-2, 6), 1)
        upper = np.triu(np.array(s["covariance"]))
        full = (upper + upper.T - np.diag(np.diag(upper))) / np.outer(units, units)
        assert np.linalg.eigvalsh(full).min() > 0.0


def test_without_a_speed_the_encoder_alone_corrects(axis):
    p, _, s, _ = filter_of(axis, 1e-4, 0.0, 0.0)
    settle(p, s, 1e-4, np.inf, 10)
    assert not np.any(s["gain"][:, 1]) and np.all(s["gain"][:, 0] != 0.0)


def test_falling_friction_asks_for_more_gain_and_stiffness_for_less(axis):
    def gain(stiffness, slope):
        return motion_filter.steady_gain(p, model, 1e-3, stiffness, slope)

    observer = FrictionObserver(axis, period=1e-3)
    p, model = observer.parameters, observer.model
    assert gain(0.0, -270.0)[1, 1] > gain(0.0, 0.0)[1, 1] > gain(3e4, 0.0)[1, 1]


@pytest.mark.parametrize("speed", [2e-6, -2e-6, 5e-5, 1e-3])
def test_slope_of_sliding_is_that_of_the_curve(axis, speed):
    observer = FrictionObserver(axis)
    model, s = observer.model, observer.memory
    s["actuator"][6:12] = np.sign(speed)
    linearise(model, s, speed)
    screw = 2e-3 / 2 / np.pi
    assert s["stiffness"] == 0.0
    assert s["slope"] * model["moving_mass"] == pytest.approx(19 / screw**2 * sliding_slope(model["actuator"], abs(speed) / screw))
    s["actuator"][6:12] = 0.0
    linearise(model, s, speed)
    whole = 19 / screw**2 * model["actuator"][11:17].sum() / model["moving_mass"]
    assert s["stiffness"] == pytest.approx(motion_filter.STIFFNESS_SHARE * whole)
    assert feedforward.BLOCK_STATE >= 12
