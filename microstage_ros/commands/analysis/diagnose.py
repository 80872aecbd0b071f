"""``diagnose``: where model and measurement part, why, and what it gains to know."""

import argparse
import dataclasses
import json
import pathlib
import sys

from microstage_ros.commands import answer
from microstage_ros.commands.axis import check_effects_fit, warn
from microstage_ros.commands.given_twice import refuse_given_twice
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.progress import progress
from microstage_ros.control.runs.components import component_records
from microstage_ros.diagnosis.batch import (
    Case,
    cases_of,
    checked_record,
    diagnose_batch,
    diagnose_files,
    diagnose_records,
    diagnose_series,
)
from microstage_ros.diagnosis.fleet import is_address
from microstage_ros.diagnosis.report.answer import write_answer
from microstage_ros.diagnosis.report.page import headline
from microstage_ros.files import keep_earlier, missing, write_text
from microstage_ros.model.coarse_fine import CoarseFine, load_machine
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.readable import quantity

DESCRIPTION = """\
Compares measured records with the model of an axis file, names the physical cause of what differs, and writes
into DIR: report.html (for people), report.json, extended.yaml (the axis file with the causes, for simulate),
and a run file for every question that the records leave open.

Gain is measured on the records given with --holdout. Without it the program holds back some of the records
itself (or the end of a single one) and says which. --baseline gives records of the axis while the model was right.
A long series (more than 16 records) is diagnosed in groups of 8, one group in memory per process, and pooled.

A coarse axis with a fine stage on top (config/axes/coarse_fine.yaml) is diagnosed part by part, with --baseline:
answers go to DIR/coarse, DIR/fine and DIR/summary.json.

With --log LOG.yaml the records are logs of any machine, as its drive wrote them, and no axis file is needed:
`microstage diagnose --log LOG.yaml --help`, docs/logs.md.
"""


def main(argv=None):
    """Run the command. Returns 0; raises InputError for bad input."""
    given = sys.argv[1:] if argv is None else argv
    if any(word == "--log" or word.startswith("--log=") for word in given):
        from microstage_ros.commands.log_diagnosis import main as main_of_logs

        return main_of_logs(given)
    arguments = _parse(argv)
    if arguments.each:
        return _each(arguments)
    case = Case("", arguments.axis, tuple(arguments.records), tuple(arguments.holdout), tuple(arguments.baseline),
                arguments.out, arguments.seed)
    machine = load_machine(case.axis)  # a bad axis file is reported before long work begins, and so is a missing record
    for path in (*case.records, *case.holdout, *case.baseline):
        if not is_address(path) and not pathlib.Path(path).exists():
            raise missing(path, "a record: .mcap, bag folder, .csv[.gz|.xz]")
    refuse_given_twice(RECORD=case.records, holdout=case.holdout, baseline=case.baseline)
    if isinstance(machine, CoarseFine):
        return _of_two(machine, case, arguments)
    warn(machine)
    check_effects_fit(machine)
    keep_earlier("--out", [pathlib.Path(arguments.out) / "report.json"], arguments.force)
    report = _series(case, arguments) if case.is_series or arguments.scheduler else _alone(case, arguments.jobs)
    answer.state(report=report, folder=str(arguments.out))
    tell(report, arguments.out)
    return 0


def _of_two(machine, case, arguments):
    """A machine of two components: each has its answer in a folder of its own under ``case.out``. Returns 0."""
    if arguments.scheduler:
        raise InputError("--scheduler", arguments.scheduler, f"nothing: {case.axis} has two components")
    if not case.baseline:
        raise InputError("--baseline", "missing", "records of the healthy machine: what its two stages do to each "
                         "other is known from them alone")
    summary = pathlib.Path(case.out) / "summary.json"
    keep_earlier("--out", [summary], arguments.force)
    given = [[component_records(checked_record(path, machine.alone["coarse"]), machine.fine) for path in paths]
             for paths in (case.records, case.holdout, case.baseline)]
    rows = []
    for name, axis in machine.alone.items():
        records, holdout, baseline = ([each[name] for each in group] for group in given)
        with progress(f"diagnosing the {name} stage") as bar:
            found = diagnose_records(axis, records, holdout, baseline, case.seed, bar.say, arguments.jobs)
        report = write_answer(found, axis, pathlib.Path(case.out) / name, case.sources)
        rows.append(_row(dataclasses.replace(case, name=name), report))
        print(f"{name}: ", end="")
        tell(report, pathlib.Path(case.out) / name)
    write_text(summary, json.dumps(rows, indent=1, ensure_ascii=False) + "\n")
    answer.state(cases=rows, summary=str(summary))
    return 0


