"""Reference motions: jerk-limited moves, scans, sines. None of them steps.

Every function returns the samples of the reference [m], one per control period, beginning at the place
where the axis is and ending, exactly, where it was sent.

The ``period`` is that of control [s]; ``start``, ``target``, ``to``, ``centre`` are places [m].
"""

import math
from typing import NamedTuple

import numpy as np

from microstage_ros.quantities.errors import InputError


class MotionLimits(NamedTuple):
    """Largest velocity [m/s], acceleration [m/s^2] and jerk [m/s^3] of a reference motion."""

    velocity: float = 6.0e-3
    acceleration: float = 0.15
    jerk: float = 15.0


DEFAULT_LIMITS = MotionLimits()

SLOWEST, FASTEST = 1e-12, 1e9
"""Of each limit; beyond them the arithmetic of a profile runs over."""

LEAST = 1e-15
"""A shorter distance [m] is none: it is below the resolution of a number of the size of the travel, and the arithmetic
of a profile over it underflows."""


MOST = 30_000_000
"""Samples of one motion: 50 min at 10 kHz. Its arithmetic takes about a hundred bytes for each."""


def _times(total, period):
    """Moments of the samples [s], from 0 to ``total`` or just beyond. Raises `InputError` if they are too many."""
    count = total / period
    if not count < MOST:
        raise InputError("motion", f"{total:.3g} s, which are {count:.3g} control periods",
                         f"a faster motion, of at most {MOST:g} control periods")
    return np.arange(math.ceil(count * (1 - 1e-12)) + 1) * period


def check_limits(limits, place="limits"):
    """Refuse limits that are not positive and finite (`InputError`)."""
    for name, value in limits._asdict().items():
        if not (isinstance(value, (int, float)) and SLOWEST <= value <= FASTEST):
            raise InputError(
                f"{place}.{name}", value, f"a positive number, {SLOWEST:g} to {FASTEST:g} m/s, m/s^2 or m/s^3"
            )


def move_times(distance, limits):
    """Durations (jerk, constant acceleration and velocity) [s] and the jerk [m/s^3] of a move over ``distance`` [m].

    The motion is the symmetrical one of seven segments: jerk t_j, constant t_a, jerk t_j, cruise t_v, and
    the same again downwards; peak velocity J t_j (t_j + t_a), distance = peak (2 t_j + t_a + t_v).
    """
    velocity, acceleration, jerk = limits
    t_j = min(acceleration / jerk, math.sqrt(velocity / jerk), (distance / (2 * jerk)) ** (1 / 3))
    # largest constant-acceleration time that velocity and distance leave (0 when t_j already uses them up)
    by_velocity = velocity / (jerk * t_j) - t_j
    by_distance = 0.5 * (-3 * t_j + math.sqrt(t_j * t_j + 4 * distance / (jerk * t_j)))
    t_a = max(min(by_velocity, by_distance), 0.0)
    peak = jerk * t_j * (t_j + t_a)
    t_v = max(distance / peak - (2 * t_j + t_a), 0.0)
    return t_j, t_a, t_v, distance / (t_j * (t_j + t_a) * (2 * t_j + t_a + t_v))


def move_duration(distance, limits=DEFAULT_LIMITS):
    """Duration [s] of a jerk-limited move over ``distance`` [m]."""
    if abs(distance) < LEAST:
        return 0.0
    t_j, t_a, t_v, _ = move_times(abs(distance), limits)
    return 4 * t_j + 2 * t_a + t_v


def jerk_limited_move(start, target, period, limits=DEFAULT_LIMITS):
    """Reference [m] of a point-to-point move within ``limits``; first sample start, last exactly target.

    Shape (ceil(duration / period) + 1,). Raises `InputError` for a place that is not finite or bad limits.
    """
    check_limits(limits)
    for name, value in (("start", start), ("target", target)):
        if not math.isfinite(value):
            raise InputError(name, value, "a finite position in m")
    distance = abs(target - start)
    if distance < LEAST:
        return np.array([float(target)])
    t_j, t_a, t_v, jerk = move_times(distance, limits)
    durations = np.array([t_j, t_a, t_j, t_v, t_j, t_a, t_j])
    jerks = jerk * np.array([1, 0, -1, 0, -1, 0, 1])
    total = durations.sum()
    times = _times(total, period)
    travelled = _piecewise_cubic(np.minimum(times, total), durations, jerks)
    reference = start + math.copysign(1.0, target - start) * np.minimum(travelled, distance)
    reference[-1] = target
    return reference


def _piecewise_cubic(times, durations, jerks):
    """Distance at ``times`` of a motion from rest with constant jerk in each segment."""
    starts = np.concatenate([[0.0], np.cumsum(durations)])
    x = v = a = 0.0
    result = np.zeros_like(times)
    for begin, duration, jerk in zip(starts, durations, jerks):
        here = times >= begin
        t = times[here] - begin
        result[here] = x + v * t + a * t**2 / 2 + jerk * t**3 / 6
        x += v * duration + a * duration**2 / 2 + jerk * duration**3 / 6
        v += a * duration + jerk * duration**2 / 2
        a += jerk * duration
    return result


def scan(start, to, speed, period, limits=DEFAULT_LIMITS):
    """Reference [m] of a travel at constant ``speed`` [m/s], with jerk-limited ends.

    Raises InputError: a speed that is not positive.
    """
    if not (math.isfinite(speed) and speed > 0):
        raise InputError("scan.speed_m_s", speed, "a positive speed in m/s")
    return jerk_limited_move(start, to, period, limits._replace(velocity=speed))


def sine(centre, amplitude, frequency, cycles, period, limits=DEFAULT_LIMITS):
    """Reference [m] centre + A sin(phase), from rest to rest at the centre.

    ``amplitude`` A [m], ``frequency`` f [Hz], ``cycles`` [1].
    The phase rate runs up to 2 pi f and down again within a hundredth of a cycle (longer where the
    acceleration limit asks for it), so that the motion begins and ends without a step of velocity; ``cycles``
    full turns of the phase in all.

    Raises InputError: an amplitude, frequency or count that is not positive.
    """
    for name, value in (("amplitude_m", amplitude), ("frequency_hz", frequency), ("cycles", cycles)):
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"sine.{name}", value, "a positive number")
    rate = 2 * math.pi * frequency
    # the half-cosine ramp of the rate has its steepest slope pi/2 times the mean one
    ramp = min(max(0.01 / frequency, math.pi / 2 * amplitude * rate / limits.acceleration), 0.5 * cycles / frequency)
    total = cycles / frequency + ramp
    times = np.minimum(_times(total, period), total)
    reference = centre + amplitude * np.sin(_phase(times, total, ramp, rate))
    reference[-1] = centre + amplitude * math.sin(2 * math.pi * cycles)
    return reference


def _phase(times, total, ramp, rate):
    """Phase whose rate rises as (1 - cos)/2 over ``ramp``, stays at ``rate`` and falls the same way."""

    def run_up(t):
        return 0.5 * rate * (t - ramp / math.pi * np.sin(math.pi * t / ramp))

    middle = 0.5 * rate * ramp + rate * (times - ramp)
    end = rate * (total - ramp) - run_up(total - times)
    return np.where(times < ramp, run_up(times), np.where(times > total - ramp, end, middle))
