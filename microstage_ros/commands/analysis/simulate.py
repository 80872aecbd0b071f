"""``simulate``: one run of the model, without ROS."""

from pathlib import Path

from microstage_ros.commands import answer
from microstage_ros.commands.axis import check_effects_fit, warn
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.progress import progress
from microstage_ros.control.runs.coarse_fine import coarse_fine_record
from microstage_ros.control.runs.run_file import load_run
from microstage_ros.control.runs.simulate import simulated_record
from microstage_ros.files import complete_folder, keep_earlier
from microstage_ros.hardware.simulated import machine_for
from microstage_ros.model.coarse_fine import CoarseFine, load_machine
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import write_record
from microstage_ros.records.columns import ENDINGS


def main(argv=None):
    """Run the command. Returns 0; raises InputError for bad input."""
    parser = Parser(prog="microstage simulate", description="Simulate one run of an axis.")
    parser.add_argument("--axis", required=True, metavar="FILE", help="axis file")
    parser.add_argument(
        "--machine",
        metavar="FILE",
        help="axis file of the machine that is simulated, where it is not the one "
        "that the controller is given with --axis",
    )
    parser.add_argument("--run", required=True, metavar="FILE", help="run file: controller, noise, effects, program")
    parser.add_argument("--out", required=True, metavar="FILE", help="record to write: " + ", ".join(ENDINGS))
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of every random number (default 0)")
    parser.add_force()
    arguments = parser.parse_args(argv)
    if not arguments.out.endswith(ENDINGS):
        raise InputError("--out", arguments.out, "a file name ending in " + ", ".join(ENDINGS))
    keep_earlier("--out", [arguments.out], arguments.force)
    axis, run = load_machine(arguments.axis), load_run(arguments.run)
    both = isinstance(axis, CoarseFine)
    if not both:
        warn(axis)
    if both and arguments.machine:
        raise InputError("--machine", arguments.machine, f"nothing: {arguments.axis} has two components")
    machine = machine_for(axis, arguments.machine) if arguments.machine else None
    if both:
        check_effects_fit(axis.coarse, run)
        check_effects_fit(axis.fine)
    else:
        check_effects_fit(machine or axis, run)
        within_travel(machine or axis, run)
    out = Path(arguments.out)
    with progress("simulating") as bar:
        if both:
            record = coarse_fine_record(axis, run, arguments.seed)
        else:
            record = simulated_record(axis, run, arguments.seed, machine, bar.reach if bar else None)
        bar.say("writing")
        with complete_folder(out.parent) as folder:
            write_record(record, folder / out.name)
    answer.state(
        record=str(out), rows=len(record), period_s=record.period_s, columns=list(record.columns), seed=arguments.seed
    )
    return 0


def within_travel(machine, run):
    """Raise InputError where the reference of the run goes beyond the travel of the machine: the model has no end
    stops, and a machine has."""
    low, high = machine.value("travel.minimum"), machine.value("travel.maximum")
    for number, segment in enumerate(run.program, 1):
        target = segment.get("move_to_m", 0.5 * (low + high))
        if not low <= target <= high:
            raise InputError(f"{run.place}: program[{number}].move_to_m", target,
                             f"{low:g} to {high:g} m, the travel of {machine.place}")
    reference = run.tables(run.period_s or machine.value("period"))["reference"]
    for farthest in (float(reference.min()), float(reference.max())):
        if not low <= farthest <= high:
            raise InputError(f"{run.place}: program: farthest reference", farthest,
                             f"{low:g} to {high:g} m, the travel of {machine.place}")
