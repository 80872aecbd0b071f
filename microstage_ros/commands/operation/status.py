"""``status``: how an axis is, who drives it, what is missing."""

import sys
import time

from microstage_ros.commands import answer
from microstage_ros.commands.operator import name_live_axes, operator_parser
from microstage_ros.hardware.command_gate import FAULTS
from microstage_ros.quantities.command import COMMANDS

STATES = {0: "starting", 1: "running", 2: "stopped by a signal", 3: "ended", 4: "started again"}


def main(argv=None):
    """Run the command. Returns 0 if the axis is active and without fault, 1 otherwise."""
    parser = operator_parser("status", "Says how an axis is: position, voltage, fault, who commands, its nodes.")
    parser.add_argument(
        "--processes", action="store_true", help="one line for every node, with the number of its process"
    )
    return _run(parser.parse_args(argv))


def _run(arguments):
    name_live_axes(arguments.namespace)
    from microstage_ros.ros.client import NoAnswer
    from microstage_ros.ros.operator import Operator

    try:
        with Operator(arguments.namespace) as axis:
            found = axis.status()
            cell = axis.processes()
            answered = axis.took
    except NoAnswer as error:
        answer.state(success=False, message=str(error))
        print(error, file=sys.stderr)
        return 1
    driver = found.driver
    unit = driver.command_unit or "V"
    processes = {} if cell is None else {
        name: {"state": STATES.get(state, str(state)), "process": number, "restarts": again}
        for name, state, number, again in zip(cell.names, cell.states, cell.processes, cell.restarts)}
    answer.state(
        active=driver.active,
        lifecycle=found.lifecycle,
        fault=FAULTS[driver.fault],
        says=driver.message,
        position_m=found.position,
        **{"voltage_V": None, command_column(unit): found.voltage},
        command_unit=unit,
        lockstep=driver.lockstep,
        simulated=driver.simulated,
        backend=driver.backend,
        host=driver.host,
        process=driver.process,
        commander=driver.commander,
        watched=driver.watched,
        processes=processes,
        answered_s=answered,
        summary=found.summary,
    )
    since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(driver.since.sec))
    print(f"{arguments.namespace}: {found.summary}")
    print(
        f"  {found.position * 1e6:.3f} µm, {found.voltage:.3g} {unit}; {'lockstep' if driver.lockstep else 'paced'},"
        f" backend {driver.backend}"
    )
    print(f"  driver on {driver.host} since {since}; watchdog {'there' if driver.watched else 'missing'}")
    _print_nodes(processes, arguments.processes)
    if cell is not None and cell.message:
        print(f"  missing: {cell.message}")
    return 0 if driver.active and not driver.fault else 1


def command_column(unit):
    """The key of a command in ``unit``, such as "V": what records call it, which says the unit."""
    return next((command.column for command in COMMANDS if command.unit == unit), "command_value")


def _print_nodes(processes, every):
    """Nodes that run in one line; a line of its own for whatever is not as it was started, or for ``every`` node."""
    well = [
        name for name, facts in processes.items() if facts["state"] == STATES[1] and not facts["restarts"] and not every
    ]
    if well:
        print(f"  running: {', '.join(well)}")
    for name, facts in processes.items():
        if name not in well:
            again = f", started again {facts['restarts']} times" if facts["restarts"] else ""
            print(f"  {name}: {facts['state']}{again}" + (f", process {facts['process']}" if every else ""))
