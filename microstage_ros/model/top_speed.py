"""How fast an axis can be: what its command limit brings about without load."""

import math

from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.actuators.actuator import UNKNOWN_TOP_SPEED

MARGIN = 1.3
"""Above that speed, for a motor that is better than its data sheet."""


def top_speed(axis):
    """Highest speed of the stage [m/s]; infinity where nothing says.

    Of a voltage-driven motor it is ``MARGIN u / k_e p / (2 pi g)``.
    Of any other drive it is ``MARGIN`` times what its `Actuator.feed_forward` says.

    Parameters
    ----------
    axis : `model.axis_file.Axis`, with u the voltage limit [V], k_e the back-EMF constant [V s/rad], p the pitch [m], g
        the gear ratio.
    """
    keys = ("drive.voltage_limit", "drive.back_emf", "transmission.pitch", "transmission.gear_ratio")
    if not all(axis.has(key) for key in keys):
        speed = actuator_of(axis).feed_forward(axis)["top_speed"]
        return MARGIN * speed if speed < UNKNOWN_TOP_SPEED else math.inf
    voltage, back_emf, pitch, gear = (float(axis.value(key)) for key in keys)
    return MARGIN * voltage / back_emf * pitch / (2.0 * math.pi * gear)
