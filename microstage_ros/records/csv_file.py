"""Records as CSV, plain or compressed, read fast and refused with line and field.

A file is: lines beginning with `#` (comments, of which `# key: value` is metadata), a header with
the names of `records.columns`, then rows of numbers over a constant period.  An empty field is a
missing sample.
"""

import json
from pathlib import Path

import numpy as np

from microstage_ros import __version__
from microstage_ros.files import unwritable
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.columns import COMMANDS, KNOWN_COLUMNS, REQUIRED, SUFFIXES, in_file_order
from microstage_ros.records.compression import read_bytes, write_bytes
from microstage_ros.records.csv_text import parse_rows, rows_text
from microstage_ros.records.record import Record, metadata_value, refuse_unknown, require_columns
from microstage_ros.records.timebase import constant_period

SHOWN = 40
"""Longest piece of a bad file that a message quotes."""


def read_csv(path, required=REQUIRED, one_of=COMMANDS):
    """Read a CSV file as a `Record`.

    Parameters
    ----------
    path : file ending in `.csv`, `.csv.gz` or `.csv.xz`.
    required : columns that must be there.
    one_of : columns of which at least one must be there; () for none.

    Raises
    ------
    InputError : anything that is not as the module says, with file, line, field, value and
        what would be right.
    """
    text = _text_of(path)
    names, first_row = _header(path, text)
    refuse_unknown(path, names)
    require_columns(path, names, required, one_of)
    columns = _numbers(path, text, names, first_row)
    period = constant_period(columns["t_s"], path, lambda row: f"line {_line_number(text, row)}")
    return Record(period, columns, str(path), _metadata(text))


def write_csv(record, path):
    """Write `record` to `path` (`.csv`, `.csv.gz` or `.csv.xz`).

    Values are rounded to the decimals of `records.columns` (0.1 pm, 0.1 nV …), NaN becomes an
    empty field, and `record.metadata` goes into comment lines above the header, the program's
    version first.

    Raises
    ------
    InputError : the file cannot be written.
    """
    try:
        write_bytes(path, _pieces(record))
    except OSError as error:
        raise unwritable(path, error) from None


def _pieces(record, rows_at_once=200_000):
    """The bytes of a CSV file, piece by piece so that memory stays small."""
    metadata = {"microstage_ros": __version__, **record.metadata}
    yield "".join(f"# {key}: {json.dumps(value, default=str)}\n" for key, value in metadata.items()).encode()
    names = in_file_order(record.columns)
    yield (",".join(names) + "\n").encode()
    for start in range(0, len(record), rows_at_once):
        part = slice(start, start + rows_at_once)
        yield rows_text([np.round(record.columns[name][part], KNOWN_COLUMNS[name].decimals) + 0.0 for name in names])


def _text_of(path):
    """Decompressed bytes of the file, without byte-order mark and trailing blank lines."""
    if not str(path).endswith(SUFFIXES):
        raise InputError(path, Path(path).suffix, "a file name ending in " + ", ".join(SUFFIXES))
    text = read_bytes(path).removeprefix(b"\xef\xbb\xbf").rstrip()
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return text


def _lines(text, start=0):
    """Yields (offset, line) for every line of `text` from offset `start`."""
    while start < len(text):
        end = text.find(b"\n", start)
        end = len(text) if end < 0 else end
        yield start, text[start:end]
        start = end + 1


def _shown(raw):
    """A piece of a file, short and printable."""
    return raw[:SHOWN].decode("utf-8", "replace")


def _header(path, text):
    """Names of the header line and the offset of the first row."""
    for offset, line in _lines(text):
        if line.startswith(b"#") or not line.strip():
            continue
        names = [name.strip().strip('"') for name in line.decode("utf-8", "replace").split(",")]
        _check_header(path, line, names)
        return names, offset + len(line) + 1
    raise InputError(path, "comments only", "a header line and rows")


def _check_header(path, line, names):
    """Refuse a header that is numbers, is separated otherwise, or names a column twice."""
    if len(names) == 1 and (b";" in line or b"\t" in line):
        raise InputError(f"{path}: header", _shown(line), "names separated by commas")
    if all(_number(name) is not None for name in names):
        raise InputError(f"{path}: header", _shown(line), "a line with the names of the columns")
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{path}: header", name, "every column once")


def _number(cell):
    """The number that a cell holds, or None."""
    if "_" in cell:  # Python reads 1_0 as ten, no other program does
        return None
    try:
        return float(cell)
    except ValueError:
        return None


def _numbers(path, text, names, first_row):
    """All columns as float64; the first cell that is no number is refused with its line."""
    body = text[first_row:]
    if not body:
        raise InputError(f"{path}: rows", 0, "at least 2 rows, to know the sampling period")
    if body.startswith(b"#") or b"\n#" in body:
        body = b"\n".join(line for _, line in _lines(body) if not line.startswith(b"#"))
    if body.count(b",") != (body.count(b"\n") + 1) * (len(names) - 1):
        raise _first_bad_row(path, text, names, first_row)
    try:
        columns = dict(zip(names, parse_rows(body, len(names))))
    except ValueError:
        raise _first_bad_row(path, text, names, first_row) from None
    if any(np.isinf(values).any() for values in columns.values()):
        raise _first_bad_row(path, text, names, first_row)
    return columns


def _first_bad_row(path, text, names, first_row):
    """The InputError for the first row with a wrong number of fields or a cell that is no number."""
    line_number = text.count(b"\n", 0, first_row)
    for _, line in _lines(text, first_row):
        line_number += 1
        if line.startswith(b"#"):
            continue
        cells = line.split(b",")
        if len(cells) != len(names):
            return InputError(f"{path}: line {line_number}", _shown(line),
                              f"{len(names)} fields, {len(cells)} found")
        for name, cell in zip(names, cells):
            number = _number(cell.decode("utf-8", "replace")) if cell else 0.0
            if number is None or np.isinf(number):
                return InputError(f"{path}: line {line_number}, field {name}", _shown(cell),
                                  "a finite number, or an empty field for a missing sample")
    return InputError(path, "rows that cannot be read", "numbers separated by commas")


def _line_number(text, row):
    """Line of the file, counted from 1, that holds data row `row`, counted from 0."""
    rows_seen = -2
    for number, (_, line) in enumerate(_lines(text), start=1):
        if line.startswith(b"#") or (rows_seen == -2 and not line.strip()):
            continue
        rows_seen += 1
        if rows_seen == row:
            return number
    raise ValueError(f"no data row {row}")


def _metadata(text):
    """`# key: value` lines above the header as a dict; a value that is JSON is read as such."""
    metadata = {}
    for _, line in _lines(text):
        if not line.startswith(b"#"):
            break
        key, colon, value = line[1:].decode("utf-8", "replace").partition(":")
        if colon:
            metadata[key.strip()] = metadata_value(value.strip())
    return metadata
