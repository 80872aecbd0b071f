"""One axis, from its records to a `Diagnosis`.

Order: records are prepared; the amplifier's slowness is found from the fast part alone and taken into
the input, and so is lost motion that is wide enough to be seen as such; the channels' evidence is gathered; causes are selected forward and backward and their
non-linear sizes refined; lines and late readings, which are matters of spectrum and scatter, are looked
for apart; everything is judged on held-out records.
"""

import numpy as np

from microstage_ros.axis.errors import InputError
from microstage_ros.discrepancy import judge
from microstage_ros.discrepancy.amplifier import find_slowness
from microstage_ros.discrepancy.catalogue import FORMS
from microstage_ros.discrepancy.channels.resonance import Resonance
from microstage_ros.discrepancy.collection import Collection
from microstage_ros.discrepancy.diagnosis import Cause, Diagnosis, Gain, Parameter
from microstage_ros.discrepancy.drive import drive_of
from microstage_ros.discrepancy.lines import find_lines
from microstage_ros.discrepancy.lost_motion import find_gap
from microstage_ros.discrepancy.pictures import gap_picture, pictures_of
from microstage_ros.discrepancy.preparation import prepare
from microstage_ros.discrepancy.refinement import refine
from microstage_ros.discrepancy.selection import select, sizes_of
from microstage_ros.discrepancy.systematic import SYSTEMATIC
from microstage_ros.discrepancy.timing import readings_late

EFFECTS = tuple(sorted({form.effect for form in FORMS if form.named and form.channel != "command"}))
RATTLED = 0.4           # share of the command's χ² that a slow amplifier must hold beside a gap
#: Shares of the χ² of a slow amplifier, or of a gap, that a further cause must hold in these channels: neither is
#: modelled to the last nanometre.
SLOW_SHARE = {"windup": 0.01, "resonance": 0.01, "torque": 0.002}
RATTLE_SHARE = {"windup": 0.01, "resonance": 0.01, "torque": 0.05}
GENERIC = tuple(form for form in FORMS if not form.named)


def diagnose_case(axis, records, holdout=(), baseline=(), seed=0):
    """Find what makes these records differ from the axis's model.

    Parameters
    ----------
    axis : `Axis` of a voltage-driven screw, the model as it was right for the baseline.
    records : list of `Record` to learn from.
    holdout : records to judge on; without any, the last record is held back, or the last third of the only one.
    baseline : records of the healthy axis, for the thresholds; may be empty.
    seed : written into the result; nothing here is drawn at random.

    Raises InputError for records that cannot be used.
    """
    drive = drive_of(axis)
    records, holdout, notes = _hold_back(list(records), list(holdout))
    groups = {"learn": records, "held": holdout, "base": list(baseline)}
    if not baseline:
        notes.append("No baseline was given: thresholds come from the model's own figures.")
    prepared = {name: [prepare(record, drive) for record in group] for name, group in groups.items()}
    prepared, slow, amplifier, gap = _unfollowed(groups, prepared, drive)
    width = 0.0 if gap is None else gap.width
    lines = _lines(prepared, drive)
    if lines:
        prepared |= _again(groups, drive, amplifier, lines, width)
    collection = Collection(prepared, drive)
    effects = [effect for effect in EFFECTS if gap is None or effect != "backlash"]
    evidences = collection.evidences([form for form in FORMS if form.channel != "command"])
    choices, _ = select(evidences, effects)
    if slow is not None:  # a slow amplifier is never modelled to the last nanometre
        choices = _clear_of(evidences, choices, slow.held, SLOW_SHARE)
    if gap is not None:
        choices = _clear_of(evidences, choices, max(gap.held_before - gap.held_after, gap.taken), RATTLE_SHARE)
    rivals = {c.effect: judge.rivals_of(evidences, c, choices, effects) for c in choices}
    refined = refine(collection, choices)
    if refined != choices:
        evidences, choices = _final(collection, refined)
    choices = judge.without_strangers(evidences, choices)
    return _answer(collection, evidences, choices, rivals, (slow, gap, lines), holdout, notes, seed)


def _clear_of(evidences, choices, held, shares):
    """Choices that hold more, on held-out records, than what a cause of χ² ``held`` may leave in their channels."""
    def part(choice):
        return evidences.held_gain(choices) - evidences.held_gain([o for o in choices if o is not choice])

    return [c for c in choices if part(c) > held * min(shares.get(form.channel, 0.0) for form in c.forms)]


