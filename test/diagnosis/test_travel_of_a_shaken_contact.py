"""A contact that is shaken does not rest: its travel wipes out what grows with rest; by hand, without a simulation."""

import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue.friction import _ageing, _calm_speed

PERIOD, ROWS = 1.0e-4, 60000
NOISE = 8.0e-6     # m/s of the readings


def record(seed=5):
    """Two seconds of rest, two of a shake of 200 Hz and 0.1 mm/s, two of a steady 0.5 mm/s."""
    time = PERIOD * np.arange(ROWS)
    true = np.where(time < 2.0, 0.0, np.where(time < 4.0, 1.0e-4 * np.sin(2.0 * np.pi * 200.0 * time), 5.0e-4))
    noise = np.convolve(np.random.default_rng(seed).normal(size=ROWS), np.ones(10), "same") / np.sqrt(10.0)
    return types.SimpleNamespace(speed=true + NOISE * noise, period=PERIOD), true


def test_travel_is_that_of_rest_of_shake_and_of_motion():
    prepared, true = record()
    rest, shake, motion = ((np.sum(_calm_speed(prepared)[part]) * PERIOD, np.sum(np.abs(true[part])) * PERIOD)
                           for part in (slice(1000, 19000), slice(21000, 39000), slice(41000, 59000)))
    assert rest[0] < 0.3 * np.sum(np.abs(prepared.speed[1000:19000])) * PERIOD     # the noise would add up to 11 µm
    assert shake[0] == pytest.approx(shake[1], rel=0.15) and motion[0] == pytest.approx(motion[1], rel=0.02)


def test_nothing_grows_while_it_is_shaken():
    prepared, _ = record()
    age = _ageing(np.ones(ROWS), _calm_speed(prepared), PERIOD, 0.03, 2.0e-6)
    assert age[19000] == pytest.approx(np.log10(1.0 + 1.9 / 0.03), rel=0.25)
    assert age[25000:39000].max() < 0.35 * age[19000] and age[-1] < 0.06
