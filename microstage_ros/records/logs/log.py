"""A log in SI: pieces of continuous time with their signals, labels, facts and what was odd about it."""

import dataclasses
from pathlib import Path

import numpy as np

from microstage_ros.quantities.errors import InputError
from microstage_ros.records.logs import quality
from microstage_ros.records.logs.containers import read_mat, read_mcap
from microstage_ros.records.logs.description import EFFORTS, LogDescription
from microstage_ros.records.logs.units import SI, TURN
from microstage_ros.records.logs.vendor_formats import read_text

MOST_SHIFTS_PER_RUN = 40


@dataclasses.dataclass
class Log:
    """One file, converted.

    Attributes
    ----------
    source : file name. time : shape (n,) [s], from the start of each piece's clock.
    signals : name → array of shape (n,), SI: reference, position, following_error, velocity, reference_velocity, and
        the efforts (current, torque, force, voltage) that the file holds; NaN is a missing sample.
    piece : number of the continuous piece of each row. run, condition : index into ``runs`` and ``conditions``.
    shift : class of the constant by which the effort was shifted afterwards, per row, or None.
    place_unit : ``"m"`` or ``"rad"``. effort : name of the effort signal or ``""``; effort_unit; signed.
    facts : in SI. notes : what was odd and what was done about it, in sentences. period : usual one [s].
    """

    source: str
    time: np.ndarray
    signals: dict
    piece: np.ndarray
    run: np.ndarray
    condition: np.ndarray
    runs: list
    conditions: list
    shift: np.ndarray | None
    place_unit: str
    effort: str
    effort_unit: str
    signed: bool
    facts: dict
    notes: list
    period: float

    def __len__(self):
        return len(self.time)

    def rows(self, kept):
        """The rows of a mask (n,) or index array ``kept``, shape (m,), as a log of their own."""
        return dataclasses.replace(
            self, time=self.time[kept], signals={k: v[kept] for k, v in self.signals.items()}, piece=self.piece[kept],
            run=self.run[kept], condition=self.condition[kept], shift=None if self.shift is None else self.shift[kept])


def read_table(path, description=None):
    """The file's columns as they stand in it: `Table`. Raises InputError."""
    place = Path(path)
    if not place.exists():
        raise InputError(path, "file not found", "a log: .csv, .txt, .mat, .mcap, plain or .gz, .xz")
    kind = description.format if description else ""
    suffix = place.suffix.lower() if place.suffix.lower() not in (".gz", ".xz") else Path(place.stem).suffix.lower()
    if kind == "mat" or (not kind and suffix == ".mat"):
        return read_mat(path)
    if kind == "mcap" or (not kind and suffix == ".mcap"):
        return read_mcap(path, description.topic if description else "")
    separator = (description.separator if description else "") or (" " if kind == "table" else "")
    return read_text(path, separator, description.skip_rows if description else None)


def read_log(path, description: LogDescription):
    """Read a file as LOG.yaml describes it.

    Raises InputError for a file that cannot be read, a column that it lacks, a unit that needs a fact that is not
    given.
    """
    table = read_table(path, description)
    notes = [*table.notes]
    time = _checked_time(table, description, path)
    signals, unit, notes_q = _signals(table, description, path)
    piece, kept, more = quality.pieces_of(time, description.cycle_restarts)
    if len(time) and piece[-1] + 1 > 0.3 * len(time):
        raise InputError(
            f"{path}: time",
            f"{piece[-1]} steps back or gaps in {len(time)} rows",
            "time that advances; see time.column and time.unit",
        )
    notes += more
    shift = None
    effort = description.effort
    if effort:
        shift = quality.shifts(signals[effort])
        if shift is not None:
            notes.append(
                f"The digits of {effort} show that it was shifted afterwards by {len(np.unique(shift))} different "
                "constants: levels of stretches with different constants cannot be compared."
            )
    notes += notes_q + _clean(signals, piece, effort)
    run, runs = _labels(table, description.run, path, "run")
    condition, conditions = _labels(table, description.condition, path, "condition")
    shown = description.quantities.get(effort)
    log = Log(
        str(path),
        time,
        signals,
        piece,
        run,
        condition,
        runs,
        conditions,
        shift,
        unit,
        effort,
        SI[shown.dimension] if shown else "",
        bool(shown.signed) if shown else True,
        dict(description.facts),
        notes,
        0.0,
    )
    log = log.rows(kept)
    _effort_in_si(log)
    forward = np.diff(log.time)[np.diff(log.piece) == 0]
    if not len(forward):
        raise InputError(path, f"{len(log)} rows", "pieces of at least two rows with advancing time")
    log.period = float(np.median(forward))
    off = float(np.mean(np.abs(forward / log.period - 1.0) > quality.UNEVEN))
    if off > quality.UNEVEN_SHARE:
        log.notes.append(
            f"Sampling is uneven (period {log.period:.3g} s, {off:.0%} of the steps off by more than "
            f"{quality.UNEVEN:.0%}); "
            f"pieces are interpolated to a constant period."
        )
        log = _resampled(log)
    return log


