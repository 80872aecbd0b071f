"""The answer of a log's diagnosis in files: report.json, report.html, extended.yaml where an axis file was given."""

import json

from microstage_ros import __version__
from microstage_ros.diagnosis.logs.selection import course as course_module
from microstage_ros.diagnosis.logs.report.page import write_page
from microstage_ros.diagnosis.report.answer import FORMAT, finding_fields, gain_fields, plain
from microstage_ros.diagnosis.report.extended import write_extended
from microstage_ros.diagnosis.report.wording import sentence_of
from microstage_ros.files import complete_folder
from microstage_ros.model.effects import REGISTRY
from microstage_ros.model.effects.effect import CONTACTS
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.plant import make_plant

SHAPELESS = ("position_dependent_friction", "screw_pitch_error")
"""A log tells how large they are, and the axis file asks along which shape."""


def write_log_answer(result, description, folder, sources, axis=None):
    """Write the files of one diagnosis into ``folder``; returns the mapping of report.json.

    ``sources``: {"now": [...], "baseline": [...]}. Raises InputError if the folder cannot be written.
    """
    with complete_folder(folder) as folder:
        report = report_fields(result, description, sources, axis)
        if axis is not None:
            report["extended_axis"] = _extended(result.diagnosis, axis, folder, sources, report)
        write_page(report, result, folder / "report.html", description)
        (folder / "report.json").write_text(
            json.dumps(report, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
        )
    return report


def report_fields(result, description, sources, axis=None):
    """The mapping of report.json: the fields of every diagnosis, and what is particular to logs."""
    diagnosis, gain = result.diagnosis, result.diagnosis.gain
    return {
        "format": FORMAT,
        "verdict": diagnosis.verdict,
        "causes": [_cause(cause) for cause in diagnosis.causes],
        "rivals": [
            {
                "ids": list(r.ids),
                "why": r.why,
                "experiment": r.experiment["decides"],
                "parameters": {name: _parameters(p) for name, p in sizes.items()},
            }
            for r, sizes in zip(diagnosis.rivals, result.rival_sizes)
        ],
        "gain": gain_fields(gain),
        "extended_axis": None,
        "findings": finding_fields(diagnosis.findings),
        "since": since(result),
        "compared": float(result.evidence["compared"]),
        "visible": {
            name: {"visible": entry[0], "detectable": plain(entry[1]), "of": "level of the channel"}
            for name, entry in sorted(result.visibility.items())
        },
        "not_visible": dict(sorted(result.hidden.items())),
        "healthy": [
            {
                "channel": c,
                "condition": _condition(result, code),
                "name": name,
                "value": plain(v),
                "stderr": plain(e),
                "unit": u,
            }
            for c, code, name, v, e, u in result.healthy
        ],
        "identified": {},
        "consequences": [],
        "notes": list(diagnosis.notes),
        "axis": axis.place if axis is not None else None,
        "log": description.place,
        "sources": sources,
        "seed": diagnosis.seed,
        "version": __version__,
    }


def _condition(result, code):
    if code < 0:
        return None
    rows = result.evidence["groups"]["baseline"][0]
    labels = [
        label
        for k, label in enumerate(rows.log.conditions)
        if code in set(rows.condition[rows.log.condition == k].tolist())
    ]
    return " ".join(map(str, labels[0])) if labels and labels[0] else None


def since(result):
    """Per named or open effect: {"id", "source", "repetition"} from which on its course differs from the baseline, or
    None."""
    out = []
    for stage in result.evidence["stages"]:
        for choice in stage.chosen:
            points = course_module.course_of(stage, choice.name, result.evidence["groups"])
            now = [p for p in points if not p.baseline]
            changes = course_module.change_points([p.value for p in now], [p.stderr for p in now])
            first = changes[-1] if changes else 0
            out.append({"id": choice.name.rstrip("+"), "source": now[first].source, "repetition": now[first].number + 1,
                        "from_the_start": not changes} if now else None)
    return [entry for entry in out if entry]


def _cause(cause):
    return {"id": cause.id, "parameters": _parameters(cause.parameters),
            "probability": plain(cause.probability), "share": plain(cause.share),
            "gain": {"before": plain(cause.gain.before), "after": plain(cause.gain.after), "unit": cause.gain.unit},
            "channel": cause.channel, "sentence": cause.sentence or sentence_of(cause.id, cause.parameters)}


def _parameters(parameters):
    return {
        name: {"value": plain(p.value), "stderr": plain(p.stderr), "unit": p.unit} for name, p in parameters.items()
    }


def _extended(diagnosis, axis, folder, sources, report):
    """Write extended.yaml with those causes whose sizes are parameters of the axis's effects; returns its name."""
    import dataclasses

    kept = []
    for cause in diagnosis.causes:
        effect = _effect_of(cause, axis)
        if effect is None:
            report["notes"].append(
                f"{cause.id} is not in extended.yaml: its size in these signals is no parameter of the axis file."
            )
        elif effect:
            kept.append(dataclasses.replace(cause, effect=effect))
    write_extended(axis, dataclasses.replace(diagnosis, causes=tuple(kept)), folder / "extended.yaml", sources)
    return "extended.yaml"


def _effect_of(cause, axis):
    """Parameters of a cause as an effect that the axis can have, at the first contact that has it; None where its size
    is none of these."""
    if cause.id not in REGISTRY or cause.id in SHAPELESS:
        return None
    effect = REGISTRY[cause.id]
    given = {name: p.value for name, p in cause.parameters.items()
             if name in effect.parameters and effect.parameters[name].unit == p.unit}
    for contact in CONTACTS if effect.on_contact else (None,):
        tried = given | ({"contact": contact} if contact and given else {})
        try:
            make_plant(axis, effects={cause.id: tried})
        except InputError:
            continue
        return tried
    return None
