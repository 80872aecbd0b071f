"""``campaign``: the diagnosis examined on many simulated axes with something hidden in each."""

import argparse
import dataclasses
import json
import math
import pathlib
import sys

from rich.console import Console
from rich.table import Table

from microstage_ros import __version__
from microstage_ros.commands import answer
from microstage_ros.commands.axis import read_axis
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.progress import progress
from microstage_ros.commands.tables import DIAGNOSIS
from microstage_ros.diagnosis.selection.calibration import calibrate, write_calibration
from microstage_ros.diagnosis.validation import campaign
from microstage_ros.diagnosis.validation.form_errors import form_errors
from microstage_ros.diagnosis.validation.ways import CASES
from microstage_ros.files import write_text
from microstage_ros.metrology.rates import rate
from microstage_ros.model.effects import REGISTRY
from microstage_ros.places import SOURCE, config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.report.stamped import digest

DEFAULT_AXIS = config_file("axis.yaml")
DESCRIPTION = """\
Hides effects in simulated axes, each from its own seed, lets the diagnosis look at the records alone, and prints
what it said against what was there: confusion matrix, false alarms, coverage of the stated intervals, gain, time.
"""


def main(argv=None):
    """Run the command. Returns 0; raises InputError for bad input."""
    arguments = _parse(argv)
    examined = campaign.examinations(arguments.cases, arguments.seed, str(arguments.axis), arguments.kind,
                                     arguments.strength, arguments.effect, arguments.world, not arguments.no_baseline)
    earlier = [outcome for path in arguments.earlier for outcome in earlier_outcomes(path)]
    outcomes = _resumed(arguments)
    finished = {outcome.number for outcome in outcomes}
    examined = [one for one in examined if one.number not in finished]
    with progress("examining", len(examined)) as bar:
        for outcome in campaign.run(examined, arguments.jobs, arguments.scheduler):
            outcomes.append(outcome)
            bar.advance()
            if arguments.resume:
                _write(arguments, outcomes)
            if arguments.verbose:
                print(_line(outcome), flush=True)
    outcomes.sort(key=lambda outcome: outcome.number)
    outcomes += earlier
    counts, medians = campaign.scores(outcomes)
    _write_result(arguments, outcomes)
    if arguments.calibrate:
        stated = [one for outcome in outcomes for one in outcome.stated + outcome.doubted]
        named = [(evidence, clarity, right) for _, _, evidence, clarity, right in stated]
        words = " ".join(["./microstage campaign", *(sys.argv[1:] if argv is None else argv)])
        write_calibration(arguments.calibrate, calibrate(named), words)
    console = Console(width=None if sys.stdout.isatty() else 160)
    show(outcomes, counts, medians, console)
    if arguments.form_errors:
        show_form_errors(outcomes, read_axis(arguments.axis).value("period"), console)
    return 0


def _parse(argv):
    parser = Parser(prog="microstage campaign", json="file", description=DESCRIPTION,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=27, metavar="N", help="number of cases (default 27)")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="of everything drawn (default 1)")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes (default 1)")
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="hand the cases to this Dask scheduler, tcp://host:port (docs/logs.md)"
    )
    parser.add_argument(
        "--kind", default="mixed", choices=("mixed", *campaign.KINDS), help="what to hide (default mixed)"
    )
    parser.add_argument("--effect", default="", metavar="ID", help="always hide this effect")
    parser.add_argument("--strength", type=float, default=1.0, metavar="X", help="factor on all sizes (default 1)")
    parser.add_argument(
        "--axis", type=pathlib.Path, default=DEFAULT_AXIS, metavar="FILE", help="axis file (default the shipped one)"
    )
    parser.add_argument(
        "--world",
        default="first",
        choices=tuple(CASES),
        help="who makes the records: the first world, or "
        "one of other programmes, controllers, encoders, noise, variability and friction laws (default first)",
    )
    parser.add_argument("--no-baseline", action="store_true",
                        help="give the diagnosis no healthy record: the axis file alone says what noise there is")
    parser.add_argument(
        "--calibrate",
        type=pathlib.Path,
        metavar="FILE",
        help="write the calibration of the stated probabilities that these cases give; with --from, of those",
    )
    parser.add_argument("--form-errors", action="store_true", help="print by what share sizes are off beyond the noise")
    parser.add_argument("--from", dest="earlier", nargs="+", type=pathlib.Path, default=[], metavar="JSON",
                        help="count the cases of earlier campaigns (their --json files) too")
    parser.add_argument(
        "--resume",
        action="store_true",
        help="with --json FILE: run only the cases that FILE lacks, and write it after every case",
    )
    parser.add_argument("--verbose", action="store_true", help="a line per case")
    arguments = parser.parse_args(argv)
    for name, value, least in (
        ("--cases", arguments.cases, 0 if arguments.earlier else 1),
        ("--jobs", arguments.jobs, 1),
        ("--seed", arguments.seed, 0),
    ):
        if value < least:
            raise InputError(name, value, f"{least} or more")
    if arguments.resume and not isinstance(arguments.json, str):
        raise InputError("--resume", "no file", "--json FILE, which holds the cases examined so far")
    if not arguments.strength > 0.0:
        raise InputError("--strength", arguments.strength, "a factor above 0")
    if arguments.effect and arguments.effect not in REGISTRY:
        raise InputError("--effect", arguments.effect, "one of " + ", ".join(sorted(REGISTRY)))
    read_axis(arguments.axis)
    arguments.code = digest(SOURCE, DIAGNOSIS)  # as it is when the cases begin
    return arguments


