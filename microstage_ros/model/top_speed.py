"""How fast an axis can be: what its voltage limit brings about without load."""

import math

MARGIN = 1.3
"""Above that speed, for a motor that is better than its data sheet."""


def top_speed(axis):
    """Highest speed of the stage [m/s]: ``MARGIN u / k_e p / (2 pi g)``; infinity for an axis whose data do not say.

    Parameters
    ----------
    axis : `model.axis_file.Axis`, with u the voltage limit [V], k_e the back-EMF constant [V s/rad], p the pitch [m], g the
        gear ratio.
    """
    keys = ("drive.voltage_limit", "drive.back_emf", "transmission.pitch", "transmission.gear_ratio")
    if not all(axis.has(key) for key in keys):
        return math.inf
    voltage, back_emf, pitch, gear = (float(axis.value(key)) for key in keys)
    return MARGIN * voltage / back_emf * pitch / (2.0 * math.pi * gear)
