"""LOG.yaml: what the columns of foreign files mean.

Every key is checked here, once; a wrong one is refused with the file, the key, the value and what would be right.
"""

import dataclasses
import difflib
import math


from microstage_ros.files import read_yaml
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.logs.units import unit_of

PLACES = ("length", "angle", "counts")
SPEEDS = ("speed", "angular speed", "count rate")
#: Quantities that a column can hold, and the dimensions that their units may have.
QUANTITIES = {
    "time": ("time",),
    "reference": PLACES,
    "position": PLACES,
    "following_error": PLACES,
    "velocity": SPEEDS,
    "reference_velocity": SPEEDS,
    "current": ("current", "ratio"),
    "torque": ("torque", "ratio"),
    "force": ("force", "ratio"),
    "voltage": ("voltage", "ratio"),
}
#: Facts of the machine, their dimensions, and the lowest sensible value.
FACTS = {
    "lead": ("length",),
    "gear_ratio": ("ratio",),
    "counts_per_turn": ("counts", "ratio"),
    "mass": ("mass",),
    "nominal_current": ("current",),
    "nominal_torque": ("torque",),
    "nominal_force": ("force",),
    "nominal_voltage": ("voltage",),
    "torque_constant": ("torque constant",),
    "resistance": ("resistance",),
    "cogging_per_turn": ("ratio",),
}
EFFORTS = ("current", "torque", "force", "voltage")
FORMATS = ("csv", "table", "mat", "mcap")
OPTIONS = (
    "format",
    "separator",
    "skip_rows",
    "sampling_hz",
    "condition",
    "run",
    "cycle_restarts",
    "position_at",
    "topic",
    "name",
)
KEYS = (*OPTIONS, *QUANTITIES, *FACTS)
#: Where the position is read: before the transmission or behind it. What the transmission does shows only behind it.
SIDES = ("motor", "load")
ENTRY = ("column", "unit", "sign", "signed", "offset")


@dataclasses.dataclass(frozen=True)
class Quantity:
    """One column: SI value = sign · factor · (value as written − offset).

    Attributes
    ----------
    column : name, or number counted from 1. dimension : key of `units.SI`. factor : to SI.
    sign : 1 or −1. signed : False where the column holds a magnitude. offset : in the unit as written.
    """

    column: object
    unit: str
    dimension: str
    factor: float
    sign: float = 1.0
    signed: bool = True
    offset: float = 0.0


@dataclasses.dataclass(frozen=True)
class LogDescription:
    """A checked LOG.yaml; ``facts`` are in SI, ``quantities`` maps names of `QUANTITIES` to `Quantity`."""

    place: str
    quantities: dict
    facts: dict
    format: str = ""
    separator: str = ""
    skip_rows: int | None = None
    sampling_hz: float | None = None
    condition: tuple = ()
    run: tuple = ()
    cycle_restarts: bool = False
    position_at: str = ""
    topic: str = ""
    name: str = ""

    @property
    def effort(self):
        """Name of the quantity that tells the drive's effort, the nearest to a force first; or an empty string."""
        return next((name for name in ("force", "torque", "current", "voltage") if name in self.quantities), "")


def load_description(path):
    """Read and check a LOG.yaml. Raises InputError with file, key, value and what would be right."""
    return description_of(read_yaml(path, "a LOG.yaml; `microstage log FILE` proposes one"), str(path))


def description_of(tree, place):
    """`LogDescription` of the mapping of a LOG.yaml. Raises InputError."""
    if not isinstance(tree, dict):
        raise InputError(place, tree, "a mapping with entries such as time, position, current")
    for key in tree:
        if key not in KEYS:
            near = difflib.get_close_matches(str(key), KEYS, 1)
            raise InputError(f"{place}: {key}", "unknown key", f"{near[0]}" if near else "one of " + ", ".join(KEYS))
    quantities = {name: _quantity(tree[name], name, f"{place}: {name}") for name in QUANTITIES if name in tree}
    options = {name: tree[name] for name in OPTIONS if name in tree}
    checked = _options(options, place)
    _enough(quantities, checked, place)
    facts = {name: _fact(tree[name], name, f"{place}: {name}") for name in FACTS if name in tree}
    return LogDescription(place, quantities, facts, **checked)


