"""The sketch of a machine: an axis file of which most numbers may be missing or only roughly known.

Required are the period, the travel, the kind of drive and transmission, the drive's limit (of voltage, or of current),
gear ratio and pitch of a screw, and the encoder's resolution. A leaf may have ``tolerance`` (relative: 0.3 means within
a factor 1.3).
What is missing is filled with a typical value, scaled to what is given, and counts as known within `UNKNOWN`.
"""

import math
from dataclasses import dataclass
from pathlib import Path

from microstage_ros.files import read_yaml
from microstage_ros.model.actuators import ACTUATORS, BY_NAME
from microstage_ros.model.axis_file import Axis, axis_from_dict, load_axis
from microstage_ros.model.plausibility import implausible
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError

USUAL = 1.0
"""Tolerance of a number that is given without one: within a factor of two."""

UNKNOWN = 9.0
"""Tolerance of a number that is not given: within a factor of ten."""

REQUIRED = ("period", "travel.minimum", "travel.maximum", "sensors.encoder.resolution")
"""Leaves without which nothing may move; also the drive's limit, and of a screw gear ratio and pitch."""

DRIVES = tuple(actuator.name for actuator in ACTUATORS if not actuator.holds_position)
"""Kinds of drive that the steps are written for: those whose command makes a force."""

TEMPLATES = {"voltage_motor": "axis.yaml", "force": "emps.yaml"}
"""Axis files in ``config/`` with typical values, where it is not ``axes/<drive>.yaml``."""

OWN = {
    "current_motor": ("supply_voltage", "resistance", "back_emf"),
    "voice_coil": ("force_constant_slope", "force_constant_curvature"),
}
"""Numbers of the template's own machine: left out, they have no effect."""

EXACT = (
    *(*REQUIRED, *(BY_NAME[name].limit_key for name in DRIVES)),
    *("drive.dac_range", "drive.dac_bits", "drive.command_bits", "drive.supply_voltage"),
    *("transmission.gear_ratio", "transmission.pitch"),
)
"""Leaves that are taken as they are."""


@dataclass(frozen=True)
class Sketch:
    """An axis with how well each of its numbers is known.

    Attributes
    ----------
    axis : `Axis`, complete. tolerance : dotted key to relative tolerance. given : keys that stood in the file.
    """

    axis: Axis
    tolerance: dict
    given: frozenset

    def spread(self, key):
        """Standard deviation of the logarithm of a number [1]: its tolerance as a uniform distribution."""
        return math.log1p(self.tolerance.get(key, USUAL)) / math.sqrt(3.0)

    @property
    def unlikely(self):
        """One sentence per unlikely number that stood in the file; typical values that were filled in have none."""
        line = f"{self.axis.place}: line "
        return [said for said in implausible(self.axis) if said.startswith(line) and not said.startswith(f"{line}0")]


def load_sketch(path):
    """Read a sketch. Raises InputError: file, key, value, what would be right."""
    return sketch_from_dict(read_yaml(path, "an axis file"), str(path))


def sketch_from_dict(tree, place="sketch"):
    """`Sketch` from plain data. Raises InputError."""
    if not isinstance(tree, dict):
        raise InputError(place, tree, "a mapping of sections")
    if "components" in tree:
        axis_from_dict({"format": 1, **tree}, place)  # refuses it, in the words of all other commands
    tolerance = {}
    tree = _without_tolerances(tree, "", tolerance, place)
    given = frozenset(_leaves(tree))
    drive, transmission = (_choice(tree, section, place) for section in ("drive", "transmission"))
    if drive not in DRIVES:
        raise InputError(f"{place}: drive.type", drive, _instead(drive))
    screw = ("transmission.gear_ratio", "transmission.pitch") if transmission == "screw" else ()
    for key in (*REQUIRED, BY_NAME[drive].limit_key, *screw):
        if key not in given:
            raise InputError(f"{place}: {key}", None, "a value; without it nothing may move")
    tree = _merged(_template(tree, drive, transmission), tree)
    tree.setdefault("format", 1)
    tree.setdefault("name", Path(place).stem)
    axis = axis_from_dict(tree, place).with_controller({"type": "self_tuning"})
    for key in axis.quantities:
        if key in EXACT:
            tolerance[key] = 0.0
        elif key not in given:
            tolerance[key] = UNKNOWN
    return Sketch(axis, {**{key: USUAL for key in axis.quantities}, **tolerance}, given)