def _unfollowed(groups, prepared, drive):
    """What must be known before any residual means something: (prepared, slowness or None, amplifier, gap or None).

    The gap first, as in its rattle the amplifier cannot be judged; and again with a slow amplifier, whose
    lateness moves the motor's travel.
    """
    gap = find_gap(prepared, drive)
    if gap is not None:
        prepared = prepared | _again(groups, drive, None, (), gap.width)
    slow = find_slowness(prepared, drive)
    if slow is None or (gap is not None and slow.held < RATTLED * slow.held_before):
        return prepared, None, None, gap
    prepared = prepared | _again(groups, drive, slow.apply, ())
    slow = find_slowness(prepared, drive) or slow   # the motor's speed was told with a prompt amplifier
    prepared = prepared | _again(groups, drive, slow.apply, ())
    gap = find_gap(prepared, drive)
    if gap is not None:
        prepared = prepared | _again(groups, drive, slow.apply, (), gap.width)
    return prepared, slow, slow.apply, gap


def _again(groups, drive, amplifier, lines, gap=0.0):
    """Learning and held-out records prepared anew, with the amplifier's slowness and the gap, and without the lines."""
    prepared, number = {}, 0
    for name in ("learn", "held"):
        prepared[name] = []
        for record in groups[name]:
            traces = [(line.frequency, line.traces[number]) for line in lines]
            prepared[name].append(prepare(record, drive, amplifier, traces, gap))
            number += 1
    return prepared


def _lines(prepared, drive):
    """Lines in the resting parts of the records that have a current."""
    if not all(p.has_current for p in (*prepared["learn"], *prepared["held"])):
        return []
    return find_lines(*([Resonance(p, drive) for p in prepared[name]] for name in ("learn", "held", "base")))


def _final(collection, choices):
    """Evidence of the chosen, refined forms, the nameless shapes and the model's own errors only; and what still stands."""
    own = [form for choice in choices for form in choice.forms]
    keys = {(channel, key) for channel, table in SYSTEMATIC.items() for key in table}
    more = [form for form in FORMS if (form.channel, form.key) in keys and form.key not in {f.key for f in own}]
    final = collection.evidences([*own, *more, *GENERIC])
    kept = [c for c in choices if judge.best_or_same(final, c, [o for o in choices if o is not c]).held > 0.0]
    return final, kept


def _answer(collection, evidences, choices, rivals, apart, holdout, notes, seed):
    book = judge.ledger_of(evidences, choices, GENERIC)
    found = judge.findings_of(evidences, choices, GENERIC)
    units = _units(collection)
    causes, unsure = [], []
    for choice in choices:
        others = rivals.get(choice.effect, [])
        if others:
            unsure.append(judge.rivals_entry([choice.effect, *others]))
        else:
            causes.append(_cause(evidences, choice, choices, units))
    causes += _special_causes(collection, *apart, book, unsure)
    causes = _with_shares(causes, book)
    left = judge.leftovers(found)
    scattered = judge.stands_out(evidences, choices)
    if scattered and not causes:
        notes.append("The residual scatters more than the baseline's in: " + ", ".join(scattered) + ".")
    if apart[1] is not None and apart[1].held_after >= apart[1].held_before:
        notes.append("The replay behind the gap makes the held-out record no better; the gap rests on the learning records.")
    verdict = judge.verdict_of(causes, unsure, left, book, scattered)
    pictures = pictures_of(collection, evidences, choices, left)
    if collection.prepared["held"][0].behind is not None:
        pictures.insert(0, gap_picture(collection.prepared["held"][0]))
    return Diagnosis(
        verdict=verdict, causes=tuple(causes), rivals=tuple(unsure),
        gain=judge.overall_gain(book, [record.source for record in holdout]),
        findings=tuple(sorted((f for f, _ in found), key=lambda f: -f.statistic / f.threshold)),
        pictures=tuple(pictures), notes=tuple(notes), seed=seed,
    )


def _cause(evidences, choice, choices, units):
    """`Cause` of a selected effect; its share is filled in at the end."""
    parameters, effect = {}, {}
    for form in choice.forms:
        fitted, entry = sizes_of(evidences, choice, choices, form)
        for name, (value, stderr, unit) in fitted.items():
            known = parameters.get(name)
            if known is None or stderr < known.stderr:
                parameters[name] = Parameter(value, stderr, unit)
                effect |= {name: entry[name]} if name in entry else entry
        effect = {**entry, **effect}
    trial = judge.best_or_same(evidences, choice, [c for c in choices if c is not choice])
    channel, gain = judge.cause_gain(evidences, choice, choices, units)
    return Cause(choice.effect, parameters, effect, judge.probability_of(trial), 0.0, gain, channel)


