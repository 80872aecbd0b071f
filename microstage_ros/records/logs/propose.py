"""What a log may be: columns, units, rate, signs and cycles proposed from names and numbers, for a person to correct.

A proposal is a mapping for LOG.yaml; every guess that rests on numbers alone is reported with its reason, and so is
what is missing.
"""

import dataclasses
import re

import numpy as np

from microstage_ros.records.logs import quality
from microstage_ros.records.logs.description import QUANTITIES
from microstage_ros.records.logs.units import known_unit

VELOCITY = r"(?<![a-z])vel|act(ual)?vel|speed|rpm|drehzahl"     # not the end of "level", "travel"
#: Quantity → pattern of column names, in the order in which they are tried. Names are those of `_words`: capitals
#: within a name begin a word, all is in lower case.
NAMES = (
    ("time", r"(^|[._/])(time|t|timestamp|stamp|zeit|seconds)$|^time\b|_time$"),
    (
        "following_error",
        r"(following|f|pos|position|tracking|lag|contour).{0,3}(error|err|diff|dev)|ferror|f-error|posdiff|schlepp"
        r"|^error$|(?<![a-z])lag$|(pos|following)lag$",
    ),
    (
        "reference_velocity",
        r"(ref|set|cmd|command|target|demand|desired).{0,12}(vel|speed|velo)"
        r"|(vel|speed|velo)\w*.{0,3}(ref|set|cmd|command|demand)",
    ),
    ("velocity", VELOCITY),
    (
        "reference",
        r"(?<![a-z])set.?p|reference|(?<![a-z])ref|pos.?ref|input_pos|control.?pos|cmd|command"
        r"|target|demand|soll|desired",
    ),
    (
        "position",
        r"(?<![a-z])pos(?!t|sib)|pos(ition)?\d*$|actual|(?<![a-z])act(?!uator|i)|feedback|\bfb|encoder|\benc|rbv\b"
        r"|\bist\b|^x$|(?<![a-z])angle",
    ),
    ("current", r"(?<![ce])curr|(?<=[ap]e)curr|(?<![a-z])iq(?![a-z])|^i$|strom|\bamp(?!l)|(?<![._]d)_a$|:cur"),
    ("torque", r"torq|moment(?!a)|effort"),
    ("force", r"force(?!d)|kraft"),
    ("voltage", r"volt|^u$|_v$"),
)
RUNS, CONDITIONS = r"^(run|repeat|repetition|cycle|trial)s?$", r"^(load|profile|payload|recipe|program|gear|mode)$"
TURNS = r"servo_(stats|control|command)\.|(pos|vel)_estimate"      # moteus, ODrive: turns, turns/s (their references)
GUESSED = {"time": "s", "current": "A", "torque": "%", "force": "N", "voltage": "V"}


@dataclasses.dataclass
class Proposal:
    """``tree``: the mapping of LOG.yaml. ``reasons``: key → why. ``missing``: sentences. ``unused``: columns that were
    not understood."""

    tree: dict
    reasons: dict
    missing: list
    unused: list
    kind: str
    rows: int


def propose(table):
    """`Proposal` for a `Table`."""
    tree: dict[str, dict | list] = {}
    reasons, used = {}, set()
    numeric = {name: v for name, v in table.columns.items() if v.dtype.kind == "f" and np.isfinite(v).any()}
    for quantity, pattern in NAMES:
        found = next(
            (
                n
                for n in table.columns
                if n not in used
                and _matches(pattern, n, table)
                and (n in numeric or quantity == "time")
                and _may_be(quantity, n, table)
            ),
            None,
        )
        if found is None or (quantity == "torque" and "current" in tree and "%" not in str(table.units.get(found, ""))):
            continue
        used.add(found)
        tree[quantity] = {"column": found, "unit": _unit(quantity, found, table, reasons)}
    for key, pattern in (("run", RUNS), ("condition", CONDITIONS)):
        names = [n for n in table.columns if n not in used and re.search(pattern, n.lower())]
        if names:
            tree[key] = names
            used.update(names)
    _time(tree, table, reasons)
    _signs(tree, table, reasons)
    missing = _missing(tree, table)
    return Proposal(tree, reasons, missing, [n for n in table.columns if n not in used], table.kind, table.rows)


def _words(name):
    """The name in lower case, with ``_`` where a capital begins a word within it."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def _matches(pattern, name, table):
    """Whether a column's name fits a pattern: as it stands, by its words, or without a unit at its end."""
    suffix = "_" + str(table.units.get(name, "")).replace("/", "_")
    bare = name.removesuffix(suffix) or name
    return any(re.search(pattern, text) for text in (_words(name), _words(bare)))


def _may_be(quantity, name, table):
    """Whether the unit that the file tells, or a plainer word in the name, allows this quantity."""
    declared = known_unit(table.units.get(name, "")) if table.units.get(name) else None
    if declared is not None and declared[0] not in QUANTITIES[quantity]:
        return False
    other = r"torq|curr|volt|force|veloc|speed|\brpm\b|(?<![a-z])(vel|i[dq])(?![a-z])"
    return quantity not in ("reference", "position") or not re.search(other, _words(name))


