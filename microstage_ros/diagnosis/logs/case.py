"""From logs to a `Diagnosis`: the baseline learned, the difference told, causes named, rivals and blind spots said."""

import dataclasses
import math

import numpy as np

from microstage_ros.diagnosis.logs import channels as channel_module
from microstage_ros.diagnosis.logs import coordinates as reduction
from microstage_ros.diagnosis.logs import decide, spread
from microstage_ros.diagnosis.logs.effects import NEVER, SIGNATURES, columns_of, separation
from microstage_ros.diagnosis.logs.motion import motion_of, tops
from microstage_ros.diagnosis.logs.repeats import repetitions
from microstage_ros.diagnosis.logs.sizes import parameters_of, widening
from microstage_ros.diagnosis.logs.turn import turn_of
from microstage_ros.diagnosis.result import Cause, Diagnosis, Finding, Gain, OverallGain, Rivals
from microstage_ros.quantities.errors import InputError

LEAST_ROWS = 40
PRIOR_LOO = 4.0            # weight, in repetitions, of "the spread is as learned" against the repetitions left out


@dataclasses.dataclass
class Context:
    """What the sizes need to become parameters."""

    channels: dict
    facts: dict
    stroke: float
    top_speed: float
    top_acceleration: float
    place_unit: str
    codes: list
    spectra: dict

    def scale(self, channel):
        """Mean scale of a channel over the conditions, in its unit."""
        own = self.channels[channel]
        return float(np.mean([own.scale[c] for c in self.codes if c in own.scale]))

    def viscous(self, channel):
        """(coefficient, stderr) of the baseline's viscous part if it is well determined and matters, else None."""
        own = self.channels[channel]
        values = [own.models[c][2] for c in self.codes]
        errors = [own.stderr[c][2] for c in self.codes]
        value, error = float(np.mean(values)), float(np.mean(errors))
        share = abs(value) * self.top_speed / self.scale(channel)
        return (value, error) if value > 0.0 and share > 0.1 and error < 0.1 * value else None

    def inertia(self, channel):
        """Coefficient of the acceleration, or None where the baseline does not determine it."""
        own = self.channels[channel]
        value = float(np.mean([own.models[c][3] for c in self.codes]))
        error = float(np.mean([own.stderr[c][3] for c in self.codes]))
        return value if abs(value) > 5.0 * error and abs(value) * self.top_acceleration > 0.05 * self.scale(channel) else None

    def dominant_order(self):
        """Cycles per turn of the ripple that changed most, or None."""
        best = (0.0, None)
        for (is_now, code, direction), (orders, size) in self.spectra.items():
            before = self.spectra.get((False, code, direction))
            if is_now and before is not None and len(before[1]) == len(size):
                k = int(np.argmax(np.abs(size - before[1])))
                best = max(best, (float(abs(size[k] - before[1][k])), int(orders[k])), key=lambda e: e[0])
        return best[1]


@dataclasses.dataclass
class LogDiagnosis:
    """`Diagnosis` in the common words, and what is particular to logs.

    ``visibility``: {id: (visible, detectable size, column, largest)}; ``hidden``: {id: what would show it};
    ``healthy``: rows of the table of the baseline's model; ``evidence``: what the pictures need.
    """

    diagnosis: Diagnosis
    visibility: dict
    hidden: dict
    healthy: list
    evidence: dict
    context: Context


