"""``move``: one move or several through the action, with feedback."""

import argparse
import sys
import time
from pathlib import Path

from microstage_ros.commands import answer, units
from microstage_ros.commands.operator import name_live_axes, say
from microstage_ros.commands.parser import Parser
from microstage_ros.files import unreadable
from microstage_ros.quantities.errors import InputError

PHASES = {1: "moving", 2: "settling", 3: "stopping"}
WAIT_S = 600.0  # longest wait for a result, unless the move itself may take longer [s]


def main(argv=None):
    """Run the command. Returns 0 if every target was reached, 2 if a move was refused, 1 otherwise.

    Raises InputError: less than one repetition.
    """
    parser = Parser(prog="microstage move", description=(
        "Moves a running axis (microstage cell). Lengths are typed as 10um, -50nm, 0.5mm, or in metres as 1e-5; "
        "one that begins with + counts from where the axis stands."))
    place = parser.add_mutually_exclusive_group(required=True)
    place.add_argument(
        "--to", nargs="+", type=units.target, metavar="PLACE", help="target from home, or several one after the other"
    )
    place.add_argument(
        "--by", type=units.length, metavar="LENGTH", help="so far from where the axis stands, either sign"
    )
    place.add_argument("--targets", metavar="FILE", help="a target per line; # begins a comment")
    parser.add_argument("--repeat", type=int, default=1, metavar="N", help="all targets so many times (default 1)")
    parser.add_argument(
        "--dwell", type=units.duration, default=0.0, metavar="TIME", help="rest between two moves (default none)"
    )
    parser.add_argument(
        "--namespace", type=units.namespace, default="/axis", metavar="NS", help="of the axis (default /axis)"
    )
    parser.add_argument(
        "--tolerance",
        type=units.positive_length,
        default=5e-8,
        metavar="LENGTH",
        help="half width that counts as reached (default 50nm)",
    )
    parser.add_argument(
        "--speed", type=units.speed, default=0.0, metavar="SPEED", help="largest speed (default: that of the axis)"
    )
    parser.add_argument(
        "--timeout", type=units.duration, default=10.0, metavar="TIME", help="from start to settled (default 10s)"
    )
    arguments = parser.parse_args(argv)
    if arguments.repeat < 1:
        raise InputError("--repeat", arguments.repeat, "1 or more")
    targets = (
        [units.Target(arguments.by, True)]
        if arguments.by is not None
        else arguments.to or read_targets(arguments.targets)
    )
    return _run(arguments, targets * arguments.repeat)


def read_targets(path):
    """`units.Target` of every line of a file. Raises `InputError` with the line that is none."""
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise unreadable(path, error, "a file with a target per line") from None
    except UnicodeDecodeError:
        raise InputError(path, "no text", "a file with a target per line") from None
    found = []
    for number, line in enumerate(lines, 1):
        text = line.partition("#")[0].strip()
        try:
            found += [units.target(text)] if text else []
        except argparse.ArgumentTypeError:
            raise InputError(
                f"{path}: line {number}", text[:40], "a length such as 10um, +50nm or 1e-5 (metres)"
            ) from None
    if not found:
        raise InputError(path, "no target", "a target per line, such as 10um")
    return found


def _run(arguments, targets):
    name_live_axes(arguments.namespace)
    import rclpy

    from microstage_ros.ros.client import AxisClient, NoAnswer, patience

    results, status = [], 0
    rclpy.init()
    try:
        with AxisClient(arguments.namespace, sought=patience(), starting=say) as axis:
            for number, target in enumerate(targets):
                if number and arguments.dwell:
                    time.sleep(arguments.dwell)
                place = target.value + (_start(axis, results) if target.relative else 0.0)
                status = _move(axis, place, arguments, results, several=len(targets) > 1)
                if status:
                    break
    except NoAnswer as error:
        answer.state(error={"place": arguments.namespace, "says": str(error)})
        print(error, file=sys.stderr)
        status = 1
    finally:
        rclpy.try_shutdown()
    answer.state(moves=results)
    if status and len(targets) > 1:
        print(f"{sum(each['reached'] for each in results)} of {len(targets)} moves were made", file=sys.stderr)
    return status


def _start(axis, results):
    """Where the set point stands [m]: the target of the move before, or what the axis says."""
    return results[-1]["target_m"] if results else axis.reference()


def _move(axis, place, arguments, results, several):
    """One move; its result goes to ``results``. Returns the exit status."""
    from microstage_msgs.action import MoveTo

    result = axis.move(
        place, tell_feedback, wait=max(WAIT_S, 2.0 * arguments.timeout), tolerance=arguments.tolerance,
        timeout=arguments.timeout, max_velocity=arguments.speed
    )
    if sys.stderr.isatty():
        print("\r\033[K", end="", file=sys.stderr)
    results.append({"target_m": place, "reached": bool(result.reached), "final_error_m": result.final_error,
                    "interferometer_error_m": result.interferometer_error, "settling_time_s": result.settling_time,
                    "overshoot_m": result.overshoot, "code": int(result.code), "message": result.message})
    if result.code == MoveTo.Result.CODE_REFUSED:
        print(result.message, file=sys.stderr)
        return 2
    print((f"{units.shown_length(place)}: " if several else "") + sentence(result))
    return 0 if result.reached else 1


def sentence(result):
    """A move's result in one line, errors in [nm]; what was not measured is left out."""
    parts = [f"{1e9 * value:+.1f} nm by the {who}" for value, who in (
        (result.final_error, "encoder"), (result.interferometer_error, "interferometer")) if value == value]
    text = result.message + (": error " + ", ".join(parts) if parts else "")
    return text + (
        f", settled after {result.settling_time * 1e3:.0f} ms" if result.settling_time == result.settling_time else ""
    )


def tell_feedback(feedback):
    """Where the stage is, on a terminal."""
    if sys.stderr.isatty():
        print(
            f"\r{feedback.position * 1e6:+12.3f} µm  {feedback.error * 1e9:+14.1f} nm to go "
            f" {PHASES[feedback.phase]:9}",
            end="",
            file=sys.stderr,
            flush=True,
        )
