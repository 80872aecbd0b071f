"""One axis, from its records to a `Diagnosis`.

Order: records are prepared, and what spoils every residual is found and taken into the model (`known`); the
channels' evidence is gathered, for the catalogue's forms and for those that the records suggest (`periods`,
`resonant`); causes are selected forward and backward and their non-linear sizes refined; what is no matter of
regression is added (`nonregression`); everything is judged on held-out records.
"""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.beyond_the_known import beyond_the_known, taken
from microstage_ros.diagnosis.catalogue import FORMS
from microstage_ros.diagnosis.catalogue.drive import inertia_form
from microstage_ros.diagnosis.preprocessing.preparation import prepare
from microstage_ros.diagnosis.prerequisites.drive import drive_of
from microstage_ros.diagnosis.prerequisites.encoder import seen_count, seen_interpolation
from microstage_ros.diagnosis.prerequisites.growth import power_forms
from microstage_ros.diagnosis.prerequisites.law import OwnLaw, own_law
from microstage_ros.diagnosis.prerequisites.lateness import forms_of_slowness
from microstage_ros.diagnosis.prerequisites.lost_motion import shows_no_gap
from microstage_ros.diagnosis.prerequisites.periods import periodic_forms, within_travel
from microstage_ros.diagnosis.prerequisites.prerequisites import find_known, slow_beside
from microstage_ros.diagnosis.prerequisites.resonant import FAR, damped_forms, with_likelier_damping
from microstage_ros.diagnosis.prerequisites.slow_drift import Course, find_course, take_out
from microstage_ros.diagnosis.prerequisites.timing import with_scatter
from microstage_ros.diagnosis.report.pictures import drift_picture, gap_picture, pictures_of
from microstage_ros.diagnosis.residuals.collection import Collection
from microstage_ros.diagnosis.residuals.evidence_set import Evidences
from microstage_ros.diagnosis.residuals.systematic import SYSTEMATIC
from microstage_ros.diagnosis.residuals.terminals import at_terminals, beyond_the_command
from microstage_ros.diagnosis.result import Cause, Diagnosis, Parameter
from microstage_ros.diagnosis.selection import judge, limit_cycle
from microstage_ros.diagnosis.selection.agreement import unsteadiness
from microstage_ros.diagnosis.selection.calibration import likely, probability
from microstage_ros.diagnosis.selection.leftover import over_twin, remains, scatter_findings, swings_in_time
from microstage_ros.diagnosis.selection.mass_or_drive import FAST, RESONANT, seeming_stiffness
from microstage_ros.diagnosis.selection.nonregression_causes import nonregression_causes
from microstage_ros.diagnosis.selection.refinement import about_their_sizes, refine
from microstage_ros.diagnosis.selection.selection import select
from microstage_ros.diagnosis.selection.sizes import (
    before_the_gain,
    effect_of,
    offset_of,
    pooled,
    stated_sizes,
    with_payload,
    with_rattled_mass,
)
from microstage_ros.diagnosis.selection.splinters import one_force
from microstage_ros.quantities.errors import InputError

EFFECTS = tuple(sorted({form.effect for form in FORMS if form.named and form.channel != "command"}))
#: Rounds in which an offset and the dead band around it are found beside each other, and relative change of the offset
#: that ends them; calibrated by: `test/diagnosis/cases/plain_programmes.py --kind two --effect amplifier_offset
#: amplifier_deadband --cases 4 --seed 7200` (both to 1.5 % in 11 of 12 pairs)
MOST_OFFSETS, SAME_OFFSET = 3, 0.01
SLOW_IN_TIME = ("thermal_drift", "refractive_index")   # what a course of every record's own leaves no room for
GENERIC = tuple(form for form in FORMS if not form.named)


