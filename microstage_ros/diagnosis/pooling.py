"""A long series of records of one axis: diagnosed in groups, one group in memory at a time, then pooled.

A thousand records do not fit into memory, and over their time the axis may have changed. So the series is
cut into groups in the order given; each is a diagnosis of its own (on any core or cluster), and the pooled
answer says what most groups agree on, with the spread between them, and from which group on.
"""

import dataclasses
import math
import pathlib

import numpy as np

from microstage_ros.diagnosis.report.wording import is_measured
from microstage_ros.diagnosis.result import (
    Cause, Diagnosis, Finding, Improvement, OverallImprovement, Parameter, Picture, Rivals
)
from microstage_ros.model.axis_file import load_axis

GROUP = 8                      # records to learn from in one group
BASELINES = 4                  # baseline records that every group gets
AGREED = 0.5                   # share of the groups that must name a cause,
STAYED = 2                     # or this many groups at the end, all of them from the first that names it


def groups_of(case, size=GROUP):
    """`many.Case` for every group, of ``size`` [1] records, of a long case; held-out records are dealt out to the
    groups in order.

    A group left without held-out records holds back some of its own, as a short case does.
    """
    count = math.ceil(len(case.records) / size)
    learn, held = _dealt(case.records, count), _dealt(case.holdout, count)
    return [
        dataclasses.replace(
            case,
            name=f"group {number + 1}",
            records=learn[number],
            holdout=held[number],
            baseline=case.baseline[:BASELINES],
            out=str(pathlib.Path(case.out) / "groups" / f"{number + 1:04d}"),
        )
        for number in range(count)
    ]


def _dealt(items, count):
    return [tuple(part) for part in np.array_split(np.array(items, dtype=object), count)]


def pool(groups, reports, seed):
    """`Diagnosis` of the whole series from the groups (`many.Case`) and their report mappings, in their order.

    ``seed``: written into the result [1].
    """
    named = {}
    for number, report in enumerate(reports):
        for cause in report["causes"]:
            named.setdefault(cause["id"], []).append((number, cause))
    where = {name: [number for number, _ in found] for name, found in named.items()}
    confirmed = [name for name in named if _is_confirmed(where[name], len(reports))]
    causes = [_pooled(named[name], groups, reports) for name in confirmed]
    causes.sort(key=lambda cause: -cause.share)
    notes = [
        f"{len(reports)} groups of up to {GROUP} records were diagnosed one by one; what more than half of them name, "
        "or all from some group on, is a cause."
    ]
    notes += [f"{name} was named in {len(where[name])} of {len(reports)} groups (first in group {where[name][0] + 1})"
              + ("." if name in confirmed else " and not named as a cause.") for name in sorted(named)]
    rivals = _rivals(reports, AGREED * len(reports))
    return Diagnosis(_verdict(reports, causes, rivals), tuple(causes), rivals, _gain(reports), _findings(reports),
                     _pictures(named, len(reports)), tuple(notes), seed)


def _pooled(found, groups, reports):
    """One `Cause`: medians over the groups that name it, and the spread between the groups in the standard error."""
    numbers, causes = [number for number, _ in found], [cause for _, cause in found]
    parameters = {}
    for name, first in causes[0]["parameters"].items():
        values = [
            c["parameters"][name]
            for c in causes
            if name in c["parameters"] and c["parameters"][name]["value"] is not None
        ]
        sizes, spread = np.array([v["value"] for v in values]), np.array([v["stderr"] or 0.0 for v in values])
        between = np.std(sizes, ddof=1) if len(sizes) > 1 else 0.0
        error = max(between, float(np.median(spread))) / math.sqrt(len(sizes))
        parameters[name] = Parameter(float(np.median(sizes)), float(error), first["unit"])
    middle = numbers[int(np.argsort([cause["share"] for cause in causes])[len(causes) // 2])]
    effect = load_axis(pathlib.Path(groups[middle].out) / "extended.yaml").effects[causes[0]["id"]]
    before, after = (_rms([cause["gain"][key] for cause in causes]) for key in ("before", "after"))
    gain = Improvement(before, after, causes[0]["gain"]["unit"])
    share = float(np.sum([cause["share"] for cause in causes]) / len(reports))
    return Cause(
        causes[0]["id"],
        parameters,
        effect,
        float(max(cause["probability"] or 0.0 for cause in causes)),
        share,
        gain,
        causes[0]["channel"],
    )


def _rms(values):
    return float(np.sqrt(np.mean(np.square([v for v in values if v is not None]))))


def _rivals(reports, needed):
    """Open questions that more than half of the groups leave."""
    found = {}
    for report in reports:
        for rivals in report["rivals"]:
            found.setdefault(tuple(sorted(rivals["ids"])), []).append(rivals)
    return tuple(
        Rivals(tuple(entries[0]["ids"]), entries[0]["why"], {}) for entries in found.values() if len(entries) > needed
    )


def _is_confirmed(where, count):
    """Whether the groups that name a cause are most, or all from one on to the end."""
    return len(where) > AGREED * count or (len(where) >= STAYED and where == list(range(where[0], count)))


def _verdict(reports, causes, rivals):
    """Open questions first; else explained if most groups are, given causes; else the commonest of the groups'."""
    verdicts = [report["verdict"] for report in reports]
    if rivals:
        return "undetermined"
    if causes:
        return (
            "explained"
            if sum(v in ("explained", "agrees") for v in verdicts) > len(verdicts) / 2
            else "partly_explained"
        )
    common = max(sorted(set(verdicts)), key=verdicts.count)
    return common if common in ("agrees", "unexplained") else "unexplained"


def _gain(reports):
    gains = [report["gain"] for report in reports if is_measured(report)]
    if not gains:
        return None
    before, after, floor = (_rms([gain[key] for gain in gains]) for key in ("before", "after", "floor"))
    afters = np.array([gain["after"] for gain in gains])
    error = 1.96 * float(np.std(afters, ddof=1)) / math.sqrt(len(afters)) if len(afters) > 1 else 0.0
    records = tuple(name for gain in gains for name in gain["records"])
    return OverallImprovement(
        gains[0]["metric"], gains[0]["unit"], records, before, after, floor, (max(after - error, 0.0), after + error)
    )


def _findings(reports):
    """Medians over the groups, for coordinates that every group has."""
    tables = [{(f["channel"], f["coordinate"]): f for f in report["findings"]} for report in reports]
    common = [key for key in tables[0] if all(key in table for table in tables)]
    return tuple(Finding(*key, *(float(np.median([table[key][field] or 0.0 for table in tables]))
                                 for field in ("statistic", "threshold", "left"))) for key in common)


def _pictures(named, count):
    """Share of every cause over the groups: when it came."""
    if not named:
        return ()
    curves = {}
    for name, found in named.items():
        share = np.zeros(count)
        for number, cause in found:
            share[number] = cause["share"]
        curves[name] = (np.arange(1, count + 1), share)
    return (
        Picture("series", "Share of each cause over the series", "group of records", "share of what stood out", curves),
    )
