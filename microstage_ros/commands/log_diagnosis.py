"""``diagnose --log``: logs of other people's machines."""

import argparse
import json
import pathlib

from microstage_ros.commands import answer
from microstage_ros.commands.axis import read_axis
from microstage_ros.commands.given_twice import refuse_given_twice
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.progress import progress
from microstage_ros.diagnosis.logs.batch import cases_of_logs, diagnose_log_batch, with_axis
from microstage_ros.diagnosis.logs.case import diagnose_logs
from microstage_ros.diagnosis.logs.report.page import headline
from microstage_ros.diagnosis.logs.report.answer import write_log_answer
from microstage_ros.diagnosis.logs.report.trend import diagnose_over_time, write_trend
from microstage_ros.diagnosis.logs.selection.verdict import FEW_REPEATED
from microstage_ros.files import keep_earlier, missing, write_text
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.logs import load_description, read_log

DESCRIPTION = """\
Compares logs of a machine with logs from when it was healthy, and names what has changed, by how much, how sure,
and what else it might be. LOG.yaml says what the columns mean; `microstage log FILE` proposes one. No model of the
machine is needed: it is learned from the baseline, with its spread from run to run and from log to log.

With --over-time every NOW file is one point of a course, in the order given: the sizes with their intervals, and where
they change.

With --each every NOW is a folder with the logs of one machine.
"""


def main(argv):
    """Run ``diagnose --log``. Returns 0; raises InputError for bad input."""
    arguments = parser().parse_args(argv)
    if arguments.jobs < 1:
        raise InputError("--jobs", arguments.jobs, "1 or more processes")
    if arguments.each:
        if arguments.over_time:
            raise InputError("--over-time", "together with --each", "one of the two")
        return _each(arguments)
    if not arguments.baseline:
        raise InputError("--baseline", None, "logs of the machine while it was healthy")
    if arguments.scheduler:
        raise InputError("--scheduler", arguments.scheduler, "--each: a machine has one process")
    description = load_description(arguments.log)
    axis = read_axis(arguments.axis) if arguments.axis else None
    if axis is not None:
        description = with_axis(description, axis)
    for path in (*arguments.baseline, *arguments.records):
        if not pathlib.Path(path).exists():
            raise missing(path, "a log: .csv, .txt, .mat, .mcap, plain or .gz, .xz")
    refuse_given_twice(NOW=arguments.records, baseline=arguments.baseline)
    names = ("trend.json", "report.json") if arguments.over_time else ("report.json",)
    keep_earlier("--out", [pathlib.Path(arguments.out) / name for name in names], arguments.force)
    with progress("reading", len(arguments.baseline) + len(arguments.records)) as bar:
        logs = []
        for path in (*arguments.baseline, *arguments.records):
            logs.append(read_log(path, description))
            bar.advance()
        baseline, now = logs[: len(arguments.baseline)], logs[len(arguments.baseline):]
        sources = {
            "records": [str(p) for p in arguments.records],
            "now": [str(p) for p in arguments.records],
            "holdout": [],
            "baseline": [str(p) for p in arguments.baseline],
        }
        if arguments.over_time:
            trend = diagnose_over_time(baseline, now, description, arguments.seed)
            report = write_trend(trend, description, arguments.out, sources)
        else:
            bar.say("comparing with the baseline")
            report = write_log_answer(
                diagnose_logs(baseline, now, description, arguments.seed), description, arguments.out, sources, axis
            )
    answer.state(report=report, folder=str(arguments.out))
    tell_trend(report, arguments.out) if arguments.over_time else tell(report, arguments.out)
    return 0


def parser():
    """The options of ``diagnose --log``."""
    found = Parser(
        prog="microstage diagnose", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    found.add_argument("--log", required=True, metavar="LOG.yaml", help="what the columns of the files mean")
    found.add_argument(
        "--baseline", nargs="+", default=[], metavar="FILE", help="logs of the machine while it was healthy"
    )
    found.add_argument("--axis", metavar="FILE", help="axis file, for lead, gear ratio and mass, and for extended.yaml")
    found.add_argument("records", nargs="+", metavar="NOW", help="logs to examine")
    found.add_argument("--out", required=True, metavar="DIR", help="folder for the answer")
    found.add_argument(
        "--over-time",
        action="store_true",
        help="every NOW file is a point of a course; writes trend.json and report.html",
    )
    found.add_argument("--seed", type=int, default=0, metavar="N", help="written into the answer")
    found.add_argument(
        "--each",
        action="store_true",
        help="every NOW is a folder with the logs of one machine (base* its baseline, else "
        "--baseline; LOG.yaml and axis.yaml in place of those given); answers go to DIR/NAME and DIR/summary.json",
    )
    found.add_argument("--jobs", type=int, default=1, metavar="N", help="with --each: processes here (default 1)")
    found.add_argument(
        "--scheduler", metavar="ADDRESS", help="with --each: hand the work to this Dask scheduler, tcp://host:port"
    )
    found.add_force()
    return found


def _each(arguments):
    """Many machines: one line per machine as it ends, a summary file that is whole after every case."""
    cases = cases_of_logs(arguments.records, arguments.log, arguments.baseline, arguments.axis,
                          arguments.out, arguments.seed)
    summary = pathlib.Path(arguments.out) / "summary.json"
    keep_earlier("--out", [summary], arguments.force)
    rows = []
    with progress("diagnosing", len(cases)) as bar:
        for case, report in diagnose_log_batch(cases, arguments.jobs, arguments.scheduler):
            bar.advance()
            row = _row(case, report)
            rows = sorted([*rows, row], key=lambda one: one["case"])
            write_text(summary, json.dumps(rows, indent=1, ensure_ascii=False) + "\n")
            print(f"{case.name}: {row.get('error') or row['headline']}", flush=True)
    answer.state(cases=rows, summary=str(summary))
    return 1 if any("error" in row for row in rows) else 0


def _row(case, report):
    if isinstance(report, Exception):
        plain = isinstance(report, InputError)
        return {"case": case.name, "error": str(report) if plain else f"{type(report).__name__}: {report}"}
    return {"case": case.name, "verdict": report["verdict"], "causes": [one["id"] for one in report["causes"]],
            "rivals": [one["ids"] for one in report["rivals"]], "headline": headline(report)}


def tell(report, folder):
    """Print the answer in a few lines."""
    print(headline(report))
    for cause in report["causes"]:
        print(f"  {cause['id']}: {cause['sentence']} ({cause['share']:.0%} of what stood out)")
    for rivals in report["rivals"]:
        print(f"  open: {' or '.join(rivals['ids'])}; this would decide: {rivals['experiment']}")
    for note in report["notes"]:
        if note.startswith(FEW_REPEATED):
            print(f"  {note}")
    if report["not_visible"]:
        print(f"  not visible in these signals: {', '.join(report['not_visible'])}")
    print(f"  {pathlib.Path(folder) / 'report.html'}")


def tell_trend(report, folder):
    """Print the changes of a course in a few lines."""
    for line in report["sentences"]:
        print(line)
    print(f"  {pathlib.Path(folder) / 'report.html'}")