def diagnose_case(axis, records, holdout=(), baseline=(), seed=0, twin=()):
    """Find what makes these records differ from the axis's model.

    Parameters
    ----------
    axis : `Axis` of a voltage-driven screw, the model as it was right for the baseline.
    records : list of `Record` to learn from.
    holdout : records to judge on; without any, the last record is held back, or the last third of the only one.
    baseline : records of the healthy axis, for the thresholds; may be empty.
    seed : written into the result [1]; what is drawn at random here (`refinement`) has a seed of its own.
    twin : list of `Record`, the held-out one as the same machine makes it with nothing wrong in it, once or with
        several draws of its noise, which only a simulation has; nothing is fitted to them (`leftover.over_twin`).

    Raises
    ------
    InputError : for records that cannot be used.
    """
    records, holdout, notes = _hold_back(list(records), list(holdout))
    baseline, left_out = _baseline_in_motion(list(baseline), records, drive_of(axis).signal_period)
    notes += left_out
    drive = seen_interpolation(drive_of(axis), baseline, records)
    groups = {"learn": records, "held": holdout, "base": baseline}
    if not baseline:
        why = "No baseline is left" if left_out else "No baseline was given"
        notes.append(f"{why}: thresholds come from the model's own figures.")
    prepared, known = find_known(groups, drive)
    prepared |= {"twin": [prepare(one, drive) for one in twin]} if twin else {}
    chosen = _beside_offset(groups, prepared, drive, known)
    if not baseline and _makes_up_for(offset_of(chosen.evidences, chosen.choices), drive):
        drive = dataclasses.replace(drive, current_offset=0.0)
        prepared, known = find_known(groups, drive)
        prepared |= {"twin": [prepare(one, drive) for one in twin]} if twin else {}
        chosen = _beside_offset(groups, prepared, drive, known)
    more = beyond_the_command(chosen.collection, chosen.evidences, chosen.choices) if known.slow is not None else None
    anew = slow_beside(more, groups, prepared, drive, known) if more is not None else None
    if anew is not None:
        prepared, known = anew
        chosen = _choose(groups, prepared, drive, known, chosen.collection.frame.drive.offset)
    prepared, known, chosen = _behind_windup(groups, prepared, drive, known, chosen)
    known, chosen = _without_train(groups, prepared, drive, known, _at_terminals(groups, known, chosen))
    collection, evidences, choices = chosen.collection, chosen.evidences, chosen.choices
    course, effects = chosen.course, chosen.effects
    notes += [chosen.law.words] if chosen.law is not None else []
    choices = beyond_the_known(evidences, choices, known, rests=not _swings(collection))
    # behind a gap the stage's speed is its reading's, whose noise would weigh more than its swing
    if known.gap is None and "position" in judge.stands_out(evidences, choices):
        evidences = with_scatter(collection, evidences, effect_of(evidences, choices, "encoder_sde"))
    rivals = {c.effect: judge.rivals_of(evidences, c, choices, effects) for c in choices}
    choices, rivals = one_force(evidences, choices, rivals)
    refined = refine(collection, about_their_sizes(evidences, choices))
    if refined != choices:
        evidences, choices = _final(collection, refined)
        choices = judge.that_agree(evidences, choices)
    kept = judge.without_faint(evidences, judge.without_strangers(evidences, choices), taken(known, course))
    dropped = [c.effect for c in choices if c not in kept]
    for choice in kept if dropped else []:      # no rivals as long as both stood
        rivals[choice.effect] = [*rivals.get(choice.effect, ()), *judge.rivals_of(evidences, choice, kept, dropped)]
    choices = kept
    return _answer(collection, evidences, choices, rivals, (known, course), holdout, notes, seed)


def _makes_up_for(offset, drive):
    """Whether an amplifier's ``offset`` [V] is what taking out a zero of the current's sensor makes, -R i_0, that the
    axis file states and the records do not have."""
    put_in = -drive.resistance * drive.current_offset
    return abs(offset - put_in) < 0.5 * abs(put_in)  # derived: nearer to it than to nothing


@dataclasses.dataclass(frozen=True)
class _Chosen:
    """What was chosen from records prepared with what is known: `Evidences` and choices, the ``effects`` they were
    chosen from, the ``course`` of the interferometer (or None) and the friction's own ``law`` (or None)."""

    collection: Collection
    evidences: Evidences
    choices: list
    effects: list
    course: Course | None
    law: OwnLaw | None


def _beside_offset(groups, prepared, drive, known):
    """`_choose`, and again with the amplifier's offset that was found, where a dead band, which lies around it, was
    chosen, too, or something is left of the wind-up."""
    chosen = _choose(groups, prepared, drive, known)
    for _ in range(MOST_OFFSETS):
        offset = offset_of(chosen.evidences, chosen.choices)
        swallows = any(c.effect == "amplifier_deadband" for c in chosen.choices)
        if abs(offset - chosen.collection.frame.drive.offset) <= SAME_OFFSET * abs(offset) or not (
                swallows or "windup" in judge.stands_out(chosen.evidences, chosen.choices)):
            break
        chosen = _choose(groups, prepared, drive, known, offset)
    return chosen