def _quantity(entry, name, place):
    """One entry; a bare name is a column in SI's own unit."""
    if not isinstance(entry, dict):
        raise InputError(place, entry, "a mapping {column: …, unit: …}")
    for key in entry:
        if key not in ENTRY:
            raise InputError(f"{place}.{key}", "unknown key", "one of " + ", ".join(ENTRY))
    column = entry.get("column")
    if (
        isinstance(column, bool)
        or not isinstance(column, (str, int))
        or column == ""
        or (isinstance(column, int) and column < 1)
    ):
        raise InputError(f"{place}.column", column, "a column's name, or its number counted from 1")
    if "unit" not in entry:
        raise InputError(
            f"{place}.unit", None, "the unit of the column, for instance " + {"time": "s"}.get(name, "mm, rpm, A, %")
        )
    dimension, factor = unit_of(entry["unit"], QUANTITIES[name], f"{place}.unit")
    sign, signed, offset = entry.get("sign", 1), entry.get("signed", True), entry.get("offset", 0.0)
    if sign not in (1, -1):
        raise InputError(f"{place}.sign", sign, "1 or -1")
    if not isinstance(signed, bool):
        raise InputError(f"{place}.signed", signed, "true, or false for a column without sign")
    return Quantity(
        column, str(entry["unit"]), dimension, factor, float(sign), signed, _number(offset, f"{place}.offset")
    )


def separator_of(text, place):
    """The character that ``text`` is or names; empty where it is to be found. Raises InputError."""
    named = {"tab": "\t", "comma": ",", "semicolon": ";", "blank": " ", "blanks": " ", "\\t": "\t"}
    found = named.get(text, text) if isinstance(text, str) else text
    if not isinstance(found, str) or len(found) > 1 or found in ('"', "\n", "\r") or not found.isascii():
        raise InputError(place, text, "one character, or tab, comma, semicolon, blanks")
    return found


def skip_rows_of(value, place):
    """``value``, the number of lines before the header [1], or None where it is to be found. Raises InputError."""
    if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < 0):
        raise InputError(place, value, "the number of lines before the header, 0 or more")
    return value


def _options(options, place):
    kind = options.get("format", "")
    if kind and kind not in FORMATS:
        raise InputError(f"{place}: format", kind, "one of " + ", ".join(FORMATS))
    checked = {"format": kind, "separator": separator_of(options.get("separator", ""), f"{place}: separator")}
    rows = skip_rows_of(options.get("skip_rows"), f"{place}: skip_rows")
    rate = options.get("sampling_hz")
    if rate is not None and not _number(rate, f"{place}: sampling_hz") > 0.0:
        raise InputError(f"{place}: sampling_hz", rate, "a rate above 0 Hz")
    for key in ("condition", "run"):
        value = options.get(key, [])
        names = value if isinstance(value, list) else [value]
        if not all(isinstance(name, (str, int)) and not isinstance(name, bool) for name in names):
            raise InputError(f"{place}: {key}", value, "a list of column names")
        checked[key] = tuple(names)
    restarts = options.get("cycle_restarts", False)
    if not isinstance(restarts, bool):
        raise InputError(f"{place}: cycle_restarts", restarts, "true or false")
    side = options.get("position_at", "")
    if side and side not in SIDES:
        raise InputError(f"{place}: position_at", side, "motor or load: where the position is read")
    return {
        **checked,
        "position_at": side,
        "skip_rows": rows,
        "sampling_hz": None if rate is None else float(rate),
        "cycle_restarts": restarts,
        "topic": str(options.get("topic", "")),
        "name": str(options.get("name", "")),
    }


def _enough(quantities, options, place):
    """A log without time, or without anything that tells of the machine, is of no use."""
    if "time" not in quantities and options["sampling_hz"] is None and options["format"] != "mcap":
        raise InputError(f"{place}: time", None, "an entry time, or sampling_hz where there is no time column")
    if not any(name in quantities for name in ("reference", "position", "velocity", "reference_velocity")):
        raise InputError(
            f"{place}: position",
            None,
            "at least one of reference, position, velocity, reference_velocity: "
            "without it nothing tells how the machine moved",
        )
    if not any(name in quantities for name in (*EFFORTS, "following_error")) and not (
            "reference" in quantities and "position" in quantities) and not (
            "reference_velocity" in quantities and "velocity" in quantities):
        raise InputError(f"{place}: current", None, "at least one of current, torque, force, voltage, following_error, "
                         "or reference together with position: without it nothing tells how the machine answered")


def _fact(entry, name, place):
    """A fact in SI: a mapping {value, unit}, or a bare number of a ratio."""
    dimensions = FACTS[name]
    if isinstance(entry, dict):
        unknown = [key for key in entry if key not in ("value", "unit", "stderr", "source")]
        if unknown:
            raise InputError(f"{place}.{unknown[0]}", "unknown key", "value, unit")
        unit = entry.get("unit", "1" if "ratio" in dimensions else None)
        if unit is None:
            raise InputError(f"{place}.unit", None, "its unit")
        value, factor = entry.get("value"), unit_of(unit, dimensions, f"{place}.unit")[1]
    elif "ratio" in dimensions:
        value, factor = entry, 1.0
    else:
        raise InputError(place, entry, "a mapping {value: …, unit: …}")
    number = _number(value, f"{place}.value") * factor
    if not number > 0.0:
        raise InputError(f"{place}.value", value, "a number above 0")
    return number


def _number(value, place):
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise InputError(place, value, "a finite number")
    return float(value)
