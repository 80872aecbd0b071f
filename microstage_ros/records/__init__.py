"""Records of an axis in and out: CSV and MCAP, one reader and one writer for both."""

from pathlib import Path

from microstage_ros.files import missing
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.columns import SUFFIXES
from microstage_ros.records.record import Record

__all__ = ["Record", "read_record", "write_record"]

EXPECTED = f"a bag of this project (.mcap or a rosbag2 folder) or a CSV file ({', '.join(SUFFIXES)})"


def read_record(path, namespace=None):
    """Read a record from a CSV file, an MCAP file or a rosbag2 folder.

    Parameters
    ----------
    path : the file or folder.
    namespace : of the axis, in a bag with several.

    Raises
    ------
    InputError : file not found, another kind of file, or a defect in it, with its place.
    """
    path = Path(path)
    if not path.exists():
        raise missing(path, EXPECTED)
    if path.is_dir() or path.suffix in (".mcap", ".db3"):
        from microstage_ros.records.bags.bag_record import (
            bag_to_record,  # a node needs none of these, and starts the sooner
        )

        return bag_to_record(path, namespace)
    if str(path).endswith(SUFFIXES):
        from microstage_ros.records.csv_file import read_csv

        return read_csv(path)
    raise InputError(path, path.suffix or path.name, EXPECTED)


def write_record(record, path):
    """Write a record to a CSV file, an MCAP file, or (a name without suffix) a rosbag2 folder.

    Raises
    ------
    InputError : another kind of file, or a place that cannot be written.
    """
    path = Path(path)
    if str(path).endswith(SUFFIXES):
        from microstage_ros.records.csv_file import write_csv

        write_csv(record, path)
    elif path.suffix in (".mcap", ""):
        from microstage_ros.records.bags.bag_record import record_to_bag

        record_to_bag(record, path)
    else:
        raise InputError(path, path.suffix, EXPECTED)
