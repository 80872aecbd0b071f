"""One record: what an axis did, as columns over a constant period."""

import json
from dataclasses import dataclass, field

import numpy as np

from microstage_ros.quantities.command import command_of
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.columns import COMMANDS, KNOWN_COLUMNS, REQUIRED


@dataclass
class Record:
    """Columns of equal length over a constant sampling period.

    Row n holds the sensors read at the start of period n and the command held during it.
    A missing sample is NaN.

    Attributes
    ----------
    period_s : sampling period [s].
    columns : name (`records.columns.KNOWN_COLUMNS`) to values, each of shape (n,), float64, SI.
        `t_s` is always among them.
    source : where the record came from (file name); used in messages.
    metadata : version, configuration, seed and whatever else the writer left.
    remarks : what reading it showed that weakens it, one sentence each; a command prints them as warnings.

    Raises
    ------
    InputError : a column that nobody knows, of another length, or not one-dimensional.
    """

    period_s: float
    columns: dict
    source: str = "record"
    metadata: dict = field(default_factory=dict)
    remarks: tuple = ()

    def __post_init__(self):
        self.columns = {name: np.asarray(values, dtype=float) for name, values in self.columns.items()}
        refuse_unknown(self.source, self.columns)
        if not np.isfinite(self.period_s) or self.period_s <= 0.0:
            raise InputError(f"{self.source}: period", self.period_s, "a sampling period above 0 s")
        shapes = {values.shape for values in self.columns.values()}
        if len(shapes) != 1 or len(next(iter(shapes))) != 1:
            lengths = {name: values.shape for name, values in self.columns.items()}
            raise InputError(f"{self.source}: columns", lengths, "columns of one and the same length")
        if "t_s" not in self.columns:
            rows = len(next(iter(self.columns.values())))
            self.columns = {"t_s": np.arange(rows) * self.period_s, **self.columns}

    def __len__(self):
        return len(self.columns["t_s"])

    def __getitem__(self, name):
        """Values of one column, shape (n,).  Raises InputError if the record lacks it."""
        if name not in self.columns:
            raise InputError(f"{self.source}: column {name}", "missing",
                             f"a record with it; this one has {', '.join(self.columns)}")
        return self.columns[name]

    def __contains__(self, name):
        """True if the column exists and holds at least one value."""
        return name in self.columns and not np.isnan(self.columns[name]).all()

    @property
    def command(self):
        """The command held during each period, shape (n,), in the unit of its column; InputError without one."""
        found = command_of(self.columns)
        return self[found.column if found else "voltage_V"]

    @property
    def disturbance(self):
        """The part of `command` that was added on purpose, shape (n,); InputError without its column."""
        found = command_of(self.columns)
        return self[found.disturbance if found else "disturbance_V"]

    @property
    def duration_s(self):
        """Length of the record [s], n periods."""
        return len(self) * self.period_s

    def rows(self, start, stop):
        """The rows `start` <= n < `stop` [1] as a record of their own; times stay as they were."""
        part = {name: values[start:stop] for name, values in self.columns.items()}
        return Record(self.period_s, part, self.source, dict(self.metadata), self.remarks)


def refuse_unknown(source, names):
    """Raise InputError for a column name that is not in `KNOWN_COLUMNS`, listing those that are."""
    for name in names:
        if name not in KNOWN_COLUMNS:
            raise InputError(f"{source}: column", name, "one of " + ", ".join(KNOWN_COLUMNS))


def require_columns(source, names, required=REQUIRED, one_of=COMMANDS):
    """Raise InputError if `names` lacks one of `required`, or all of `one_of`."""
    for name in required:
        if name not in names:
            raise InputError(f"{source}: header", ",".join(names), f"a column {name}")
    if one_of and not any(name in names for name in one_of):
        raise InputError(f"{source}: header", ",".join(names), "a column " + " or ".join(one_of))


def metadata_value(text):
    """A piece of metadata as it stands in a file: JSON if it is that, else the text itself."""
    try:
        return json.loads(text)
    except ValueError:
        return text