def _checked_time(table, description, path):
    """Time of every row, shape (n,) [s]. Raises InputError where a row has none or where it stands still."""
    time = _time(table, description, path)
    entry = description.quantities.get("time")
    name = entry.column if entry else "time"
    missing = np.flatnonzero(~np.isfinite(time))
    if len(missing):
        row = int(missing[0]) + 1
        known, text = table.no_number.get(_name_of(table, name), (0, ""))
        raise InputError(f"{path}: column {name}, row {row} of {len(time)}", text if known == row else "no number",
                         "a time in every row; correct or remove the row")
    if len(time) < 2:
        raise InputError(path, f"{len(time)} row", "at least two rows with advancing time")
    if not (np.diff(time) > 0.0).any():
        raise InputError(f"{path}: column {name}", f"a time that does not advance in {len(time)} rows",
                         "time that advances; see time.column and time.unit")
    return time


def _time(table, description, path):
    entry = description.quantities.get("time")
    if entry is None:
        if description.sampling_hz:
            return np.arange(table.rows) / description.sampling_hz
        if "time" in table.columns:
            return np.asarray(table.columns["time"], float)
        raise InputError(f"{path}: time", None, "an entry time or sampling_hz in LOG.yaml")
    values = column_of(table, entry.column, path, "time")
    if values.dtype.kind != "f":
        plain = [text.strip().rstrip("Z").replace(" ", "T") for text in values]
        try:
            stamps = np.array(plain, dtype="datetime64[ns]")
        except ValueError:
            stamps = np.array([_stamp(text) for text in plain])
        wrong = np.flatnonzero(np.isnat(stamps))
        if len(wrong):
            row = int(wrong[0])
            raise InputError(f"{path}: column {entry.column}, row {row + 1} of {len(values)}", str(values[row])[:60],
                             "a stamp such as 2024-05-01 12:00:00.123")
        stamps = stamps.astype(np.int64)
        return (stamps - stamps[0]) * 1e-9
    first = values[np.isfinite(values)][:1]
    if not len(first):
        raise InputError(f"{path}: column {entry.column}", "no numbers", "time")
    return (values - first[0]) * entry.factor


def _stamp(text):
    try:
        return np.datetime64(text, "ns")
    except ValueError:
        return np.datetime64("NaT", "ns")


def _name_of(table, name):
    """Name in the table of a column given by name (exact, else but for case and blanks) or number, or None."""
    names = list(table.columns)
    if isinstance(name, int):
        return names[name - 1] if name <= len(names) else None
    plain = {"".join(n.lower().split()): n for n in reversed(names)}
    return name if name in table.columns else plain.get("".join(str(name).lower().split()))


def column_of(table, name, path, place):
    """A column by name or number, see `_name_of`. Raises InputError with what there is."""
    found = _name_of(table, name)
    if found is None:
        names = list(table.columns)
        right = (f"a column number of 1 … {len(names)}" if isinstance(name, int)
                 else "a column of the file: " + ", ".join(names[:30]))
        raise InputError(f"{path}: {place}", name, right)
    return table.columns[found]


