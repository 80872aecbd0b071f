"""Stribeck curves: exact recovery, outliers, identifiability, the issue's figures."""

import numpy as np
import pytest

from microstage_ros.identification.coverage import synthetic_features
from microstage_ros.identification.estimators.actuator import Features
from microstage_ros.identification.estimators.actuator_fit import by_unit, identify_sliding
from microstage_ros.identification.estimators.stribeck import NAMES, fit_stribeck, stribeck_curve
from microstage_ros.quantities.errors import InputError

TRUTH = np.array([219e-6, 125.6e-6, 0.18, 0.9, 10.51e-6])
SPEEDS = np.geomspace(0.003, 16.0, 30)


def test_exact_points_give_the_parameters_back():
    values, _ = fit_stribeck(SPEEDS, stribeck_curve(TRUTH, SPEEDS), np.full(30, 1e-6))
    assert values == pytest.approx(TRUTH, rel=1e-4)


def test_one_wild_point_hardly_matters():
    friction = stribeck_curve(TRUTH, SPEEDS)
    friction[20] *= 1.5
    values, _ = fit_stribeck(SPEEDS, friction, 0.005 * friction)
    assert values[[0, 1, 4]] == pytest.approx(TRUTH[[0, 1, 4]], rel=0.03)


def test_too_few_speeds_are_refused():
    with pytest.raises(InputError, match="five or more speeds"):
        fit_stribeck(np.array([0.1, 1.0, 10.0]), np.array([2e-4, 1.3e-4, 2.3e-4]), np.full(3, 1e-6))


def test_without_slow_runs_the_knee_is_not_determined():
    """Above ten Stribeck velocities only M_C and σ can be told, and that is what is said."""
    generator = np.random.default_rng(2)
    features = Features()
    for repeat in range(8):
        for speed in np.geomspace(1.5, 16.0, 12):
            features.speed.append(speed)
            features.friction.append(stribeck_curve(TRUTH, speed) * (1.0 + 0.01 * generator.standard_normal()))
            features.repeat.append(repeat)
    result = identify_sliding(features, 1, resamples=12)
    told = {name: result.estimates[f"contacts.actuator.{name}"].determined for name in NAMES}
    assert told["viscous"] and not told["stribeck_velocity"] and not told["static"]
    assert "would" in result.estimates["contacts.actuator.stribeck_velocity"].remark


def test_few_steady_runs_give_no_number():
    features = Features(speed=[0.1, 1.0], friction=[2e-4, 1.3e-4], repeat=[0, 0])
    estimate = identify_sliding(features, 1).estimates["contacts.actuator.static"]
    assert not estimate.determined and "2 steady runs" in estimate.remark


def test_as_many_runs_as_speeds_give_no_number():
    """Of 200 resamples of nine runs at nine speeds some have fewer than the five speeds that a curve needs."""
    speeds = np.geomspace(0.03, 16.0, 9)
    features = Features(speed=[*speeds], friction=[*stribeck_curve(TRUTH, speeds)], repeat=[0] * 9)
    estimate = identify_sliding(features, 1).estimates["contacts.actuator.static"]
    assert not estimate.determined and "9 steady runs" in estimate.remark


def test_means_by_unit_and_speed():
    speeds, means, deviation = by_unit(np.array([1.0, 1.0, 1.0, 2.0]), np.array([1.0, 3.0, 4.0, 5.0]), np.full(4, 0.1),
                                       np.array([0, 0, 1, 1]))
    assert speeds.tolist() == [1.0, 2.0]
    assert means[0, 0] == 2.0 and np.isnan(means[0, 1]) and means[1].tolist() == [4.0, 5.0]
    assert (deviation > 0).all()


def test_fifty_repeats_reach_the_figures(actuator_bench):
    """Issue figures: curve 2 %, M_s and M_C 3 %, ω_S 5 % (rms over experiments), σ 1.5 %."""
    deviations, speeds = [], np.geomspace(0.03, 16.0, 50)
    for seed in range(4):
        features = synthetic_features(actuator_bench, 50, np.random.default_rng(seed))
        result = identify_sliding(features, 1, resamples=2)
        found = np.array([result.estimates[f"contacts.actuator.{name}"].value for name in NAMES])
        deviations.append(found / TRUTH - 1.0)
        assert np.sqrt(np.mean((stribeck_curve(found, speeds) / stribeck_curve(TRUTH, speeds) - 1.0) ** 2)) < 0.02
    size = np.sqrt(np.mean(np.square(deviations), axis=0))
    assert np.all(size[[0, 1, 2, 4]] < [0.03, 0.03, 0.05, 0.015])
