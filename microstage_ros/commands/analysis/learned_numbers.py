"""``robustness --learned``: what the law has learned of each machine at the end of a run, beside the machine's own."""

import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from rich.console import Console
from rich.table import Table

from microstage_ros import __version__
from microstage_ros.commands import answer
from microstage_ros.commands.progress import progress
from microstage_ros.commands.tables import update_tables
from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.laws.registry import LAWS
from microstage_ros.control.robustness import campaign
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.files import write_text
from microstage_ros.metrology.rates import rate
from microstage_ros.quantities.errors import InputError

NAMES = {  # as the table heads them: what a person reads is so many SI units
    "resonance": ("resonance (Hz)", 1.0),
    "stiffness": ("stiffness (N/µm)", 1e6),
    "stage_mass": ("mass of the stage (kg)", 1.0),
    "damping": ("damping (N s/m)", 1.0),
    "moving_mass": ("moving mass (kg)", 1.0),
    "resistance": ("resistance (Ω)", 1.0),
    "volts_per_velocity": ("back-EMF (V s/m)", 1.0),
}
HEADS = ["machine", *(head for head, _ in NAMES.values())]
COUNTED = ("within two standard uncertainties", 2.0), ("within three", 3.0)


def true_numbers(machine, law):
    """{name of `NAMES`: number of the ``machine`` (an `Axis`), SI}, as a ``law`` (a type) starts that is given it.

    The moving mass is not in the file; the law makes it of rotor, gear and screw.
    """
    return {name: number.file for name, number in make_controller(law, machine).learned.items() if name in NAMES}


def show_learned(arguments, axis, chosen, law):
    """What is learned on every condition of ``chosen`` (`Condition` each), and how often it is right. Returns 0.

    Raises InputError where the ``law`` (a type) learns nothing, or the ``axis`` has no drive train to be learned.
    """
    if LAWS[law].loop != "observer":
        raise InputError("--law", law, "self_tuning_observer: no other law learns its axis")
    if not set(NAMES) <= set(true_numbers(axis, law)):
        raise InputError("--axis", arguments.axis, "a motor whose current is measured, on a drive that is not rigid")
    seeds = range(arguments.seed, arguments.seed + arguments.seeds)
    work = [(condition, seed) for condition in chosen for seed in seeds]
    with progress(law, total=len(work)) as bar, ThreadPoolExecutor(arguments.jobs) as pool:

        def one(job):
            condition, seed = job
            kept = []
            simulate(condition.assumed_axis(axis), campaign.run_of(condition, law), seed, finish=kept.append)
            bar.advance()
            return kept[0].learned

        found = list(pool.map(one, work))
    truths = {condition.name: true_numbers(condition.machine(axis), law) for condition in chosen}
    runs = [(condition.name, truths[condition.name], numbers) for (condition, _), numbers in zip(work, found)]
    alike = {} if arguments.random else truths  # random ones are counted only
    rows = [_row(name, truths[name], [each for own, _, each in runs if own == name]) for name in alike]
    rows += [[words, *(_share(runs, name, width) for name in NAMES)] for words, width in COUNTED]
    title = f"{law}, what is learned{f' of {arguments.random} random machines' if arguments.random else ''}"
    shown = (
        "the machine's number, then the median of what is learned at the end of the program and of its standard"
        " uncertainty"
    )
    shown = "runs whose number lies so near to the machine's at the end of the program" if arguments.random else shown
    remark = (
        f"Seeds {seeds[0]} … {seeds[-1]}: {shown}. Effects are none of the machine's numbers. Intervals of 95 %, exact."
    )
    table = Table(*HEADS, title=title, caption=remark)
    for cells in rows:
        table.add_row(*cells)
    console = Console()
    console.width = max(console.width, 180)  # the table is wide
    console.print(table)
    update_tables(arguments.update, [(title, HEADS, rows, remark)], "robustness")
    facts = {
        "version": __version__,
        "axis": axis.as_dict(),
        "law": law,
        "seeds": list(seeds),
        "runs": [
            {"condition": condition.name, "seed": seed, "learned": {k: v._asdict() for k, v in numbers.items()},
             "true": truths[condition.name]}
            for (condition, seed), numbers in zip(work, found)
        ],
    }
    answer.state(**facts)
    if isinstance(arguments.json, str):
        write_text(arguments.json, json.dumps(facts, indent=1) + "\n")
    return 0


def _row(name, truth, learned):
    """Cells of one machine: its number, and the medians of what the runs learned."""
    cells = [name]
    for key, (_, unit) in NAMES.items():
        value = np.median([each[key].value for each in learned]) / unit
        stderr = np.median([each[key].stderr for each in learned]) / unit
        cells.append(f"{truth[key] / unit:.3g}: {value:.3g} ± {stderr:.2g}")
    return cells


def _share(runs, key, width):
    """In how many ``runs`` (name, truth, learned) the number lies within ``width`` standard uncertainties."""
    hits = sum(abs(numbers[key].value - truth[key]) <= width * numbers[key].stderr for _, truth, numbers in runs)
    return str(rate(hits, len(runs)))
