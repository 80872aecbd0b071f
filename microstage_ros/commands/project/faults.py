"""``faults``: the fault campaign on real cells of the simulated axis, and healthy running."""

import json
import os
import sys

from microstage_ros.commands import answer
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.progress import progress
from microstage_ros.quantities.errors import InputError

MODES = ("paced_1kHz", "paced_10kHz", "lockstep")
COUNTS = {"trials": 51, "messages": 2000, "files": 500, "commands": 2000, "cycles": 0}


def main(argv=None):
    """Run the command. Returns 0 if every figure is kept, 1 if one falls short.

    Raises InputError: a number out of range, or nothing asked for.
    """
    parser = Parser(
        prog="microstage faults",
        description=(
            "Starts cells of the simulated axis, kills and stops their processes at random while the axis moves, and"
            " measures from outside: was it noticed, how long after the last valid command the voltage was zero, was"
            " every action answered, is anything left behind, does every bag open. Then messages and files that are"
            " none, commands delayed, reordered, replayed and doubled, a full disk, the clock set back, a second owner."
            " Fails if a figure falls short."
        ),
    )
    parser.add_argument(
        "--trials",
        type=int,
        metavar="N",
        help="kills, stops and full disks (default 51: each process, mode and fault once)",
    )
    parser.add_argument(
        "--messages",
        type=int,
        metavar="N",
        help="malformed messages from a stranger to a running cell, and as many to the callbacks of all nodes"
        " (default 2000)",
    )
    parser.add_argument(
        "--files",
        type=int,
        metavar="N",
        help="files of all kinds truncated, bit-flipped, with bad values (default 500)",
    )
    parser.add_argument("--commands", type=int, metavar="N", help="periods with disturbed commands (default 2000)")
    parser.add_argument(
        "--healthy",
        type=float,
        metavar="SECONDS",
        help="instead of faults: healthy running so long, with what every process holds",
    )
    parser.add_argument(
        "--periods", type=int, default=0, metavar="N", help="with --healthy: end sooner, after so many control periods"
    )
    parser.add_argument(
        "--cycles",
        type=int,
        metavar="N",
        help="instead of faults: so many cycles of the compiled loop without ROS, its memory and latency",
    )
    parser.add_argument("--mode", choices=MODES, help="only this one (default: all; of --healthy paced_1kHz)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of everything random (default 1)")
    parser.add_argument("--verbose", action="store_true", help="a line of JSON per trial on standard error")
    arguments = parser.parse_args(argv)
    for name in COUNTS:
        value = getattr(arguments, name)
        if value is not None and not 0 <= value <= 10**9:
            raise InputError(f"--{name}", value, "0 to 1000000000")
    if not 0 <= arguments.periods <= 10**9:
        raise InputError("--periods", arguments.periods, "0 to 1000000000 (0: as many as there are)")
    if arguments.periods and arguments.healthy is None:
        raise InputError("--periods", arguments.periods, "--healthy SECONDS beside it, the longest it may take")
    if arguments.healthy is not None and not 1.0 <= arguments.healthy <= 1e6:
        raise InputError("--healthy", arguments.healthy, "1 to 1000000 s")
    asked = [name for name in COUNTS if getattr(arguments, name) is not None]
    for name in COUNTS:  # who asks for one part gets this part
        default = 0 if asked or arguments.healthy is not None else COUNTS[name]
        setattr(arguments, name, default if getattr(arguments, name) is None else getattr(arguments, name))
    if not any(getattr(arguments, name) for name in PARTS):
        raise InputError(f"--{asked[0]}", 0, "1 or more of something: nothing is examined so")
    return _run(arguments)


def _run(arguments):
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    found, short = {}, []
    try:
        for name, part in PARTS.items():
            if not getattr(arguments, name):
                continue
            facts, falls = part(arguments)
            found[name] = facts
            short += [f"{name}: {text}" for text in falls]
    finally:
        rclpy.try_shutdown()
    answer.state(seed=arguments.seed, **found, fell_short=short)
    for name, facts in found.items():
        print(f"{name}:")
        for key, value in facts.items():
            print(f"  {key}: {value}")
    print("every figure kept" if not short else "fell short: " + "; ".join(short))
    return 1 if short else 0


def _teller(arguments, bar):
    def tell(facts):
        bar.advance("process" in facts)
        if arguments.verbose:
            print(json.dumps(facts), file=sys.stderr, flush=True)

    return tell


def _trials(arguments):
    from microstage_ros.ros.benchmarks.faults import campaign, judged

    modes = (arguments.mode,) if arguments.mode else MODES
    with progress("killing and stopping", arguments.trials) as bar:
        figures, short = judged(*campaign(arguments.trials, arguments.seed, _teller(arguments, bar), modes))
    return figures, short


def _one(facts):
    return facts, [facts["fell_short"]] if facts["fell_short"] else []


def _messages(arguments):
    from microstage_ros.ros.benchmarks.hostile.callbacks import feed_in_a_process
    from microstage_ros.ros.benchmarks.hostile.trial import flood_a_cell

    sent, fed = flood_a_cell(arguments.messages, arguments.seed), feed_in_a_process(arguments.messages, arguments.seed)
    return {"to_a_cell": sent, "to_callbacks": fed}, [
        facts["fell_short"] for facts in (sent, fed) if facts["fell_short"]
    ]


def _files(arguments):
    from microstage_ros.ros.benchmarks.hostile.files import SHARE, damage_files

    with progress("damaging files", len(SHARE)) as bar:
        found = damage_files(arguments.files, arguments.seed, lambda kind, facts: bar.advance())
    total = {
        name: sum(facts.get(name, 0) for facts in found.values())
        for name in ("files", "refused", "bad_values", "bad_values_accepted")
    }
    return {**total, **found}, [
        f"{kind}: {facts['fell_short']}" for kind, facts in found.items() if facts["fell_short"]
    ]


def _commands(arguments):
    from microstage_ros.ros.benchmarks.disturbed_commands import disturb
    from microstage_ros.ros.benchmarks.surroundings import surround

    disturbed, around = disturb(arguments.commands, arguments.seed), surround(arguments.mode or "lockstep")
    return {"disturbed": disturbed, "surroundings": around}, [
        facts["fell_short"] for facts in (disturbed, around) if facts["fell_short"]
    ]


def _healthy(arguments):
    from microstage_ros.ros.benchmarks.healthy import Healthy

    def tell(facts):
        bar.reach(facts["seconds"])
        if arguments.verbose and facts["seconds"] % 60 < 5:
            print(json.dumps(facts), file=sys.stderr, flush=True)

    with progress("running", round(arguments.healthy)) as bar:
        mode = arguments.mode or "paced_1kHz"
        return _one(Healthy(arguments.healthy, mode, arguments.seed, tell, arguments.periods).run())


def _cycles(arguments):
    from microstage_ros.ros.benchmarks.bare_loop import run_cycles

    with progress("running", 100) as bar:
        return _one(run_cycles(arguments.cycles, arguments.seed, lambda share: bar.reach(round(100 * share))))


PARTS = {
    "trials": _trials,
    "messages": _messages,
    "files": _files,
    "commands": _commands,
    "healthy": _healthy,
    "cycles": _cycles,
}
"""Option to what does it: (arguments) to facts and what falls short."""
