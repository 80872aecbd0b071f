"""``compare``: the paper's Fig. 10, Fig. 11 and Table 4, for every controller."""

import functools
import json
import os
import pathlib

import numpy as np
from rich.console import Console
from rich.table import Table

from microstage_ros import __version__
from microstage_ros.commands import answer
from microstage_ros.commands.axis import check_effects_fit, read_axis
from microstage_ros.commands.drives import check_drive
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.progress import progress
from microstage_ros.commands.tables import check_documents, save_markdown, update_tables
from microstage_ros.control.evaluation import comparison, opponents
from microstage_ros.diagnosis.fleet import in_order
from microstage_ros.files import complete_folder, keep_earlier
from microstage_ros.hardware.simulated import machine_for
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.report.comparison import comparison_page, comparison_tables

DEFAULT_AXIS = str(config_file("axis.yaml"))
WIDEST = 400
"""Letters of a line of a printed table, at most."""


def main(argv=None):
    """Run the command. Returns 0; raises InputError for bad input."""
    arguments = _parse(argv)
    axis = read_axis(arguments.axis)
    if arguments.machine:
        machine = machine_for(axis, arguments.machine)
        check_effects_fit(machine)
        axis = axis.simulated_on(machine)
    check_drive("compare", axis)
    if arguments.opponents:
        return _contest(arguments, axis)
    extent = comparison.QUICK if arguments.quick else comparison.Extent()
    if arguments.seeds:
        extent = extent._replace(seeds=arguments.seeds)
    keep_earlier("--out", [pathlib.Path(arguments.out) / "comparison.json"], arguments.force)
    with progress("comparing", remembered=f"compare {extent} {len(arguments.controllers)} {arguments.jobs}") as bar:
        result = comparison.compare(
            axis,
            extent,
            arguments.controllers,
            arguments.jobs,
            bar.say,
            functools.partial(in_order, scheduler=arguments.scheduler) if arguments.scheduler else None,
        )
    page = comparison_page(
        result, comparison.PAPER_4S, comparison.PAPER_SINE, arguments.axis, f"0 … {extent.seeds - 1}"
    )
    facts = {"version": __version__, "axis": axis.as_dict(), "seeds": extent.seeds, **_plain(result)}
    tables = comparison_tables(result, comparison.PAPER_4S, comparison.PAPER_SINE)
    with complete_folder(arguments.out) as folder:
        page.save(folder / "report.html")
        (folder / "comparison.json").write_text(json.dumps(facts, indent=1) + "\n")
        save_markdown(folder / "tables.md", tables)
    answer.state(**facts)
    update_tables(arguments.update, tables, "compare")
    _show(tables)
    print(pathlib.Path(arguments.out) / "report.html")
    return 0


def _contest(arguments, axis):
    """Fixed laws searched by differential evolution against the self-tuning ones: tables, and what was found."""
    keep_earlier("--out", [pathlib.Path(arguments.out) / "opponents.json"], arguments.force)
    with progress("searching", remembered=f"opponents {arguments.opponents}") as bar:
        found, table = opponents.contest(axis, arguments.opponents, progress=bar.say, known=_known(arguments))
    tables = opponents.contest_tables(found, table)
    facts = {
        "version": __version__,
        "axis": axis.as_dict(),
        "search_seeds": list(opponents.SEARCH_SEEDS),
        "judged_seeds": list(opponents.JUDGED_SEEDS),
        "opponents": [opponent._asdict() for opponent in found],
        "figures": {name: {kind: figures._asdict() for kind, figures in row.items()} for name, row in table.items()},
    }
    with complete_folder(arguments.out) as folder:
        (folder / "opponents.json").write_text(json.dumps(_plain(facts), indent=1) + "\n")
        save_markdown(folder / "tables.md", tables)
    answer.state(**facts)
    update_tables(arguments.update, tables, "compare")
    _show(tables)
    print(pathlib.Path(arguments.out) / "opponents.json")
    return 0


def _known(arguments):
    """Fixed laws that an earlier search found, from its opponents.json."""
    if not arguments.found:
        return []
    found = opponents.read_opponents(arguments.found, "--found")
    return [
        opponent for opponent in found if opponent.evaluations >= opponents.budget(opponent.kind, arguments.opponents)
    ]


def _parse(argv):
    parser = Parser(prog="microstage compare", description="Compare all controllers on the simulated axis.")
    parser.add_argument("--axis", default=DEFAULT_AXIS, metavar="FILE", help="axis file (default the paper's axis)")
    parser.add_argument(
        "--machine",
        metavar="FILE",
        help="axis file of the machine that is simulated, where it is not the one "
        "that the controllers are given with --axis",
    )
    parser.add_argument(
        "--out", required=True, metavar="DIR", help="folder for report.html, comparison.json, tables.md"
    )
    parser.add_argument(
        "--controllers",
        nargs="+",
        default=list(comparison.CONTROLLERS),
        choices=comparison.CONTROLLERS,
        metavar="TYPE",
        help="controllers to compare (default all: %(default)s)",
    )
    parser.add_argument("--seeds", type=int, metavar="N", help="friction seeds (default 20, quick 3)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), metavar="N", help="threads (default all cores)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="hand the runs to this Dask scheduler, tcp://host:port")
    parser.add_argument(
        "--update",
        nargs="+",
        default=[],
        metavar="FILE",
        help="Markdown files whose tables between <!-- compare: TITLE --> and <!-- end --> are to be replaced",
    )
    parser.add_argument(
        "--opponents",
        type=int,
        default=0,
        metavar="N",
        help="search fixed laws by differential evolution, N runs of each, and judge them beside the "
        "self-tuning ones on seeds and machines that no search saw; nothing else",
    )
    parser.add_argument(
        "--found",
        default="",
        metavar="FILE",
        help="opponents.json of an earlier search on this axis: its laws are not searched again, if they had N runs",
    )
    parser.add_argument("--quick", action="store_true", help="few seeds, moves and searches")
    parser.add_force()
    arguments = parser.parse_args(argv)
    check_documents(arguments.update)
    if arguments.opponents < 0:
        raise InputError("--opponents", arguments.opponents, "0 or more")
    if arguments.found and not arguments.opponents:
        raise InputError("--found", arguments.found, "--opponents N beside it: nothing else uses an earlier search")
    for name in ("seeds", "jobs"):
        value = getattr(arguments, name)
        if value is not None and value < 1:
            raise InputError(f"--{name}", value, "1 or more")
    return arguments


def _plain(value):
    """Plain data for JSON, without the curves; numbers that are not finite become null."""
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items() if key != "curve"}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value


def _show(tables):
    """Print what was asked and reached, and the tables of Fig. 10 and Table 4."""
    console = Console()
    window = console.width
    for title, header, rows, _ in tables[:7]:
        table = Table(*header, title=title)
        for row in rows:
            table.add_row(*row)
        wanted = console.measure(table, options=console.options.update(width=WIDEST)).maximum
        console.width = max(window, wanted)  # a terminal wraps what is wider; nothing is cut
        console.print(table)
