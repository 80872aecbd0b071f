"""One axis, from its records to a `Diagnosis`.

Order: records are prepared, and what spoils every residual is found and taken into the model (`known`); the
channels' evidence is gathered, for the catalogue's forms and for those that the records suggest (`periods`,
`resonant`); causes are selected forward and backward and their non-linear sizes refined; what is no matter of
regression is added (`nonregression`); everything is judged on held-out records.
"""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.catalogue import FORMS
from microstage_ros.diagnosis.catalogue.drive import inertia_form
from microstage_ros.diagnosis.preprocessing.preparation import prepare
from microstage_ros.diagnosis.prerequisites.drive import drive_of
from microstage_ros.diagnosis.prerequisites.encoder import seen_count, seen_interpolation
from microstage_ros.diagnosis.prerequisites.growth import power_forms
from microstage_ros.diagnosis.prerequisites.law import own_law
from microstage_ros.diagnosis.prerequisites.lateness import OTHER_TIME, forms_of_slowness
from microstage_ros.diagnosis.prerequisites.lost_motion import shows_no_gap
from microstage_ros.diagnosis.prerequisites.periods import periodic_forms
from microstage_ros.diagnosis.prerequisites.prerequisites import find_known
from microstage_ros.diagnosis.prerequisites.resonant import damped_forms
from microstage_ros.diagnosis.prerequisites.slow_drift import find_course, take_out
from microstage_ros.diagnosis.report.pictures import drift_picture, gap_picture, pictures_of
from microstage_ros.diagnosis.residuals.collection import Collection
from microstage_ros.diagnosis.residuals.evidence_set import Choice
from microstage_ros.diagnosis.residuals.systematic import SYSTEMATIC
from microstage_ros.diagnosis.residuals.terminals import at_terminals
from microstage_ros.diagnosis.result import Cause, Diagnosis, Parameter
from microstage_ros.diagnosis.selection import judge, limit_cycle
from microstage_ros.diagnosis.selection.agreement import CERTAIN, held_out_records_show, unsteadiness
from microstage_ros.diagnosis.selection.calibration import likely, probability
from microstage_ros.diagnosis.selection.leftover import over_twin, scatter_findings
from microstage_ros.diagnosis.selection.mass_or_drive import RESONANT
from microstage_ros.diagnosis.selection.nonregression_causes import nonregression_causes
from microstage_ros.diagnosis.selection.refinement import about_their_sizes, refine
from microstage_ros.diagnosis.selection.selection import acceptable, select
from microstage_ros.diagnosis.selection.sizes import stated_sizes, with_payload, with_rattled_mass
from microstage_ros.diagnosis.selection.splinters import (
    FLIPS_NOT,
    OF_REST,
    STEADY,
    one_force,
    stands_beside,
    wider_keys,
)
from microstage_ros.quantities.errors import InputError

