"""Units that people write, and their factors to SI.

A unit is a pair (dimension, factor): value in SI = factor · value as written. Angles and lengths are two
dimensions; facts of the machine (lead, gear ratio, counts per turn) lead from one to the other.
"""

import math

from microstage_ros.quantities.errors import InputError

TURN = 2.0 * math.pi
GRAVITY = 9.80665              # m/s², standard gravity, defines the kilogram-force (ISO 80000-4)
POUND_FORCE = 4.4482216152605  # N, from the avoirdupois pound and standard gravity
INCH = 0.0254                  # m, international inch

UNITS = {
    "s": ("time", 1.0),
    "sec": ("time", 1.0),
    "ms": ("time", 1e-3),
    "us": ("time", 1e-6),
    "µs": ("time", 1e-6),
    "ns": ("time", 1e-9),
    "min": ("time", 60.0),
    "h": ("time", 3600.0),
    "iso": ("time", 1.0),
    "filetime": ("time", 1e-7),
    "m": ("length", 1.0),
    "cm": ("length", 1e-2),
    "mm": ("length", 1e-3),
    "µm": ("length", 1e-6),
    "um": ("length", 1e-6),
    "nm": ("length", 1e-9),
    "in": ("length", INCH),
    "inch": ("length", INCH),
    "rad": ("angle", 1.0),
    "mrad": ("angle", 1e-3),
    "deg": ("angle", TURN / 360.0),
    "°": ("angle", TURN / 360.0),
    "turn": ("angle", TURN),
    "turns": ("angle", TURN),
    "rev": ("angle", TURN),
    "counts": ("counts", 1.0),
    "inc": ("counts", 1.0),
    "qc": ("counts", 1.0),
    "m/s": ("speed", 1.0),
    "mm/s": ("speed", 1e-3),
    "µm/s": ("speed", 1e-6),
    "um/s": ("speed", 1e-6),
    "m/min": ("speed", 1.0 / 60.0),
    "mm/min": ("speed", 1e-3 / 60.0),
    "in/s": ("speed", INCH),
    "in/min": ("speed", INCH / 60.0),
    "rad/s": ("angular speed", 1.0),
    "deg/s": ("angular speed", TURN / 360.0),
    "rpm": ("angular speed", TURN / 60.0),
    "1/min": ("angular speed", TURN / 60.0),
    "rps": ("angular speed", TURN),
    "turn/s": ("angular speed", TURN),
    "rev/s": ("angular speed", TURN),
    "rev/min": ("angular speed", TURN / 60.0),
    "counts/s": ("count rate", 1.0),
    "A": ("current", 1.0),
    "mA": ("current", 1e-3),
    "N m": ("torque", 1.0),
    "Nm": ("torque", 1.0),
    "mN m": ("torque", 1e-3),
    "mNm": ("torque", 1e-3),
    "N cm": ("torque", 1e-2),
    "Ncm": ("torque", 1e-2),
    "lbf ft": ("torque", POUND_FORCE * 12 * INCH),
    "lbf in": ("torque", POUND_FORCE * INCH),
    "ozf in": ("torque", POUND_FORCE * INCH / 16.0),
    "kgf cm": ("torque", GRAVITY * 1e-2),
    "N": ("force", 1.0),
    "mN": ("force", 1e-3),
    "kN": ("force", 1e3),
    "kgf": ("force", GRAVITY),
    "kp": ("force", GRAVITY),
    "lbf": ("force", POUND_FORCE),
    "V": ("voltage", 1.0),
    "mV": ("voltage", 1e-3),
    "%": ("ratio", 1e-2),
    "1": ("ratio", 1.0),
    "permille": ("ratio", 1e-3),
    "‰": ("ratio", 1e-3),
    "kg": ("mass", 1.0),
    "g": ("mass", 1e-3),
    "lb": ("mass", POUND_FORCE / GRAVITY),
    "N m/A": ("torque constant", 1.0),
    "mN m/A": ("torque constant", 1e-3),
    "mNm/A": ("torque constant", 1e-3),
    "Nm/A": ("torque constant", 1.0),
    "ohm": ("resistance", 1.0),
    "Ω": ("resistance", 1.0),
    "Hz": ("frequency", 1.0),
    "kHz": ("frequency", 1e3),
    "kg m²": ("inertia", 1.0),
    "kg m^2": ("inertia", 1.0),
}
SI = {
    "time": "s",
    "length": "m",
    "angle": "rad",
    "counts": "counts",
    "speed": "m/s",
    "angular speed": "rad/s",
    "count rate": "counts/s",
    "current": "A",
    "torque": "N m",
    "force": "N",
    "voltage": "V",
    "ratio": "1",
    "mass": "kg",
    "torque constant": "N m/A",
    "resistance": "ohm",
    "frequency": "Hz",
    "inertia": "kg m²",
}


def known_unit(text):
    """(dimension, factor) of a unit as written, or None."""
    text = str(text).strip().replace("μ", "µ").replace("·", " ").replace("*", " ").replace("[", "").replace("]", "")
    return UNITS.get(text) or UNITS.get(text.lower()) or next(
        (unit for name, unit in UNITS.items() if name.lower() == text.lower() and len(name) > 2), None)


def unit_of(text, dimensions, place):
    """(dimension, factor) of a unit, which must be of one of ``dimensions``.

    Raises InputError with the units that would be right.
    """
    found = known_unit(text)
    if found is None or found[0] not in dimensions:
        right = ", ".join(name for name, (dimension, _) in UNITS.items() if dimension in dimensions)
        raise InputError(place, text, f"a unit of {' or '.join(dimensions)}: {right}")
    return found