def diagnose_logs(baseline, now, description, seed=0):
    """Find what changed between the logs of a healthy machine and those of now.

    Parameters
    ----------
    baseline, now : lists of `Log` (one file each). description : `LogDescription`. seed : written into the result.

    Raises InputError if nothing can be compared: no condition, no motion, no signal in common.
    """
    prepared = prepare(baseline, now, description)
    groups, channels, stroke, top, sharp, notes = prepared
    places_cells = reduction.choose_cells(groups["baseline"], groups["now"], stroke, top)
    if not len(places_cells[1]):
        raise InputError("records", "no phase of motion in common with the baseline", "logs with like speeds and places as the baseline's")
    if places_cells[2] < 0.5:
        notes.append(f"Only {places_cells[2]:.0%} of the rows move as the baseline does; the others are not compared.")
    reduced, spreads, spectra = {}, {}, {}
    turn, guess = turn_of(groups, channels, description, stroke)
    if guess:
        notes.append(guess)
    for name, channel in channels.items():
        places, cells, _ = places_cells
        reduced[name] = reduction.reduce(channel, groups["baseline"], groups["now"], cells, places, stroke, top, columns_of(stroke), turn)
        spreads[name] = spread.learn(reduced[name])
        if name == "effort" or not spectra:
            spectra = reduced[name].spectrum
    problem = build(reduced, spreads)
    codes = sorted({int(c) for r in groups["now"] for c in np.unique(r.condition) if c >= 0})
    context = Context(channels, description.facts, abs(stroke[1] - stroke[0]), top, sharp, groups["baseline"][0].log.place_unit, codes, spectra)
    open_sign, ratio = channel_module.sign_is_open(channels["effort"], groups["baseline"]) if "effort" in channels else (False, 1.0)
    if open_sign:
        notes.append("The current has no sign, and the logs do not tell whether friction or a constant force is the larger: the two may change places.")
    if any(r.log.shift is not None for side in groups.values() for r in side):
        notes.append("Levels of the effort were shifted after the recording; only its shape within stretches of one constant is compared.")
    return _answer(problem, reduced, spreads, groups, context, notes, open_sign, seed)


def prepare(baseline, now, description):
    """Rows with motion, repetition and condition; channels with their healthy models; stroke, top speed and acceleration; notes."""
    notes = []
    if not baseline:
        raise InputError("--baseline", "none", "at least one log of the machine while it was healthy")
    common = {label for log in baseline for label in log.conditions} & {label for log in now for label in log.conditions}
    if not common:
        raise InputError(f"{description.place}: condition", "no value in common between baseline and now",
                         "logs of like conditions; the baseline has " + "; ".join(str(c) for log in baseline[:3] for c in log.conditions[:3]))
    order = {label: k for k, label in enumerate(sorted(common, key=str))}
    for name, side in (("baseline", baseline), ("now", now)):
        left = {label for log in side for label in log.conditions} - common
        if left:
            notes.append(f"Conditions only in {name} are not compared: {', '.join(map(str, sorted(left, key=str)))}.")
    top, sharp = tops(baseline)
    if not top > 0.0:
        raise InputError("--baseline", "no motion", "logs in which the axis moves")
    groups = {}
    for name, side in (("baseline", baseline), ("now", now)):
        rows = []
        for number, log in enumerate(side):
            motion = motion_of(log, top, sharp)
            codes = np.array([order.get(label, -1) for label in log.conditions])[log.condition]
            rows.append(channel_module.Rows(log, motion, repetitions(log, motion, description, len(side)), codes, number))
            notes += [f"{log.source}: {note}" for note in log.notes]
        groups[name] = rows
    channels = {c.name: c for c in channel_module.channels_of(baseline[0])}
    for name, channel in list(channels.items()):
        good = sum(int(np.isfinite(channel.values(rows)).sum()) for rows in groups["baseline"])
        if good < LEAST_ROWS:
            del channels[name]
        else:
            channel_module.fit_models(channel, groups["baseline"])
    if not channels:
        raise InputError("--baseline", "no signal that tells how the machine answered", "following_error, current, torque, force or voltage")
    everything = [*groups["baseline"], *groups["now"]]
    return groups, channels, reduction.stroke_of(everything), top, sharp, _shorter(notes)


def _shorter(notes):
    """Notes that many files share are told once."""
    plain = {}
    for note in notes:
        key = note.split(": ", 1)[1] if ": " in note else note
        plain.setdefault(key, []).append(note)
    return [entries[0] if len(entries) == 1 else f"{len(entries)} files: {key}" for key, entries in plain.items()]


