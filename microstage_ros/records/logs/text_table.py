"""Text files as tables: separator, preamble, header, line of units and decimal comma are found, not asked for.

A file is: any preamble; a line of names; perhaps a line of units; rows. What is a row is decided by the longest
run of lines with the same number of fields of which at least one is a number in (nearly) every line.
"""

import csv
import dataclasses
import io
import re

import numpy as np

from microstage_ros.quantities.errors import InputError
from microstage_ros.records.compression import read_bytes
from microstage_ros.records.csv_text import polars_or_none
from microstage_ros.records.logs.units import known_unit

LOOK = 400                     # lines that are looked at to learn a file's form
DECIMAL_COMMA = re.compile(r"^[+-]?\d+,\d+(?:[eE][+-]?\d+)?$")
POINT = re.compile(r"^[+-]?\d*\.\d+(?:[eE][+-]?\d+)?$")
RATE = re.compile(r"_([a-zµ]+)_s$")        # a unit per second at the end of a name: stage_velocity_m_s
NAME_WITH_UNIT = re.compile(r"^(.*?)\s*[\[(]\s*([^\])]+?)\s*[\])]\s*$")


@dataclasses.dataclass
class Table:
    """Columns of a file as they stand in it: name → float64 array, or array of str where it is no number.

    ``units``: what the file itself says of a column's unit. ``sampling_s``: period that the file states, or None.
    ``notes``: what a reader should know of how it was read. ``kind``: the sort of file that was recognised.
    ``no_number``: column of numbers → (row counted from 1, text) of its first field that holds none.
    """

    columns: dict
    units: dict
    kind: str
    sampling_s: float | None = None
    notes: list = dataclasses.field(default_factory=list)
    no_number: dict = dataclasses.field(default_factory=dict)

    @property
    def rows(self):
        """Number of rows."""
        return len(next(iter(self.columns.values()))) if self.columns else 0


def decoded(path):
    """Text of a file, decompressed, with line feeds only."""
    raw = read_bytes(path).removeprefix(b"\xef\xbb\xbf")
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = raw.decode("utf-16", "replace")
    else:
        try:
            text = raw.decode("utf-8")
        except UnicodeDecodeError:
            text = raw.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def fields_of(line, separator):
    """Fields of one line; quotes are those of CSV; blanks as separator may repeat."""
    if separator == " ":
        return line.split()
    if '"' in line:
        return [field.strip() for field in next(csv.reader([line], delimiter=separator))]
    return [field.strip() for field in line.split(separator)]


def number_of(field):
    """The number that a field holds [its own unit], with a decimal comma too, or None."""
    if "_" in field:
        return None
    try:
        return float(field)
    except ValueError:
        return float(field.replace(",", ".")) if DECIMAL_COMMA.match(field) else None


def find_separator(lines):
    """The character that separates the fields of most lines into the same number of parts, more than one: a tab where
    it does so in nearly all, since texts between tabs have blanks and commas of their own."""
    best, score = ",", 0.0
    for separator in ("\t", ";", ",", " "):
        counts = [len(fields_of(line, separator)) for line in lines]
        values, times = np.unique([c for c in counts if c > 1] or [0], return_counts=True)
        if values[-1] <= 1:
            continue
        common = int(values[np.argmax(times)])
        rows = [fields_of(line, separator) for line in lines]
        numbers = sum(number_of(f) is not None for row in rows if len(row) == common for f in row)
        if separator == "\t" and numbers > 0 and times.max() >= 0.9 * len(lines):
            return separator
        if numbers > score * 1.001:
            best, score = separator, numbers
    return best


