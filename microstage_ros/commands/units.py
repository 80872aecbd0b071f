"""Numbers as people type them: ``10um``, ``-1e-6``, ``+50nm``, ``200ms``, ``0.5mm/s``; SI units inside.

Each function is a ``type=`` for `argparse`; a number without a unit is in SI.
"""

import argparse
import math
import re
from typing import NamedTuple

LENGTHS = {"pm": 1e-12, "nm": 1e-9, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0}
TIMES = {"us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
SPEEDS = {f"{name}/s": factor for name, factor in LENGTHS.items()}
VOLTAGES = {"mV": 1e-3, "V": 1.0}
NUMBER = re.compile(r"\s*([+\-\u2212]?(?:\d+\.?\d*|\.\d+)(?:[eE][+\-\u2212]?\d+)?)\s*(.*?)\s*")


def _read(text, units, what, example):
    """A typed number in SI. Raises `argparse.ArgumentTypeError` that says what would be right."""
    found = NUMBER.fullmatch(text)
    value = float(found[1].replace("\u2212", "-")) if found else math.nan
    unit = found[2] if found else ""
    if not math.isfinite(value) or (unit and unit not in units):
        raise argparse.ArgumentTypeError(f"got {text.strip()!r}, expected {what} such as {example}")
    return value * units[unit] if unit else value


def namespace(text):
    """The namespace of an axis, as ROS 2 allows it: ``/axis``, ``/left/stage``; else `argparse.ArgumentTypeError`."""
    if not re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", text) or len(text) > 100 or "__" in text:
        raise argparse.ArgumentTypeError(
            f"got {text!r}, expected a name that begins with a slash, of letters, digits and _, such as /axis"
        )
    return text


def length(text):
    """A length [m]: ``1e-5``, ``10um``, ``10 µm``, ``-0.5mm``."""
    return _read(text, LENGTHS, "a length", "10um, -0.5mm or 1e-5 (metres)")


def positive_length(text):
    """A length above zero [m]."""
    return _positive(length(text), text, "a length above 0 such as 50nm")


def duration(text):
    """A time above zero [s]: ``0.2``, ``200ms``, ``2min``."""
    return _positive(_read(text, TIMES, "a time", "200ms, 10s or 10 (seconds)"), text, "a time above 0 such as 200ms")


def moment(text):
    """A time of a record [s]: ``0``, ``12.5``, ``2min``."""
    return _read(text, TIMES, "a time", "200ms, 10s or 10 (seconds)")


def speed(text):
    """A speed above zero [m/s]: ``5e-4``, ``0.5mm/s``."""
    return _positive(_read(text, SPEEDS, "a speed", "0.5mm/s or 5e-4 (m/s)"), text, "a speed above 0 such as 0.5mm/s")


def voltage(text):
    """A voltage [V]: ``0.5``, ``500mV``."""
    return _read(text, VOLTAGES, "a voltage", "500mV or 0.5 (volts)")


def _positive(value, text, expected):
    if not value > 0.0:
        raise argparse.ArgumentTypeError(f"got {text.strip()!r}, expected {expected}")
    return value


class Target(NamedTuple):
    """A place to move to: ``value`` [m] from home, or from where the axis stands if ``relative``."""

    value: float
    relative: bool


def target(text):
    """A `Target`: a length; one that begins with ``+`` counts from where the axis stands."""
    return Target(length(text), text.lstrip().startswith("+"))


def shown_length(value):
    """A length, ``value`` [m], as people read it: ``10.05 µm``, ``-50 nm``, ``0``."""
    from microstage_ros.quantities.readable import quantity  # numpy and matplotlib's colours: not for --help

    return quantity(value, "m", 4) if value else "0"