def build(reduced, spreads, now=None, base=None, counts=None, assembly=True):
    """`Problem` of the mean of now against the mean of the baseline.

    ``now``, ``base``: {channel: vectors (repetitions, K)} in place of those of ``reduced``, with ``counts`` of the repetitions.
    """
    differences, blocks, where, kinds, kept = [], [], [], [], []
    for name, coordinates in reduced.items():
        vectors_now = coordinates.now if now is None else now[name]
        vectors_base = coordinates.baseline if base is None else base[name]
        mean_now, _ = spread.mean_of(vectors_now)
        mean_base, _ = spread.mean_of(vectors_base)
        codes = np.unique(coordinates.condition)
        number_now = {int(c): int(np.isfinite(vectors_now[:, coordinates.condition == c]).any(axis=1).sum()) for c in codes}
        number_base = {int(c): int(np.isfinite(vectors_base[:, coordinates.condition == c]).any(axis=1).sum()) for c in codes}
        d = mean_now - mean_base
        good = np.isfinite(d)
        c = spreads[name].covariance(coordinates, number_now, number_base, assembly)
        differences.append(np.nan_to_num(d))
        c[~good, :] = 0.0
        c[:, ~good] = 0.0
        c[~good, ~good] = spread.FREE**2
        blocks.append(c)
        where += [name] * len(d)
        kinds += list(coordinates.kind)
    size = sum(len(d) for d in differences)
    covariance, at = np.zeros((size, size)), 0
    for block in blocks:
        covariance[at: at + len(block), at: at + len(block)] = block
        at += len(block)
    effects, parts = decide.effects_of(reduced)
    first = next(iter(spreads.values()))
    dof = _dof(first)
    problem = decide.Problem(np.concatenate(differences), covariance, effects, parts, np.array(where), np.array(kinds, dtype=object), dof)
    if now is None and counts is None:
        _calibrate(problem, reduced, spreads)
    return problem


def _dof(learned):
    """Degrees of freedom behind the covariance: those of the repetitions and of assembly, by their usual shares."""
    share = 0.4
    return 1.0 / (share**2 / learned.dof_repetition + (1.0 - share) ** 2 / learned.dof_assembly)


def _calibrate(problem, reduced, spreads):
    """Inflation of each effect's variance so that repetitions left out of the baseline show what the spread predicts.

    Variance factor = (ν₀ + Σ F) / (ν₀ + n) with the F ratio of every repetition against the others, at least 1.
    """
    first = next(iter(reduced.values()))
    count = len(first.baseline)
    if count < 3:
        return
    ratios, whole = {name: [] for name in problem.effects}, []
    for left in range(min(count, 30)):
        own = np.isfinite(first.baseline[left])
        codes = set(first.condition[own])
        others = np.array([k for k in range(count) if k != left and first.group_baseline[k] == first.group_baseline[left]
                           and set(first.condition[np.isfinite(first.baseline[k])]) & codes])
        across = not len(others)
        if across:
            others = np.array([k for k in range(count) if k != left])
        if not len(others):
            continue
        single = build(reduced, spreads, {n: r.baseline[[left]] for n, r in reduced.items()},
                       {n: r.baseline[others] for n, r in reduced.items()}, counts=True, assembly=across)
        for name in ratios:
            ratios[name].append(single.taken([name])[0] / single.white[name].shape[1])
        whole.append(single.whole / len(single.difference))
    for name, values in ratios.items():
        problem.inflation[name] = max(1.0, (PRIOR_LOO + sum(min(v, 100.0) for v in values)) / (PRIOR_LOO + len(values)))
    if whole:
        problem.whole_inflation = max(1.0, (PRIOR_LOO + sum(whole)) / (PRIOR_LOO + len(whole)))


