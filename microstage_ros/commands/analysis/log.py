"""``log``: what a foreign log is, as a LOG.yaml to correct; and the examination of `diagnose --log` on simulated
machines."""

import argparse
import pathlib
import sys

import numpy as np
import yaml

from microstage_ros.commands import answer
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.progress import progress
from microstage_ros.diagnosis.logs.preprocessing.motion import STATES, motion_of, tops
from microstage_ros.files import complete_folder, keep_earlier, write_text
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.logs.description import description_of, separator_of, skip_rows_of
from microstage_ros.records.logs.log import read_log, read_table
from microstage_ros.records.logs.propose import oddities, propose
from microstage_ros.report.page import Page
from microstage_ros.report.plots import COLOURS, legend_above, new_figure, plot_signal, readable

DESCRIPTION = """\
Looks at a log of any machine (CSV with any separator and preamble, EPOS Studio, TwinCAT Scope, halscope, camonitor,
MATLAB, MCAP) and proposes the LOG.yaml that `diagnose --log` needs: columns, units, rate, signs, cycles. Prints it, or
with --out writes DIR/LOG.yaml and DIR/report.html with a picture of what was understood. Guesses are marked; what is
missing is said.

With --examine N instead of a file: N simulated machines that nobody here has tuned for, degraded as logs are, with or
without something hidden; prints rates with their 95 % intervals.
"""

CHANGING, STILL = ("accelerates or brakes", "yellow"), ("at rest", "grey")
PHASES = {"start": CHANGING, "brake": CHANGING, "rest": STILL, "settled": STILL}
"""Phase of a motion to what its shade is called, and its colour."""


def main(argv=None):
    """Run the command. Returns 0; raises InputError for bad input."""
    parser = Parser(
        prog="microstage log",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        json="flag",
    )
    parser.add_argument("file", nargs="?", metavar="FILE", help="the log")
    parser.add_argument("--out", metavar="DIR", help="folder for LOG.yaml and report.html")
    parser.add_argument("--separator", default="", metavar="C", help="where the one that is found is wrong")
    parser.add_argument(
        "--skip-rows", type=int, metavar="N", help="lines before the header, where what is found is wrong"
    )
    parser.add_argument("--examine", type=int, metavar="N", help="examine diagnose --log on N simulated machines")
    parser.add_argument(
        "--kind", default="mixed", choices=("mixed", "healthy", "one", "two"), help="with --examine: what is hidden"
    )
    parser.add_argument("--effect", default="", metavar="ID", help="with --examine: always hide this effect")
    parser.add_argument("--strength", type=float, default=1.0, metavar="X", help="with --examine: factor on all sizes")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="with --examine: of everything drawn")
    parser.add_argument("--verbose", action="store_true", help="with --examine: a line per case")
    parser.add_argument("--names-only", action="store_true", help="with --examine: not which effects the signals carry,"
                        " which takes most of the time")
    parser.add_argument("--calibrate", metavar="FILE", type=pathlib.Path, help="with --examine: write the calibration "
                        "of the stated probabilities that these cases give")
    parser.add_force()
    arguments = parser.parse_args(argv)
    if arguments.examine is not None:
        if arguments.file:
            raise InputError("FILE", arguments.file, "no file together with --examine, which simulates its machines")
        return _examine(arguments, sys.argv[1:] if argv is None else argv)
    if not arguments.file:
        raise InputError("FILE", None, "a log to look at, or --examine N")
    return _look(arguments)


def _look(arguments):
    """Propose a LOG.yaml for one file."""
    arguments.separator = separator_of(arguments.separator, "--separator")
    skip_rows_of(arguments.skip_rows, "--skip-rows")
    if arguments.out:
        keep_earlier("--out", [pathlib.Path(arguments.out) / "LOG.yaml"], arguments.force)
    from microstage_ros.records.logs.description import LogDescription

    shown = LogDescription(arguments.file, {}, {}, separator=arguments.separator, skip_rows=arguments.skip_rows)
    table = read_table(arguments.file, shown)
    if table.rows < 2:
        raise InputError(arguments.file, f"{table.rows} row", "at least two rows")
    found = propose(table)
    odd = [*table.notes, *oddities(table, found.tree)]
    text = as_yaml(found, arguments)
    answer.state(
        proposal=found.tree,
        reasons=found.reasons,
        missing=found.missing,
        unused=found.unused,
        oddities=odd,
        kind=found.kind,
        rows=found.rows,
    )
    print(text, end="")
    for sentence in odd:
        print(f"# {sentence}")
    if arguments.out:
        with complete_folder(arguments.out) as folder:
            write_text(folder / "LOG.yaml", text)
            _page(arguments.file, found, odd, text, folder / "report.html")
        print(f"# {pathlib.Path(arguments.out) / 'LOG.yaml'}, {pathlib.Path(arguments.out) / 'report.html'}")
    return 0


