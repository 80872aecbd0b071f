"""The motions of a record that tells most of an axis: moves, slow and fast scans, sines of two sizes."""

import math

FASTEST = 3e-3  # m/s
REACH = 4e-3  # largest way from the centre, where the travel allows it [m]


def size_of(stroke):
    """Share of the usual ways that a travel of ``stroke`` [m] allows."""
    return min(1.0, 0.04 * stroke / 1e-3)


def segments(centre, stroke, fast):
    """Segments of a run file about ``centre`` [m], on to `REACH` in the positive direction, at up to ``fast`` [m/s].

    ``stroke``: length of the travel [m].
    """
    size = size_of(stroke)
    rate = min(1.0, 0.7 * fast / (2.0 * math.pi * 5e-4 * size))

    def at(way):
        return centre + way * size

    return [
        {"move_to_m": at(1e-3), "dwell_s": 0.2},
        {"move_to_m": at(0.0), "dwell_s": 0.2},
        {"scan": {"to_m": at(2e-4), "speed_m_s": min(1e-4, fast)}},
        {"scan": {"to_m": at(0.0), "speed_m_s": min(1e-4, fast)}},
        {"scan": {"to_m": at(2e-3), "speed_m_s": min(1e-3, fast)}},
        {"scan": {"to_m": at(0.0), "speed_m_s": min(1e-3, fast)}},
        {"sine": {"amplitude_m": 5e-5 * size, "frequency_hz": 0.5, "cycles": 2}},
        {"sine": {"amplitude_m": 5e-4 * size, "frequency_hz": rate, "cycles": 3}},
        {"scan": {"to_m": at(REACH), "speed_m_s": fast}},
        {"scan": {"to_m": at(0.0), "speed_m_s": fast}},
    ]


def run_about(place, axis):
    """(segments, centre [m]) of the programme on an axis that stands at ``place`` [m]: inside its travel, a tenth of it
    from the ends.

    The speed leaves half of the voltage at the file's motor constants.
    """
    from microstage_ros.control.laws.controller import controller_parameters

    low, high = axis.value("travel.minimum"), axis.value("travel.maximum")
    stroke = high - low
    centre = min(max(place, low + 0.1 * stroke), high - 0.1 * stroke - REACH * size_of(stroke))
    fast = FASTEST
    if axis.choices["drive.type"] == "voltage_motor":
        volts = float(controller_parameters("pid_feedforward", axis, {})["feedforward"]["volts_per_velocity"])
        fast = min(fast, 0.4 * axis.value("drive.voltage_limit") / max(volts, 1e-9))
    return segments(centre, stroke, fast), centre
