"""Run files: what the simulator shall do, as a YAML file (period, controller, noise, effects, program).

    period_s: 1.0e-4
    controller: {type: self_tuning, ...}
    noise: {encoder_m: 8.0e-9, voltage_V: 1.0e-3, current_A: 0.0, interferometer_m: 1.0e-8, friction_relative: 0.06}
    effects: {backlash: {width_rad: 0.017}}
    start: {friction: random}
    program:
      - {voltage_file: u.csv}
      - {reference_file: r.csv}
      - {move_to_m: 1.0e-5, dwell_s: 0.5}
      - {sine: {amplitude_m: 1.0e-5, frequency_hz: 0.03, cycles: 2}}
      - {scan: {to_m: 4.0e-3, speed_m_s: 5.0e-4}}

``start.friction``: ``random``, contacts loaded by a history that the seed draws, or ``relaxed``, contacts without
load. Not given: random where the friction is random, relaxed in a run without random friction.

A noise that is not named keeps the axis's own figure; 0 turns it off. Moves, scans and sines begin where the
segment before ended. A key that is not known, and a value out of range, are refused with file and key.
"""

import math
import pathlib
from dataclasses import dataclass, field

import numpy as np

from microstage_ros.control.laws import registry as laws
from microstage_ros.control.trajectories import profiles
from microstage_ros.control.trajectories.reference_player import check_speed
from microstage_ros.files import read_yaml
from microstage_ros.model.effects import check_effects
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec
from microstage_ros.records.csv_file import read_csv

MOST_PERIODS = 100_000_000
"""Of a program, together: three hours at 10 kHz."""

NOISES = ("encoder_m", "voltage_V", "current_A", "interferometer_m", "friction_relative")
SECTIONS = ("period_s", "controller", "noise", "effects", "program", "limits", "start", "start_m")
STARTS = ("random", "relaxed")
LIMIT_KEYS = {"velocity_m_s": "velocity", "acceleration_m_s2": "acceleration", "jerk_m_s3": "jerk"}
#: Segment of the program: its own key, the keys beside it, and those that may be left out.
SEGMENTS = {
    "voltage_file": ((), ()),
    "reference_file": ((), ()),
    "move_to_m": ((), ("dwell_s", *LIMIT_KEYS)),
    "sine": (("amplitude_m", "frequency_hz", "cycles"), ("dwell_s",)),
    "scan": (("to_m", "speed_m_s"), ("dwell_s",)),
}


@dataclass
class Run:
    """One checked run.

    Attributes
    ----------
    period_s : control period [s], or None for the axis's own.
    controller : {"type": ..., gains}, empty for the axis's own.
    noise : {name of `NOISES`: standard deviation}, only those that were given.
    effects : checked {id: {parameter: value}}.
    program : list of segments as in the file; tables may be given as arrays in place of file names
        ({"voltage": u} or {"reference": r, "disturbance": d}).
    limits : `profiles.MotionLimits` of moves, scans and the ends of sines.
    friction : state of the contacts at the beginning, of `STARTS`; None: random if the plant's friction is.
    start_m : where the axis stands at the beginning [m]; None: at the first reference, else at 0.
    """

    period_s: float | None = None
    controller: dict = field(default_factory=dict)
    noise: dict = field(default_factory=dict)
    effects: dict = field(default_factory=dict)
    program: list = field(default_factory=list)
    limits: profiles.MotionLimits = profiles.DEFAULT_LIMITS
    start_m: float | None = None
    friction: str | None = None
    place: str = "run"
    folder: pathlib.Path = pathlib.Path(".")

    def tables(self, period, fastest=math.inf):
        """The program as arrays over time, each of one value per ``period`` [s].

        Returns a dict: ``reference`` [m], ``disturbance`` [V], ``open_loop`` [V], and ``start`` [m]. A reference file
        that is faster than ``fastest`` [m/s] in any period, or begins with such a step, is an `InputError`.
        """
        parts = {"reference": [], "disturbance": [], "open_loop": []}
        position, start, total = self.start_m, self.start_m, 0
        for number, segment in enumerate(self.program, 1):
            dwell = segment.get("dwell_s", 0.0) / period
            if total + dwell > MOST_PERIODS:
                raise InputError(f"{self.place}: program[{number}].dwell_s", segment.get("dwell_s", 0.0),
                                 f"a program of at most {MOST_PERIODS:g} control periods")
            rows = _segment_rows(segment, position or 0.0, period, self.limits, self.folder)
            if position is None:
                position = start = float(rows["reference"][0]) if "reference" in rows else 0.0
            if "reference_file" in segment:
                file = str(self.folder / segment["reference_file"])
                check_speed(np.concatenate([[position], rows["reference"]]), period, fastest, file)
            length = len(next(iter(rows.values())))
            total += length
            rows.setdefault("reference", np.full(length, position))
            for name, pieces in parts.items():
                pieces.append(np.asarray(rows.get(name, np.zeros(length)), float))
            position = float(rows["reference"][-1])
        return {name: np.concatenate(pieces) for name, pieces in parts.items()} | {"start": start}