def as_yaml(found, arguments):
    """The proposal as LOG.yaml, guesses marked, missing entries as comments."""
    lines = [
        f"# Proposed for {arguments.file}: {found.kind}, {found.rows} rows. Correct it, then: microstage diagnose --log"
        " LOG.yaml …"
    ]
    if arguments.separator:
        lines.append(f"separator: {arguments.separator!r}")
    if arguments.skip_rows is not None:
        lines.append(f"skip_rows: {arguments.skip_rows}")
    for key, value in found.tree.items():
        entry = (
            yaml.safe_dump(value, default_flow_style=True, allow_unicode=True, width=200)
            .strip()
            .removesuffix("...")
            .strip()
        )
        why = "; ".join(reason for name, reason in found.reasons.items() if name.split(".")[0] == key)
        lines.append(f"{key}: {entry}" + (f"     # {why}" if why else ""))
    lines += [f"# missing  {sentence}" for sentence in found.missing]
    lines += [f"# column not understood: {name}" for name in found.unused[:20]]
    return "\n".join(lines) + "\n"


def _page(path, found, odd, text, where):
    """A page with the picture of what was understood."""
    page = Page("What this log seems to be", str(path))
    page.verdict(
        f"{found.kind[:1].upper()}{found.kind[1:]}, {found.rows} rows; found in it:"
        f" {', '.join(k.replace('_', ' ') for k in found.tree if isinstance(found.tree[k], dict))}.",
        "caution" if found.reasons else "good",
        more="Guesses are marked in LOG.yaml; correct them before they are used." if found.reasons else "",
    )
    try:
        log = read_log(path, description_of({k: v for k, v in found.tree.items() if v is not None}, "the proposal"))
        page.figure(
            _picture(log),
            "The first stretch, with the phases of motion as they are understood; without colour: constant speed.",
            "signals against time, shaded by phases of motion",
        )
    except InputError as error:
        page.text(f"The log cannot be read with this proposal yet: {error}")
    page.section("LOG.yaml")
    page.code(text)
    if found.missing:
        page.section("What is missing")
        page.list(found.missing)
    if odd:
        page.section("What is odd")
        page.list(odd)
    page.save(where)


def _picture(log):
    """Signals of the first stretch over time, phases shaded."""
    names = [n for n in ("reference", "position", "velocity", "following_error", log.effort) if n and n in log.signals]
    if "reference" in names and "position" in names:
        names.remove("position")
    figure, axes = new_figure(len(names), 1, height=1.7, sharex=True, squeeze=False)
    shown = slice(0, min(len(log), max(int(20.0 / log.period), 400)))
    motion = motion_of(log, *tops([log]))
    time = np.arange(len(log)) * log.period
    for axis, name in zip(axes[:, 0], names):
        unit = {log.effort: log.effort_unit, "velocity": f"{log.place_unit}/s"}.get(name, log.place_unit)
        words = name.replace("_", " ")
        words = words if name != log.effort or log.signed else f"|{words}|"
        factor, label = readable(f"{words} [{unit}]", [log.signals[name][shown]])
        if unit == "1":
            factor, label = 100.0, f"{words}\n[% of nominal]"
        plot_signal(axis, time[shown], factor * log.signals[name][shown], color=COLOURS["blue"])
        state = motion.state[shown]
        edges = np.concatenate([[0], np.flatnonzero(np.diff(state)) + 1, [len(state)]])
        named = set()
        for a, b in list(zip(edges[:-1], edges[1:]))[:200]:
            phase = PHASES.get(STATES[state[a]])
            if phase:
                words, colour = phase
                axis.axvspan(time[a], time[b - 1] + log.period, color=COLOURS[colour], alpha=0.25, lw=0,
                             label=None if words in named else words)
                named.add(words)
        axis.set_ylabel(label)
    axes[-1, 0].set_xlabel("time [s]")
    legend_above(axes[0, 0])
    return figure


def _examine(arguments, argv):
    from microstage_ros.diagnosis.selection.calibration import calibrate, write_calibration
    from microstage_ros.diagnosis.validation import campaign, log_campaign

    if arguments.examine < 1:
        raise InputError("--examine", arguments.examine, "1 case or more")
    if not arguments.strength > 0.0:
        raise InputError("--strength", arguments.strength, "a finite number above 0")
    if arguments.effect and arguments.effect not in log_campaign.EFFECTS:
        raise InputError("--effect", arguments.effect, "one of " + ", ".join(log_campaign.EFFECTS))
    if arguments.out:
        keep_earlier("--out", [pathlib.Path(arguments.out) / "examination.json"], arguments.force)
    outcomes = []
    with progress("examining", arguments.examine) as bar:
        for outcome in log_campaign.run(
            arguments.examine, arguments.seed, arguments.kind, arguments.effect, arguments.strength,
            arguments.names_only,
        ):
            outcomes.append(outcome)
            bar.advance()
            if arguments.verbose:
                print(log_campaign.line(outcome), flush=True)
    figures = log_campaign.scores(outcomes)
    if arguments.calibrate:
        named = [one[2:] for outcome in outcomes for one in outcome.stated]
        write_calibration(arguments.calibrate, calibrate(named), " ".join(["./microstage log", *argv]))
    answer.state(figures=figures, reliability=campaign.reliability(outcomes),
                 visibility=log_campaign.visibility_table(outcomes), seed=arguments.seed)
    for text in log_campaign.sentences(figures, outcomes):
        print(text)
    if arguments.out:
        log_campaign.write(outcomes, figures, arguments)
    return 0
