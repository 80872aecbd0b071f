"""Jitter and lost samples told apart, on readings made by hand."""

import types

import numpy as np
import pytest

from microstage_ros.diagnosis.prerequisites import timing
from microstage_ros.diagnosis.prerequisites.timing import HALF_SPREAD, readings_late, timing_of

PERIOD, ROWS = 1e-4, 200000
TIME = np.arange(ROWS) * PERIOD


def place_at(time):
    """Speeds up to 2.4 mm/s, steady within blocks of 20 rows [m]."""
    return -2.4e-3 / (2.0 * np.pi * 0.2) * np.cos(2.0 * np.pi * 0.2 * time)


def moves_at(time):
    """Moves of 0.5 mm to and fro in 0.15 s, at no steady speed and up to 6.7 mm/s, and 0.35 s of rest after each [m]."""
    number, phase = np.divmod(time, 0.5)
    share = np.minimum(phase / 0.15, 1.0)
    way = 0.5e-3 * (share - np.sin(2.0 * np.pi * share) / (2.0 * np.pi))
    return np.where(number % 2 == 0, way, 0.5e-3 - way)


def readings(jitter=0.0, lost=0.0, seed=0, count=0.0, noise=5.0e-9, place_at=place_at, ripple=1e-3):
    """A record as prepared: an encoder with ``noise`` [m], read late by |``jitter`` N(0, 1)| [s], a share of its samples ``lost``, of a
    stage at ``place_at`` a time; ``ripple`` of the current [A], in counts of 10 uA."""
    generator = np.random.default_rng(seed)
    encoder = place_at(TIME + np.abs(jitter * generator.normal(size=ROWS))) + noise * generator.normal(size=ROWS)
    encoder = np.round(encoder / count) * count if count else encoder
    current = np.round(generator.normal(0.1, ripple, ROWS) / 1e-5) * 1e-5
    for row in np.flatnonzero(generator.random(ROWS) < lost):
        encoder[row], current[row] = encoder[max(row - 1, 0)], current[max(row - 1, 0)]
    repeated = np.append(False, (np.diff(encoder) == 0.0) & (np.diff(current) == 0.0))
    speed = np.gradient(place_at(TIME), PERIOD)
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
        found = timing_of([readings(jitter, lost, seed)])
        errors.append((found.variance - (HALF_SPREAD * jitter) ** 2) / found.stderr)
    assert np.abs(errors).max() < 4.5 and np.std(errors) > 0.1


def test_without_a_sample_that_was_lost_nothing_is_left_out():
    found = timing_of([readings(jitter=1e-5)])
    assert found.growth is None and found.grown == found.variance and found.lost == 0.0


@pytest.mark.parametrize("steady", [0.1, 0.3, 1.0])
def test_moves_at_no_steady_speed_tell_the_jitter_too(monkeypatch, steady):
    """Below 3 mm/s they had too few blocks of one speed, and the mean lateness was stated as the constant one: 11 % and 19 of its errors."""
    monkeypatch.setattr(timing, "STEADY", steady)
    none, some = (timing_of([readings(jitter, place_at=moves_at, count=2.5e-8, noise=8.0e-9, seed=5)]) for jitter in (0.0, 4.1e-5))
    # rounding to 25 nm differs between the few speeds of a steady tenth: 1.2 µs of jitter, 4.4 standard errors
    assert abs(none.variance) < (HALF_SPREAD * 1.5e-6) ** 2
    assert some.jitter / HALF_SPREAD == pytest.approx(4.1e-5, rel=0.02)


def test_a_reading_that_is_alike_by_the_jitters_chance_was_not_lost():
    """41 us of jitter make 0.1 % of the readings repeat the one before, which were stated as lost."""
    found = timing_of([readings(4.1e-5, 0.0001, 7, 2.5e-8, ripple=1e-5)])
    assert found.chance > 2.0 * found.lost_stderr and abs(found.lost - 0.0001) < 4.0 * found.lost_stderr
    lost = timing_of([readings(4.1e-5, 0.02, 7, 2.5e-8, ripple=1e-5)])
    assert abs(lost.lost - 0.02) < 4.0 * lost.lost_stderr
