"""The answer: verdict, causes with sizes, rivals with what separates them, gain on repetitions held back, findings."""

import math
import pathlib

import numpy as np
from scipy.stats import f as f_distribution

from microstage_ros.diagnosis.logs.preprocessing import spread
from microstage_ros.diagnosis.logs.preprocessing.channels import FLUCTUATION
from microstage_ros.diagnosis.logs.selection import decide
from microstage_ros.diagnosis.logs.selection.context import LogDiagnosis, healthy_table, hidden_effects
from microstage_ros.diagnosis.logs.selection.effects import (
    BEHIND, BEHIND_NEED, FOLLOWING, FORCED, FROM_READING, WITHOUT_EFFORT, separation,
)
from microstage_ros.diagnosis.logs.selection.gain import gain_of_confirmed
from microstage_ros.diagnosis.logs.selection.sizes import Fitted, parameters_of, widening
from microstage_ros.diagnosis.logs.selection.stages import stages_of
from microstage_ros.diagnosis.logs.selection.visibility import LARGEST, LEVEL
from microstage_ros.diagnosis.report.wording import sentence_of
from microstage_ros.diagnosis.result import Cause, Diagnosis, Finding, Improvement, Rivals
from microstage_ros.diagnosis.stored_calibration import stored_calibration

CALIBRATION = pathlib.Path(__file__).with_name("calibration.yaml")     # written by `log --examine … --calibrate`
LATE_S, GAP = 0.02, 0.005  # s, and share of the stroke: sizes that are counted as visible if they would be found
#: Names in the effort that a rough reading can feign where the motion is known from that reading alone.
MISREAD = ("rising_static_friction", "torque_ripple", "payload_change", "friction_level_change", "cable_spring")
# log p of the strongest effect in the effort, below which it may be behind what the error shows
HINT = math.log(0.01)
BRINGS_NO_ERROR = ("torque_ripple", "floor_vibration", "amplifier_offset")
#: What the error would show of lost motion and the like, were the effort as before.
BESIDE = "logs from after the changed effort has been dealt with: beside it, what the error does is its consequence"
CREEP = 0.001              # of the stroke: creep at rest that is counted as usual
# s: a lag of the amplifier that is counted as usual, and the position loop's time constant that it acts through
LAG_S, LOOP_S = 0.002, 0.05
# of a size, by which its form's misfit may mislead it; a judgement, held by the coverage that `log --examine` measures
FORM_SIZE = 0.04
FEW_REPEATED = "Few baseline repetitions"
FEW = 6                    # repetitions of the baseline below which thresholds are called wide


def answer(reduced, spreads, groups, context, notes, open_sign, seed):
    """`LogDiagnosis` of channels: stages solved in order, the effort first, then what the error shows beside it.

    ``reduced``: {channel: `Coordinates`}; ``seed``: written into the result [1].
    """
    stages = stages_of(reduced, spreads, BEHIND if context.position_at == "motor" else ())
    changed = False
    signals = groups["baseline"][0].log.signals
    for stage in stages:
        if "effort" not in context.channels:
            stage.also = WITHOUT_EFFORT
        elif "reference" not in signals and context.position_at != "motor" and "error" not in stage.coordinates:
            stage.also = FROM_READING
        stage.largest = largest_in_error(context) if "error" in stage.coordinates else largest_in_effort(context)
        of_reading = _is_fluctuation(stage)
        if "error" in stage.coordinates and (of_reading or not _rests(stage.coordinates["error"])):
            stage.also = {
                **stage.also,
                "sampling_jitter": ("floor_vibration",),
                "floor_vibration": ("sampling_jitter",),
            }
        if changed and not of_reading:
            stage.free = FORCED
            stage.without += FOLLOWING
        said = stage.solve(open_sign)
        notes += [said] if said else []
        if stage is not stages[0] and not of_reading:
            _suspected(stages[0], stage)
        if context.position_at != "motor":
            _unresolved(stage)
        if of_reading and changed:
            _misread(stages[0], stage)
        changed = changed or bool(stage.chosen) or stage.whole < decide.WHOLE
    causes, rivals, rival_sizes = [], [], []
    gain, parts, said = gain_of_confirmed(stages, groups, open_sign)
    notes += said
    for stage in stages:
        for choice in stage.chosen:
            cause = _cause(stage, choice, context, parts)
            if choice.rivals:
                ids = (cause.id, *choice.rivals)
                rivals.append(
                    Rivals(
                        ids,
                        f"{' and '.join(ids)} would show alike in these signals."
                        f" If it is {cause.id}: {sizes_in_words(cause)}.",
                        {"decides": separation(ids)},
                    )
                )
                rival_sizes.append({cause.id: cause.parameters, **_sizes_of_rivals(stage, choice, context)})
            else:
                causes.append(cause)
    causes.sort(key=lambda c: -c.share)
    verdict = _verdict(stages, causes, rivals)
    _sentences(notes, spreads)
    seen = {}
    for stage in stages:
        for name, entry in stage.seen.items():
            seen.setdefault(name, entry)
    findings = tuple(f for stage in stages for f in _findings(stage))
    diagnosis = Diagnosis(verdict, tuple(causes), tuple(rivals), gain, findings, (), tuple(notes), seed)
    evidence = {"reduced": reduced, "spreads": spreads, "stages": stages, "groups": groups}
    hidden = hidden_effects(seen, context)
    if any(stage.free for stage in stages):
        hidden |= {name: BESIDE for name in FOLLOWING if name not in seen and hidden.get(name) != BEHIND_NEED}
    named = {cause.id for cause in causes} | {name for group in rivals for name in group.ids}
    hidden = {name: need for name, need in hidden.items() if name not in named}
    return LogDiagnosis(diagnosis, seen, hidden, healthy_table(context, spreads), evidence, context, tuple(rival_sizes))


