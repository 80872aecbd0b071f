"""``demo``: the paper's point-to-point moves by separate ROS 2 processes, on the simulated axis or a backend."""

import json
import sys
from pathlib import Path

import yaml

from microstage_ros import __version__
from microstage_ros.commands import answer
from microstage_ros.commands.__main__ import which_ros
from microstage_ros.commands.axis import add_controller, read_axis
from microstage_ros.commands.backend import add_backend, chosen_backend
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.progress import progress
from microstage_ros.files import complete_folder, keep_earlier, write_text
from microstage_ros.model.actuators import actuator_of
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError

TARGETS = (1e-6, 1e-5, 1e-4, 1e-3)
REPEATS, QUICK_REPEATS = 10, 2
TOLERANCE = 3e-8
"""One count of the encoder, and what its noise adds [m]."""

SETTLE_TIME = 0.1
MOVE_TIMEOUT = 5.0
PAUSE = 30.0
"""Simulated time stands still between two moves for this long at most (wall clock) [s]."""


def main(argv=None):
    """Run the command. Returns 0; 1 if a process failed or a target was not reached.

    Raises InputError: a seed out of range.
    """
    parser = Parser(
        prog="microstage demo",
        description=(
            "The main job, on the simulated axis unless a backend is named: separate ROS 2 processes make the paper's"
            " point-to-point moves; the run is recorded to MCAP and reported in DIR/report.html."
        ),
    )
    parser.add_argument("--out", metavar="DIR", help="folder for bag and report (default demo, demo-2, ...)")
    parser.add_argument(
        "--quick", action="store_true", help=f"{QUICK_REPEATS} repeats in place of {REPEATS}: under a minute"
    )
    parser.add_argument("--axis", metavar="FILE", help="axis file (default: the shipped config/axis.yaml)")
    add_controller(parser)
    add_backend(parser)
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of every random number (default 1)")
    parser.add_force()
    arguments = parser.parse_args(argv)
    if not 0 <= arguments.seed < 2**32:
        raise InputError("--seed", arguments.seed, "a whole number from 0 to 4294967295")
    axis = read_axis(arguments.axis or config_file("axis.yaml"))
    out = _place(arguments.out, arguments.force)
    return _run(arguments, axis, out, chosen_backend(arguments, axis))


RESULTS = ("bag", "moves.json", "report.html")


def _place(given, force):
    """A folder that no earlier run has used, unless it is to be replaced."""
    if given:
        out = Path(given)
        keep_earlier("--out", [out / name for name in RESULTS], force)
        return out
    number, out = 1, Path("demo")
    while out.exists():
        number += 1
        out = Path(f"demo-{number}")
    return out


def program(repeats):
    """The moves: (target [m], measured); so many unidirectional ``repeats`` [1] of each, in each direction, and
    back."""
    return [(place, measured) for target in TARGETS for sign in (1.0, -1.0) for _ in range(repeats)
            for place, measured in ((sign * target, True), (0.0, False))]


def _run(arguments, axis, out, backend):
    import rclpy

    from microstage_ros.ros.client import NoAnswer
    from microstage_ros.ros.launching.cell_processes import CellFailure
    from microstage_ros.ros.launching.ownership import free_namespace

    print(f"{which_ros()}\n{backend.words(axis.name, arguments.seed)}", file=sys.stderr)
    namespace = free_namespace()
    if namespace != "/axis":
        print(f"/axis is in use; this demo is {namespace}", file=sys.stderr)
    moves = program(QUICK_REPEATS if arguments.quick else REPEATS)
    with complete_folder(out) as folder:
        try:
            results = _make_moves(arguments, axis, out, folder, moves, backend, namespace)
        except (CellFailure, NoAnswer) as failure:  # the bag as far as it goes is kept: it may show why
            says = f"{failure}; what the nodes said is in {out / 'logs'}"
            answer.state(error={"place": "demo", "says": says})
            print(says, file=sys.stderr)
            return 1
        finally:
            rclpy.try_shutdown()
        facts = _facts(arguments, axis, backend, namespace)
        write_text(folder / "moves.json", json.dumps({"run": facts, "moves": results}, indent=1))
    failed = _tell(out, results, facts)
    if failed:
        print(f"{len(failed)} of {len(results)} moves did not settle", file=sys.stderr)
    return 1 if failed else 0