def parse(text, path, separator="", skip_rows=None):
    """`Table` of a text file. Raises InputError if there are no rows of numbers."""
    # every line is looked at only until the rows have begun: a log may have millions
    head = text[: 400 * LOOK].split("\n")[:LOOK]
    start_at = skip_rows or 0
    kept = [
        (number, line.lstrip("#%").strip("\n"))
        for number, line in enumerate(head)
        if number >= start_at and line.strip()
    ]
    if not kept:
        raise InputError(path, "no lines", "rows of numbers")
    separator = separator or find_separator([line for _, line in kept][-LOOK // 2:])
    rows = [(number, fields_of(line, separator)) for number, line in kept]
    widths, times = np.unique([len(fields) for _, fields in rows[len(rows) // 2:]], return_counts=True)
    width = int(widths[np.argmax(times)])
    first = next(
        (k for k, (_, fields) in enumerate(rows) if _is_row(fields, width) and _rows_follow(rows, k, width)), None
    )
    if first is None:
        raise InputError(f"{path}: line {kept[0][0] + 1}", kept[0][1][:60], "rows of numbers below the header"
                         f" (separator {separator!r})")
    names, units = _names(rows, first, width)
    body_line = rows[first][0]
    columns, notes, no_number = _columns(text, body_line, width, separator, path)
    if (
        width
        and not names[-1]
        and np.all(columns[-1] != columns[-1] if columns[-1].dtype.kind == "f" else columns[-1] == "")
    ):
        names, columns = names[:-1], columns[:-1]      # a separator at the end of every row
    names = [name or f"column {k + 1}" for k, name in enumerate(names)]
    unique = [
        name if names.index(name) == k else f"{name} ({names[:k].count(name) + 1})" for k, name in enumerate(names)
    ]
    return Table(
        dict(zip(unique, columns)),
        {unique[k]: unit for k, unit in units.items() if k < len(unique)},
        "text",
        None,
        notes,
        {unique[k]: found for k, found in no_number.items() if k < len(unique)},
    )


def _is_row(fields, width):
    return len(fields) == width and sum(number_of(f) is not None for f in fields) >= max(1, (len(fields) + 1) // 3)


def _rows_follow(rows, k, width):
    """Whether most of what follows are rows too."""
    following = rows[k: k + 20]
    return sum(_is_row(fields, width) for _, fields in following) >= 0.7 * len(following)


def _names(rows, first, width):
    """Names of the columns and the units that the file tells: from the one or two lines before the first row."""
    names, units = [""] * width, {}
    above = [
        fields
        for _, fields in rows[:first]
        if len(fields) == width or (len(fields) == width - 1 and fields[-1:] != [""])
    ]
    texts = [fields for fields in above[-3:] if not _is_row(fields, width)]
    if (
        texts
        and all(not f or known_unit(f) or f in ("-", "[-]") for f in texts[-1])
        and any(known_unit(f) for f in texts[-1])
    ):
        units = {k: f.strip("[]()") for k, f in enumerate(texts[-1]) if known_unit(f.strip("[]()"))}
        texts = texts[:-1]
    if texts:
        names = (texts[-1] + [""] * width)[:width]
    for k, name in enumerate(names):
        found = NAME_WITH_UNIT.match(name)
        if found and known_unit(found[2]):
            names[k], units[k] = found[1].strip(), found[2]
        elif k not in units and (rate := RATE.search(name)) and known_unit(f"{rate[1]}/s"):
            units[k] = f"{rate[1]}/s"
        elif "_" in name and k not in units and name.rsplit("_", 1)[1] and known_unit(name.rsplit("_", 1)[1]):
            if len(name.rsplit("_", 1)[1]) > 1 or name.rsplit("_", 1)[1] in ("s", "A", "V", "m", "N"):
                units[k] = name.rsplit("_", 1)[1]
    if not names[0] and known_unit(units.get(0, "")) and known_unit(units[0])[0] == "time":
        names[0] = "time"
    return names, units


def _columns(text, body_line, width, separator, path):
    """All columns below line ``body_line``, notes on what was left out, and the first field of each column of numbers
    that holds none."""
    start = 0
    for _ in range(body_line):
        start = text.find("\n", start) + 1
    body, notes = _without_cut_line(text[start:].rstrip("\n"), width, separator)
    if separator == " ":
        body = re.sub(r"[ \t]+", " ", body)
        body = "\n".join(line.strip() for line in body.split("\n"))
    if separator != "," and "," in body:
        body = _with_points(body, width, separator, path)
    body = _even(body, width, separator, notes)
    polars = polars_or_none()
    columns, no_number = None, {}
    if polars is not None:
        columns = _by_polars(polars, body, width, separator, notes, no_number)
    if columns is None:
        columns = _by_hand(body, width, separator, notes, no_number)
    if not len(columns) or not len(columns[0]):
        raise InputError(path, "no rows", "rows of numbers")
    return columns, notes, no_number


def _with_points(body, width, separator, path):
    """The body with decimal points in fields that are numbers with a decimal comma; commas in texts stay.

    Raises `InputError`: numbers with decimal points beside them."""
    edge = re.escape(separator)
    comma_field = re.compile(rf'((?:^|[\n{edge}]) *"?[+-]?\d+),(\d+(?:[eE][+-]?\d+)?"? *(?=[\n{edge}]|$))')
    if found := comma_field.search(body):
        _refuse_points(body, width, separator, found[0].strip(f'\n{separator} "'), path)
    return comma_field.sub(r"\1.\2", body)


def _refuse_points(body, width, separator, comma, path):
    """InputError if a column holds numbers with decimal points where ``comma`` has a comma: one of the two separates
    thousands, and nobody knows which."""
    for k in range(width):
        points = {}
        for line in body[: 400 * LOOK].split("\n")[:LOOK]:
            fields = fields_of(line, separator)
            if len(fields) == width and POINT.match(fields[k]):
                points[fields[k]] = None
        if len(points) > 1:   # one alone may be a version
            raise InputError(path, f"{next(iter(points))} in column {k + 1}, and {comma}",
                             "decimal points or decimal commas, and no thousands separators")


def _even(body, width, separator, notes):
    """The body without lines of another number of fields, whose numbers may stand in wrong columns; a note on these."""
    if body.count(separator) == body.count("\n") * (width - 1) and '"' not in body:
        return body
    lines = [line for line in body.split("\n") if line.strip() and not line.startswith("#")]
    whole = [line for line in lines if len(fields_of(line, separator)) == width]
    if len(whole) < len(lines):
        notes.append(f"{len(lines) - len(whole)} lines with another number of fields are left out")
    return "\n".join(whole) + "\n"


def _without_cut_line(body, width, separator):
    """The body with a line feed at its end, less a last line of fewer fields than the others, and notes on that."""
    above, _, last = body.rpartition("\n")
    found = len(fields_of(last.strip() if separator == " " else last, separator))
    if not above or found >= width:
        return body + "\n", []
    return above + "\n", [f"the last line is cut ({found} of {width} fields) and left out"]


def _by_polars(polars, body, width, separator, notes, no_number):
    names = [str(k) for k in range(width)]
    try:
        table = polars.read_csv(io.BytesIO(body.encode()), has_header=False, separator=separator, infer_schema=False,
                                new_columns=names, ignore_errors=True)
    except polars.exceptions.PolarsError:
        return None
    if table.width != width:
        return None
    columns = []
    for name in names:
        text = table[name].fill_null("").str.strip_chars()
        values = text.cast(polars.Float64, strict=False)
        wrong = values.is_null() & (text != "")
        bad = int(wrong.sum())
        if bad > 0.5 * len(text):
            columns.append(np.asarray(text.to_list(), dtype=str))
            continue
        if bad:
            notes.append(f"{bad} fields of column {int(name) + 1} hold no number and count as missing")
            no_number[int(name)] = (int(wrong.arg_max()) + 1, text[int(wrong.arg_max())])
        columns.append(values.fill_null(np.nan).to_numpy().astype(float))
    return columns


def _by_hand(body, width, separator, notes, no_number):
    columns = []
    for k, texts in enumerate(zip(*(fields_of(line, separator) for line in body.split("\n") if line))):
        values = [number_of(t) if t else np.nan for t in texts]
        bad = sum(v is None for v in values)
        if bad and bad <= 0.5 * len(texts):
            no_number[k] = (values.index(None) + 1, texts[values.index(None)])
        columns.append(
            np.array(texts) if bad > 0.5 * len(texts) else np.array([np.nan if v is None else v for v in values])
        )
    return columns
