"""Records of an axis in and out: CSV and MCAP, one reader and one writer for both."""

from pathlib import Path

from microstage_ros.axis.errors import InputError
from microstage_ros.records.csv_file import SUFFIXES, read_csv, write_csv
from microstage_ros.records.record import Record

__all__ = ["Record", "read_record", "write_record"]

EXPECTED = "a CSV file (" + ", ".join(SUFFIXES) + ")"


def read_record(path):
    """Read a record from a CSV file.

    Raises
    ------
    InputError : no such file, another kind of file, or a defect in it, with its place.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(path, "no such file", EXPECTED)
    if str(path).endswith(SUFFIXES):
        return read_csv(path)
    raise InputError(path, path.suffix or path.name, EXPECTED)


def write_record(record, path):
    """Write a record to a CSV file.

    Raises
    ------
    InputError : another kind of file, or a place that cannot be written.
    """
    if str(path).endswith(SUFFIXES):
        write_csv(record, path)
    else:
        raise InputError(path, Path(path).suffix or path, EXPECTED)