def _behind_windup(groups, prepared, drive, known, chosen):
    """``prepared``, ``known`` and ``chosen``, anew where the wind-up tells a drive train far from the model's that was
    too faint in the resonance to be known before: the stage's motion is computed with it."""
    shown = (c for c in chosen.choices if c.effect in RESONANT and any(form.channel in FAST for form in c.forms))
    choice = next(shown, None)
    if choice is None or known.train is not None or known.gap is not None:
        return prepared, known, chosen
    others = [c for c in chosen.choices if c is not choice]
    stiffness = (seeming_stiffness(chosen.evidences, choice, others) or (1.0,))[0]
    if FAR * stiffness > 1.0:
        return prepared, known, chosen
    channels = [c["resonance"] for c in chosen.collection.channels["learn"] if "resonance" in c]
    known = dataclasses.replace(known, train=with_likelier_damping(channels, stiffness))
    prepared = known.prepare(groups, drive, prepared)
    return prepared, known, _choose(groups, prepared, drive, known, chosen.collection.frame.drive.offset)


def _at_terminals(groups, known, chosen):
    """``chosen`` anew with torque and resonance of the voltage at the motor's terminals, where it is another."""
    anew = at_terminals(chosen.collection, chosen.evidences, chosen.choices, groups, known, chosen.law)
    if anew is chosen.evidences:
        return chosen
    return dataclasses.replace(chosen, evidences=anew, choices=select(anew, chosen.effects)[0])


def _without_train(groups, prepared, drive, known, chosen):
    """``known`` and ``chosen``, anew without a drive train that nothing chosen stands for: an amplifier's gain, which
    is found later, moves the motor as no drive train does, and one was fitted to it."""
    if known.train is None or any(choice.effect in RESONANT for choice in chosen.choices):
        return known, chosen
    known = dataclasses.replace(known, train=None)
    prepared = known.prepare(groups, drive, prepared)
    offset = chosen.collection.frame.drive.offset
    return known, _at_terminals(groups, known, _choose(groups, prepared, drive, known, offset))


def _choose(groups, prepared, drive, known, offset=0.0):
    """`_Chosen` of ``prepared`` records {group: [`Prepared`]}, with a `prerequisites.Known` and the amplifier's
    ``offset`` [V]."""
    prepared, drive, law = own_law(prepared, seen_count(drive, prepared))
    rattles = known.gap is not None and known.gap.rattles
    mass = known.gap.added_mass(drive.mass)[0] if rattles and known.gap.scales else 0.0
    pull = (known.gap.pull, known.gap.pull_stderr) if rattles else None
    collection = Collection(prepared, dataclasses.replace(drive, pull=pull, offset=offset), rattled_mass=mass)
    found = ("backlash", "drive_compliance") if rattles else ("backlash",) if known.gap is not None else ()
    effects = [effect for effect in EFFECTS if effect not in found]
    own = [*periodic_forms(collection), *damped_forms(collection, known.train), *power_forms(collection),
           *forms_of_slowness(groups, drive, known, collection), inertia_form()]
    evidences = collection.evidences(within_travel([*(f for f in FORMS if f.channel != "command"), *own], collection))
    choices, _ = select(evidences, effects)
    course = find_course(collection, evidences, choices)
    if course is not None:
        evidences, course = take_out(collection, evidences, course)
        effects = [effect for effect in effects if effect not in SLOW_IN_TIME]
        choices, _ = select(evidences, effects)
    return _Chosen(collection, evidences, choices, effects, course, law)


def _final(collection, choices):
    """Evidence of the chosen, refined forms, the nameless shapes and the model's own errors only; and what still
    stands."""
    own = [form for choice in choices for form in choice.forms]
    keys = {(channel, key) for channel, table in SYSTEMATIC.items() for key in table}
    more = [form for form in FORMS if (form.channel, form.key) in keys and form.key not in {f.key for f in own}]
    final = collection.evidences(within_travel([*own, *more, *GENERIC], collection))
    kept = [c for c in choices if judge.best_or_same(final, c, [o for o in choices if o is not c]).held > 0.0]
    return final, kept


