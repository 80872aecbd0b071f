"""Many logs over weeks: the course of each size with its interval and its change points."""

import dataclasses
import json
import math

import numpy as np

from microstage_ros import __version__
from microstage_ros.diagnosis.logs import case
from microstage_ros.diagnosis.logs.report import pictures
from microstage_ros.diagnosis.logs.selection import course as course_module
from microstage_ros.diagnosis.logs.report.page import headline, size_of
from microstage_ros.diagnosis.logs.report.answer import report_fields
from microstage_ros.diagnosis.report.wording import advice_for, listed, name_of
from microstage_ros.files import complete_folder
from microstage_ros.report.page import Page

FOLLOWED = (
    "friction_level_change",
    "viscous_change",
    "direction_asymmetry",
    "gravity_tilt",
    "cable_spring",
    "position_dependent_friction",
    "torque_ripple",
    "payload_change",
    "backlash",
    "transport_delay",
    "scale_error",
    "floor_vibration",
    "resistance_rise",
    "amplifier_gain",
)
#: Modified z-score from which on one log lies off the others, and the ratio of the median deviation to the standard
#: deviation of a normal distribution in it. Source: Iglewicz and Hoaglin, How to detect and handle outliers, 1993.
OUTLYING, TO_SIGMA = 3.5, 0.6745
LEAST_LOGS = 3             # logs of now, of which two can agree against one; derived: a median of two lies off both


@dataclasses.dataclass
class Trend:
    """``courses``: {effect id: (points, indices of change points)}; ``last``: `LogDiagnosis` of the logs after the last
    change; ``order``: sources, baseline first; ``changes``: indices into it; ``passed``: None, or, where those logs
    agree with the baseline, (indices of the logs of now that did not, their `LogDiagnosis`, whether there are later
    ones and these agree)."""

    courses: dict
    last: object
    order: list
    changes: list
    passed: tuple | None = None


def diagnose_over_time(baseline, now, description, seed=0):
    """`Trend` of the logs of now, in the order given, each against the baseline.

    The courses are of single effects, each fitted alone; what the change is, the diagnosis of the logs after the last
    common change point says, with all its rivals; ``seed``: written into the result [1]. Raises InputError as
    `case.diagnose_logs` does.
    """
    whole = case.diagnose_logs(baseline, now, description, seed)
    courses = {}
    for stage in whole.evidence["stages"]:
        for name in stage.problem.effects:
            if name in FOLLOWED and whole.visibility.get(name, (False,))[0]:
                points = course_module.course_of(stage, name, whole.evidence["groups"], per_file=True)
                courses[name] = (
                    points,
                    course_module.change_points([p.value for p in points], [p.stderr for p in points]),
                )
    after_baseline = sum(p.baseline for p in next(iter(courses.values()))[0]) if courses else len(baseline)
    # the effect whose course moves most, over its own errors, dates the change
    best = max(courses, key=lambda n: _movement(courses[n][0]), default=None)
    changes = courses[best][1] if best else []
    last = max((c for c in changes if c > after_baseline), default=after_baseline) - after_baseline
    tail = now[last:] or now
    answer = case.diagnose_logs(baseline, tail, description, seed) if last else whole
    passed = None
    if best and _agrees(answer):
        span = passing(courses[best][0], changes)
        alone = case.diagnose_logs(baseline, [now[k] for k in span], description, seed) if span else answer
        if not _agrees(alone):
            later = now[span[-1] + 1:]
            back = later and (last > span[-1] or _agrees(case.diagnose_logs(baseline, later, description, seed)))
            passed = (span, alone, bool(back))
    return Trend(courses, answer, [log.source for log in [*baseline, *now]], changes, passed)


def _agrees(answer):
    return answer.diagnosis.verdict == "agrees"


def passing(points, changes):
    """Numbers of the logs of now that may have differed for a time: those before the last change, else the one that
    lies farthest off the others, if it lies `OUTLYING` or more off; a list that may be empty.

    ``points``: `Point` per log, baseline first; ``changes``: indices of points before which the mean changes [1].
    """
    first = sum(p.baseline for p in points)
    inside = [c for c in changes if c > first]
    if inside:
        return list(range(max([c for c in changes if first < c < inside[-1]], default=first) - first,
                          inside[-1] - first))
    values = np.array([p.value for p in points[first:]])
    if len(values) < LEAST_LOGS or not np.isfinite(values).all():
        return []
    off = np.abs(values - np.median(values))
    error = float(np.median([p.stderr for p in points[first:]]))
    worst = int(np.argmax(off))
    return [worst] if TO_SIGMA * off[worst] > OUTLYING * max(float(np.median(off)), TO_SIGMA * error) else []


