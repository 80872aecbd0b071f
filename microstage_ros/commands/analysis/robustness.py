"""``robustness``: a law on machines that it was not given: conditions, random machines, seeds; what failed and how to
see it."""

import functools
import json
import os
import pathlib
import shlex

import yaml

from microstage_ros import __version__
from microstage_ros.commands import answer
from microstage_ros.commands.analysis.ends_of_moves import show_ends
from microstage_ros.commands.analysis.learned_numbers import show_learned
from microstage_ros.commands.analysis.margins_cost import show_margins_cost
from microstage_ros.commands.analysis.robustness_tables import document, of_machines, show
from microstage_ros.commands.axis import check_effects_fit, read_axis
from microstage_ros.commands.drives import check_drive
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.progress import progress
from microstage_ros.commands.tables import check_documents, update_tables
from microstage_ros.control.evaluation import opponents
from microstage_ros.control.laws.registry import LAWS
from microstage_ros.control.robustness import campaign
from microstage_ros.control.robustness.conditions import Condition, conditions, random_machine
from microstage_ros.diagnosis.fleet import in_order
from microstage_ros.files import keep_earlier, write_text
from microstage_ros.hardware.simulated import machine_for
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError

DEFAULT_AXIS = str(config_file("axis.yaml"))


def main(argv=None):
    """Run the command. Returns 0, or 1 if a run failed; raises InputError for bad input."""
    arguments = _parse(argv)
    axis = read_axis(arguments.axis)
    check_drive("robustness", axis)
    law = arguments.law or axis.controller.get("type", "none")
    if law not in LAWS or law == "none":
        raise InputError("--law", law, "one of " + ", ".join(name for name in LAWS if name != "none"))
    if arguments.list:
        print("\n".join(condition.name for condition in conditions(axis)))
        return 0
    if arguments.margins:
        return show_margins_cost(arguments, axis)
    folder = pathlib.Path(arguments.out) if arguments.out else None
    if folder:
        keep_earlier("--out", [*folder.glob("*/run.yaml"), folder / "failure" / "run.yaml"], arguments.force)
    chosen, seeds = _chosen(arguments, axis), [arguments.seed + n for n in range(arguments.seeds)]
    if arguments.learned:
        return show_learned(arguments, axis, chosen, law)
    if arguments.moves:
        return show_ends(arguments, axis, chosen, law)
    fixed = _fixed(arguments)
    each = functools.partial(in_order, scheduler=arguments.scheduler) if arguments.scheduler else None
    with progress(law, total=len(chosen) * len(seeds)) as bar:
        outcomes = campaign.campaign(
            axis,
            chosen,
            seeds,
            law,
            arguments.jobs,
            lambda done: bar.advance(),
            each=each,
            beside=arguments.beside,
            fixed=fixed,
        )
    rows = campaign.summary(outcomes)
    show(rows, law, arguments)
    title = (
        f"{law},"
        f" {f'{arguments.random} random machines within {arguments.factor:g}' if arguments.random else 'conditions'}"
    )
    update_tables(arguments.update, [(title, *document(rows, arguments))], "robustness")
    failures = [o for o in outcomes if o.fault]
    for outcome in failures:
        condition = next(c for c in chosen if c.name == outcome.condition)
        print(
            f"{outcome.condition}, seed {outcome.seed}: {outcome.fault}\n "
            f" {_again(arguments, axis, condition, outcome, law, folder)}"
        )
    print(f"{len(failures)} of {len(outcomes)} runs failed; {of_machines(rows)}")
    facts = {
        "version": __version__,
        "axis": axis.as_dict(),
        "law": law,
        "seeds": seeds,
        "failed": len(failures),
        "conditions": rows,
        "runs": [
            {**o._asdict(), "fixed": [one._asdict() for one in o.fixed], "fault": o.fault} for o in outcomes
        ],
    }
    answer.state(**facts)
    if isinstance(arguments.json, str):
        write_text(arguments.json, json.dumps(facts, indent=1) + "\n")
    return 1 if failures else 0


