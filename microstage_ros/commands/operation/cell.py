"""``cell``: the nodes of an axis, left running until interrupted."""

import os
import shutil
import sys
from contextlib import contextmanager
from pathlib import Path

from microstage_ros.commands import answer, units
from microstage_ros.commands.__main__ import which_ros
from microstage_ros.commands.axis import add_controller, read_axis
from microstage_ros.commands.backend import add_backend, chosen_backend
from microstage_ros.commands.parser import Parser
from microstage_ros.files import keep_earlier
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError


def main(argv=None):
    """Run the command. Returns 0 when interrupted, 1 if a process ended by itself.

    Raises InputError: a seed out of range, a record's folder that holds something else.
    """
    parser = Parser(prog="microstage cell", description="Start the nodes of an axis; Ctrl-C stops them.")
    parser.add_argument("--axis", metavar="FILE", help="axis file (default: the shipped config/axis.yaml)")
    parser.add_argument(
        "--namespace", type=units.namespace, default="/axis", metavar="NS", help="of the nodes (default /axis)"
    )
    add_backend(parser)
    parser.add_argument(
        "--mode",
        choices=("lockstep", "paced"),
        help="simulated time no faster than real time (default where the backend is simulated), or wall clock",
    )
    add_controller(parser)
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of the simulated axis (default 1)")
    parser.add_argument("--record", metavar="DIR", help="record everything into this bag folder")
    parser.add_force()
    arguments = parser.parse_args(argv)
    if not 0 <= arguments.seed < 2**32:
        raise InputError("--seed", arguments.seed, "a whole number from 0 to 4294967295")
    if arguments.record:
        keep_earlier("--record", [arguments.record], arguments.force)
        if Path(arguments.record).exists() and not is_bag(arguments.record):
            raise InputError(
                "--record", arguments.record, "a folder that does not exist yet, or one that holds nothing but a bag"
            )
    axis = read_axis(arguments.axis or config_file("axis.yaml"))
    backend = chosen_backend(arguments, axis)
    arguments.mode = backend.mode_or(arguments.mode)
    with earlier_aside(arguments.record) as done:
        return _run(arguments, backend, axis, done)


def is_bag(folder):
    """Whether a folder holds a bag and nothing else, so that ``--force`` may replace it."""
    folder = Path(folder)
    return folder.is_dir() and not folder.is_symlink() and all(
        entry.name == "metadata.yaml" or entry.suffix == ".mcap" for entry in folder.iterdir())


@contextmanager
def earlier_aside(folder):
    """An earlier bag lies aside until the function that this gives is called: then it goes; else it comes back."""
    folder = Path(folder) if folder else None
    if folder is None or not folder.exists():
        yield lambda: None
        return
    aside = folder.with_name(f".{folder.name}.{os.getpid()}.earlier")
    os.replace(folder, aside)
    try:
        yield lambda: shutil.rmtree(aside)
    finally:
        if aside.exists():
            shutil.rmtree(folder, ignore_errors=True)
            os.replace(aside, folder)


def move_hint(namespace):
    """The command that moves the axis ``namespace``; the default one need not be named."""
    return "./microstage move --to 1e-5" + (f" --namespace {namespace}" if namespace != "/axis" else "")


def _run(arguments, backend, machine, recording):
    from microstage_ros.ros.launching.cell_processes import NODES, QUICK, CellFailure, CellProcesses
    from microstage_ros.ros.launching.interruption import Interruption
    from microstage_ros.ros.launching.supervision import Supervisor, leave_graph, run_until_interrupted

    print(f"{which_ros()}\n{backend.words(machine.name, arguments.seed)}", file=sys.stderr)
    interruption = Interruption()
    axis = {"axis_file": str(Path(arguments.axis).resolve())} if arguments.axis else {}
    driver = {"mode": arguments.mode, "seed": arguments.seed, **axis, **backend.driver_parameters}
    if arguments.mode == "lockstep":
        driver["rate_limit"] = 1.0
    law = {"controller": arguments.controller} if arguments.controller else {}
    parameters = {"axis_driver": driver, "str_controller": {**axis, **law}, "gms_observer": axis,
                  "bag_recorder": {"directory": str(arguments.record),
                                   "log_time": "stamp" if arguments.mode == "lockstep" else "arrival",
                                   **backend.recorder_parameters}}
    nodes = list(backend.nodes(name for name in NODES if arguments.record or name != "bag_recorder"))
    node = None
    try:
        cell = CellProcesses(arguments.namespace, nodes, parameters)
        try:
            cell.start()
            import rclpy  # while the nodes start
            from rclpy.signals import SignalHandlerOptions

            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
            node = rclpy.create_node("cell", namespace=arguments.namespace)
            supervisor = Supervisor(cell, node)
            cell.activate(node, interruption.check)
            recording()
            what = "simulated" if backend.simulated else backend.name
            answer.state(namespace=arguments.namespace, nodes=list(nodes), mode=arguments.mode, backend=backend.name,
                         simulated=backend.simulated, seed=arguments.seed, record=arguments.record)
            print(f"{arguments.namespace} is active ({len(nodes)} nodes, {arguments.mode}, {what}). "
                  f"In another terminal: {move_hint(arguments.namespace)}. Ctrl-C stops it.", flush=True)
            run_until_interrupted(supervisor, lambda seconds: rclpy.spin_once(node, timeout_sec=seconds), interruption)
        finally:
            cell.stop(QUICK)
            if node is not None:
                leave_graph(node)
    except KeyboardInterrupt:
        return 0
    except CellFailure as failure:
        print(failure, file=sys.stderr)
        return 1
