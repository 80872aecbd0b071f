"""``robustness --moves N``: how many moves end beside their target."""

import dataclasses
import json

from rich.console import Console
from rich.table import Table

from microstage_ros import __version__
from microstage_ros.commands import answer
from microstage_ros.commands.progress import progress
from microstage_ros.commands.tables import update_tables
from microstage_ros.control.robustness import ends_of_moves
from microstage_ros.files import write_text


def show_ends(arguments, axis, chosen, law):
    """How many moves end beside their target, by condition; ``chosen``: `Condition` each. Returns 1 if any did."""
    records = -(-arguments.moves // ends_of_moves.judged_moves())
    seeds, found = range(arguments.seed, arguments.seed + records), {}
    with progress(law, total=len(chosen) * records) as bar:
        for condition in chosen:
            found[condition.name] = ends_of_moves.ends_of_moves(
                axis, condition, law, arguments.distance, seeds, arguments.jobs, bar.advance
            )
    rows = [ends_of_moves.row(name, ends) for name, ends in found.items()]
    title = f"{law}, ends of moves of {arguments.distance * 1e6:g} µm"
    remark = (
        f"Seeds {arguments.seed} … {seeds[-1]}, {2 * ends_of_moves.ROUNDS} moves each, judged from number"
        f" {ends_of_moves.FIRST + 1} on. Intervals of 95 %: of the moves by drawing records again, of the records"
        " exact."
    )
    table = Table(*ends_of_moves.HEADS, title=title, caption=remark)
    for cells in rows:
        table.add_row(*cells)
    console = Console()
    console.width = max(console.width, 150)  # the table is wide
    console.print(table)
    update_tables(arguments.update, [(title, ends_of_moves.HEADS, rows, remark)], "robustness")
    facts = {
        "version": __version__,
        "axis": axis.as_dict(),
        "law": law,
        "seeds": list(seeds),
        "distance_m": arguments.distance,
        "conditions": [
            {
                "condition": name,
                "moves": dataclasses.asdict(ends.moves),
                "records": dataclasses.asdict(ends.records),
                "errors_m": ends.errors.tolist(),
            }
            for name, ends in found.items()
        ],
    }
    answer.state(**facts)
    if isinstance(arguments.json, str):
        write_text(arguments.json, json.dumps(facts, indent=1) + "\n")
    return 1 if any(ends.moves.hits for ends in found.values()) else 0