def _answer(collection, evidences, choices, rivals, nonregression, holdout, notes, seed):
    book = judge.ledger_of(evidences, choices)
    found = judge.findings_of(evidences, choices, within_travel(GENERIC, collection))
    units = _units(collection)
    causes, unsure, open_in = [], [], []
    for choice in choices:
        others = rivals.get(choice.effect, [])
        if others:
            unsure.append(judge.rivals_entry([choice.effect, *others]))
            open_in.append(judge.cause_gain(evidences, choice, choices, units)[0])
        else:
            without = _telling_nothing(collection, choice, choices)
            causes.append(_cause(evidences, choice, choices, units, without))
    known, course = nonregression
    if collection.frame.rattled_mass:
        causes = with_rattled_mass(causes, *known.gap.added_mass(collection.frame.drive.mass))
    causes = before_the_gain(with_payload(causes, collection.frame.drive.mass))
    scattered = judge.stands_out(evidences, choices)
    if known.slow is not None and "resonance" in scattered and not known.lines:
        # what is left follows the motor otherwise than the model at the very frequencies that tell a delay from a lag
        known = dataclasses.replace(known, slow=dataclasses.replace(known.slow, rival=True))
    causes += nonregression_causes(collection, known, course, causes, book, unsure)
    errors = {c.effect: unsteadiness(evidences, c, [o for o in choices if o is not c]) for c in choices}
    rattled = known.gap.held_before if known.gap is not None and known.gap.rattles else 0.0
    left, swinging = judge.leftovers(found), swings_in_time(collection, evidences, choices)
    above = [*scattered, *(name for name in swinging if name not in scattered)]
    book = book.where_it_stands([*open_in, *above, *(one.channel for one in (*causes, *left))])
    causes, doubtful = likely(_with_shares(causes, book), unsure, errors, rattled)
    causes, unsure, swings = limit_cycle.judged(
        _at_limit(collection), causes, unsure, scattered, errors,
        lambda: known.gap is None and shows_no_gap(collection.prepared, collection.frame.drive))
    notes += [swings] if swings else []
    if doubtful:
        notes.append(f"Beside the causes, too unlikely to be named: {', '.join(c.id for c in doubtful)}.")
    if not (left or causes or unsure):
        left = judge.of_learning_records(found)
        notes += (
            ["What stands out does so in the learning records only; the held-out ones may not go there."]
            if left
            else []
        )
    by_size, words = scatter_findings(collection, evidences, choices, above)
    words |= {name: f"what is left in {name} swings in time ({at:.2g} Hz)" for name, at in swinging.items()}
    if above:
        notes.append(
            f"The residual{' that is left' if causes else ''} stands above the noise floor in {', '.join(above)}"
            + "".join(f"; {words[name]}" for name in above if name in words)
            + "."
        )
    if known.gap is not None and known.gap.held_after >= known.gap.held_before:
        notes.append(
            "The replay behind the gap makes the held-out record no better; the gap rests on the learning records."
        )
    if course is not None:
        notes.append("Every record drifts on a course of its own; the extended axis holds the mean rate only.")
    verdict = judge.verdict_of(causes, unsure, left, book.remaining(one.channel for one in (*causes, *left)), above)
    pictures = pictures_of(collection, evidences, choices, left)
    if collection.prepared["held"][0].behind is not None:
        pictures.insert(0, gap_picture(collection.prepared["held"][0]))
    if course is not None:
        pictures.insert(0, drift_picture(collection.prepared["held"][0]))
    return Diagnosis(
        verdict=verdict, causes=tuple(causes), rivals=tuple(unsure),
        gain=judge.overall_gain(book, [record.source for record in holdout]),
        findings=tuple(sorted([*(f for f, _ in found), *by_size], key=lambda f: -f.statistic / f.threshold)),
        pictures=tuple(pictures), notes=tuple(notes), seed=seed, doubtful=tuple(doubtful),
        floors=over_twin(collection, evidences, choices),
        remains=remains(collection, evidences, choices),
    )


