"""``watch``: is the axis still the machine that it was? Scores against its own healthy spread, live or from records."""

import dataclasses
import math
from pathlib import Path

from microstage_ros import __version__
from microstage_ros.commands import answer, units
from microstage_ros.commands.given_twice import refuse_given_twice
from microstage_ros.commands.operator import name_live_axes
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.progress import progress
from microstage_ros.diagnosis.preprocessing.preparation import LEAST_ROWS
from microstage_ros.files import missing
from microstage_ros.model.axis_file import load_axis
from microstage_ros.monitoring.health import IN_A_ROW, LEAST_WINDOWS, MOST_FALSE_ALARMS, Watch
from microstage_ros.monitoring.store import Store
from microstage_ros.monitoring.traits import Machine
from microstage_ros.monitoring.validation import EFFECTS, EXAMINED_WINDOW, examine, table
from microstage_ros.monitoring.windows import DEFAULT_WINDOW, windows_of
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec
from microstage_ros.quantities.yaml_text import yaml_tree
from microstage_ros.records import read_record


def main(argv=None):
    """Run the command. Returns 0 whether there was an alarm or not; raises InputError for bad input."""
    parser = Parser(
        prog="microstage watch",
        description=(
            "Watches an axis. With records: judges them in the order given, which is to be that of time. Without: runs"
            " the node health_monitor beside a cell until interrupted. A score of 1 is the threshold; an alarm takes"
            f" {IN_A_ROW} windows in a row."
        ),
    )
    parser.add_argument(
        "records", nargs="*", metavar="RECORD", help="records to judge, the oldest first; none: watch a running axis"
    )
    parser.add_argument("--axis", required=True, metavar="FILE", help="axis file that the machine is compared with")
    parser.add_argument(
        "--baseline",
        action="append",
        default=[],
        metavar="RECORD",
        help="a record of the healthy axis to learn its spread from; may be given again",
    )
    parser.add_argument(
        "--healthy",
        type=int,
        default=20,
        metavar="N",
        help="without --baseline: so many first windows count as healthy (default 20)",
    )
    parser.add_argument(
        "--window", type=units.duration, default=DEFAULT_WINDOW, metavar="TIME", help="length of a window (default 20s)"
    )
    parser.add_argument(
        "--false-alarms", type=float, default=1.0, metavar="N", help="accepted per month of motion (default 1)"
    )
    parser.add_argument(
        "--store", metavar="FILE", help="history file (SQLite): healthy windows and every score are kept there"
    )
    parser.add_argument(
        "--namespace", type=units.namespace, default="/axis", metavar="NS", help="of the running axis (default /axis)"
    )
    parser.add_argument(
        "--examine",
        type=int,
        metavar="N",
        help="no records: simulate N axes of this kind, healthy and with effects that "
        "set in, and tell how many alarms are false and how soon the others come",
    )
    parser.add_argument("--seed", type=int, default=1, help="of the examination (default 1)")
    arguments = parser.parse_args(argv)
    if arguments.healthy < LEAST_WINDOWS:
        raise InputError("--healthy", arguments.healthy, f"{LEAST_WINDOWS} or more")
    if not 0.0 < arguments.false_alarms <= MOST_FALSE_ALARMS:
        raise InputError("--false-alarms", arguments.false_alarms,
                         f"false alarms per month, a number above 0 and up to {MOST_FALSE_ALARMS:g}")
    axis = load_axis(arguments.axis)
    if arguments.examine is not None:
        return _examine(axis, arguments)
    if not arguments.records:
        _check_live(arguments, axis)
        return _live(arguments)
    with Store(arguments.store or ":memory:", axis.name, arguments.window) as store:
        return _judge_records(arguments, Machine(axis), store)


def _judge_records(arguments, machine, store):
    """Learn what is healthy, judge the rest, tell. Returns 0."""
    refuse_given_twice(RECORD=arguments.records, baseline=arguments.baseline)
    _meet(arguments, machine)
    store.hold(machine)
    _learn(arguments.baseline, machine, store, arguments.window)
    records = list(arguments.records)
    watch, judged, alarms = None, 0, {}
    with progress("watching", total=len(records)) as bar:
        for name in records:
            for time, window in windows_of(read_record(name), arguments.window):
                traits = machine.traits(window)
                if store.has_learned(time, traits):
                    continue  # of an earlier day, or given as a baseline: no judge of itself
                if watch is None:
                    if len(store.healthy()) < (
                        LEAST_WINDOWS if arguments.baseline or arguments.store else arguments.healthy
                    ):
                        store.add_healthy(time, name, traits)
                        continue
                    watch = Watch(store.reference(), arguments.false_alarms)
                    _say_reference(watch)
                judged += 1
                health = watch.judge(time, traits, name)
                store.add_health(time, name, health)
                _say_window(name, time, health, alarms)
            bar.advance()
    if watch is None:
        raise InputError(
            "watch: windows", len(store.healthy()), "records with more windows of motion than --healthy, or --baseline"
        )
    _say_end(judged, alarms, watch)
    return 0


def _meet(arguments, machine):
    """Show the machine every window that is to come: a sensor that one of them lacks is used in none. Raises InputError
    where no record can be cut into such windows."""
    longest, names = 0.0, dict.fromkeys((*arguments.baseline, *arguments.records))
    with progress("reading", total=len(names)) as bar:
        for name in names:
            record = dataclasses.replace(read_record(name), remarks=())
            if round(arguments.window / record.period_s) < LEAST_ROWS:
                raise InputError("--window", arguments.window,
                                 f"{LEAST_ROWS * record.period_s:g} s or more: {LEAST_ROWS} control periods of {name}")
            longest = max(longest, len(record) * record.period_s)
            for _, window in windows_of(record, arguments.window):
                machine.meet(window)
            bar.advance()
    if longest < arguments.window:
        raise InputError("--window", arguments.window, f"at most {longest:g} s, as long as the longest record is")


