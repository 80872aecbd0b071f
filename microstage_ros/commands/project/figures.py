"""``figures``: measures the tables of the documentation anew and stamps each with version, machine and state of the
code.

A table of another area is added by one line in `TABLES` and its two comments in the page
(`microstage_ros.report.stamped`).
"""

import sys
import time

from microstage_ros.commands import answer
from microstage_ros.commands.parser import Parser
from microstage_ros.places import SOURCE
from microstage_ros.quantities.errors import InputError
from microstage_ros.report.stamped import Table, is_stale, mark_stale, read_stamp, write_table

DIAGNOSIS = ("diagnosis", "model", "solver")
TABLES = (
    Table(
        "campaign", "docs/diagnosis.md", "microstage_ros.diagnosis.validation.tables:campaign_table", DIAGNOSIS, 90.0
    ),
    Table(
        "second-world",
        "docs/diagnosis.md",
        "microstage_ros.diagnosis.validation.tables:second_world_table",
        DIAGNOSIS,
        90.0,
    ),
    Table(
        "emps",
        "docs/emps.md",
        "microstage_ros.diagnosis.validation.tables:emps_table",
        ("diagnosis/resimulation", "solver", "control/laws"),
        8.0,
    ),
)
"""Every stamped table of the documentation."""


def main(argv=None):
    """Run the command. Returns 0, with ``--check`` 1 if a stale table does not say so; raises InputError for bad
    input."""
    parser = Parser(
        prog="microstage figures",
        description="Measures tables of the documentation anew and stamps them: version, "
        "machine, date, and a digest of the code that they are about.",
    )
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="tables (default all): " + ", ".join(t.name for t in TABLES)
    )
    parser.add_argument(
        "--check", action="store_true", help="measure nothing; list the tables and fail if a stale one does not say so"
    )
    parser.add_argument("--mark", action="store_true", help="measure nothing; let stale tables say so to their reader")
    arguments = parser.parse_args(argv)
    known = {table.name: table for table in TABLES}
    for name in arguments.names:
        if name not in known:
            raise InputError("figures: NAME", name, "one of " + ", ".join(known))
    chosen = [known[name] for name in arguments.names] or list(TABLES)
    if arguments.check or arguments.mark:
        return _check(chosen, arguments.mark)
    for table in chosen:
        print(f"{table.name}: about {table.minutes:g} min of one idle core …", file=sys.stderr, flush=True)
        began = time.monotonic()
        write_table(SOURCE, table, table.make())
        print(f"{table.name}: {table.page}, {time.monotonic() - began:.0f} s")
    answer.state(tables=[{"name": table.name, "page": table.page} for table in chosen])
    return 0


def _check(tables, mark):
    """List the tables; the exit status."""
    bad, rows = 0, []
    for table in tables:
        if mark:
            mark_stale(SOURCE, table)
        stale, stamp = is_stale(SOURCE, table), read_stamp(SOURCE, table)
        state = "fresh" if not stale else "stale, and says so" if stamp.marked else "stale, and does not say so"
        bad += stale and not stamp.marked
        print(f"{table.name:14s} {table.page:22s} {stamp.version} {stamp.made}  {state}  ({stamp.machine})")
        rows.append(
            {
                "name": table.name,
                "page": table.page,
                "version": stamp.version,
                "made": str(stamp.made),
                "state": state,
                "machine": stamp.machine,
            }
        )
    answer.state(tables=rows)
    return 1 if bad else 0
