"""``cut``: a part of a record, or all of it, as a record of its own."""

from pathlib import Path

import numpy as np

from microstage_ros.commands import answer, units
from microstage_ros.commands.parser import Parser
from microstage_ros.files import complete_folder, keep_earlier
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import read_record, write_record
from microstage_ros.records.columns import ENDINGS

DESCRIPTION = """\
Writes the rows of a record between two times, or all of them, as a record of its own: the minutes before a stop, the
one move that matters, a bag as a table. Times are those of the record's column t_s; a CSV file keeps them, a bag
begins at 0 again.
"""


def main(argv=None):
    """Run the command. Returns 0; raises InputError for bad input, and where no two rows are left."""
    parser = Parser(prog="microstage cut", description=DESCRIPTION)
    parser.add_argument("record", metavar="RECORD", help="a bag (.mcap or a folder) or a CSV file (.csv[.gz|.xz])")
    parser.add_argument("--out", required=True, metavar="FILE", help="record to write: " + ", ".join(ENDINGS))
    parser.add_argument("--from", dest="first", type=units.moment, metavar="TIME",
                        help="the first row is the one at this time or the next (default: of the record)")
    parser.add_argument("--to", dest="end", type=units.moment, metavar="TIME",
                        help="rows before this time (default: to the end)")
    parser.add_argument("--namespace", type=units.namespace, metavar="NS", help="of the axis, in a bag of several")
    parser.add_force()
    arguments = parser.parse_args(argv)
    if not arguments.out.endswith(ENDINGS):
        raise InputError("--out", arguments.out, "a file name ending in " + ", ".join(ENDINGS))
    out = Path(arguments.out)
    if out.exists() and Path(arguments.record).exists() and out.samefile(arguments.record):
        raise InputError("--out", arguments.out, "another file than the record")
    keep_earlier("--out", [out], arguments.force)
    part = between(read_record(arguments.record, arguments.namespace), arguments.first, arguments.end)
    with complete_folder(out.parent) as folder:
        write_record(part, folder / out.name)
    first, last = (float(part["t_s"][k]) for k in (0, -1))
    answer.state(record=str(out), rows=len(part), period_s=part.period_s, columns=list(part.columns), first_s=first,
                 last_s=last)
    print(f"{out}: {len(part)} rows, {first:.6g} to {last:.6g} s")
    return 0


def between(record, first=None, end=None):
    """The rows of a `Record` at ``first`` <= t < ``end`` [s]; None: from its start, to its end.

    Raises InputError: fewer than two rows are left; says from when to when the record goes.
    """
    time = record["t_s"]
    late = 1e-6 * record.period_s     # a time that is written in decimals is the row's
    start = 0 if first is None else int(np.searchsorted(time, first - late))
    stop = len(time) if end is None else int(np.searchsorted(time, end - late))
    if stop - start < 2:
        place, value = ("--to", end) if end is not None else ("--from", first)
        raise InputError(place, value, f"times that leave two rows and more: {record.source} goes from {time[0]:.6g} to"
                                       f" {time[-1]:.6g} s, with a row every {record.period_s:g} s")
    return record.rows(start, stop)