def load_run(path):
    """Read and check a run file. Returns `Run`; raises `InputError` (file: key, value, expected)."""
    path = pathlib.Path(path)
    tree = read_yaml(path, "a run file")
    return run_from_dict(tree, str(path), path.parent)


def run_from_dict(tree, place="run", folder="."):
    """`Run` from plain data, with the same checks as `load_run`; file names are relative to ``folder``.

    Raises InputError: an unknown key, a wrong type, a number out of range; the place and what would be right.
    """
    _mapping(tree, place, SECTIONS)
    period = tree.get("period_s")
    if period is not None:
        period = _number(period, f"{place}: period_s", 1e-6, 1.0, "s")
    controller = {} if tree.get("controller") is None else tree["controller"]
    if not isinstance(controller, dict):
        raise InputError(f"{place}: controller", controller, "a mapping {type: ..., gains}")
    if controller:
        kind = controller.get("type")
        if not isinstance(kind, str):
            raise InputError(f"{place}: controller.type", kind, "one of " + ", ".join(laws.LAWS))
        laws.law(kind, f"{place}: controller.type")
    noise = {} if tree.get("noise") is None else tree["noise"]
    _mapping(noise, f"{place}: noise", NOISES)
    noise = {
        key: _number(value, f"{place}: noise.{key}", 0.0, 1e3, "(standard deviation)") for key, value in noise.items()
    }
    effects = check_effects({} if tree.get("effects") is None else tree["effects"], f"{place}: effects")
    limits = _limits({} if tree.get("limits") is None else tree["limits"], profiles.DEFAULT_LIMITS, f"{place}: limits")
    start = tree.get("start_m")
    start = None if start is None else _number(start, f"{place}: start_m", -1e3, 1e3, "m")
    program = _program(tree.get("program"), f"{place}: program", pathlib.Path(folder))
    if any("voltage_file" in segment for segment in program) and controller.get("type") != "none":
        raise InputError(
            f"{place}: controller.type", controller.get("type"), "none, because the program has a voltage_file"
        )
    return Run(
        period,
        dict(controller),
        noise,
        effects,
        program,
        limits,
        start,
        _friction(tree.get("start"), f"{place}: start"),
        place,
        pathlib.Path(folder),
    )


def _mapping(node, place, known):
    if not isinstance(node, dict):
        raise InputError(place, node, "a mapping with " + ", ".join(known))
    for key in node:
        if key not in known:
            raise InputError(f"{place}: {key}", "unknown key", "one of " + ", ".join(known))


def _number(value, place, low, high, unit):
    return Spec(unit, low, high, place.replace(": ", ".").split(".")[-1]).check(value, place)


def _friction(start, place):
    """State of the contacts at the beginning, None if it is not said."""
    if start is None:
        return None
    _mapping(start, place, ("friction",))
    friction = start.get("friction")
    if friction not in STARTS:
        raise InputError(f"{place}.friction", friction, "one of " + ", ".join(STARTS))
    return friction


def _limits(given, limits, place):
    _mapping(given, place, tuple(LIMIT_KEYS))
    changed = {LIMIT_KEYS[key]: _number(value, f"{place}.{key}", 1e-9, 1e6, "(SI)") for key, value in given.items()}
    return limits._replace(**changed)


