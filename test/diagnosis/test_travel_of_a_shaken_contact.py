"""A contact that is shaken does not rest: its travel wipes out what grows with rest; by hand, without a simulation."""

import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue.friction import _ageing, _calm_speed

PERIOD, ROWS = 1.0e-4, 60000
NOISE = 2.0e-9     # m of the motor's position


def record(seed=5):
    """Two seconds of rest, two of a shake of 200 Hz and 0.1 mm/s, two of a steady 0.5 mm/s."""
    time = PERIOD * np.arange(ROWS)
    true = np.where(time < 2.0, 0.0, np.where(time < 4.0, 1.0e-4 * np.sin(2.0 * np.pi * 200.0 * time), 5.0e-4))
    noise = np.convolve(np.random.default_rng(seed).normal(size=ROWS), np.ones(10), "same") / np.sqrt(10.0)
    return types.SimpleNamespace(position=np.cumsum(true) * PERIOD + NOISE * noise, period=PERIOD), true


def test_travel_is_that_of_rest_of_shake_and_of_motion():
    prepared, true = record()
    rest, shake, motion = ((np.sum(_calm_speed(prepared)[part]) * PERIOD, np.sum(np.abs(true[part])) * PERIOD)
                           for part in (slice(1000, 19000), slice(21000, 39000), slice(41000, 59000)))
    assert rest[0] < 0.05 * np.sum(np.abs(np.diff(prepared.position[1000:19000])))     # the noise would add up to 9 µm
    assert shake[0] == pytest.approx(shake[1], rel=0.15) and motion[0] == pytest.approx(motion[1], rel=0.02)


def test_nothing_grows_while_it_is_shaken():
    prepared, _ = record()
    age = _ageing(np.ones(ROWS), _calm_speed(prepared), PERIOD, 0.03, 2.0e-6)
    assert age[19000] == pytest.approx(np.log10(1.0 + 1.9 / 0.03), rel=0.25)
    assert age[25000:39000].max() < 0.35 * age[19000] and age[-1] < 0.06


def test_the_dwell_is_there_until_the_contact_moves():
    """A motion of 1 mm/s after two seconds: 1 ms before nothing of it has faded, and 10 ms later the dwell exp(−10 µm/2 µm)."""
    time = PERIOD * np.arange(ROWS)
    noise = NOISE * np.random.default_rng(7).normal(size=ROWS)
    prepared = types.SimpleNamespace(position=1.0e-3 * np.maximum(time - 2.0, 0.0) + noise, period=PERIOD)
    age = _ageing(np.ones(ROWS), _calm_speed(prepared), PERIOD, 0.03, 2.0e-6)
    assert age[19990] == pytest.approx(np.log10(1.0 + 2.0 / 0.03), rel=0.05)
    assert age[20100] == pytest.approx(np.log10(1.0 + 2.0 * np.exp(-5.0) / 0.03), rel=0.2)