def _is_fluctuation(stage):
    return "error" in stage.coordinates and stage.coordinates["error"].channel.kind == FLUCTUATION


def _rests(coordinates):
    """Whether the roughness at rest is known, which tells what shakes the machine from what comes late."""
    return bool(((coordinates.kind == "rough") & (coordinates.direction == 0)).any())


def _misread(first, stage):
    """What makes a reading rough misleads the motion that is read from it: a rival of what the effort shows."""
    for choice in first.chosen:
        if decide.plain(choice.name) in MISREAD:
            found = [decide.plain(c.name) for c in stage.chosen]
            choice.rivals += [name for name in found if name not in choice.rivals]
    stage.chosen, stage.free = [], FORCED


def _suspected(first, stage):
    """What the effort hints at, too weakly to be named, is a rival of what the error shows: a force moves the error."""
    if first.chosen:
        return
    hints = [(first.problem.log_p(name), decide.plain(name)) for name in first.problem.effects
             if decide.acceptable(first.problem, name, [])]
    hint = min((h for h in hints if h[1] not in BRINGS_NO_ERROR), default=(0.0, ""))
    for choice in stage.chosen:
        if hint[0] < HINT and hint[1] not in choice.rivals and hint[1] != decide.plain(choice.name):
            choice.rivals.append(hint[1])


def _unresolved(stage):
    """An uneven lead of which the sampling shows no ripple makes the reading rough in motion, and puts the two ends of
    the stroke off by different amounts: a rival of a wrong scale where the reading has become rough."""
    problem, rough = stage.problem, "sampling_jitter"
    for choice in stage.chosen:
        rises = decide.plain(choice.name) == "scale_error" and rough in problem.effects
        if rises and problem.log_p(rough, [choice.name]) < LEVEL and "screw_pitch_error" not in choice.rivals:
            choice.rivals.append("screw_pitch_error")


def largest_in_error(context):
    """Usual largest sizes in the following error, relative to its rms: a delay of `LATE_S`, lost motion of `GAP` of the
    stroke."""
    scale = max(context.scale("error"), 1e-300)
    of_place = GAP * context.stroke / scale
    usual = {
        "speed": LATE_S * context.top_speed / scale,
        **dict.fromkeys(("lost motion", "load", "place", "acceleration", "creep"), of_place),
    }
    usual = {name: max(value, LARGEST[name]) for name, value in usual.items()}
    return {
        **usual,
        "creep": CREEP * context.stroke / scale,
        "acceleration": LAG_S * LOOP_S * context.top_acceleration / scale,
    }


def largest_in_effort(context):
    """Usual largest sizes in the effort, relative to its level: a mass of twice the baseline's, as far as that is
    known."""
    channel = context.channels.get("effort")
    if channel is None:
        return {}
    shares = [
        (abs(channel.models[c][3]) + 2.0 * channel.stderr[c][3]) * context.top_acceleration / channel.scale[c]
        for c in context.codes
        if c in channel.models
    ]
    return {"inertia": min(float(np.mean(shares)), LARGEST["inertia"])} if shares else {}


def sizes_in_words(cause):
    """Sizes of a cause in words."""
    return sentence_of(cause.id, cause.parameters).rstrip(".").partition(": ")[2] or "size open"