def _signals(table, description, path):
    """Signals in SI, the unit of places, and notes."""
    signals, notes, units = {}, [], set()
    for name, entry in description.quantities.items():
        if name == "time":
            continue
        raw = column_of(table, entry.column, path, name)
        if raw.dtype.kind != "f":
            raise InputError(f"{path}: {name}: column {entry.column}", str(raw[0])[:30], "numbers")
        if not np.isfinite(raw).any():
            raise InputError(f"{path}: {name}: column {entry.column}", f"no number in {len(raw)} rows", "numbers")
        factor, unit = entry.factor, SI[entry.dimension]
        if entry.dimension in ("counts", "count rate"):
            if "counts_per_turn" not in description.facts:
                raise InputError(
                    f"{description.place}: counts_per_turn", None, f"the counts of one turn, for {name} in counts"
                )
            factor, unit = (
                factor * TURN / description.facts["counts_per_turn"],
                {"counts": "rad", "counts/s": "rad/s"}[unit],
            )
        if name not in EFFORTS:
            units.add(unit.removesuffix("/s"))
        signals[name] = entry.sign * factor * (raw - entry.offset)
        if name in EFFORTS and not entry.signed:
            signals[name] = (
                np.abs(signals[name])
                if np.nanmin(signals[name]) >= 0.0 or np.nanmean(signals[name] < 0) < 0.05
                else signals[name]
            )
    unit = _one_unit(signals, units, description, notes)
    if "position" not in signals and {"reference", "following_error"} <= set(signals):
        signals["position"] = signals["reference"] - signals["following_error"]
    if "following_error" not in signals and {"reference", "position"} <= set(signals):
        signals["following_error"] = signals["reference"] - signals["position"]
    return signals, unit, notes


def _one_unit(signals, units, description, notes):
    """Turns become metres where the lead is given; else all places must be of one sort. Returns ``"m"`` or
    ``"rad"``."""
    if "rad" not in units:
        return "m"
    if "lead" not in description.facts:
        if "m" in units:
            raise InputError(f"{description.place}: lead", None, "the lead, for it holds lengths and angles together")
        return "rad"
    per_radian = description.facts["lead"] / TURN / description.facts.get("gear_ratio", 1.0)
    for name, entry in description.quantities.items():
        if (
            name in signals
            and name not in EFFORTS
            and entry.dimension in ("angle", "counts", "angular speed", "count rate")
        ):
            signals[name] = signals[name] * per_radian
    notes.append(
        "Angles were turned into lengths by the lead"
        + (" and the gear ratio." if "gear_ratio" in description.facts else ".")
    )
    return "m"


def _effort_in_si(log):
    """A ratio of the nominal value becomes the quantity itself where the nominal value is given."""
    if not log.effort or log.effort_unit != "1":
        return
    nominal = log.facts.get(f"nominal_{log.effort}")
    if nominal:
        log.signals[log.effort] = log.signals[log.effort] * nominal
        log.effort_unit = {"current": "A", "torque": "N m", "force": "N", "voltage": "V"}[log.effort]


def _clean(signals, piece, effort):
    """Outliers and saturated samples become missing ones; quantisation is reported. Returns sentences."""
    notes = []
    for name, values in signals.items():
        bad = quality.outliers(values, piece)
        if bad.any() and bad.mean() < 0.01:
            values[bad] = np.nan
            notes.append(f"{int(bad.sum())} single samples of {name} far off both neighbours count as missing.")
    if effort:
        at_limit = quality.saturation(signals[effort])
        if at_limit.any():
            signals[effort][at_limit] = np.nan
            notes.append(
                f"{effort} stands at its limit in {at_limit.mean():.1%} of the rows (saturated); they are left out."
            )
        step = quality.quantum(signals[effort])
        if step:
            notes.append(f"{effort} is quantised in steps of {step:.3g} of its SI unit.")
    return notes


def _labels(table, names, path, place):
    """Index and list of the labels that these columns make together."""
    if not names:
        return np.zeros(table.rows, int), [()]
    columns = [column_of(table, name, path, place) for name in names]
    codes, tables = np.zeros(table.rows, int), []
    for values in columns:
        levels, index = np.unique(values, return_inverse=True)
        codes = codes * len(levels) + index
        tables.append(values)
    _, first, index = np.unique(codes, return_index=True, return_inverse=True)
    return index, [tuple(_plain(values[k]) for values in tables) for k in first]


def _plain(value):
    return float(value) if isinstance(value, (float, np.floating)) else str(value)


def _resampled(log):
    """Every piece on its usual period, by linear interpolation; labels are those of the row before."""
    parts = []
    for number in np.unique(log.piece):
        own = np.flatnonzero(log.piece == number)
        if len(own) < 3:
            continue
        time = np.arange(log.time[own[0]], log.time[own[-1]], log.period)
        held = own[np.searchsorted(log.time[own], time, side="right") - 1]
        parts.append((time, held, {k: np.interp(time, log.time[own], v[own]) for k, v in log.signals.items()}))
    if not parts:
        return log
    held = np.concatenate([p[1] for p in parts])
    whole = log.rows(held)
    whole.time = np.concatenate([p[0] for p in parts])
    whole.signals = {k: np.concatenate([p[2][k] for p in parts]) for k in log.signals}
    return whole
