"""The torque balance of the whole axis: what friction that varies along the way leaves unknown."""

import numpy as np
import pytest

from microstage_ros.identification.estimators.intervals import correlated_score
from microstage_ros.identification.whole_axis import Balance, _loss, _varied_score, independent_share
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.transmission import screw_ratio
from microstage_ros.places import config_file


def test_score_of_a_correlated_process_is_the_double_sum():
    generator = np.random.default_rng(1)
    regressors, way = generator.standard_normal((40, 3)), np.cumsum(generator.uniform(0.0, 0.3, 40))
    dense = np.exp(-np.abs(way[:, None] - way) / 0.7)
    assert correlated_score(regressors, way, 0.7) == pytest.approx(regressors.T @ dense @ regressors, rel=1e-12)


def test_mean_over_a_way_scatters_as_the_integral_says():
    """Variance of the mean of an Ornstein-Uhlenbeck process over S = n l: 2/n² (n − 1 + exp(−n))."""
    way = np.linspace(0.0, 5.0, 4001)
    score = correlated_score(np.full((4001, 1), 1.0 / 4001), way, 1.0)
    assert score[0, 0] == pytest.approx(2.0 / 25.0 * (4.0 + np.exp(-5.0)), rel=1e-3)


def _slow_and_fast(axis, rows=4000, period=1e-3):
    speed = np.where(np.arange(rows) < rows // 2, 1e-4, 1e-3) / screw_ratio(axis)
    return Balance(period, 100.0, speed, np.zeros(rows), np.full(rows, 1e-4), np.ones(rows, bool))


def test_covariance_by_the_variability_is_that_of_drawn_friction():
    """Friction drawn along travel and time: the fits of two levels scatter as stated."""
    axis = load_axis(config_file("axis.yaml"))
    balance = _slow_and_fast(axis)
    level = np.arange(len(balance.used)) < len(balance.used) // 2
    regressors = np.column_stack([level, ~level]).astype(float)
    way, time = balance.way()
    length, duration, share = (axis.value(f"variability.{n}") for n in ("travel_length", "time_length", "travel_share"))
    generator, weak = np.random.default_rng(2), np.linalg.inv(regressors.T @ regressors)

    def process(steps):
        values, fade = np.empty(len(steps) + 1), np.exp(-steps)
        values[0] = generator.standard_normal()
        noise = generator.standard_normal(len(steps)) * np.sqrt(1.0 - fade**2)
        for k in range(len(steps)):
            values[k + 1] = fade[k] * values[k] + noise[k]
        return values

    found, stated = [], []
    for _ in range(120):
        error = 0.06 * (np.sqrt(share) * process(np.diff(way) * screw_ratio(axis) / length)
                        + np.sqrt(1.0 - share) * process(np.diff(time) / duration))
        values = weak @ regressors.T @ error
        left = error - regressors @ values
        score = _varied_score(regressors, left, 1e4, weak, [balance], axis)
        found.append(values)
        stated.append(np.diag(weak @ score @ weak))
    scatter, mean = np.var(found, axis=0), np.mean(stated, axis=0)
    assert np.all(np.abs(scatter / mean - 1.0) < 0.65)  # five standard deviations of a variance of 120 values
    assert mean[0] > 1.3 * mean[1]  # the slow stretch holds fewer independent values


def test_rows_count_by_their_independent_values():
    axis = load_axis(config_file("axis.yaml"))
    travel, time = 2.0 * 1e-3 + 2.0 * 1e-4, 4.0
    expected = (travel / (2.0 * 1e-4) + time / (2.0 * 20.0)) / 4000
    assert independent_share([_slow_and_fast(axis)], axis) == pytest.approx(expected, rel=1e-9)


def test_loss_of_the_prior_is_not_shared_and_its_slopes_are_right():
    squares = np.array([0.01, 1.0, 30.0, 4.0])
    value, first, second = _loss(0.2, 1, squares)
    step = 1e-5
    up, down = _loss(0.2, 1, squares + step)[0], _loss(0.2, 1, squares - step)[0]
    assert value[-1] == 4.0 and value[0] == pytest.approx(0.2 * 0.01, rel=1e-2)
    assert first == pytest.approx((up - down) / (2.0 * step), rel=1e-6)
    assert second == pytest.approx((_loss(0.2, 1, squares + step)[1] - _loss(0.2, 1, squares - step)[1]) / (2.0 * step), abs=1e-7)