def _verdict(stages, causes, rivals):
    """One of `result.VERDICTS`. What the error does beside a changed effort is its consequence and stands for
    nothing."""
    first = stages[0]
    judged = [s for s in stages if s is first or not s.free]
    if rivals:
        return "undetermined"
    if causes:
        return (
            "explained" if all(s.left > decide.WHOLE or s.share > decide.MOSTLY for s in judged) else "partly_explained"
        )
    return "unexplained" if any(s.whole < decide.WHOLE for s in judged) else "agrees"


def _sentences(notes, spreads):
    repeats = min(min(s.repetitions.values()) for s in spreads.values())
    assemblies = max(max(s.groups.values()) for s in spreads.values())
    if repeats < FEW:
        notes.append(f"{FEW_REPEATED} ({repeats}): thresholds are wide.")
    if assemblies < 2:
        level = 100.0 * spread.USUAL["level"][1]
        notes.append(
            "The baseline shows one state of assembly only; how much taking apart, restarts and days change is taken"
            f" from other machines (friction ± {level:.1f} %). Baseline logs of several days make the thresholds this"
            " machine's own."
        )


def _cause(stage, choice, context, parts):
    """`Cause` with sizes from the joint fit of its stage. How sure it is: calibrated by the χ² that it takes from
    repetitions held back, and by the part of its stage's difference that it alone takes."""
    parameters, channel = _sizes(stage, [c.name for c in stage.chosen], choice.name, context)
    share, before, after, evidence = parts.get(choice.name, (0.0, 0.0, 0.0, 0.0))
    clarity = decide.part_of(stage.problem, choice, stage.chosen)
    probability = stored_calibration(CALIBRATION).probability(evidence, clarity)
    return Cause(decide.plain(choice.name), parameters, {}, probability, share, Improvement(before, after, "1"),
                 channel, evidence=evidence, clarity=clarity)


def _sizes_of_rivals(stage, choice, context):
    """{id: sizes} of the rivals that were tried in the place of a cause."""
    beside = [c.name for c in stage.chosen if c is not choice]
    return {
        name: _sizes(stage, [*beside, form], form, context)[0]
        for name, form in choice.forms.items()
        if name in choice.rivals
    }


def _sizes(stage, names, name, context):
    """Sizes of ``name`` in the joint fit of ``names``, and the channel in which it shows most."""
    problem = stage.problem
    _, beta, covariance = problem.taken(names)
    start = sum(problem.white[n].shape[1] for n in names[: names.index(name)])
    own = slice(start, start + problem.white[name].shape[1])
    inflation = max(problem.inflation.get(name, 1.0), 1.0) * widening(problem.dof) ** 2
    channel = str(problem.where[np.argmax(np.abs(problem.effects[name]).max(axis=1))])
    spread_of = covariance[own, own] * inflation + np.diag((FORM_SIZE * beta[own]) ** 2)
    column = problem.effects[name][:, 0]
    reach = float(np.sqrt(np.mean(column[column != 0.0] ** 2))) if column.any() else 1.0
    plain, parts = decide.plain(name), problem.parts[name]
    return parameters_of(plain, Fitted(parts, beta[own], spread_of, context, channel, reach)), channel


COORDINATES = {
    "steady": "position",
    "start": "start of motion",
    "brake": "braking",
    "rest": "end of motion",
    "settled": "rest",
    "ripple": "angle, once per turn",
    "ripple high": "angle, more than once per turn",
    "rough": "fast fluctuation",
}


def _findings(stage):
    """How strongly each channel's change goes with each phase of the motion: variance ratio and its threshold."""
    problem = stage.problem
    names = [c.name for c in stage.chosen]
    rest = problem.difference.copy()
    if names:
        rest = rest - np.hstack([problem.effects[n] for n in names]) @ problem.taken(names)[1]
    for channel in dict.fromkeys(problem.where):
        for kind in dict.fromkeys(problem.kind):
            own = (problem.where == channel) & (problem.kind == kind)
            if not own.any():
                continue
            block = problem.covariance[np.ix_(own, own)]
            k = int(own.sum())
            ratio = lambda d: float(d[own] @ np.linalg.lstsq(block, d[own], rcond=None)[0]) / k
            threshold = float(f_distribution.isf(1e-3, k, problem.dof)) * problem.whole_inflation
            yield Finding(
                str(channel), COORDINATES.get(str(kind), str(kind)), ratio(problem.difference), threshold, ratio(rest)
            )