def _at_limit(collection):
    """Share of the learning records [1] in which the command stands at the amplifier's limit."""
    return limit_cycle.share_at_limit(collection.prepared["learn"], collection.frame.drive.voltage_limit)


def _swings(collection):
    """Whether the loop of the learning records swings between the amplifier's limits."""
    return _at_limit(collection) > limit_cycle.MOST_AT_LIMIT


def _telling_nothing(collection, choice, choices):
    """Channels that tell no size of a ``choice``: the wind-up of a loop that swings between the amplifier's limits, in
    which the mean of a block is not the drive train's of the mean load (10 to 50 % too stiff), and that of a cable,
    which bends a drive train of another stiffness."""
    bent = choice.effect == "cable_spring" and any(c.effect == "drive_compliance" for c in choices)
    return {"windup"} if bent or choice.effect in RESONANT and _swings(collection) else set()


def _cause(evidences, choice, choices, units, without=()):
    """`Cause` of a selected effect, its sizes by all its channels but those ``without``; its share is filled in at the
    end."""
    sizes, effect = {}, {}
    forms = [form for form in choice.forms if form.channel not in without] or choice.forms
    for form in forms:
        fitted, entry = stated_sizes(evidences, choice, choices, form)
        for name, size in fitted.items():
            sizes.setdefault(name, []).append(Parameter(*size))
        effect = {**entry, **effect}
    parameters = {name: pooled(several) for name, several in sizes.items()}
    effect |= {name: parameters[name].value for name, several in sizes.items() if len(several) > 1 and name in effect}
    channel, gain = judge.cause_gain(evidences, choice, choices, units)
    return Cause(choice.effect, parameters, effect, 0.0, 0.0, gain, channel)


def _with_shares(causes, book):
    """Causes of one id merged, with their share of what stood out, the largest first."""
    merged = {}
    for cause in causes:
        if cause.id in merged:
            first = merged[cause.id]
            cause = Cause(cause.id, {**first.parameters, **cause.parameters}, {**first.effect, **cause.effect},
                          0.0, 0.0, first.gain, first.channel)
        merged[cause.id] = cause
    total = max(book.excess, sum(book.parts.values()))
    shared = []
    for c in merged.values():
        part = float(book.parts.get(c.id, 0.0))
        clarity = part / max(part + max(book.left.get(c.channel, 0.0), 0.0), 1e-9)
        shared.append(dataclasses.replace(c, probability=probability(part, clarity), share=min(part / total, 1.0),
                                          evidence=part, clarity=clarity))
    return sorted(shared, key=lambda c: -c.share)


def _units(collection):
    """Factor from a standardised residual to the channel's unit, and that unit; torque is reported as voltage."""
    units = {}
    for name in collection.names:
        channels = [c[name] for c in collection.channels["held"]]
        if name == "torque":
            drive = channels[0].drive
            size = np.mean([np.sqrt(np.median(c.white)) for c in channels])
            units[name] = (float(size * drive.resistance / drive.torque_constant), "V")
        else:
            units[name] = (float(np.mean([c.scatter if name == "position" else c.noise for c in channels])), "m")
    return units


def _baseline_in_motion(baseline, records, least):
    """(Records of the ``baseline`` that move, notes): what rests says nothing of friction and drive. One that travels
    less than ``least`` [m] is left out, unless none of the ``records`` to learn from travels further."""
    def travel(record):
        return float(np.nanmax(record["encoder_m"]) - np.nanmin(record["encoder_m"]))

    if max(map(travel, records)) < least:
        return baseline, []
    rests = [record for record in baseline if travel(record) < least]
    notes = [f"Left out of the baseline: {record.source} moves by {1e6 * travel(record):.2g} µm only, and says"
             " nothing of friction in motion." for record in rests]
    return [record for record in baseline if travel(record) >= least], notes


def _hold_back(records, holdout):
    """Records to learn from and to judge on, and notes about what was held back."""
    if not records:
        raise InputError("records", "none", "at least one record to learn from")
    if holdout:
        return records, holdout, []
    if len(records) > 1:
        return records[:-1], records[-1:], [f"Held back for judging: {records[-1].source}."]
    only, cut = records[0], int(len(records[0]) * 0.65)
    return (
        [only.rows(0, cut)],
        [only.rows(cut, len(only))],
        [f"Held back for judging: the last third of {only.source}."],
    )