def _check_live(arguments, axis):
    """Raise InputError for what the node would refuse when it starts: values outside the ranges of its parameter file,
    another kind of axis, a history of another axis or window."""
    place = config_file("health_monitor.yaml")
    entries = yaml_tree(place.read_text(encoding="utf-8"), str(place))
    for option, name, value in (
        ("--window", "window", arguments.window),
        ("--healthy", "healthy_windows", arguments.healthy),
        ("--false-alarms", "false_alarms_per_month", arguments.false_alarms),
    ):
        entry = entries[name]
        Spec(entry["unit"], entry["minimum"], entry["maximum"], entry["description"]).check(value, option)
    for path in arguments.baseline:
        if "," in path:
            raise InputError("--baseline", path, "a name without a comma beside a running axis")
        if not Path(path).exists():
            raise missing(path, "a record: .mcap, bag folder, .csv[.gz|.xz]")
    Machine(axis)
    if arguments.store:
        Store(arguments.store, axis.name, arguments.window).close()


def _learn(paths, machine, store, window_s):
    """Put the windows of healthy records into the store."""
    for name in paths:
        for time, window in windows_of(read_record(name), window_s):
            store.add_healthy(time, name, machine.traits(window))


def _say_reference(watch):
    r = watch.reference
    print(
        f"healthy: {r.windows} windows of {r.window_s:g} s, {len(r.spread)} traits; threshold {watch.limit:.2f}"
        f" standard deviations for {watch.per_month:g} false alarms in a month of motion"
        + (f" (few windows: with {r.windows} the threshold is wide)" if r.windows < 30 else "")
    )


def _say_window(name, time, health, alarms):
    """One line for a window, and one more where an alarm begins."""
    worst = max(health, key=lambda channel: health[channel].score)
    print(
        f"{name} {time:9.1f} s  "
        + "  ".join(f"{channel} {h.score:.2f}" for channel, h in sorted(health.items()))
        + f"   largest: {worst}, {health[worst].trait}"
    )
    for channel, h in health.items():
        if h.alarm and channel not in alarms:
            alarms[channel] = {
                "channel": channel,
                "trait": h.trait,
                "score": h.score,
                "record": h.record,
                "since_s": h.since,
            }
            print(f"ALARM  {channel}: {h.trait}, since {h.since:.1f} s of {h.record}; "
                  "`microstage diagnose` names the cause")


def _say_end(judged, alarms, watch):
    print(f"{judged} windows judged, {'no alarm' if not alarms else 'alarm in ' + ', '.join(sorted(alarms))}")
    answer.state(
        windows=judged,
        alarms=list(alarms.values()),
        healthy_windows=watch.reference.windows,
        threshold=watch.limit,
        window_s=watch.reference.window_s,
        false_alarms_per_month=watch.per_month,
        made_by=__version__,
        channels=sorted({channel for channel, _ in watch.reference.spread}),
    )


def _examine(axis, arguments):
    """Simulated axes: rates of alarms with their interval. Returns 0."""
    if arguments.examine < 1:
        raise InputError("--examine", arguments.examine, "1 or more axes")
    outcomes = []
    with progress("examining", total=arguments.examine * (len(EFFECTS) + 1)) as bar:
        for seed in range(arguments.seed, arguments.seed + arguments.examine):
            for effect in ("", *EFFECTS):
                outcomes.append(
                    examine(
                        axis,
                        effect,
                        seed,
                        arguments.healthy,
                        window_s=EXAMINED_WINDOW,
                        per_month=arguments.false_alarms,
                    )
                )
                bar.advance()
    rows = table(outcomes)
    print(f"{'':24}{'alarms of axes (95 %)':32}windows until the alarm, median")
    for name, row in rows.items():
        print(f"{name:24}{row['noticed']!s:32}{row['windows'] if row['windows'] is not None else '-'}")
    healthy = [o for o in outcomes if not o.effect]
    motion = sum(o.windows if o.delay is None else o.delay for o in healthy) * EXAMINED_WINDOW
    print(
        f"healthy motion examined: {motion:.0f} s, {sum(o.delay is not None for o in healthy)} false alarms; windows of"
        f" {EXAMINED_WINDOW:g} s"
    )
    answer.state(
        seed=arguments.seed,
        axes=arguments.examine,
        window_s=EXAMINED_WINDOW,
        healthy_motion_s=motion,
        rows={
            name: {
                "alarms": row["noticed"].hits,
                "axes": row["noticed"].cases,
                "ci95": [row["noticed"].low, row["noticed"].high],
                "windows": row["windows"],
            }
            for name, row in rows.items()
        },
    )
    return 0


def _live(arguments):
    """Run the node beside a cell until interrupted. Returns its exit status."""
    name_live_axes(arguments.namespace)
    from microstage_ros.ros.nodes.health_monitor import main as run

    parameters = {
        "axis_file": arguments.axis,
        "window": float(arguments.window),
        "healthy_windows": arguments.healthy,
        "false_alarms_per_month": arguments.false_alarms,
        "store": arguments.store or "",
        "baseline": ",".join(arguments.baseline),
    }
    words = [
        f"{name}:={value if not isinstance(value, str) else repr(value)}"
        for name, value in parameters.items()
        if not (isinstance(value, float) and math.isnan(value))
    ]
    print(
        f"watching {arguments.namespace}: a score after each {arguments.window:g} s of motion, the first"
        f" {arguments.healthy} windows count as healthy. Ctrl-C ends it.",
        flush=True,
    )
    return run(["--ros-args", "-r", f"__ns:={arguments.namespace}", *(part for word in words for part in ("-p", word))])