def _settings(arguments):
    """What must be the same for two runs to be parts of one campaign."""
    return {"seed": arguments.seed, "axis": str(arguments.axis), "kind": arguments.kind, "strength": arguments.strength,
            "effect": arguments.effect, "world": arguments.world, "baseline": not arguments.no_baseline,
            "code": arguments.code}


def _resumed(arguments):
    """Outcomes that the --json file holds already, with --resume; [] where there is no such file yet."""
    path = pathlib.Path(arguments.json) if arguments.resume else None
    if path is None or not path.exists():
        return []
    outcomes = earlier_outcomes(path, "--resume")
    tree = {"baseline": True, **json.loads(path.read_text(encoding="utf-8"))}  # older files do not say it
    for name, value in _settings(arguments).items():
        if tree.get(name) != value:
            raise InputError(f"--resume {path}: {name}", value, f"{tree.get(name)!r}, with which its cases were made")
    return outcomes


def earlier_outcomes(path, option="--from"):
    """Outcomes of an earlier campaign's JSON file. Raises `InputError` for a file that is none of this version."""
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
        cases = tree.get("cases") if isinstance(tree, dict) else None
        if not isinstance(cases, list) or not all(isinstance(case, dict) for case in cases):
            raise ValueError("no list of cases")
        fields = {field.name for field in dataclasses.fields(campaign.Outcome)}
        if any("stated" not in case for case in cases):
            raise ValueError("a case without stated, which earlier versions did not write")
        return [
            campaign.Outcome(**{key: _tuples(value) for key, value in case.items() if key in fields}) for case in cases
        ]
    except OSError as error:
        raise InputError(f"{option} {path}", error.strerror, "the --json file of a campaign") from None
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{option} {path}", str(error)[:80], "the --json file of a campaign of this version") from None


def _tuples(value):
    if value is None:
        return float("nan")
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def _line(outcome):
    way = "" if math.isnan(outcome.removed) else f" {outcome.removed:4.0%}"
    opened = "".join(f" open({'|'.join(ids)})" for ids in outcome.rivals)
    return (
        f"{outcome.number:4d} {outcome.name:32s} {outcome.verdict:17s}{', '.join(outcome.named)}{opened}{way}"
        f" {outcome.seconds:.0f} s {outcome.error}"
    )


def _tree(arguments, outcomes):
    counts, medians = campaign.scores(outcomes)
    return {
        "version": __version__,
        **_settings(arguments),
        "figures": {name: list(pair) for name, pair in counts.items()},
        "medians": {name: _plain(value) for name, value in medians.items()},
        "confusion": campaign.confusion(outcomes),
        "cases": [{key: _plain(value) for key, value in dataclasses.asdict(outcome).items()} for outcome in outcomes],
    }


def _write_result(arguments, outcomes):
    answer.state(**_tree(arguments, outcomes))
    if isinstance(arguments.json, str) and not arguments.resume:
        _write(arguments, outcomes)


def _write(arguments, outcomes):
    write_text(arguments.json, json.dumps(_tree(arguments, outcomes), indent=1, ensure_ascii=False) + "\n")


def _plain(value):
    return None if isinstance(value, float) and not math.isfinite(value) else value


def show(outcomes, counts, medians, console):
    """Print the confusion matrix, one line per hidden effect, and the figures.

    Parameters
    ----------
    outcomes : of the cases, `Outcome` each. counts : {what: (so many, of so many)} [1].
    medians : {what: median error of a size} [1]. console : of rich.
    """
    sheet = Table("hidden", "cases", "said first", title="What was said of what was there", title_justify="left")
    for name, said in sorted(campaign.confusion(outcomes).items()):
        sheet.add_row(name, str(said.total()), ", ".join(f"{word} {n}" for word, n in said.most_common()))
    for outcome in outcomes:
        if outcome.kind == "two":
            sheet.add_row(outcome.name, "1", ", ".join(outcome.named) or campaign.said(outcome))
    console.print(sheet)
    figures = Table("figure", "", "", title="Figures", title_justify="left")
    for name, (hits, of) in counts.items():
        interval = rate(hits, of)
        figures.add_row(
            name, f"{hits} of {of}", f"{hits / of:.0%} ({interval.low:.0%} … {interval.high:.0%})" if of else ""
        )
    for name, value in medians.items():
        figures.add_row(name, f"{value:.3g}", "")
    console.print(figures)
    diagram = Table(
        "stated probability", "mean stated", "right", title="Are the stated probabilities true", title_justify="left"
    )
    for low, high, mean, right, named in campaign.reliability(outcomes):
        diagram.add_row(f"{low:.2f} … {high:.2f}", f"{mean:.3f}", str(rate(right, named)))
    console.print(diagram)


def show_form_errors(outcomes, period, console):
    """Print by what share of themselves sizes are off beyond the noise (`form_errors`).

    Parameters
    ----------
    outcomes : of the cases, `Outcome` each. period : of the control loop [s]. console : of rich.
    """
    sheet = Table("size", "inside 95 %", "stated", "most likely", "95 % interval",
                  title="Form errors", title_justify="left")
    for one in form_errors([error for outcome in outcomes for error in outcome.errors], period):
        sheet.add_row(one.parameter, str(rate(one.inside, one.count)), f"{one.stated:.2g}", f"{one.share:.2g}",
                      f"{one.low:.2g} … {one.high:.2g}")
    console.print(sheet)