def _movement(points):
    values = [(p.value, p.stderr) for p in points if math.isfinite(p.value) and p.stderr > 0.0]
    return max((abs(v) / e for v, e in values), default=0.0)


def write_trend(trend, description, folder, sources):
    """Write trend.json, report.json (of the logs after the last change) and report.html; returns the mapping of
    trend.json."""
    report = report_fields(trend.last, description, sources)
    rows = {}
    for name, (points, changes) in trend.courses.items():
        rows[name] = {
            "points": [
                {"source": p.source, "value": _plain(p.value), "stderr": _plain(p.stderr), "baseline": p.baseline}
                for p in points
            ],
            "unit": "1",
            "of": "level of the channel",
            "changes_at": [points[c].source for c in changes],
        }
    passed = _passed_fields(trend, description, sources)
    after = "After the last change: " if trend.changes else ""
    sentences = [_in_passing(passed, sources["now"]) if passed else f"{after}{headline(report)}"]
    for change in trend.changes:
        sentences.append(f"  changes at {trend.order[change]}")
    tree = {
        "format": 1,
        "verdict": report["verdict"],
        "courses": rows,
        "changes_at": [trend.order[c] for c in trend.changes],
        "report": report,
        "passed": passed,
        "sentences": sentences,
        "sources": sources,
        "version": __version__,
    }
    with complete_folder(folder) as place:
        _page(trend, report, tree, description, place / "report.html")
        for name, content in (("trend.json", tree), ("report.json", report)):
            (place / name).write_text(
                json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
            )
    return tree


def _passed_fields(trend, description, sources):
    """{"logs": numbers of those that differed for a time, from 1, "report": their report, "back": whether later ones
    agree}, or None."""
    if trend.passed is None:
        return None
    span, alone, back = trend.passed
    own = {name: [sources[name][k] for k in span] for name in ("records", "now")}
    return {"logs": [k + 1 for k in span], "report": report_fields(alone, description, {**sources, **own}),
            "back": back}


def _in_passing(passed, now):
    """What differed for a time, in one sentence, and whether it was over at the end."""
    first, last = passed["logs"][0], passed["logs"][-1]
    which = (f"Log {first} of {len(now)} ({now[first - 1]}) differs" if first == last
             else f"Logs {first} to {last} of {len(now)} (from {now[first - 1]}) differ")
    after = "The logs after that" if passed["back"] else "All logs taken together"
    return f"{which} from the baseline: {headline(passed['report'])} {after} agree with the baseline."


def _plain(value):
    return float(value) if math.isfinite(value) else None


def _page(trend, report, tree, description, path):
    from microstage_ros.diagnosis.report.wording import TONES

    page = Page(
        "The course of this machine",
        description.name or description.place,
        configuration=description.place,
        seed=report["seed"],
        about={"Logs": f"{len(trend.order)}"},
    )
    page.verdict(
        tree["sentences"][0],
        TONES[report["verdict"]] if tree["passed"] is None else "caution",
        more="; ".join(s.strip() for s in tree["sentences"][1:]),
    )
    page.section("What has changed" + (" for a time" if tree["passed"] else ""))
    report = tree["passed"]["report"] if tree["passed"] else report
    page.list([f"{name_of(c['id'])}: {size_of(c)}. {advice_for(c['id'])}" for c in report["causes"]]
              + [f"Open, {listed([name_of(i).lower() for i in r['ids']], 'or')}. This would decide: {r['experiment']}."
                 for r in report["rivals"]] or ["Nothing."])
    page.section("Courses")
    for name, (points, changes) in sorted(trend.courses.items(), key=lambda item: -_movement(item[1][0])):
        page.heading(name_of(name))
        page.figure(
            pictures.course(points, "change\n[% of the level]", changes, per_log=True),
            "One point per log with its 95 % interval; each effect is fitted by itself, so that effects which look"
            " alike move together." + (" Dashed: where the mean changes." if changes else ""),
            name_of(name),
        )
    page.save(path)