EFFECTS = tuple(sorted({form.effect for form in FORMS if form.named and form.channel != "command"}))
#: Shares of the χ² of a slow amplifier, of a gap, or of a soft drive, that a further cause must hold in these channels:
#: none of them is modelled to the last nanometre.
SLOW_SHARE = {"windup": 0.01, "resonance": 0.01, "torque": 0.002}
RATTLE_SHARE = {"windup": 0.01, "resonance": 0.01, "torque": 0.05}
SOFT_SHARE = {"windup": 0.02, "torque": 0.001}    # beside a drive train far from the model's, which swings
#: What a loop that swings in a gap, or on a soft drive, feigns in the torque: shapes of the friction over speed and
#: rest. They must hold this share of the gap's χ², behind which a replay may lose its place,
SWUNG = ("nonlinear_viscous", "rising_static_friction", "presliding_creep", "frictional_lag", "viscous_change")
SWUNG_SHARE = {"torque": 1.0}
#: and this share of a soft drive's: the geometric mean of 0.0093, of three shapes that were not there and together
#: passed for what LuGre's friction is beyond the model's, and 0.041, of friction that lags; calibrated by: microstage
#: campaign --world second --kind two, seed 9601, case 99, and seed 6105, case 45 (seed 9701: 0.0039 and less for shapes
#: that were not there)
SOFT_SWUNG_SHARE = {"torque": 0.02}
#: Behind a gap that force over deflection told no place is lost, and the torque is clear; yet a rattle, in which the
#: friction turns at every hit, feigns a little of those shapes: the geometric mean of 7.7e-4, a power of the speed that
#: was not there, and 5.4e-3, creep that was; calibrated by: microstage campaign --world second --kind two, seed 9401,
#: case 76, and seed 8305, case 48
FOLLOWED_SHARE = {"windup": RATTLE_SHARE["windup"]}
FOLLOWED_SWUNG_SHARE = {"torque": 0.002}
#: and beside a drive on which the loop swings less: the geometric mean of 0.027, a power of the speed that was not
#: there beside a payload of a loop that swung in a dead band, and 0.27, a viscosity; calibrated by: microstage campaign
#: --world second --kind two, seed 5105, case 11, and seed 4105, case 13
LESS_SWUNG_SHARE = {"torque": 0.08}
# factor on the stiffness below which a drive is one of the former; derived: the geometric mean of 0.1, the stiffest of
# them, and 0.4, the softest of the latter
SWINGS = 0.2
#: What changes along the stroke: what hangs back in time knows of no place. Reversals may all lie at a few places, so
#: that what hangs back there may seem to be friction of the place; the turns of the motor they do not know.
OF_PLACE = ("position_dependent_friction", "torque_ripple")
OF_TURNS = ("torque_ripple",)
#: A floor that shakes the contacts loosens them, which looks like creep; the share of the vibration's χ² that what
#: needs rest must hold if its size is not certain: the geometric mean of 0.04, without creep (campaign --world second
#: --kind single --seed 2103, case 49), and 0.095, of creep that is there (test_creep_beside_a_vibration_of_the_floor).
SHAKEN_SHARE = {"torque": 0.06}
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
    seed : written into the result [1]; nothing here is drawn at random.
    twin : list of `Record`, the held-out ones as the same machine makes them with nothing wrong in it, which only a
        simulation has; nothing is fitted to them (`leftover.over_twin`).

    Raises
    ------
    InputError : for records that cannot be used.
    """
    drive = seen_interpolation(drive_of(axis), list(baseline))
    records, holdout, notes = _hold_back(list(records), list(holdout))
    groups = {"learn": records, "held": holdout, "base": list(baseline)}
    if not baseline:
        notes.append("No baseline was given: thresholds come from the model's own figures.")
    prepared, known = find_known(groups, drive)
    seen = seen_count(drive, prepared)
    prepared |= {"twin": [prepare(one, drive) for one in twin]} if twin else {}
    prepared, drive, law = own_law(prepared, seen)
    notes += [law.words] if law is not None else []
    rattles = known.gap is not None and known.gap.rattles
    mass = known.gap.added_mass(drive.mass)[0] if rattles and known.gap.scales else 0.0
    drive = dataclasses.replace(drive, pull=(known.gap.pull, known.gap.pull_stderr) if rattles else None)
    collection = Collection(prepared, drive, rattled_mass=mass)
    found = ("backlash", "drive_compliance") if rattles else ("backlash",) if known.gap is not None else ()
    effects = [effect for effect in EFFECTS if effect not in found]
    own = [*periodic_forms(collection), *damped_forms(collection, known.train), *power_forms(collection),
           *forms_of_slowness(groups, drive, known, collection), *([inertia_form()] if known.gap is not None else [])]
    evidences = collection.evidences([*(form for form in FORMS if form.channel != "command"), *own])
    choices, _ = select(evidences, effects)
    course = find_course(collection, evidences, choices)
    if course is not None:
        evidences, course = take_out(collection, evidences, course)
        effects = [effect for effect in effects if effect not in SLOW_IN_TIME]
        choices, _ = select(evidences, effects)
    anew = at_terminals(collection, evidences, choices, groups, known, law)
    if anew is not evidences:
        evidences, (choices, _) = anew, select(anew, effects)
    choices = _beyond_the_known(evidences, choices, known)
    rivals = {c.effect: judge.rivals_of(evidences, c, choices, effects) for c in choices}
    choices, rivals = one_force(evidences, choices, rivals)
    refined = refine(collection, about_their_sizes(evidences, choices))
    if refined != choices:
        evidences, choices = _final(collection, refined)
        choices = judge.that_agree(evidences, choices)
    kept = judge.without_faint(evidences, judge.without_strangers(evidences, choices), _taken(known, course))
    dropped = [c.effect for c in choices if c not in kept]
    for choice in kept if dropped else []:      # no rivals as long as both stood
        rivals[choice.effect] = [*rivals.get(choice.effect, ()), *judge.rivals_of(evidences, choice, kept, dropped)]
    choices = kept
    return _answer(collection, evidences, choices, rivals, (known, course), holdout, notes, seed)


def _taken(known, course):
    """χ² [1] of the held-out records taken by causes that are modelled outside the regression: a slow amplifier, lines
    of the floor, a drift of its own course, a gap."""
    parts = [line.held for line in known.lines]
    parts += [known.slow.held] if known.slow is not None else []
    parts += [course.held_before - course.held_after] if course is not None else []
    parts += [max(known.gap.held_before - known.gap.held_after, known.gap.taken)] if known.gap is not None else []
    return sum(parts)


def _beyond_the_known(evidences, choices, known):
    """Choices that are more than what the known prerequisites, never modelled to the last nanometre, leave behind."""
    if known.slow is not None:
        clear = _clear_of(evidences, choices, known.slow.held, SLOW_SHARE)
        choices = [c for c in choices if c in clear or c.effect in OF_PLACE or _is_constant(evidences, c, choices)
                   or _beside_any_time(evidences, c, choices)]
    if known.gap is not None:
        gap = known.gap
        held = max(gap.held_before - gap.held_after, gap.taken)
        both = (FOLLOWED_SHARE, FOLLOWED_SWUNG_SHARE) if gap.rattles else (RATTLE_SHARE, SWUNG_SHARE)
        clear, swung = (_clear_of(evidences, choices, held, shares) for shares in both)
        choices = [c for c in choices if c.effect in OF_TURNS or c in (swung if c.effect in SWUNG else clear)]
        # behind a gap only the deflection would tell of a soft drive, and there the gap's own error does
        choices = [_in_torque(c) if c.effect in RESONANT else c for c in choices]
        choices = [c for c in choices if c.forms]
    if known.lines:
        loose = _clear_of(evidences, choices, sum(line.held for line in known.lines), SHAKEN_SHARE)
        choices = [c for c in choices
                   if c.effect not in OF_REST or c in loose or _beside_any_speed(evidences, c, choices)]
    soft = [c for c in choices if c.effect in RESONANT] if known.train is not None else []
    if soft:
        part = evidences.held_gain(choices) - evidences.held_gain([c for c in choices if c not in soft])
        swings, of_drive = known.train.stiffness < SWINGS, part
        # in a dead band the motor's travel, which comes from the command, is off in every half of a cycle
        moved = [c for c in choices if c not in soft and c.effect != "amplifier_deadband"]
        part = evidences.held_gain(choices) - evidences.held_gain(moved)
        # a limit cycle repeats itself: what it feigns has one size in all stretches, too
        swung = _clear_of(evidences, choices, part, SOFT_SWUNG_SHARE if swings else LESS_SWUNG_SHARE,
                          of_one_size=not (swings or len(moved) + len(soft) < len(choices)))
        rested = [c for c in choices if c.effect in OF_REST and _beside_any_speed(evidences, c, choices)]
        kept = [c for c in choices if c in soft or c.effect not in SWUNG or c in (*swung, *rested)]
        # what the swing feigns takes nothing from what is judged without it
        clear = [*_clear_of(evidences, kept, of_drive, SOFT_SHARE), *rested]
        kept = [*soft, *(c for c in kept if c in clear and c not in soft)]
        if len(kept) < len(choices):    # what was chosen beside a shape that the swing feigns stands without it, or not
            kept = [c for c in kept if c in soft or _stands(evidences, c, kept)]
        choices = kept
    return choices


def _in_torque(choice):
    """A `Choice` as it shows in the torque alone."""
    return Choice(choice.effect, tuple(form for form in choice.forms if form.channel == "torque"))


def _stands(evidences, choice, choices):
    """Whether a cause is acceptable beside the other ``choices``."""
    others = [c for c in choices if c is not choice]
    return acceptable(evidences, judge.best_or_same(evidences, choice, others), others)


def _beside_any_speed(evidences, choice, choices):
    """Whether a cause that needs rest is of a certain size, and stands beside any friction over speed: a swing, or a
    floor that shakes, feigns that, and knows no rest."""
    others = [o for o in choices if o is not choice]
    shapes = wider_keys(evidences, "viscous_change", "torque")
    return unsteadiness(evidences, choice, others) < CERTAIN and stands_beside(evidences, choice, others, shapes)


def _is_constant(evidences, choice, choices):
    """Whether a cause is a force that does not turn with the motion, as what hangs back in time does, and certain."""
    others = [o for o in choices if o is not choice]
    return choice.effect in FLIPS_NOT and held_out_records_show(evidences, choice, others)


def _beside_any_time(evidences, choice, choices):
    """Whether a cause shows in the torque alone, and stands there beside what an amplifier of another time leaves."""
    shapes = [(form.channel, form.key) for form in evidences.forms if form.effect == OTHER_TIME]
    others = [o for o in choices if o is not choice]
    of_torque = all(form.channel == "torque" for form in choice.forms)
    return bool(shapes) and of_torque and stands_beside(evidences, choice, others, shapes)


def _clear_of(evidences, choices, held, shares, of_one_size=True):
    """Choices that hold more, on held-out records, than what a cause of χ² ``held`` may leave in their channels, or
    have one size in all stretches, where that counts (``of_one_size``)."""
    def clear(choice):
        others = [o for o in choices if o is not choice]
        part = evidences.held_gain(choices) - evidences.held_gain(others)
        enough = held * min(shares.get(form.channel, 0.0) for form in choice.forms)
        return part > enough or of_one_size and unsteadiness(evidences, choice, others) < STEADY

    return [choice for choice in choices if clear(choice)]


def _final(collection, choices):
    """Evidence of the chosen, refined forms, the nameless shapes and the model's own errors only; and what still
    stands."""
    own = [form for choice in choices for form in choice.forms]
    keys = {(channel, key) for channel, table in SYSTEMATIC.items() for key in table}
    more = [form for form in FORMS if (form.channel, form.key) in keys and form.key not in {f.key for f in own}]
    final = collection.evidences([*own, *more, *GENERIC])
    kept = [c for c in choices if judge.best_or_same(final, c, [o for o in choices if o is not c]).held > 0.0]
    return final, kept


def _answer(collection, evidences, choices, rivals, nonregression, holdout, notes, seed):
    book = judge.ledger_of(evidences, choices)
    found = judge.findings_of(evidences, choices, GENERIC)
    units = _units(collection)
    causes, unsure = [], []
    for choice in choices:
        others = rivals.get(choice.effect, [])
        if others:
            unsure.append(judge.rivals_entry([choice.effect, *others]))
        else:
            causes.append(_cause(evidences, choice, choices, units))
    known, course = nonregression
    if collection.frame.rattled_mass:
        causes = with_rattled_mass(causes, *known.gap.added_mass(collection.frame.drive.mass))
    causes = with_payload(causes, collection.frame.drive.mass)
    scattered = judge.stands_out(evidences, choices)
    if known.slow is not None and "resonance" in scattered and not known.lines:
        # what is left follows the motor otherwise than the model at the very frequencies that tell a delay from a lag
        known = dataclasses.replace(known, slow=dataclasses.replace(known.slow, rival=True))
    causes += nonregression_causes(collection, known, course, causes, book, unsure)
    errors = {c.effect: unsteadiness(evidences, c, [o for o in choices if o is not c]) for c in choices}
    rattled = known.gap.held_before if known.gap is not None and known.gap.rattles else 0.0
    causes, doubtful = likely(_with_shares(causes, book), unsure, errors, rattled)
    at_limit = limit_cycle.share_at_limit(collection.prepared["learn"], collection.frame.drive.voltage_limit)
    causes, unsure, swings = limit_cycle.judged(
        at_limit, causes, unsure, scattered, errors,
        lambda: known.gap is None and shows_no_gap(collection.prepared, collection.frame.drive))
    notes += [swings] if swings else []
    if doubtful:
        notes.append(f"Beside the causes, too unlikely to be named: {', '.join(c.id for c in doubtful)}.")
    left = judge.leftovers(found)
    if not (left or causes or unsure):
        left = judge.of_learning_records(found)
        notes += (
            ["What stands out does so in the learning records only; the held-out ones may not go there."]
            if left
            else []
        )
    by_size, words = scatter_findings(collection, evidences, choices, scattered)
    if scattered:
        notes.append(
            f"The residual{' that is left' if causes else ''} stands above the noise floor in {', '.join(scattered)}"
            + "".join(f"; {words[name]}" for name in scattered if name in words)
            + "."
        )
    if known.gap is not None and known.gap.held_after >= known.gap.held_before:
        notes.append(
            "The replay behind the gap makes the held-out record no better; the gap rests on the learning records."
        )
    if course is not None:
        notes.append("Every record drifts on a course of its own; the extended axis holds the mean rate only.")
    verdict = judge.verdict_of(causes, unsure, left, book, scattered)
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
    )


def _cause(evidences, choice, choices, units):
    """`Cause` of a selected effect; its share is filled in at the end."""
    parameters, effect = {}, {}
    for form in choice.forms:
        fitted, entry = stated_sizes(evidences, choice, choices, form)
        for name, (value, stderr, unit) in fitted.items():
            known = parameters.get(name)
            if known is None or stderr < known.stderr:
                parameters[name] = Parameter(value, stderr, unit)
                effect |= {name: entry[name]} if name in entry else entry
        effect = {**entry, **effect}
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
