"""``figures``: measures the tables of the documentation anew and stamps each with version, machine and state of the
code.

A table of another area is added by its two comments in the page (`microstage_ros.report.stamped`), a line in
`microstage_ros.commands.tables.CODE`, and a line in `RUNS`.
"""

import functools
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from microstage_ros.commands import answer
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.project import first_day
from microstage_ros.commands.tables import code_of, command_of
from microstage_ros.files import write_text
from microstage_ros.places import SOURCE
from microstage_ros.quantities.errors import InputError
from microstage_ros.report.stamped import find_table, is_stale, mark_stale, read_tables, stamp_now, write_table

CONTROL_PAGES = ("docs/evidence/control.md", "docs/evidence/control_reasons.md", "docs/evidence/control_results.md")
OPPONENTS = str(SOURCE / "docs/evidence/opponents.json")
"""What `compare` found last: the fixed laws of the table of conditions."""
ROBUSTNESS = (
    ("--seeds", "5", "--seed", "12100", "--beside", "self_tuning", "--opponents", OPPONENTS),
    ("--seeds", "5", "--seed", "12400", "--random", "200", "--first", "8200", "--beside", "self_tuning"),
    ("--moves", "1003", "--seed", "9000", "--only", "nominal", "backlash 0.1 deg", "backlash 0.25 deg",
     "backlash 0.5 deg", "backlash 1 deg", "backlash 0.5 deg, current noise 1 mA"),
    ("--margins", "--seeds", "2", "--seed", "12300"),
    ("--learned", "--seeds", "5", "--seed", "12700", "--only", "nominal", "mass x 0.3", "mass x 3", "mass x 10",
     "stiffness x 0.1", "stiffness x 0.33", "stiffness x 4", "rotor inertia x 0.25", "rotor inertia x 4",
     "mass x 6, stiffness / 3", "mass x 6, axis file right", "damping of the drive / 5", "torque constant x 0.8",
     "friction x 3"),
    ("--learned", "--seeds", "1", "--seed", "12800", "--random", "200", "--first", "8200"),
)
"""Options of `robustness` for its seven tables."""


@dataclass(frozen=True)
class Run:
    """What measures some tables of the documentation.

    Attributes
    ----------
    pages : relative to the checkout. minutes : of one idle core, about.
    measure : function (*pages, earlier) that writes them; ``earlier``: files of results to use instead.
    """

    pages: tuple[str, ...]
    measure: Callable
    minutes: float


def _campaign(page, world, earlier=()):
    from microstage_ros.diagnosis.validation.tables import campaign_table

    stamp = stamp_now(SOURCE, code_of("figures", world))
    found = _outcomes(earlier, world, stamp.code) if earlier else None
    write_table(page, "figures", world, campaign_table(world.removesuffix("-world"), found), stamp)


def _outcomes(files, world, code):
    """{(kind, strength): outcomes} of campaigns' JSON files. Raises `InputError` for one of another world or code."""
    from microstage_ros.commands.analysis.campaign import earlier_outcomes

    found = {}
    for path in map(Path, files):
        outcomes, tree = earlier_outcomes(path), json.loads(path.read_text(encoding="utf-8"))
        wanted = {"world": world.removesuffix("-world"), "code": code, "effect": "", "baseline": True}
        for name, value in wanted.items():
            if tree.get(name) != value:
                raise InputError(f"--from {path}: {name}", tree.get(name), f"{value!r}, for the table of today's code")
        found.setdefault((tree["kind"], tree["strength"]), []).extend(outcomes)
    return found


def _emps(page, earlier=()):
    from microstage_ros.diagnosis.validation.tables import emps_table

    stamp = stamp_now(SOURCE, code_of("figures", "emps"))
    write_table(page, "figures", "emps", emps_table(), stamp)


def _first_day(page, earlier=()):
    stamp = stamp_now(SOURCE, code_of("figures", "first-day"))
    write_table(page, "figures", "first-day", first_day.measured(page), stamp)


