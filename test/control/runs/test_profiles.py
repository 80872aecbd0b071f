"""Reference motions keep their limits and end where they were sent."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microstage_ros.control.trajectories import profiles
from microstage_ros.control.trajectories.profiles import MotionLimits
from microstage_ros.quantities.errors import InputError

T = 1e-4


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-0.02, 0.02), st.floats(1e-8, 0.02), st.booleans(),
    st.floats(1e-3, 0.05), st.floats(0.05, 2.0), st.floats(5.0, 500.0),
)
def test_moves_keep_their_limits_and_end_exactly(start, distance, back, velocity, acceleration, jerk):
    limits = MotionLimits(velocity, acceleration, jerk)
    target = start - distance if back else start + distance
    r = profiles.jerk_limited_move(start, target, T, limits)
    assert r[0] == start and r[-1] == target
    assert abs(len(r) - 1 - profiles.move_duration(target - start, limits) / T) <= 1.0
    rounding = 1e-14
    steps = np.diff(r)
    assert np.all(steps * (-1 if back else 1) >= -rounding)
    assert np.abs(steps).max() <= velocity * T * (1 + 1e-9) + rounding
    assert np.abs(np.diff(r, 2)).max(initial=0) <= acceleration * T**2 * (1 + 1e-9) + rounding
    if len(r) > 3:
        assert np.abs(np.diff(r, 3)).max(initial=0) <= jerk * T**3 * (1 + 1e-9) + 4 * rounding


@pytest.mark.parametrize("distance", [1e-9, 1e-6, 1e-4, 1e-2])
def test_moves_are_as_fast_as_the_limits_allow(distance):
    """At any time one of the limits is reached: the shortest symmetrical motion."""
    limits = profiles.DEFAULT_LIMITS
    t_j, t_a, t_v, jerk = profiles.move_times(distance, limits)
    assert jerk == pytest.approx(limits.jerk, rel=1e-9)
    peak = jerk * t_j * (t_j + t_a)
    assert (t_v == pytest.approx(0, abs=1e-9)) or peak == pytest.approx(limits.velocity)
    assert (t_a == pytest.approx(0, abs=1e-9)) or jerk * t_j == pytest.approx(limits.acceleration)


def test_no_way_is_no_motion():
    np.testing.assert_array_equal(profiles.jerk_limited_move(1e-3, 1e-3, T), [1e-3])


def test_sine_is_a_sine_that_starts_and_ends_at_rest():
    r = profiles.sine(2e-3, 1e-5, 5.0, 3, T)
    assert r[0] == 2e-3 and r[-1] == pytest.approx(2e-3, abs=1e-18)
    fastest = np.abs(np.diff(r)).max()
    assert abs(r[1] - r[0]) < 1e-2 * fastest and abs(r[-2] - r[-1]) < 1e-2 * fastest
    middle = r[len(r) // 4 : -len(r) // 4] - 2e-3
    t = np.arange(len(middle)) * T
    basis = np.stack([np.sin(2 * math.pi * 5 * t), np.cos(2 * math.pi * 5 * t)], axis=1)
    left = middle - basis @ np.linalg.lstsq(basis, middle, rcond=None)[0]
    assert np.abs(left).max() < 1e-14
    assert r.max() - 2e-3 == pytest.approx(1e-5, rel=1e-4)


def test_scan_runs_at_its_speed():
    r = profiles.scan(0.0, 4e-3, 5e-4, T)
    assert r[-1] == 4e-3
    np.testing.assert_allclose(np.diff(r)[len(r) // 4 : len(r) // 2], 5e-4 * T, rtol=1e-9)


def test_bad_motions_are_refused():
    for limits in (MotionLimits(0.0, 1.0, 1.0), MotionLimits(1.0, math.nan, 1.0), MotionLimits(1.0, 1.0, -1.0)):
        with pytest.raises(InputError):
            profiles.jerk_limited_move(0.0, 1e-3, T, limits)
    with pytest.raises(InputError):
        profiles.jerk_limited_move(0.0, math.inf, T)
    with pytest.raises(InputError):
        profiles.scan(0.0, 1e-3, 0.0, T)
    with pytest.raises(InputError):
        profiles.sine(0.0, 1e-6, -1.0, 1, T)