def _answer(problem, reduced, spreads, groups, context, notes, open_sign, seed):
    seen = decide.visibility(problem)
    visible = {name for name, entry in seen.items() if entry[0]}
    chosen = decide.choose(problem, visible, open_sign)
    log_p, share = decide.stands_out(problem, chosen)
    unexplained_whole = log_p < decide.WHOLE
    if chosen and share < decide.EXPLAINED and unexplained_whole:
        notes.append("Best single name, not held to be the answer because it removes only "
                     f"{share:.0%} of what stands out: {decide.plain(chosen[0].name)}.")
        chosen = []
    causes, rivals = [], []
    gain, parts = _gain(problem, reduced, spreads, chosen, groups)
    wide = widening(problem.dof)
    for choice in chosen:
        cause = _cause(problem, choice, chosen, context, parts, wide)
        if choice.rivals:
            ids = (cause.id, *choice.rivals)
            rivals.append(Rivals(ids, f"{', '.join(ids)} would show alike in these signals ({cause.sentence.rstrip('.')} if it is the first).",
                                 {"decides": separation(ids)}))
        else:
            causes.append(cause)
    after_log_p = _left(problem, chosen)
    causes.sort(key=lambda c: -c.share)
    if rivals:
        verdict = "undetermined"
    elif causes:
        verdict = "explained" if after_log_p > decide.WHOLE or share > 0.7 else "partly_explained"
    else:
        verdict = "unexplained" if unexplained_whole else "agrees"
    repeats = min(next(iter(spreads.values())).repetitions.values())
    assemblies = max(next(iter(spreads.values())).groups.values())
    if repeats < 6:
        notes.append(f"Few baseline repetitions ({repeats}): thresholds are wide.")
    if assemblies < 2:
        notes.append("The baseline shows one state of assembly only; how much taking apart, restarts and days change is taken from other machines "
                     "(friction ± 4 %, patterns ± 2 %). Baseline logs of several days make the thresholds this machine's own.")
    findings = tuple(_findings(problem, chosen))
    hidden = _hidden(problem, seen, context, reduced)
    diagnosis = Diagnosis(verdict, tuple(causes), tuple(rivals), gain, findings, (), tuple(notes), seed)
    evidence = {"reduced": reduced, "spreads": spreads, "problem": problem, "chosen": chosen, "groups": groups}
    return LogDiagnosis(diagnosis, seen, hidden, healthy_table(context, spreads), evidence, context)


def _cause(problem, choice, chosen, context, parts, wide):
    """`Cause` with sizes from the joint fit."""
    names = [c.name for c in chosen]
    _, beta, covariance = problem.taken(names)
    start = sum(problem.white[n].shape[1] for n in names[: names.index(choice.name)])
    own = slice(start, start + problem.white[choice.name].shape[1])
    inflation = max(problem.inflation.get(choice.name, 1.0), 1.0) * wide**2
    effect = decide.plain(choice.name)
    parameters = parameters_of(effect, problem.parts[choice.name], beta[own], covariance[own, own] * inflation, context)
    channel = problem.where[np.argmax(np.abs(problem.effects[choice.name]).max(axis=1))]
    probability = float(np.clip(1.0 - math.exp(max(choice.log_p, -30.0)) * len(SIGNATURES), 0.0, 1.0))
    share, before, after = parts.get(choice.name, (0.0, 0.0, 0.0))
    return Cause(effect, parameters, {}, probability, share, Gain(before, after, "1"), str(channel))


def _left(problem, chosen):
    """log p of what is left of the difference."""
    removed = problem.taken([c.name for c in chosen])[0]
    k = len(problem.difference)
    return float(decide.log_sf(max(problem.whole - removed, 0.0) / k / problem.whole_inflation, k, problem.dof))


def _gain(problem, reduced, spreads, chosen, groups):
    """`OverallGain` on repetitions that the sizes were not learned from, and each cause's (share, before, after)."""
    first = next(iter(reduced.values()))
    count = len(first.now)
    names = [c.name for c in chosen]
    if count >= 2:
        learn, held = np.arange(0, count, 2), np.arange(1, count, 2)
        pick = lambda which: {n: r.now[which] for n, r in reduced.items()}
        base = {n: r.baseline for n, r in reduced.items()}
        teacher, judge = (build(reduced, spreads, pick(which), base, counts=True) for which in (learn, held))
        source = [f"{groups['now'][int(g)].log.source}" for g in dict.fromkeys(first.group_now[held])]
    else:
        teacher = judge = problem
        source = [rows.log.source for rows in groups["now"]]
    k = len(judge.difference)
    floor = problem.whole_inflation

    def left(ids):
        if not ids:
            return judge.whole
        beta = teacher.taken(ids)[1]
        rest = judge.factor[0] - np.hstack([judge.white[n] for n in ids]) @ beta
        return float(rest @ rest)

    before, after = left([]), left(names)
    rms = lambda value: math.sqrt(max(value, 0.0) / k)
    excess = max(before - k * floor, before - after, 1e-9)
    parts = {}
    for name in names:
        without = left([n for n in names if n != name])
        parts[name] = (float(np.clip((without - after) / excess, 0.0, 1.0)), rms(without), rms(after))
    half = 1.96 / math.sqrt(2.0 * k) * rms(after)
    names_of = tuple(source) if count >= 2 else tuple(source)
    return OverallGain("rms of the change against the healthy spread" + ("" if count >= 2 else ", on the log that taught it"), "1", names_of,
                       rms(before), rms(after), math.sqrt(floor), (max(rms(after) - half, 0.0), rms(after) + half)), parts


