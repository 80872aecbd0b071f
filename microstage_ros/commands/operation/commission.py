"""``commission``: the first day with a machine, from a sketch of it to a proven axis file or a refusal with its
reason."""

import argparse
import math
import signal
import sys
import threading
from contextlib import ExitStack
from pathlib import Path

import yaml

from microstage_ros.commands import answer
from microstage_ros.commands.backend import add_backend, backend_options
from microstage_ros.commands.parser import Parser
from microstage_ros.quantities.errors import InputError

DESCRIPTION = """\
Finds out what a machine is, by experiments: polarity and scale by the smallest commands that move anything, end
stops, friction, motor constants, the frequency response, then identifies it, chooses law and gains that hold for what
is known and how well, and proves them by moves. SKETCH needs only period, travel, the drive's kind and limit (of
voltage, or of current), the transmission with gear ratio and pitch, and the encoder's resolution; everything else may
be missing or be given with a tolerance.
Writes DIR/axis.yaml, report.html, report.json, frequency_response.csv and records/. An interrupted
run goes on when it is started again. Exit status: 0 ready; 3 refused or stopped, with the machine at zero volts.
"""
REFUSED = 3


def main(argv=None):
    """Run the command. Returns 0 if the machine is ready, 3 if it was refused or stopped; raises InputError for bad
    input."""
    parser = Parser(
        prog="microstage commission", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--axis", required=True, metavar="SKETCH", help="axis file; most numbers may be missing or have a tolerance"
    )
    add_backend(parser)
    parser.add_argument("--out", required=True, metavar="DIR", help="folder of the answer")
    parser.add_argument(
        "--seed", type=int, default=1, metavar="N", help="of a simulated axis, of phases and draws (default 1)"
    )
    parser.add_argument("--yes", action="store_true", help="do not ask before the machine moves")
    arguments = parser.parse_args(argv)
    if not 0 <= arguments.seed < 2**32:
        raise InputError("--seed", arguments.seed, "a whole number from 0 to 4294967295")
    from microstage_ros.commissioning.sketch import load_sketch
    from microstage_ros.commissioning.store import Store
    from microstage_ros.hardware import make_hardware
    from microstage_ros.hardware.protocol import Setup

    sketch, options = load_sketch(arguments.axis), backend_options(arguments)
    for sentence in sketch.unlikely:
        print(f"warning: {sentence}", file=sys.stderr)
    backend = make_hardware(arguments.backend, Setup(sketch.axis, arguments.seed, options))
    description = Path(arguments.axis).read_text(encoding="utf-8")
    identity = f"{description}\n{arguments.backend}\n{yaml.safe_dump(options)}\n{arguments.seed}"
    store = Store(arguments.out, identity)
    if not backend.simulated and not arguments.yes:
        _ask(sketch.axis, arguments.backend)
    return _run(arguments, sketch, backend, store)


def _ask(axis, name):
    from microstage_ros.model.actuators import actuator_of

    if not sys.stdin.isatty():
        raise InputError("--yes", None, f"given where nobody can answer: backend {name} moves a real machine")
    low, high, actuator = axis.value("travel.minimum"), axis.value("travel.maximum"), actuator_of(axis)
    most = f"±{actuator.command_limit(axis):g} {actuator.command.unit}"
    print(f"Backend {name} will move the stage between {low * 1e3:g} and {high * 1e3:g} mm with up to {most}. "
          "Is the travel free, and is the emergency stop at hand? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise InputError("answer", "no", "yes, or --yes")


def _run(arguments, sketch, backend, store):
    from microstage_ros.commissioning.experiments.machine import Machine
    from microstage_ros.commissioning.procedure import Outcome, commission
    from microstage_ros.commissioning.report import report_tree, write_answer
    from microstage_ros.hardware.protocol import HardwareError

    if store.resumed:
        print(f"going on after {store.time:.0f} s of machine time; what is done is kept", file=sys.stderr)
    machine = Machine(backend, sketch.axis, paced=not backend.simulated)

    def progress(text):
        if sys.stderr.isatty():
            print(f"{machine.time:6.1f} s  {text}", file=sys.stderr, flush=True)

    guard, before = None, _stop_by_signal()
    try:
        try:
            backend.open()
            guard = watched(backend)
            outcome = commission(machine, sketch, store, arguments.seed, progress)
        finally:
            with ExitStack() as ends:  # from the last to the first, each whatever became of the others
                if guard is not None:
                    ends.callback(guard.close)
                ends.callback(backend.close)
                for switch in filter(callable, [getattr(backend, "enable", None)]):
                    ends.callback(switch, False)
    except HardwareError as error:
        machine.zeroed = False
        outcome = Outcome(says=f"the hardware reported: {error}")
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    provenance = {"sketch": str(arguments.axis), "backend": arguments.backend, "seed": arguments.seed}
    write_answer(outcome, machine, Path(arguments.out), provenance)
    answer.state(**report_tree(outcome, machine), out=str(arguments.out))
    _tell(outcome, machine, Path(arguments.out))
    return 0 if outcome.verdict == "ready" else REFUSED


def _stop_by_signal():
    """A closed terminal or a request to end stops like Ctrl-C: with zero volts. Returns the handlers there were."""
    if threading.current_thread() is not threading.main_thread():
        return {}

    def stop(number, frame):
        raise KeyboardInterrupt

    return {number: signal.signal(number, stop) for number in (signal.SIGTERM, signal.SIGHUP)}


def watched(backend):
    """`OutputGuard` of a process that takes the voltage away should this one be killed; None for a simulated backend,
    and for one that does not say how (`SafetyMembers.outside_stop`). Raises HardwareError."""
    from microstage_ros.hardware.output_guard import OutputGuard
    from microstage_ros.hardware.protocol import HardwareError, safety_members

    members = safety_members(backend)
    if backend.simulated or "outside_stop" not in members:
        return None
    guard = OutputGuard()
    if not guard.start(members["outside_stop"]()):
        guard.close()
        raise HardwareError("the process that takes the voltage away, should this one be killed, does not start")
    return guard


def _tell(outcome, machine, folder):
    """The answer in a few lines."""
    from microstage_ros.commissioning.report import safe_words, settling_words

    print(f"{outcome.verdict}: {outcome.says}")
    if not machine.zeroed:
        print(safe_words(machine))
    for check in outcome.checks.values():
        if not check.passed:
            print(f"  failed: {check.id}: {check.says}")
    for row in outcome.moves:
        print(
            f"  {row['target_m'] * 1e6:7.4g} µm: bias {row['bias_m'] * 1e9:+7.2f} nm, 4s {row['four_s_m'] * 1e9:6.2f}"
            f" nm, settled {settling_words(row['settling_s'])} ms after the reference"
        )
    if outcome.moves and math.isfinite(outcome.sine):
        print(f"  slow sine: {outcome.sine * 1e9:.0f} nm at most")
    if outcome.margins:
        found = outcome.margins
        part = f" ({' and '.join(found.modelled)} modelled, above {found.highest_Hz:.0f} Hz)" if found.modelled else ""
        print(f"  margins, measured in motion: {found.phase_deg:.1f}°, {found.gain_dB:.1f} dB{part}")
    print(f"  {machine.time:.0f} s of machine time; {folder / 'report.html'}")