def _facts(arguments, axis, backend, namespace):
    """What the moves were made with."""
    return {"version": __version__, "axis": axis.name, "namespace": namespace, "seed": arguments.seed,
            "controller": arguments.controller or axis.controller["type"], "tolerance_m": TOLERANCE,
            "settle_time_s": SETTLE_TIME, "ros": which_ros(), "simulated": backend.simulated, "backend": backend.name,
            "instrument": "interferometer" if backend.instruments else "encoder", "period_s": axis.value("period"),
            "command": actuator_of(axis).command.as_dict()}


def _tell(out, results, facts):
    """The report beside the bag in ``out``, the table to the terminal. Returns the targets that were not reached."""
    from microstage_ros.commands.operation.demo_report import accuracy_rows, print_table, write_report

    report = out / "report.html"
    report.unlink(missing_ok=True)  # of an earlier run: it does not belong to this bag
    answer.state(run=facts, moves=results, report=str(report), bag=str(out / "bag"))
    rows = accuracy_rows(results)
    print_table(rows, facts)
    try:
        write_report(report, out / "bag", rows, results, facts)
    except Exception:
        print(f"the report could not be made; bag and moves.json are in {out}", file=sys.stderr)
        raise
    print(f"{report}: the report; {out / 'bag'}: the bag")
    return [move["target_m"] for move in results if not move["reached"]]


def _make_moves(arguments, axis, out, folder, moves, backend, namespace):
    """Start the cell, make the moves, stop it. Returns one dict per measured move."""
    import rclpy

    from microstage_ros.ros.client import AxisClient
    from microstage_ros.ros.launching.cell_processes import NODES, CellProcesses

    out.mkdir(parents=True, exist_ok=True)
    rclpy.init()
    node = rclpy.create_node("demo", namespace=namespace)
    with (
        CellProcesses(
            namespace, backend.nodes(NODES), cell_parameters(arguments, axis, folder, backend), logs=out / "logs"
        ) as cell,
        progress("moves", len(moves)) as bar,
    ):
        cell.activate(node)
        axis_client = AxisClient(namespace, node)
        results = []
        for target, measured in moves:
            cell.check()
            result = axis_client.move(target, tolerance=TOLERANCE, settle_time=SETTLE_TIME, timeout=MOVE_TIMEOUT)
            if measured:
                results.append(move_facts(target, result))
            bar.advance()
        if backend.mode == "lockstep":
            axis_client.wait_until_still()  # so that every run of one seed ends in the same control period
        cell.deactivate(node)
    return results


def cell_parameters(arguments, axis, out, backend):
    """Parameters of the nodes; with a simulated backend for a reproducible run in lockstep."""
    file = {"axis_file": str(Path(arguments.axis).resolve())} if arguments.axis else {}
    law = {"controller": arguments.controller or axis.controller["type"]}
    run = {"program": "paper's point-to-point moves", "command": "demo --quick" if arguments.quick else "demo"}
    return {
        "axis_driver": {"mode": backend.mode, "seed": arguments.seed, **file, **backend.driver_parameters},
        "str_controller": {**file, **law},
        "gms_observer": file,
        "move_server": {"pause_s": PAUSE},
        "bag_recorder": {
            "directory": str((out / "bag").resolve()),
            "run": yaml.safe_dump(run),
            "log_time": "stamp" if backend.mode == "lockstep" else "arrival",
            **backend.recorder_parameters,
        },
    }


def move_facts(target, result):
    """What is kept of one move to ``target`` [m], in SI units."""
    return {"target_m": target, "reached": bool(result.reached), "final_error_m": result.final_error,
            "interferometer_error_m": result.interferometer_error, "settling_time_s": result.settling_time,
            "overshoot_m": result.overshoot, "start_sequence": result.start_sequence,
            "end_sequence": result.end_sequence, "message": result.message}
