"""The answer of a diagnosis in files: report.json, extended.yaml, run files of experiments, report.html."""

import json
import math

import yaml

from microstage_ros import __version__
from microstage_ros.diagnosis.report.consequences import consequences
from microstage_ros.diagnosis.report.experiment import separating_run
from microstage_ros.diagnosis.report.extended import write_extended
from microstage_ros.diagnosis.report.page import write_page
from microstage_ros.diagnosis.report.wording import sentence_of
from microstage_ros.diagnosis.report.within_range import within_range
from microstage_ros.files import complete_folder

FORMAT = 1


def write_answer(diagnosis, axis, folder, sources):
    """Write all files of one diagnosis into ``folder`` (made if need be); returns the mapping of report.json.

    ``sources``: {"records": [...], "holdout": [...], "baseline": [...]} names of what was read.
    The files appear together when all are complete. Raises InputError if the folder cannot be written.
    """
    diagnosis = within_range(diagnosis, axis)
    with complete_folder(folder) as folder:
        experiments = _write_experiments(diagnosis, axis, folder)
        report = report_fields(diagnosis, experiments, axis, sources)
        report["notes"] += _uncompared(axis)
        extended = write_extended(axis, diagnosis, folder / "extended.yaml", sources)
        if extended.effects != axis.effects or diagnosis.identified:
            report["consequences"] = [{"name": c.name, "before": plain(c.before), "after": plain(c.after), "unit": "m"}
                                      for c in consequences(axis, extended)]
        (folder / "report.json").write_text(json.dumps(report, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
        write_page(report, diagnosis, axis, folder / "report.html")
    return report


def _uncompared(axis):
    """A sentence on effects of the axis file that are not in what records are compared with: the balances of a screw
    axis are of the machine without any. A list of one, or empty."""
    if not axis.effects or axis.choices["drive.type"] != "voltage_motor":
        return []
    return [f"The effects of the axis file ({', '.join(axis.effects)}) are not in the model that the records were"
            " compared with: what is still there of them is found again; extended.yaml keeps the others, unexamined."]


def report_fields(diagnosis, experiments, axis, sources):
    """The mapping of report.json; ``experiments``: run file names, one per entry of ``diagnosis.rivals``."""
    gain = diagnosis.gain
    return {
        "format": FORMAT,
        "verdict": diagnosis.verdict,
        "causes": [_cause(cause) for cause in diagnosis.causes],
        "rivals": [
            {"ids": list(rivals.ids), "why": rivals.why, "experiment": name}
            for rivals, name in zip(diagnosis.rivals, experiments)
        ],
        "gain": unmeasured(sources) if gain is None else gain_fields(gain),
        "extended_axis": "extended.yaml",
        "findings": finding_fields(diagnosis.findings),
        "identified": {key: _parameter(number) for key, number in diagnosis.identified.items()},
        "consequences": [],
        "notes": list(diagnosis.notes),
        "axis": axis.place,
        "sources": sources,
        "seed": diagnosis.seed,
        "version": __version__,
    }


def _cause(cause):
    return {
        "id": cause.id,
        "parameters": {name: _parameter(number) for name, number in cause.parameters.items()},
        "probability": plain(cause.probability),
        "share": plain(cause.share),
        "gain": {"before": plain(cause.gain.before), "after": plain(cause.gain.after), "unit": cause.gain.unit},
        "channel": cause.channel,
        "sentence": cause.sentence or sentence_of(cause.id, cause.parameters),
    }


def _parameter(number):
    return {"value": plain(number.value), "stderr": plain(number.stderr), "unit": number.unit}


def gain_fields(gain):
    """The field ``gain`` of report.json of an `Improvement`."""
    return {
        "metric": gain.metric,
        "unit": gain.unit,
        "records": [str(name) for name in gain.records],
        "before": plain(gain.before),
        "after": plain(gain.after),
        "floor": plain(gain.floor),
        "ci95": [plain(v) for v in gain.ci95],
    }


def unmeasured(sources):
    """The field ``gain`` of report.json where no residual could be made of the records: its keys, and no numbers."""
    return {
        "metric": "not measured: no residual could be made of the records, see the notes",
        "unit": "1",
        "records": [str(name) for name in sources.get("holdout") or sources.get("records", ())],
        **dict.fromkeys(("before", "after", "floor")),
        "ci95": [None, None],
    }


def finding_fields(findings):
    """The field ``findings`` of report.json: one mapping per `Finding`."""
    return [
        {
            "channel": f.channel,
            "coordinate": f.coordinate,
            "statistic": plain(f.statistic),
            "threshold": plain(f.threshold),
            "left": plain(f.left),
            "significant": bool(f.significant),
        }
        for f in findings
    ]


def plain(value):
    """A float, ``value`` [any unit], that JSON can hold: None for what is not a number."""
    value = float(value)
    return value if math.isfinite(value) else None


def _write_experiments(diagnosis, axis, folder):
    """One run file for each pair of rivals; returns their names."""
    names = []
    for number, rivals in enumerate(diagnosis.rivals, 1):
        name = f"separate_{number}.yaml"
        run = rivals.experiment or separating_run(rivals.ids, axis)
        heading = f"# Separates {', '.join(rivals.ids)}: {rivals.why}\n".replace("\n", " ").strip() + "\n"
        (folder / name).write_text(heading + yaml.safe_dump(run, sort_keys=False, allow_unicode=True))
        names.append(name)
    return names