COORDINATES = {"steady": "position", "start": "start of motion", "brake": "braking", "rest": "end of motion", "settled": "rest",
               "ripple": "angle, once per turn", "ripple high": "angle, more than once per turn", "rough": "fast fluctuation"}


def _findings(problem, chosen):
    """How strongly each channel's change goes with each phase of the motion: variance ratio and its threshold."""
    names = [c.name for c in chosen]
    rest = problem.difference.copy()
    if names:
        rest = rest - np.hstack([problem.effects[n] for n in names]) @ problem.taken(names)[1]
    for channel in dict.fromkeys(problem.where):
        for kind in dict.fromkeys(problem.kind):
            own = (problem.where == channel) & (problem.kind == kind)
            if not own.any():
                continue
            inverse = np.linalg.inv(problem.covariance[np.ix_(own, own)])
            k = int(own.sum())
            from scipy.stats import f as f_law
            threshold = float(f_law.isf(1e-3, k, problem.dof)) * problem.whole_inflation
            yield Finding(str(channel), COORDINATES.get(str(kind), str(kind)), float(problem.difference[own] @ inverse @ problem.difference[own]) / k,
                          threshold, float(rest[own] @ inverse @ rest[own]) / k)


def _hidden(problem, seen, context, reduced):
    """{id: what would be needed} of the effects that these signals do not show."""
    out = dict(NEVER)
    for name, signature in SIGNATURES.items():
        if name in seen and seen[name][0]:
            continue
        if name in seen:
            _, size, part, largest = seen[name]
            out[name] = (f"not below {size:.0%} of the {'friction' if signature.effort else 'error'} level in these logs; "
                         f"{_need(name, context)}")
        else:
            out[name] = _need(name, context)
    return out


def _need(name, context):
    """The signal or move that would show an effect."""
    signature = SIGNATURES[name]
    if signature.kinds and "voltage" not in context.channels:
        return "the drive's voltage"
    if name == "torque_ripple":
        return "the lead, a sampling of ten rows per turn or more, and a steady stretch of several turns"
    if name in ("floor_vibration",):
        return "position or following error during some seconds of rest"
    if signature.effort and "effort" not in context.channels:
        return "the drive's current or torque"
    if name in ("viscous_change", "nonlinear_viscous"):
        return "the same stroke at several speeds, with the drive's effort as recorded"
    if name == "rising_static_friction":
        return "the same move after dwells of 0.1 s, 1 s and 10 s"
    if name == "payload_change":
        return "moves of higher acceleration"
    if "error" not in context.channels:
        return "set point and position, or the following error"
    return "more baseline runs, or the effort as recorded, unshifted and with its sign"


def healthy_table(context, spreads):
    """Rows (channel, coefficient, value, stderr, unit) of the baseline's model, and the spread of its level."""
    rows = []
    for name, channel in context.channels.items():
        units = {"constant": channel.unit, "level": channel.unit, "viscous": f"{channel.unit} s/{context.place_unit}",
                 "inertia": f"{channel.unit} s²/{context.place_unit}", "spring": f"{channel.unit}/{context.place_unit}",
                 "rest": channel.unit, "rest after motion": channel.unit, "resistance": "ohm", "per speed": f"V s/{context.place_unit}"}
        for code in context.codes:
            for k, label in enumerate(channel_module.base_names(channel)):
                value, error = float(channel.models[code][k]), float(channel.stderr[code][k])
                if value or error:
                    rows.append((name, code, label, value, error, units[label]))
        learned = spreads[name]
        for mode in ("level", "gain"):
            if mode in learned.names:
                k = learned.names.index(mode)
                rows.append((name, -1, f"{mode}: spread from run to run", math.sqrt(learned.repetition[k]), 0.0, "1"))
                rows.append((name, -1, f"{mode}: spread from assembly to assembly", math.sqrt(learned.assembly[k]), 0.0, "1"))
    return rows
