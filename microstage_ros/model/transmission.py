"""Travel of the stage per angle: of the screw, and of the motor behind the gearhead."""

import math


def screw_ratio(axis) -> float:
    """Travel per radian of the screw, r = p / 2π [m/rad]; p ``transmission.pitch`` [m]."""
    return axis.value("transmission.pitch") / (2.0 * math.pi)


def motor_ratio(axis) -> float:
    """Travel per radian of the motor shaft, r / N [m/rad]; N ``transmission.gear_ratio``."""
    return screw_ratio(axis) / axis.value("transmission.gear_ratio")