def _program(program, place, folder):
    if not isinstance(program, list) or not program:
        raise InputError(place, program, "a list of at least one segment: " + ", ".join(SEGMENTS))
    return [_segment(segment, f"{place}[{number}]", folder) for number, segment in enumerate(program, 1)]


def _segment(segment, place, folder):
    """Check one segment of the program; returns it with its numbers as floats."""
    kinds = [kind for kind in SEGMENTS if isinstance(segment, dict) and kind in segment]
    if len(kinds) != 1:
        raise InputError(place, segment, "one of " + ", ".join(SEGMENTS))
    kind = kinds[0]
    inner, beside = SEGMENTS[kind]
    _mapping(segment, place, (kind, *beside))
    checked = {}
    for key in beside:
        if key in segment:
            low = 0.0 if key == "dwell_s" else 1e-9
            checked[key] = _number(segment[key], f"{place}.{key}", low, 1e6, "(SI)")
    if kind.endswith("_file"):
        if not isinstance(segment[kind], str) or not (folder / segment[kind]).is_file():
            raise InputError(f"{place}.{kind}", segment[kind], f"a CSV file in {folder}")
        return {kind: segment[kind]}
    if kind == "move_to_m":
        return {kind: _number(segment[kind], f"{place}.{kind}", -1e3, 1e3, "m"), **checked}
    body = segment[kind]
    _mapping(body, f"{place}.{kind}", inner)
    for key in inner:
        if key not in body:
            raise InputError(f"{place}.{kind}.{key}", None, "a number")
    lowest = {"to_m": -1e3}
    return {
        kind: {key: _number(body[key], f"{place}.{kind}.{key}", lowest.get(key, 1e-12), 1e6, "(SI)") for key in inner},
        **checked,
    }


def _segment_rows(segment, position, period, limits, folder):
    """Arrays of one segment by name, from the ``position`` where the one before ended."""
    if "voltage" in segment or "reference" in segment:  # arrays given by a program instead of a file
        names = {"voltage": "open_loop", "reference": "reference", "disturbance": "disturbance"}
        return {names[key]: np.asarray(value, float) for key, value in segment.items()}
    if "voltage_file" in segment:
        return {"open_loop": _columns(folder / segment["voltage_file"], ("voltage_V",), (), period)["voltage_V"]}
    if "reference_file" in segment:
        columns = _columns(folder / segment["reference_file"], ("reference_m",), ("disturbance_V",), period)
        return {
            "reference": columns["reference_m"],
            "disturbance": columns.get("disturbance_V", np.zeros(len(columns["reference_m"]))),
        }
    if "move_to_m" in segment:
        own = {LIMIT_KEYS[key]: segment[key] for key in LIMIT_KEYS if key in segment}
        motion = profiles.jerk_limited_move(position, segment["move_to_m"], period, limits._replace(**own))
    elif "sine" in segment:
        sine = segment["sine"]
        motion = profiles.sine(position, sine["amplitude_m"], sine["frequency_hz"], sine["cycles"], period, limits)
    else:
        motion = profiles.scan(position, segment["scan"]["to_m"], segment["scan"]["speed_m_s"], period, limits)
    dwell = np.full(round(segment.get("dwell_s", 0.0) / period), motion[-1])
    return {"reference": np.concatenate([motion, dwell])}


def _columns(path, required, optional, period):
    """Columns of a table file, refused unless it is sampled at the run's period and has no gaps."""
    record = read_csv(path, required=("t_s", *required), one_of=())
    if abs(record.period_s / period - 1) > 1e-3:
        raise InputError(f"{path}: t_s", record.period_s, f"rows {period:g} s apart, the period of the run")
    columns = {name: record.columns[name] for name in (*required, *optional) if name in record.columns}
    for name, values in columns.items():
        if np.isnan(values).any():
            row = int(np.flatnonzero(np.isnan(values))[0]) + 1
            raise InputError(f"{path}: row {row}, field {name}", "empty", "a number in every row")
    return columns
