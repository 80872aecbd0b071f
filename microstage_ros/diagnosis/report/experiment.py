"""The run that would tell rivals apart: a run file, as plain data, for the axis at hand.

Each pair of rivals differs in one condition (frequency, speed, load direction, dwell, stroke …); the
program moves that condition while the rest stays, in less than the two minutes that `experiment` plays.
`simulate --run` accepts the mapping as it is.
"""

import numpy as np

from microstage_ros.model.effects import REGISTRY
from microstage_ros.model.top_speed import MARGIN, top_speed

REACH = 0.4  # of the travel, either way of its middle
FASTEST, SLOWEST = 0.2, 0.02  # of the travel per second
SHARE = 0.4  # of the speed at the drive's limit without load: what friction and acceleration leave

WHY = {
    "frequency": (
        "they differ in how phase and amplitude go with frequency; sines up to a tenth of the sampling rate show it"
    ),
    "dwell": "they differ in how they grow with time at rest; dwells from 0.06 s to 60 s show it",
    "speed": "they differ in how friction goes with speed; the same stroke at speeds over two decades shows it",
    "rest": "they differ near standstill, where friction changes sign; slow sweeps through zero force show it",
    "stroke": (
        "they differ in their dependence on position and speed; the same stroke at a slow and a fast speed shows it"
    ),
}


def condition_of(ids):
    """The condition that separates a set of rivals: key of `WHY`."""
    votes = [REGISTRY[name].separated_by for name in ids if name in REGISTRY]
    return max(WHY, key=votes.count)


def separating_run(ids, axis):
    """Run file (a mapping) whose record would separate the rivals ``ids`` on this axis.

    Amplitudes and speeds are taken from the axis: its travel, its period and its encoder.
    """
    low, high = axis.value("travel.minimum"), axis.value("travel.maximum")
    stroke, period = high - low, axis.value("period")
    middle, count = 0.5 * (low + high), max(axis.value("sensors.encoder.resolution"), 1e-9)
    fastest = min(FASTEST * stroke, SHARE * top_speed(axis) / MARGIN)
    program = _PROGRAMS[condition_of(ids)](middle, stroke, period, count, fastest)
    return {"period_s": period, "start_m": _tidy(middle), "program": program}


def _tidy(value):
    return float(f"{value:.4g}")


def _frequency(middle, stroke, period, count, fastest):
    """Six sines; the amplitude falls with f^1.5, between even speed and even acceleration, so that the drive
    follows."""
    frequencies = np.geomspace(0.002, 0.1, 6) / period
    largest = min(400 * count, 1e-3 * stroke)
    return [{"sine": {"amplitude_m": _tidy(largest * (frequencies[0] / f) ** 1.5), "frequency_hz": _tidy(f),
                      "cycles": int(max(5, round(2 * f)))}, "dwell_s": 0.3} for f in frequencies]


def _dwell(middle, stroke, period, count, fastest):
    step, program = _tidy(1e-3 * stroke), []
    for k, pause in enumerate((0.06, 0.2, 0.6, 2.0, 6.0, 20.0, 60.0)):
        program.append({"move_to_m": _tidy(middle + step * (-1) ** k), "dwell_s": pause})
    return program


def _speed(middle, stroke, period, count, fastest):
    reach, program = 0.2 * stroke, []
    for speed in np.geomspace(0.01 * fastest, fastest, 5):
        program += [
            {"scan": {"to_m": _tidy(middle + min(reach, 3 * speed)), "speed_m_s": _tidy(speed)}, "dwell_s": 0.2},
            {"scan": {"to_m": _tidy(middle), "speed_m_s": _tidy(speed)}, "dwell_s": 0.2},
        ]
    return program


def _rest(middle, stroke, period, count, fastest):
    return [{"sine": {"amplitude_m": _tidy(a), "frequency_hz": 0.06, "cycles": 2}, "dwell_s": 5.0}
            for a in np.minimum(np.array([20, 200, 2000]) * count, np.array([0.02, 0.1, REACH]) * stroke)]


def _stroke(middle, stroke, period, count, fastest):
    low, high, program = _tidy(middle - REACH * stroke), _tidy(middle + REACH * stroke), []
    for speed in (max(0.1 * fastest, SLOWEST * stroke), fastest):
        program += [{"scan": {"to_m": high, "speed_m_s": _tidy(speed)}, "dwell_s": 0.5},
                    {"scan": {"to_m": low, "speed_m_s": _tidy(speed)}, "dwell_s": 0.5}]
    return program


_PROGRAMS = {"frequency": _frequency, "dwell": _dwell, "speed": _speed, "rest": _rest, "stroke": _stroke}
