"""The paper's experiments (section 4) as programs: run, simulated or live, and what each is for.

Each function gives the `Run` of one repeat; ``start`` moves it along the stroke, so that repeats see other
places, and the seed other times. The same runs as files are in ``config/experiments``.
"""

import numpy as np

from microstage_ros.control.runs.run_file import Run
from microstage_ros.control.runs.simulate import simulated_record

BENCH_NOISE = {"encoder_m": 0.4e-9, "voltage_V": 1.0e-3, "current_A": 0.0}
GUIDEWAY_NOISE = {"encoder_m": 0.0, "voltage_V": 0.0}
SPEEDS = tuple(np.round(np.concatenate([np.geomspace(0.03, 1.0, 24), np.geomspace(1.6, 16.0, 8)]), 4))
"""Speeds of the gearhead's output [rad/s]: down to 0.03, without which M_s and ω_S cannot be distinguished."""


def slow_reversals(ratio, start=0.0, speed=3.0e-3, way=0.024, places=5, spacing=3.0e-4):
    """Pre-sliding of the actuator: out, back and out again so slowly that friction is that of rest.

    Each reversal out of sliding gives one branch, by Masing's rule the virgin curve scaled by two, whatever
    the friction's history was. Closed loop: a voltage ramp (`voltage_ramp`) breaks away at a third of the
    way, because the falling Stribeck curve outweighs the back EMF.

    ``ratio`` r [m/rad], ``start`` [m], ``speed`` [rad/s], ``way`` [rad]: more than twice the slip displacement.
    ``places`` [1], a distance ``spacing`` [m] apart, are visited: further than the friction remembers.
    """
    program = []
    for place in start + np.arange(places) * spacing:
        slow = [
            {"scan": {"to_m": float(to), "speed_m_s": speed * ratio}}
            for to in (place + way * ratio, place, place + way * ratio)
        ]
        program += [{"move_to_m": float(place)}, *slow]
    return Run(
        controller={"type": "pid"}, noise=BENCH_NOISE, friction="relaxed", program=program, start_m=start - spacing
    )


def constant_speeds(ratio, start=0.0, speeds=SPEEDS, duration=0.5, least_way=0.5):
    """Sliding friction of the actuator (Fig. 5b): each speed in both directions under PI control.

    ``ratio`` r [m/rad], ``start`` [m], ``speeds`` [rad/s];
    ``duration`` [s] and ``least_way`` [rad]: each run lasts the one and covers the other at least.
    """
    program, place = [], start
    for speed in speeds:
        way = max(speed * duration, least_way) * ratio
        program += [{"scan": {"to_m": place + way, "speed_m_s": float(speed) * ratio}},
                    {"scan": {"to_m": place, "speed_m_s": float(speed) * ratio}}]
    return Run(controller={"type": "pid"}, noise=BENCH_NOISE, friction="relaxed", program=program, start_m=start)


def accelerations(ratio, start=0.0, amplitude=0.03, frequencies=(8.0, 16.0), cycles=40):
    """Acceleration and deceleration through the Stribeck velocity, for C and the inertia: sines.

    ``ratio`` r [m/rad], ``start`` [m], ``cycles`` [1],
    ``amplitude`` [rad], ``frequencies`` [Hz]: the friction follows its curve with the time |s| / C (0.2 ms
    at C = 1 N m/s), which shows only if the speed passes the curve's knee in a few of these.
    """
    program = [{"sine": {"amplitude_m": amplitude * ratio, "frequency_hz": f, "cycles": cycles}} for f in frequencies]
    limits = Run().limits._replace(acceleration=100.0, jerk=1e5)
    return Run(
        controller={"type": "pid"}, noise=BENCH_NOISE, friction="relaxed", program=program, limits=limits, start_m=start
    )


def voltage_ramp(period, rate=0.015, top=0.15):
    """The paper's own pre-sliding run (Fig. 5a): the voltage rises slowly until the actuator breaks away.

    ``period`` [s], ``rate`` [V/s], ``top`` [V]; a ramp down is the same with a negative rate.
    """
    voltage = np.arange(0.0, top, abs(rate) * period) * np.sign(rate)
    return Run(controller={"type": "none"}, noise=BENCH_NOISE, friction="relaxed", program=[{"voltage": voltage}])


def incremental_loading(period, increment=0.01, top=1.05, settle=0.15, ramp=0.05, loops=(0.3, 0.6), depth=0.15):
    """Incremental loading of the guideways with return loops (Fig. 7).

    Parameters
    ----------
    period : control period [s].
    increment : step of the load [N], 10 mN in the paper; each is reached over ``ramp`` [s] without a jerk
        (a sudden step overshoots by as much again) and held for ``settle`` [s].
    top : last load [N]; ``loops``: loads at which it is taken back by ``depth`` [N] and on again.

    Returns
    -------
    the `Run` of a force-driven bench with a gain of 1 N/V.
    """
    levels = [0.0, 0.0]
    pending = sorted(loops)
    while levels[-1] < top - 1e-9:
        levels.append(levels[-1] + increment)
        if pending and levels[-1] >= pending[0] - 1e-9:
            down = np.arange(1, round(depth / increment) + 1) * increment
            levels += list(pending[0] - down) + list(pending.pop(0) - down[::-1][1:]) + [levels[-1]]
    rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(round(ramp / period)) * period / ramp)
    hold = np.ones(round(settle / period))
    steps = [a + (b - a) * np.concatenate([rise, hold]) for a, b in zip(levels, levels[1:])]
    return Run(
        controller={"type": "none"},
        noise=GUIDEWAY_NOISE,
        friction="relaxed",
        program=[{"voltage": np.concatenate(steps)}],
    )


def repeats(axis, runs, seed):
    """Simulate runs one after the other as repeats of an experiment, each with its own friction.

    ``runs``: list of `Run`; ``seed`` of the first [1].
    Yields `Record`; the bench has no motor angle, so that column is left out.
    """
    for number, run in enumerate(runs):
        record = simulated_record(axis, run, seed=seed + number)
        record.columns.pop("motor_angle_rad", None)
        yield record
