"""``robustness --margins``: what margin at the amplifier costs the observer law, and what it does in its place."""

import dataclasses
import json
from concurrent.futures import ThreadPoolExecutor

from rich.console import Console
from rich.table import Table

from microstage_ros import __version__
from microstage_ros.commands import answer
from microstage_ros.commands.progress import progress
from microstage_ros.commands.tables import update_tables
from microstage_ros.control.robustness import margins_cost
from microstage_ros.files import write_text


def show_margins_cost(arguments, axis):
    """Both tables of `control.robustness.margins_cost`. Returns 0."""
    seeds, law = range(arguments.seed, arguments.seed + arguments.seeds), margins_cost.LAW
    settings = margins_cost.SETTINGS
    with progress(law, total=len(settings)) as bar, ThreadPoolExecutor(arguments.jobs) as pool:

        def one(setting):
            found = margins_cost.cost_of_margins(axis, setting, seeds)
            bar.advance()
            return found

        found = list(pool.map(one, settings))
    jumps = margins_cost.jump_rows(axis, seeds)
    worst = f"Worst of the seeds {arguments.seed} … {seeds[-1]}."
    tables = [
        (
            f"{law}, what margins cost",
            margins_cost.HEADS,
            [margins_cost.row(cost) for cost in found],
            f"{worst} Doubts and bandwidth over the shipped ones; margins at the amplifier, the least of pre-sliding"
            " and full speed, of the loop as it starts; error at the end of a move on the nominal machine; then on each"
            " machine, which the axis file does not tell: largest error (µm), peak in the sine of 10 µm (nm).",
        ),
        (
            f"{law}, jumps of the amplifier's gain",
            margins_cost.JUMP_HEADS,
            jumps,
            f"{worst} Sine of 10 µm at 0.25 Hz; the gain jumps to this many times what it was after 2 s.",
        ),
    ]
    console = Console()
    console.width = max(console.width, 150)  # the tables are wide
    for title, heads, rows, remark in tables:
        table = Table(*heads, title=title, caption=remark)
        for cells in rows:
            table.add_row(*cells)
        console.print(table)
    update_tables(arguments.update, tables, "robustness")
    facts = {
        "version": __version__,
        "axis": axis.as_dict(),
        "law": law,
        "seeds": list(seeds),
        "settings": [dataclasses.asdict(cost) for cost in found],
        "jumps": jumps,
    }
    answer.state(**facts)
    if isinstance(arguments.json, str):
        write_text(arguments.json, json.dumps(facts, indent=1) + "\n")
    return 0
