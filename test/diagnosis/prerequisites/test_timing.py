"""Jitter and lost samples told apart, on readings made by hand."""

import types

import numpy as np
import pytest

from microstage_ros.diagnosis.prerequisites.timing import HALF_SPREAD, readings_late, timing_of

PERIOD, ROWS = 1e-4, 200000
TIME = np.arange(ROWS) * PERIOD


def speed_at(time):
    """Speeds up to 2.4 mm/s [m/s], steady within blocks of 20 rows."""
    return 2.4e-3 * np.sin(2.0 * np.pi * 0.2 * time)


def place_at(time):
    """Its integral [m]."""
    return -2.4e-3 / (2.0 * np.pi * 0.2) * np.cos(2.0 * np.pi * 0.2 * time)


def readings(jitter=0.0, lost=0.0, seed=0, count=0.0, noise=5.0e-9):
    """A record as prepared: an encoder with ``noise`` [m], read late by |``jitter`` N(0, 1)| [s], a share of its samples ``lost``."""
    generator = np.random.default_rng(seed)
    encoder = place_at(TIME + np.abs(jitter * generator.normal(size=ROWS))) + noise * generator.normal(size=ROWS)
    encoder = np.round(encoder / count) * count if count else encoder
    current = np.round(generator.normal(0.1, 1e-3, ROWS) / 1e-5) * 1e-5
    for row in np.flatnonzero(generator.random(ROWS) < lost):
        encoder[row], current[row] = encoder[max(row - 1, 0)], current[max(row - 1, 0)]
    repeated = np.append(False, (np.diff(encoder) == 0.0) & (np.diff(current) == 0.0))
    speed = speed_at(TIME)
    return types.SimpleNamespace(encoder=encoder, current=current, repeated=repeated, lost=np.zeros(ROWS, bool), stage_position=place_at(TIME),
                                 speed=speed, stage_speed=speed, count=count, period=PERIOD, behind=None, interferometer=None)


@pytest.mark.parametrize("count", [0.0, 5.0e-9, 5.0e-8])
@pytest.mark.parametrize("lost", [0.001, 0.02, 0.05])
def test_lost_samples_are_no_jitter(lost, count):
    """They scatter by lost T^2 v^2: 14 us of jitter were stated for 2 % of them."""
    late = readings_late([readings(lost=lost, seed=1, count=count)], [readings(lost=lost, seed=2, count=count)], [readings(seed=3, count=count)])
    taught, _ = late
    assert taught.jitter == 0.0 and taught.lost == pytest.approx(lost, rel=0.2)
    assert taught.grown == pytest.approx(lost * PERIOD**2, rel=0.25)


@pytest.mark.parametrize("jitter, lost", [(1e-5, 0.0), (1e-5, 0.02), (3e-5, 0.05)])
def test_the_jitter_is_that_of_the_samples_that_were_not_lost(jitter, lost):
    errors = []
    for seed in range(6):
        timing = timing_of([readings(jitter, lost, seed)])
        errors.append((timing.variance - (HALF_SPREAD * jitter) ** 2) / timing.stderr)
    assert np.abs(errors).max() < 4.5 and np.std(errors) > 0.1


def test_without_a_sample_that_was_lost_nothing_is_left_out():
    timing = timing_of([readings(jitter=1e-5)])
    assert timing.growth is None and timing.grown == timing.variance and timing.lost == 0.0
