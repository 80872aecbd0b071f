"""``identify``: friction and drive parameters from records, with their uncertainty."""

import argparse
import pathlib
import sys

import yaml

from microstage_ros import __version__
from microstage_ros.commands import answer
from microstage_ros.commands.axis import read_axis
from microstage_ros.commands.given_twice import refuse_given_twice
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.progress import progress
from microstage_ros.control.runs.components import component_records
from microstage_ros.files import keep_earlier, missing, write_text
from microstage_ros.identification.intake import take_in
from microstage_ros.identification.page import identification_page, in_words
from microstage_ros.identification.pipeline import identify
from microstage_ros.model.axis_file import FORMAT
from microstage_ros.model.coarse_fine import CoarseFine, load_machine
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import read_record

DESCRIPTION = """\
Identifies what the records tell of the machine that the axis file describes: a voltage-driven motor alone on a
bench (config/experiments/actuator_bench.yaml), guideways under incremental loading (guideway_bench.yaml), a
force-driven axis (config/emps.yaml), or a whole axis in closed loop (config/axis.yaml). Every record counts as one
repeat. A coarse axis with a fine stage on top (config/axes/coarse_fine.yaml) is identified part by part.
Writes an axis file (source: identified, with standard uncertainties) and, beside it, a page with the
curves, bands and residuals. What the records do not determine keeps the value of the axis file, and is said.
"""


def main(argv=None):
    """Run the command. Returns 0; raises InputError for bad input."""
    parser = Parser(prog="microstage identify", description=DESCRIPTION,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--axis", required=True, metavar="FILE", help="axis file of the machine the records come from")
    parser.add_argument("records", nargs="+", metavar="RECORD", help="records: .mcap, bag folder, .csv[.gz|.xz]")
    parser.add_argument(
        "--out", required=True, metavar="FILE", help="axis file to write (.yaml); the page goes beside it as .html"
    )
    parser.add_argument(
        "--into",
        metavar="FILE",
        help="write the results into this axis file's numbers instead of those of --axis "
        "(bench results into the whole axis)",
    )
    parser.add_argument(
        "--blocks", type=int, metavar="N", help="number of Maxwell-slip blocks, 1 to 8 (default: the data choose)"
    )
    parser.add_argument(
        "--refine",
        action="store_true",
        help="force-driven axes: values of least closed-loop error in place of the inverse model's",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the bootstrap (default 0)")
    parser.add_force()
    arguments = parser.parse_args(argv)
    out = pathlib.Path(arguments.out)
    if out.suffix not in (".yaml", ".yml"):
        raise InputError("--out", arguments.out, "a file name ending in .yaml")
    if arguments.blocks is not None and not 1 <= arguments.blocks <= 8:
        raise InputError("--blocks", arguments.blocks, "a whole number from 1 to 8")
    keep_earlier("--out", [out, out.with_suffix(".html")], arguments.force)
    for path in arguments.records:
        if not pathlib.Path(path).exists():
            raise missing(path, "a record: .mcap, bag folder, .csv[.gz|.xz]")
    refuse_given_twice(RECORD=arguments.records)
    machine = load_machine(arguments.axis)
    if isinstance(machine, CoarseFine):
        return _of_two(machine, arguments, out)
    axis = read_axis(arguments.axis)
    target = read_axis(arguments.into) if arguments.into else axis
    _identified(axis, target, read_record, arguments, out)
    return 0


def _of_two(machine, arguments, out):
    """A machine of two components: each is identified, and ``out`` names both. Returns 0."""
    if arguments.into:
        raise InputError("--into", arguments.into, f"nothing: {arguments.axis} has two components")
    files = {name: out.with_name(f"{out.stem}_{name}.yaml") for name in machine.alone}
    keep_earlier("--out", [page for file in files.values() for page in (file, file.with_suffix(".html"))],
                 arguments.force)
    answers = {}
    for name, axis in machine.alone.items():
        print(f"{name}: {axis.name}")
        take = lambda path, name=name: component_records(read_record(path), machine.fine)[name]
        answers[name] = _identified(axis, getattr(machine, name), take, arguments, files[name])
    names = {name: file.name for name, file in files.items()}
    write_text(out, yaml.safe_dump({"format": FORMAT, "name": machine.name, "components": names}, sort_keys=False))
    answer.state(axis=str(out), components=answers)
    print(f"  {out}")
    return 0


def _identified(axis, target, read, arguments, out):
    """Identify ``axis`` from the records that ``read(path)`` gives, write it into ``target``'s numbers, tell. Returns
    the mapping for the answer as JSON."""
    warnings = []
    with progress("identifying", len(arguments.records)) as bar:
        result = identify(
            _taken(arguments.records, axis, read, warnings, bar),
            axis,
            arguments.seed,
            bar.say,
            arguments.blocks,
            arguments.refine,
        )
    result.to_axis(target).save(
        out,
        provenance={
            "version": __version__,
            "command": "identify",
            "axis": arguments.axis,
            "records": list(arguments.records),
            "seed": arguments.seed,
        },
    )
    identification_page(result, axis, arguments.records, arguments.seed, warnings).save(out.with_suffix(".html"))
    facts = {
        "axis": str(out),
        "page": str(out.with_suffix(".html")),
        "warnings": warnings,
        "remarks": list(result.remarks),
        "parameters": {
            e.key: {"value": e.value, "stderr": e.stderr, "unit": e.unit, "determined": bool(e.determined)}
            for e in result.estimates.values()
        },
    }
    answer.state(**facts)
    tell(result, out, warnings)
    return facts


def _taken(paths, axis, read, warnings, bar):
    for path in paths:
        record, notes = take_in(read(path), axis)
        warnings.extend(notes)
        yield record
        bar.advance()


def tell(result, out, warnings=()):
    """Print the result in a few lines, warnings on standard error."""
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)
    for estimate in result.estimates.values():
        if estimate.determined:
            print(f"  {estimate.key}: {in_words(estimate)}")
    for estimate in result.estimates.values():
        if not estimate.determined:
            print(f"  {estimate.key}: {estimate.remark}")
    for remark in result.remarks:
        print(f"  {remark}")
    print(f"  {out}, {out.with_suffix('.html')}")