def _instead(drive):
    """What a person does whose drive the steps of commissioning are not written for."""
    known = "one of " + ", ".join(DRIVES)
    if drive not in BY_NAME:
        return f"{known}, the drives that can be commissioned"
    actuator = BY_NAME[drive]
    sets = ", which sets a position" if actuator.holds_position else ""
    records = " and, from records, of identify" if actuator.estimation != "position" or actuator.identified else ""
    return (
        f"{known}: the steps feel their way with small forces. A {drive} is commanded with {actuator.command.quantity} "
        f"[{actuator.command.unit}]{sets}: write its axis file with the numbers of the data sheet{records}"
    )


def _choice(tree, section, place):
    chosen = (tree.get(section) or {}).get("type") if isinstance(tree.get(section), dict) else None
    if not isinstance(chosen, str):
        raise InputError(f"{place}: {section}.type", chosen, "the kind of " + section)
    return chosen


def _without_tolerances(node, key, tolerance, place):
    """The tree without ``tolerance``; a leaf without ``source`` is an estimate."""
    if not isinstance(node, dict):
        return node
    if "value" in node:
        leaf = dict(node)
        given = leaf.pop("tolerance", None)
        if given is not None:
            if isinstance(given, bool) or not isinstance(given, (int, float)) or not 0.0 <= given < math.inf:
                raise InputError(f"{place}: {key}.tolerance", given, "a relative tolerance from 0, such as 0.3")
            tolerance[key] = float(given)
        leaf.setdefault("source", "estimate")
        return leaf
    if key in ("effects", "controller", "provenance"):
        return node
    return {
        name: _without_tolerances(child, f"{key}.{name}".lstrip("."), tolerance, place) for name, child in node.items()
    }


def _leaves(node, key=""):
    if isinstance(node, dict):
        if "value" in node:
            yield key
        else:
            for name, child in node.items():
                yield from _leaves(child, f"{key}.{name}".lstrip("."))


def _template(tree, drive, transmission):
    """Typical values for whatever this kind of machine may leave out."""
    shipped = load_axis(config_file(TEMPLATES.get(drive, f"axes/{drive}.yaml"))).as_dict()
    for section in ("controller", "effects", "provenance", "name", "period", "travel"):
        shipped.pop(section, None)
    if shipped["transmission"]["type"] != transmission:
        shipped["transmission"] = {"type": transmission}
    shipped["drive"] = {key: value for key, value in shipped["drive"].items() if key not in OWN.get(drive, ())}
    if _kind(tree, "encoder") != shipped["sensors"]["encoder"].get("type", "incremental"):
        shipped["sensors"].pop("encoder")
    for contact, body in (tree.get("contacts") or {}).items():
        if isinstance(body, dict) and body.get("law") != shipped["contacts"].get(contact, {}).get("law"):
            shipped["contacts"].pop(contact, None)
    return shipped


def _kind(tree, sensor):
    """``type`` of a sensor of the sketch."""
    body = (tree.get("sensors") or {}).get(sensor)
    return body.get("type", "incremental") if isinstance(body, dict) else "incremental"


def _merged(base, over):
    merged = dict(base)
    for name, value in over.items():
        inner = merged.get(name)
        if isinstance(value, dict) and isinstance(inner, dict) and "value" not in value and "value" not in inner:
            merged[name] = _merged(inner, value)
        else:
            merged[name] = value
    return merged
