"""Text files that are no plain tables: halscope, EPICS camonitor, TwinCAT Scope; and the preamble of EPOS Studio.

Sources: LinuxCNC src/hal/utils/scope_files.c (``Sampling period is N ns``, then ``label value label value …`` per
line); EPICS base, camonitor (``PV date time value [status severity]``); Beckhoff Infosys TE13xx, export in CSV (per
channel or per sampling time a time column in milliseconds; an EOF tag; rows of metadata that repeat their key).
"""

import re

import numpy as np

from microstage_ros.quantities.errors import InputError
from microstage_ros.records.logs.text_table import Table, decoded, fields_of, find_separator, parse

HALSCOPE = re.compile(r"Sampling period is (\d+) ns")
CAMONITOR = re.compile(r"^(\S+)\s+(\d{4}-\d\d-\d\d)\s+(\d\d:\d\d:\d\d(?:\.\d+)?)\s+([^\s]+)(.*)$")
TWINCAT_KEYS = ("SymbolName", "SampleTime[ms]", "Data-Type", "SymbolComment", "Starttime of export", "VariableSize")
TWINCAT_META = {
    "Name",
    "SymbolName",
    "SymbolComment",
    "NetId",
    "NetID",
    "Port",
    "IndexGroup",
    "IndexOffset",
    "Data-Type",
    "SampleTime[ms]",
    "SymbolBased",
    "VariableSize",
    "Offset",
    "ScaleFactor",
    "BitMask",
    "Unit",
    "Unit ScaleFactor",
    "Unit Offset",
    "StartTime",
    "EndTime",
    "File",
    "Starttime of export",
    "Endtime of export",
}


def read_text(path, separator="", skip_rows=None):
    """`Table` of a text file of any of these sorts, or of a plain table."""
    text = decoded(path)
    head = text[:4000]
    halscope = HALSCOPE.search(head)
    if halscope:
        return _halscope(text, path, int(halscope[1]) * 1e-9)
    lines = [line for line in head.split("\n") if line.strip()][:20]
    if lines and sum(bool(CAMONITOR.match(line)) for line in lines) > 0.7 * len(lines):
        return _camonitor(text)
    if any(key in head for key in TWINCAT_KEYS[:2]) or head.startswith("Name\t") and "Starttime of export" in head:
        return _twincat(text, path)
    table = parse(text, path, separator, skip_rows)
    if "EPOS Studio" in head:
        table.kind = "EPOS Studio export"
        found = re.search(r"Sampling period:[;,\t]*([\d.]+)", head)
        table.sampling_s = float(found[1]) * 1e-3 if found else None
    return table


def _halscope(text, path, period):
    rows = [line.split() for line in text.split("\n")[1:] if line.strip()]
    if not rows:
        raise InputError(path, "no samples", "lines of labels and values below the sampling period")
    labels = rows[0][::2]
    if len(labels) != len(set(labels)) or len(rows[0]) % 2:
        raise InputError(f"{path}: line 2", " ".join(rows[0])[:60], "pairs of label and value, every label once")
    whole = [row for row in rows if len(row) == len(rows[0])]
    try:
        values = np.array([[float(v) for v in row[1::2]] for row in whole])
    except ValueError as error:
        raise InputError(path, str(error), "pairs of label and value") from None
    notes = [f"{len(rows) - len(whole)} incomplete lines are left out"] if len(whole) < len(rows) else []
    columns = {"time": np.arange(len(values)) * period, **{name: values[:, k] for k, name in enumerate(labels)}}
    return Table(columns, {"time": "s"}, "LinuxCNC halscope", period, notes)


def _camonitor(text):
    """One column per process variable over the union of all stamps; a variable holds its value until the next."""
    names, stamps, values = [], [], []
    left = 0
    for line in text.split("\n"):
        found = CAMONITOR.match(line)
        if found:
            try:
                value = float(found[4])
            except ValueError:
                left += 1
                continue
            names.append(found[1])
            stamps.append(f"{found[2]}T{found[3]}")
            values.append(value)
        elif line.strip():
            left += 1
    moments = np.array(stamps, dtype="datetime64[ns]").astype(np.int64) * 1e-9
    union = np.unique(moments)
    columns = {"time": union - union[0]}
    sources, numbers = np.array(names), np.array(values)
    for name in dict.fromkeys(names):
        own = sources == name
        order = np.argsort(moments[own], kind="stable")
        at, held = moments[own][order], numbers[own][order]
        place = np.searchsorted(at, union, side="right") - 1
        columns[name] = np.where(place >= 0, held[np.maximum(place, 0)], np.nan)
    notes = ["every process variable holds its value until its next event"]
    if left:
        notes.append(f"{left} lines without a number (disconnected, text) are left out")
    return Table(columns, {"time": "s"}, "EPICS camonitor", None, notes)


def _twincat(text, path):
    lines = text.split("\n")
    data = next((k for k, line in enumerate(lines) if line.strip() and _starts_with_number(line)), None)
    if data is None:
        raise InputError(path, "no rows", "rows of numbers below the channels' header")
    separator = find_separator(lines[data: data + 50])
    meta = {}
    for line in lines[:data]:
        fields = fields_of(line, separator)
        if fields and fields[0] in TWINCAT_META:
            meta[fields[0]] = fields          # later lines are those of the channels
    body = "\n".join(line for line in lines[data:] if line.strip() and line.strip() != "EOF")
    table = parse(body, path, separator)
    raw = list(table.columns.values())
    heads = meta.get("SymbolName") or meta.get("Name") or []
    units = meta.get("Unit", [])
    columns, units_of_columns, notes, step = {}, {}, list(table.notes), None
    keys = set(TWINCAT_META)
    times = [k for k in range(len(raw)) if k < len(heads) and heads[k] in keys] or [0]
    main = raw[times[0]] * 1e-3
    columns["time"], units_of_columns["time"] = main, "s"
    for k, values in enumerate(raw):
        if k in times:
            continue
        own = raw[max(t for t in times if t <= k)] * 1e-3 if any(t <= k for t in times) else main
        name = (
            (heads[k] if k < len(heads) and heads[k] else f"column {k + 1}").split(".")[-1]
            if heads
            else f"column {k + 1}"
        )
        name = name if name not in columns else f"{name} ({k + 1})"
        columns[name] = values if own is main or np.array_equal(own, main, equal_nan=True) else _at(own, values, main)
        if k < len(units) and units[k]:
            units_of_columns[name] = units[k].split(" (")[0]        # 'mm (Length)'
    if len(main) > 1:
        step = float(np.median(np.diff(main)))
    return Table(columns, units_of_columns, "TwinCAT Scope export", step, notes)


def _at(own, values, wanted):
    """Values on another time line, held until the next sample; nothing beyond the last."""
    good = np.isfinite(own) & np.isfinite(values)
    place = np.searchsorted(own[good], wanted, side="right") - 1
    return (
        np.where(place >= 0, values[good][np.maximum(place, 0)], np.nan) if good.any() else np.full(len(wanted), np.nan)
    )


def _starts_with_number(line):
    return bool(re.match(r"^\s*[+-]?\d+(?:[.,]\d+)?\s*[\t;,]\s*[+-]?\d", line))