def _unit(quantity, name, table, reasons):
    """Unit as the file tells it, else a guess from the size of the numbers."""
    declared = table.units.get(name)
    if declared and known_unit(declared):
        return declared
    if table.kind.startswith("MCAP") and quantity in ("position", "velocity", "torque"):
        reasons[f"{quantity}.unit"] = "a guess: ROS messages are in SI, of a slide or of a turning joint"
        return {"position": "m", "velocity": "m/s", "torque": "N m"}[quantity]
    if quantity in GUESSED:
        unit = GUESSED[quantity]
        if quantity == "time":
            unit = _time_unit(table.columns[name])
        reasons[f"{quantity}.unit"] = "a guess: the file does not tell it"
        return unit
    span = float(np.nanmax(table.columns[name]) - np.nanmin(table.columns[name]))
    unit = "m" if span < 2.0 else "mm"
    turning = [
        float(np.nanmedian(np.abs(v)))
        for n, v in table.columns.items()
        if v.dtype.kind == "f" and re.search(VELOCITY, _words(n))
    ]
    if any(re.search(TURNS, n.lower()) for n in table.columns):
        unit = "turn"
    elif "rad" in name.lower() or any(
        abs(v / (2.0 * np.pi) - round(v / (2.0 * np.pi))) < 1e-4 and v > 1.0 for v in turning
    ):
        unit = "rad"              # a speed of so many turns a second, to four digits
    if quantity in ("velocity", "reference_velocity"):
        unit = "rpm" if "rpm" in name.lower() or span > 400 else f"{unit}/s"
    reasons[f"{quantity}.unit"] = f"a guess: the file does not tell it (range {span:.4g})"
    return unit


def _time_unit(values):
    if values.dtype.kind != "f":
        return "iso"
    step = np.diff(values[np.isfinite(values)])
    step = float(np.median(step[step > 0.0])) if (step > 0.0).any() else 1.0
    return "s" if step < 0.5 else "ms" if step < 500.0 else "us" if step < 5e5 else "ns"


def _time(tree, table, reasons):
    if "time" not in tree:
        tree["sampling_hz"] = round(1.0 / table.sampling_s, 6) if table.sampling_s else None
        reasons["sampling_hz"] = "from the file's preamble" if table.sampling_s else "not in the file: fill in"
        return
    values = table.columns[tree["time"]["column"]]
    if values.dtype.kind == "f" and (np.diff(values) < 0.0).sum() >= 1:
        tree["cycle_restarts"] = True
        reasons["cycle_restarts"] = f"time goes back {int((np.diff(values) < 0.0).sum())} times"


def _signs(tree, table, reasons):
    """Sign of the following error, and whether the efforts have one."""
    column = lambda q: table.columns[tree[q]["column"]]
    direction = _direction(tree, table)
    if "following_error" in tree:
        error = column("following_error")
        if "reference" in tree and "position" in tree:
            declared = np.nansum(error * (column("reference") - column("position")))
            reasons["following_error.sign"] = "compared with reference − position"
        elif direction is not None:
            declared = np.nansum(error * direction)
            reasons["following_error.sign"] = (
                "the axis lags: an error of reference − position has the sign of the motion"
            )
        else:
            declared = 1.0
        if declared < 0.0:
            tree["following_error"]["sign"] = -1
    for quantity in ("current", "torque", "force"):
        if quantity not in tree:
            continue
        values = column(quantity)
        low, high = np.nanquantile(values, [0.01, 0.99])
        both = direction is not None and (direction > 0).any() and (direction < 0).any()
        if low >= -0.02 * abs(high) and both:
            tree[quantity]["signed"] = False
            reasons[f"{quantity}.signed"] = "never below zero although the axis moves both ways"


def _direction(tree, table):
    """Sign of the motion per row, or None."""
    for quantity in ("reference", "position"):
        if quantity in tree:
            return np.sign(np.gradient(np.nan_to_num(table.columns[tree[quantity]["column"]])))
    return np.sign(table.columns[tree["velocity"]["column"]]) if "velocity" in tree else None


def _missing(tree, table):
    """Sentences on what is not there and what it would give."""
    out = []
    if not tree.get("time") and not tree.get("sampling_hz"):
        out.append("sampling_hz: no column of time; give the rate")
    if not any(q in tree for q in ("reference", "position", "velocity", "reference_velocity")):
        out.append("reference, position or velocity: nothing tells how the axis moved")
    if not any(q in tree for q in ("current", "torque", "force", "voltage")):
        out.append("current or torque: without it friction, tilt and payload show in the following error only")
    if "following_error" not in tree and not {"reference", "position"} <= set(tree):
        out.append("following error, or set point and position: without it lost motion and delays cannot show")
    rotary = any(
        known_unit(tree[q]["unit"]) and known_unit(tree[q]["unit"])[0] in ("angle", "angular speed")
        for q in ("position", "velocity")
        if q in tree
    )
    out.append(
        "lead: {value: …, unit: mm}: "
        + ("turns angles into lengths" if rotary else "tells what repeats with the turn of the screw")
    )
    if any(tree.get(q, {}).get("unit") == "%" for q in ("current", "torque", "force")):
        out.append("nominal_torque or nominal_current: turns per cent into N m or A")
    if "run" not in tree:
        out.append("run: a column that numbers repeats; without it the file is divided at its reversals")
    return out


def oddities(table, tree):
    """Sentences on gaps, repeats, saturation, quantisation and shifted levels, as `quality` finds them."""
    found = []
    if "time" in tree and table.columns[tree["time"]["column"]].dtype.kind == "f":
        found += quality.pieces_of(table.columns[tree["time"]["column"]], tree.get("cycle_restarts", False))[2]
    for quantity in ("current", "torque", "force", "voltage"):
        if quantity in tree:
            values = table.columns[tree[quantity]["column"]]
            if quality.saturation(values).any():
                found.append(f"{quantity} stands at its limit in {quality.saturation(values).mean():.1%} of the rows")
            if quality.quantum(values):
                found.append(f"{quantity} comes in steps of {quality.quantum(values):.4g} {tree[quantity]['unit']}")
            if quality.shifts(values) is not None:
                found.append(f"the digits of {quantity} show levels that were shifted afterwards")
    return found