def _alone(case, jobs):
    """One case in this process, with a line of progress on a terminal."""
    with progress(
        "diagnosing", remembered=f"diagnose {len(case.records) + len(case.holdout) + len(case.baseline)} records"
    ) as bar:
        return diagnose_files(case, bar.say, jobs)


def _series(case, arguments):
    """A long series, or work for a cluster: in groups."""
    with progress("diagnosing groups of records") as bar:
        return diagnose_series(case, arguments.jobs, arguments.scheduler, bar.reach)


def _parse(argv):
    parser = Parser(prog="microstage diagnose", description=DESCRIPTION,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--axis", required=True, metavar="FILE", help="axis file of the model")
    parser.add_argument(
        "records", nargs="+", metavar="RECORD", help="records to learn from: .mcap, bag folder, .csv[.gz|.xz]"
    )
    parser.add_argument(
        "--holdout", nargs="+", default=[], metavar="RECORD", help="records on which the gain is measured"
    )
    parser.add_argument(
        "--baseline", nargs="+", default=[], metavar="RECORD", help="records of the axis while it was healthy"
    )
    parser.add_argument("--out", required=True, metavar="DIR", help="folder for the answer")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of thresholds and intervals (default 0)")
    parser.add_argument(
        "--each",
        action="store_true",
        help="every RECORD is a folder with the records of one axis (hold* held out, "
        "base* baseline, axis.yaml in place of --axis); answers go to DIR/NAME and DIR/summary.json",
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes on this machine (default 1)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="hand the work to this Dask scheduler, tcp://host:port")
    parser.add_force()
    arguments = parser.parse_args(argv)
    if arguments.jobs < 1:
        raise InputError("--jobs", arguments.jobs, "1 or more processes")
    return arguments


def _each(arguments):
    """Many axes: one line per axis as it ends, a summary file."""
    for option, names in (("holdout", "hold*"), ("baseline", "base*")):
        if getattr(arguments, option):
            raise InputError(f"--{option}", getattr(arguments, option)[0],
                             f"nothing beside --each: files {names} in the folder of each axis")
    cases, summary = (
        cases_of(arguments.records, arguments.axis, arguments.out, arguments.seed),
        pathlib.Path(arguments.out) / "summary.json",
    )
    keep_earlier("--out", [summary], arguments.force)
    rows, failed = [], 0
    with progress("diagnosing", len(cases)) as bar:
        for case, report in diagnose_batch(cases, arguments.jobs, arguments.scheduler):
            bar.advance()
            row = _row(case, report)
            failed += "error" in row
            rows.append(row)
            # what is done stays
            write_text(summary, json.dumps(sorted(rows, key=lambda r: r["case"]), indent=1, ensure_ascii=False) + "\n")
            print(f"{row['case']}: {row.get('error') or row['headline']}", flush=True)
    rows.sort(key=lambda row: row["case"])
    write_text(summary, json.dumps(rows, indent=1, ensure_ascii=False) + "\n")
    answer.state(cases=rows, summary=str(summary))
    return 1 if failed else 0


def _row(case, report):
    if isinstance(report, Exception):
        text = str(report) if isinstance(report, InputError) else f"{type(report).__name__}: {report}"
        return {"case": case.name, "error": text}
    return {
        "case": case.name,
        "verdict": report["verdict"],
        "causes": [cause["id"] for cause in report["causes"]],
        "rivals": [rivals["ids"] for rivals in report["rivals"]],
        "gain": report["gain"],
        "headline": headline(report),
    }


def tell(report, folder):
    """Print the answer in a few lines."""
    print(headline(report))
    for cause in report["causes"]:
        print(f"  {cause['id']}: {cause['sentence']} ({cause['share']:.0%} of what stood out)")
    for rivals in report["rivals"]:
        print(f"  open: {' or '.join(rivals['ids'])}; {rivals['experiment']} would tell")
    gain = report["gain"]
    if gain:
        before, after, floor, low, high = (quantity(v, gain["unit"]) for v in (
            gain["before"], gain["after"], gain["floor"], *gain["ci95"]))
        print(f"  {gain['metric']}: {before} before, {after} after (95 %: {low} … {high}), noise {floor}")
        print(f"  held out: {', '.join(gain['records'])}")
    print(f"  {pathlib.Path(folder) / 'report.html'}")
