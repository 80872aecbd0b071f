"""Numbers of an axis file that are allowed but unlikely, with the line they stand in and what is usual.

The ranges span what positioning axes are built with, from a flexure stage to a machine tool; they warn of a slip of the
pen (metres for millimetres, grams for kilograms), they refuse nothing.
"""

import math
import pathlib
from typing import NamedTuple

import yaml

from microstage_ros.model.axis_file import Axis


class Usual(NamedTuple):
    """A usual range in the unit of the axis file, and what it is the range of."""

    low: float
    high: float
    what: str


USUAL = {
    "period": Usual(2e-5, 1e-2, "control periods"),
    "transmission.pitch": Usual(1e-4, 0.1, "screws, 0.1 to 100 mm per turn"),
    "transmission.gear_ratio": Usual(0.2, 2000.0, "gearheads"),
    "transmission.stiffness": Usual(1e5, 1e10, "screws and their bearings; a ball-point pen's spring has 300 N/m"),
    "transmission.damping": Usual(0.0, 1e6, "screws and their bearings"),
    "stage.mass": Usual(1e-3, 2e3, "stages, 1 g to 2 t"),
    "drive.resistance": Usual(0.02, 1e3, "windings"),
    "drive.inductance": Usual(1e-7, 1.0, "windings"),
    "drive.back_emf": Usual(1e-4, 10.0, "motors"),
    "drive.torque_constant": Usual(1e-4, 10.0, "motors"),
    "drive.rotor_inertia": Usual(1e-10, 1.0, "rotors"),
    "drive.voltage_limit": Usual(0.1, 1e3, "amplifiers"),
    "sensors.encoder.resolution": Usual(1e-12, 1e-5, "linear encoders, 1 pm to 10 µm"),
    "sensors.encoder.noise": Usual(0.0, 1e-6, "linear encoders"),
    "sensors.encoder.signal_period": Usual(1e-7, 1e-3, "scales"),
    "variability.relative": Usual(0.0, 0.5, "friction, a standard deviation of up to a half"),
}
ZERO_MEANS_NONE = ("sensors.encoder.resolution", "sensors.encoder.noise", "transmission.damping",
                   "variability.relative")
SAME_CONSTANTS = 0.25
"""Largest relative difference of K_E [V s/rad] and K_T [N m/A]: one number for an ideal DC machine; windings and iron
losses leave some per cent."""

RESONANCE = Usual(5.0, 5000.0, "drive trains")
STROKE = Usual(1e-6, 20.0, "stages, 1 µm to 20 m")


def implausible(axis: Axis) -> list[str]:
    """One sentence per unlikely number of an `Axis`: file and line, key, value, usual range.

    Empty for a likely axis.
    """
    lines = _lines_of(axis.place)
    found = []

    def say(key, value, usual):
        if not usual.low <= abs(value) <= usual.high and not (value == 0.0 and key in ZERO_MEANS_NONE):
            unit = axis.quantity(key).unit if axis.has(key) else "Hz" if "frequency" in key else "m"
            line = f": line {lines[key]}" if key in lines else ""
            found.append(
                f"{axis.place}{line}: {key}: {value:g} {unit} is unlikely; usual: {usual.low:g} … {usual.high:g} {unit}"
                f" ({usual.what})"
            )

    rigid = axis.choices.get("transmission.type") == "rigid"
    for key, usual in USUAL.items():
        if axis.has(key) and not (rigid and key == "transmission.pitch") and not isinstance(axis.value(key), list):
            say(key, axis.value(key), usual)
    stroke = axis.value("travel.maximum") - axis.value("travel.minimum")
    lines.setdefault("travel", lines.get("travel.maximum", 0))
    say("travel", stroke, STROKE)
    if axis.has("transmission.stiffness"):
        lines["transmission: natural frequency of stiffness and mass"] = lines.get("transmission.stiffness", 0)
        frequency = math.sqrt(axis.value("transmission.stiffness") / axis.value("stage.mass")) / (2.0 * math.pi)
        say("transmission: natural frequency of stiffness and mass", frequency, RESONANCE)
    found += _constants(axis, lines)
    return found


def _constants(axis, lines):
    """K_E and K_T of a DC motor that are not those of one machine."""
    if not (axis.has("drive.back_emf") and axis.has("drive.torque_constant")):
        return []
    emf, torque = axis.value("drive.back_emf"), axis.value("drive.torque_constant")
    if max(emf, torque) <= 0.0 or abs(emf - torque) <= SAME_CONSTANTS * max(emf, torque):
        return []
    line = f": line {lines['drive.torque_constant']}" if "drive.torque_constant" in lines else ""
    return [
        f"{axis.place}{line}: drive.torque_constant: {torque:g} N m/A is unlikely beside drive.back_emf {emf:g} V"
        " s/rad; usual: the same number in SI, within some per cent (K_T = K_E for a DC motor)"
    ]


def _lines_of(path):
    """{dotted key: line, counted from 1} of a YAML file; empty where there is none."""
    try:
        tree = yaml.compose(pathlib.Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return {}
    lines = {}

    def walk(node, prefix):
        for name, value in node.value if isinstance(node, yaml.MappingNode) else ():
            lines[prefix + name.value] = name.start_mark.line + 1
            walk(value, f"{prefix}{name.value}.")

    walk(tree, "")
    return lines