def _special_causes(collection, slow, gap, lines, book, unsure):
    """Causes found outside the regression; their χ² is added to the book."""
    causes = []
    if slow is not None:
        book.before += slow.held
        book.parts[slow.effect] = slow.held
        name = "delay_s" if slow.effect == "transport_delay" else "time_s"
        if slow.rival:
            unsure.append(judge.rivals_entry(["transport_delay", "actuator_lag"]))
        else:
            rms = [slow.noise * np.sqrt(v / slow.held_rows) for v in (slow.held_before, slow.held_before - slow.held)]
            causes.append(Cause(slow.effect, {name: Parameter(slow.time, slow.stderr, "s")}, {name: slow.time}, 0.999, 0.0,
                                Gain(float(rms[0]), float(rms[1]), "V"), "command"))
    if gap is not None:
        causes.append(_lost_motion(gap, collection.frame.drive.radius, book))
    if lines:
        held = sum(line.held for line in lines)
        book.before += held
        book.parts["floor_vibration"] = held
        causes.append(_vibration(lines))
    late = readings_late(*(collection.prepared[g] for g in ("learn", "held", "base")))
    if late is not None:
        causes.append(_late(late, book))
    return causes


def _lost_motion(gap, radius, book):
    """The cause ``backlash`` from the replayed gap."""
    # a replay that lost its place in the gap makes the held-out record worse: no part of the whole; its own gain tells it
    part = max(gap.held_before - gap.held_after, 0.0)
    book.before += part
    book.parts["backlash"] = part
    rms = [gap.noise * np.sqrt(v / gap.held_rows) for v in (gap.held_before, gap.held_after)]
    width = gap.width / radius
    return Cause("backlash", {"width_rad": Parameter(width, gap.stderr / radius, "rad")}, {"width_rad": width}, 0.999, 0.0,
                 Gain(float(rms[0]), float(rms[1]), "m"), "windup")


def _vibration(lines):
    parameters = {}
    for n, line in enumerate(lines, 1):
        parameters[f"frequency_{n}_hz"] = Parameter(line.frequency, 0.02, "Hz")
        parameters[f"amplitude_{n}_m"] = Parameter(line.amplitude, line.stderr, "m")
    effect = {"frequencies_hz": [line.frequency for line in lines], "amplitudes_m": [line.amplitude for line in lines],
              "phases_rad": [line.phase for line in lines]}
    before = float(np.sqrt(sum(line.amplitude**2 for line in lines) / 2.0))
    left = float(np.sqrt(sum(line.stderr**2 for line in lines)))
    return Cause("floor_vibration", parameters, effect, 0.999, 0.0, Gain(before, left, "m"), "position")


def _late(late, book):
    """The cause ``sampling_jitter`` from scatter and repeated samples."""
    taught, again = late
    book.before += again.gain
    book.parts["sampling_jitter"] = book.parts.get("sampling_jitter", 0.0) + again.gain
    jitter, stderr = taught.jitter, taught.stderr / max(2.0 * taught.jitter, 1e-9)
    parameters = {"jitter_s": Parameter(jitter, float(stderr), "s"),
                  "lost_fraction": Parameter(taught.lost, float(np.sqrt(max(taught.lost, 1e-9) / 5.0e5)), "1")}
    speed = 1.0e-3
    return Cause("sampling_jitter", parameters, {"jitter_s": jitter, "lost_fraction": min(taught.lost, 0.5)}, 0.999, 0.0,
                 Gain(float(np.sqrt(again.floor + (jitter * speed) ** 2)), float(np.sqrt(again.floor)), "m"), "position")


def _with_shares(causes, book):
    """Causes of one id merged, with their share of what stood out, the largest first."""
    merged = {}
    for cause in causes:
        if cause.id in merged:
            first = merged[cause.id]
            cause = Cause(cause.id, {**first.parameters, **cause.parameters}, {**first.effect, **cause.effect},
                          max(first.probability, cause.probability), 0.0, first.gain, first.channel)
        merged[cause.id] = cause
    total = max(book.excess, sum(book.parts.values()))
    shared = [Cause(c.id, c.parameters, c.effect, c.probability, float(min(book.parts.get(c.id, 0.0) / total, 1.0)),
                    c.gain, c.channel, c.sentence) for c in merged.values()]
    return sorted(shared, key=lambda c: -c.share)


def _units(collection):
    """Factor from a standardised residual to the channel's unit, and that unit; torque is told as voltage."""
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
    return [only.rows(0, cut)], [only.rows(cut, len(only))], [f"Held back for judging: the last third of {only.source}."]