def _compare(*pages, earlier=()):
    from microstage_ros.commands.analysis import compare

    with tempfile.TemporaryDirectory() as folder:
        compare.main(["--out", os.path.join(folder, "all"), "--update", *pages])
        compare.main(["--out", os.path.join(folder, "searched"), "--opponents", "2000", "--update", *pages])
        write_text(OPPONENTS, (Path(folder) / "searched" / "opponents.json").read_text(encoding="utf-8"))


def _robustness(*pages, earlier=()):
    from microstage_ros.commands.analysis import robustness

    for options in ROBUSTNESS:
        robustness.main([*options, "--update", *pages])


RUNS = {
    "first-world": Run(("docs/diagnosis.md",), functools.partial(_campaign, world="first-world"), 240.0),
    "second-world": Run(("docs/diagnosis.md",), functools.partial(_campaign, world="second-world"), 240.0),
    "emps": Run(("docs/evidence/emps.md",), _emps, 8.0),
    "first-day": Run(("docs/first_day.md",), _first_day, 1.0),
    "compare": Run(CONTROL_PAGES, _compare, 180.0),
    "robustness": Run(CONTROL_PAGES[:1], _robustness, 15.0),
}
"""Name on the command line to what it runs."""


def main(argv=None):
    """Run the command. Returns 0, with ``--check`` 1 if a stale table does not say so; raises InputError for bad
    input."""
    parser = Parser(
        prog="microstage figures",
        description="Measures tables of the documentation anew and stamps them: version, "
        "machine, date, and a digest of the code that they are about.",
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="what to measure (default all): " + ", ".join(RUNS))
    parser.add_argument(
        "--check", action="store_true", help="measure nothing; list the tables and fail if a stale one does not say so"
    )
    parser.add_argument("--from", dest="earlier", nargs="+", default=[], metavar="JSON",
                        help="first-world or second-world, from these files of campaign --json, made with today's code")
    parser.add_argument("--mark", action="store_true", help="measure nothing; let stale tables say so to their reader")
    arguments = parser.parse_args(argv)
    for name in arguments.names:
        if name not in RUNS:
            raise InputError("figures: NAME", name, "one of " + ", ".join(RUNS))
    chosen = arguments.names or list(RUNS)
    if arguments.earlier and (len(chosen) != 1 or not chosen[0].endswith("-world")):
        raise InputError("--from", " ".join(chosen), "with first-world or second-world alone")
    if arguments.check or arguments.mark:
        return _check(SOURCE, {page for name in chosen for page in RUNS[name].pages}, arguments.mark)
    for name in chosen:
        if not arguments.earlier:
            print(f"{name}: about {RUNS[name].minutes:g} min of one idle core …", file=sys.stderr, flush=True)
        began = time.monotonic()
        RUNS[name].measure(*(str(SOURCE / page) for page in RUNS[name].pages), earlier=arguments.earlier)
        print(f"{name}: {', '.join(RUNS[name].pages)}, {time.monotonic() - began:.0f} s")
    answer.state(tables=[{"name": name, "pages": list(RUNS[name].pages)} for name in chosen])
    return 0


def state_of(root, table):
    """``fresh``, ``stale, and says so`` or ``stale, and does not say so``: of a table, as to the code of ``root``."""
    if not is_stale(root, table, code_of(table.owner, table.title)):
        return "fresh"
    said = table.says_that_it_is_stale(command_of(table.owner, table.title))
    return "stale, and says so" if said else "stale, and does not say so"


def _check(root, pages, mark):
    """List the tables of these pages; the exit status."""
    bad, rows = 0, []
    for page in sorted(pages):
        for table in read_tables(root / page):
            owner, title = table.owner, table.title
            if mark:
                table = find_table(root / page, owner, title)  # those above it have moved it
                mark_stale(root, root / page, table, code_of(owner, title), command_of(owner, title))
                table = find_table(root / page, owner, title)
            state = state_of(root, table)
            bad += state.endswith("does not say so")
            print(f"{page:33s} {table.stamp.made}  {state:26s} {owner}: {title}")
            rows.append({"page": page, "owner": owner, "title": title, "state": state, "version": table.stamp.version,
                         "made": table.stamp.made, "machine": table.stamp.machine})
    answer.state(tables=rows)
    return 1 if bad else 0
