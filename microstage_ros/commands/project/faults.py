"""``faults``: the fault campaign on a real cell of the simulated axis."""

import json
import os
import sys

from microstage_ros.commands import answer
from microstage_ros.commands.parser import Parser
from microstage_ros.quantities.errors import InputError


def main(argv=None):
    """Run the command. Returns 0 if every figure is kept, 1 if one falls short."""
    parser = Parser(prog="microstage faults", description=(
        "Starts cells of the simulated axis, kills and stops their processes at random while the axis moves, and measures from "
        "outside: was it noticed, how long after the last valid command the voltage was zero, was every action answered, is "
        "anything left behind, does every bag open. Fails if a figure falls short."))
    parser.add_argument("--trials", type=int, default=36, metavar="N", help="kills and stops (default 36: each process, mode and fault once)")
    parser.add_argument("--messages", type=int, default=2000, metavar="N", help="malformed messages from a stranger (default 2000)")
    parser.add_argument("--files", type=int, default=200, metavar="N", help="bags truncated and bit-flipped (default 200)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of everything random (default 1)")
    arguments = parser.parse_args(argv)
    for name in ("trials", "messages", "files"):
        if not 0 <= getattr(arguments, name) <= 10**7:
            raise InputError(f"--{name}", getattr(arguments, name), "0 to 10000000")
    return _run(arguments)


def _run(arguments):
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from microstage_ros.ros.benchmarks.faults import campaign, judged
    from microstage_ros.ros.benchmarks.hostile_files import damage_bags
    from microstage_ros.ros.benchmarks.hostile_trial import flood_a_cell

    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

    def tell(facts):
        print(json.dumps(facts), file=sys.stderr, flush=True)

    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        figures, short = judged(campaign(arguments.trials, arguments.seed, tell))
        messages = flood_a_cell(arguments.messages, arguments.seed) if arguments.messages else None
    finally:
        rclpy.try_shutdown()
    files = damage_bags(arguments.files, arguments.seed) if arguments.files else None
    if messages and messages["fell_short"]:
        short.append(f"malformed messages: {messages['fell_short']}")
    if files and files["fell_short"]:
        short.append(f"malformed files: {files['fell_short']}")
    answer.state(seed=arguments.seed, processes=figures, messages=messages, files=files, fell_short=short)
    for name, value in figures.items():
        print(f"{name}: {value}")
    for name, facts in (("messages", messages), ("files", files)):
        print(f"{name}: {facts}")
    print("every figure kept" if not short else "fell short: " + "; ".join(short))
    return 1 if short else 0