def _parse(argv):
    parser = Parser(
        prog="microstage robustness",
        json="file",
        description=(
            "Runs a law on machines that it was not given: named conditions, and machines whose numbers are drawn at"
            " random. Prints what failed and the command that shows it again. Exit status 1 if a run failed."
        ),
    )
    parser.add_argument(
        "--axis",
        default=DEFAULT_AXIS,
        metavar="FILE",
        help="axis file that the controller is given (default the shipped one)",
    )
    parser.add_argument("--machine", metavar="FILE", help="examine on this machine alone, in place of the conditions")
    parser.add_argument("--law", metavar="TYPE", help="type of controller (default that of the axis file)")
    parser.add_argument(
        "--beside",
        default="",
        metavar="TYPE",
        help="run this law on the same as well: its largest error, and for how long it was better",
    )
    parser.add_argument(
        "--opponents",
        default="",
        metavar="FILE",
        help="run the fixed laws of this opponents.json (compare --opponents) on the same as well: the best of them",
    )
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="NAME", help="these conditions or random machines alone, by name"
    )
    parser.add_argument(
        "--random", type=int, metavar="N", help="that many machines at random, in place of the conditions"
    )
    parser.add_argument("--first", type=int, default=0, metavar="N", help="number of the first of them (default 0)")
    parser.add_argument(
        "--factor", type=float, default=2.0, metavar="F", help="within which each of their numbers lies (default 2)"
    )
    parser.add_argument(
        "--moves",
        type=int,
        metavar="N",
        help="at least N moves there and back in place of the program: how many end beside their target",
    )
    parser.add_argument(
        "--distance", type=float, default=1e-5, metavar="M", help="of these moves, in metres (default 1e-5)"
    )
    parser.add_argument(
        "--margins",
        action="store_true",
        help="what margins cost the observer law, with nothing learned, and how it answers jumps of the gain",
    )
    parser.add_argument(
        "--learned",
        action="store_true",
        help="what the law has learned of each machine, with its uncertainty, beside the machine's own numbers",
    )
    parser.add_argument("--seeds", type=int, default=5, metavar="N", help="runs of each (default 5)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the first run (default 0)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), metavar="N", help="threads (default all cores)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="hand the runs to this Dask scheduler, tcp://host:port")
    parser.add_argument("--out", metavar="DIR", help="write machine and run file of every failure, for simulate")
    parser.add_argument(
        "--update",
        nargs="+",
        default=[],
        metavar="FILE",
        help="Markdown files whose table between <!-- robustness: TITLE --> and <!-- end --> is to be replaced",
    )
    parser.add_argument("--list", action="store_true", help="print the names of the conditions and do nothing")
    arguments = parser.parse_args(argv)
    check_documents(arguments.update)
    for name in ("seeds", "jobs", "random", "moves"):
        if getattr(arguments, name) is not None and getattr(arguments, name) < 1:
            raise InputError(f"--{name}", getattr(arguments, name), "1 or more")
    for name in ("seed", "first"):
        if getattr(arguments, name) < 0:
            raise InputError(f"--{name}", getattr(arguments, name), "0 or more")
    if arguments.beside and (arguments.beside not in LAWS or arguments.beside == "none"):
        raise InputError("--beside", arguments.beside, "one of " + ", ".join(name for name in LAWS if name != "none"))
    if arguments.margins and (arguments.moves or arguments.random or arguments.only or arguments.machine):
        raise InputError("--margins", "with --moves, --random, --only or --machine", "one of them")
    if arguments.learned and (arguments.moves or arguments.margins or arguments.beside or arguments.opponents):
        raise InputError("--learned", "with --moves, --margins, --beside or --opponents", "--learned without them")
    if not 1e-9 <= arguments.distance <= 1.0:
        raise InputError("--distance", arguments.distance, "metres from 1e-9 to 1")
    if not 1.0 <= arguments.factor <= 100.0:
        raise InputError("--factor", arguments.factor, "a number from 1 to 100")
    return arguments


def _fixed(arguments):
    """Fixed laws of ``--opponents``; those that learn from trial to trial have no trials here."""
    if not arguments.opponents:
        return ()
    found = opponents.read_opponents(arguments.opponents, "--opponents")
    return tuple(opponent for opponent in found if opponent.kind in opponents.OPPONENTS)


def _chosen(arguments, axis):
    """The conditions that were asked for."""
    if arguments.machine:
        machine = machine_for(axis, arguments.machine)
        check_effects_fit(machine)
        values = {
            key: machine.value(key)
            for key in machine.quantities
            if axis.has(key) and machine.value(key) != axis.value(key)
        }
        return [Condition(arguments.machine, values=values, effects=machine.effects)]
    if arguments.random:
        return [random_machine(axis, arguments.first + number, arguments.factor) for number in range(arguments.random)]
    known = conditions(axis)
    if not arguments.only:
        return known
    return [_named(name, known, axis) for name in arguments.only]


def _named(name, known, axis):
    words = name.split()
    if name.startswith("random machine ") and len(words) == 5:
        try:
            return random_machine(axis, int(words[2]), float(words[4]))
        except ValueError:
            pass
    for condition in known:
        if condition.name == name:
            return condition
    raise InputError("--only", name, "a name that --list prints, or 'random machine N within F'")


def _again(arguments, axis, condition, outcome, law, folder):
    """The command that shows a failure again; writes the files that it needs into ``folder`` if there is one."""
    if folder is None:
        own = [] if arguments.axis == DEFAULT_AXIS else ["--axis", arguments.axis]
        own += ["--machine", arguments.machine] if arguments.machine else ["--only", condition.name]
        return shlex.join(
            ["./microstage", "robustness", *own, "--law", law, "--seed", str(outcome.seed), "--seeds", "1"]
        )
    place = folder / f"{''.join(c if c.isalnum() else '_' for c in condition.name)}_{outcome.seed}"
    place.mkdir(parents=True, exist_ok=True)
    assumed_axis = condition.assumed_axis(axis)
    assumed_axis.save(place / "axis.yaml")
    assumed_axis.machine.save(place / "machine.yaml")
    run = campaign.run_of(condition, law)
    tree = {"controller": run.controller, "noise": run.noise, "program": run.program}
    if run.period_s:
        tree["period_s"] = run.period_s
    (place / "run.yaml").write_text(yaml.safe_dump(tree, sort_keys=False))
    files = {name: str(place / f"{name}.yaml") for name in ("axis", "machine", "run")}
    return shlex.join(
        [
            "./microstage",
            "simulate",
            *[word for name, path in files.items() for word in (f"--{name}", path)],
            "--seed",
            str(outcome.seed),
            "--out",
            str(place / "record.csv"),
        ]
    )
