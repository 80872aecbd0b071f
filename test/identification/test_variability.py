"""The random friction as a process: exact likelihood, recovery with intervals, what cannot be told."""

import numpy as np
import pytest

from microstage_ros.identification.coverage import variability_trial
from microstage_ros.identification.estimators.variability import (
    VariabilityLikelihood,
    identify_variability,
    position_locked_share,
)
from microstage_ros.quantities.errors import InputError


def test_likelihood_is_that_of_the_dense_gaussian():
    """−2 log L of the Kalman filter against the covariance matrix written out, mean concentrated."""
    generator = np.random.default_rng(1)
    travel, time = np.cumsum(generator.uniform(0, 5e-5, 12)), np.cumsum(generator.uniform(0, 3, 12))
    q = 0.05 * generator.standard_normal(12)
    sigma, share, length, duration, noise = 0.06, 0.7, 1e-4, 8.0, 0.01
    parameters = [np.log(sigma), np.log(share / (1 - share)), np.log(length), np.log(duration), np.log(noise)]
    found = VariabilityLikelihood(q, travel, time, np.zeros(12, bool))(parameters)
    apart = np.abs(travel[:, None] - travel), np.abs(time[:, None] - time)
    dense = sigma**2 * (share * np.exp(-apart[0] / length) + (1 - share) * np.exp(-apart[1] / duration)) + noise**2 * np.eye(12)
    inverse = np.linalg.inv(dense)
    mean = inverse.sum(axis=0) @ q / inverse.sum()
    expected = np.linalg.slogdet(dense)[1] + (q - mean) @ inverse @ (q - mean)
    assert found == pytest.approx(expected, rel=1e-9)


def test_process_comes_back(actuator_bench):
    found = variability_trial(actuator_bench, 4, runs=2, cells=900)
    for key in ("variability.relative", "variability.travel_length"):
        ratio, held = found[key]
        assert held and ratio == pytest.approx(1.0, abs=0.3)


def test_short_series_are_refused():
    with pytest.raises(InputError, match="at least 30"):
        identify_variability(np.zeros(5), np.arange(5.0), np.arange(5.0), np.zeros(5, bool))


def test_what_comes_back_at_the_same_place():
    generator = np.random.default_rng(2)
    position = np.concatenate([np.linspace(0, 1e-3, 300), np.linspace(1e-3, 0, 300)])
    travel = np.linspace(0, 2e-3, 600)
    locked = np.sin(position * 2e4)
    assert position_locked_share(position, locked, travel, 1e-5, 2e-4)[0] > 0.9
    free = generator.standard_normal(600)
    assert abs(position_locked_share(position, free, travel, 1e-5, 2e-4)[0]) < 0.15
