"""What must be known before any residual means something, found from the records and taken into the model.

A slow drift of the interferometer, wide lost motion, a slow amplifier, lines of the floor and a drive train far from
the model's each spoil every balance; so they are looked for one after the other, the records being prepared anew with
what is known by then.
"""

import dataclasses

from microstage_ros.diagnosis.preprocessing.preparation import prepare
from microstage_ros.diagnosis.preprocessing.threads import side_by_side
from microstage_ros.diagnosis.prerequisites.amplifier import MOST, Slowness, find_slowness
from microstage_ros.diagnosis.prerequisites.lines import find_lines, remainder_taken
from microstage_ros.diagnosis.prerequisites.lost_motion import Gap, find_gap, stands_out
from microstage_ros.diagnosis.prerequisites.resonant import FAR, Train, fit_train
from microstage_ros.diagnosis.prerequisites.slow_drift import courses
from microstage_ros.diagnosis.residuals.resonance import Resonance
from microstage_ros.diagnosis.residuals.transmission_deflection import Windup

SWING = 0.5             # of a slow amplifier's χ² that must be left of it once the drive train is known
# times the wind-up's χ² beside a prompt amplifier that a slow one may leave; derived: twice the amplitude; a true one
# leaves less, and what else winds the drive train up is as large with it as without it
WORSE = 4.0
MOST_ROUNDS = 8         # of slow amplifier and motor's speed; derived: a change of a half each leaves 4·10⁻³
SETTLED = 0.01          # relative change of its time; derived: less than `amplifier.LAG_ERROR`
CHANGED = ("learn", "held")    # groups of records in which something may be wrong


@dataclasses.dataclass(frozen=True)
class Known:
    """What was found so far: `amplifier.Slowness`, `lost_motion.Gap`, `resonant.Train`, [`lines.Line`], and each
    record's course of the interferometer."""

    slow: Slowness | None = None
    gap: Gap | None = None
    train: Train | None = None
    lines: tuple = ()
    courses: tuple = ()

    def prepare(self, groups, drive, prepared, more=()):
        """``prepared`` with the learning and held-out records prepared anew; ``more``: voltage (n,) [V] that each of
        them has at the motor's terminals beyond what the amplifier makes of the command."""
        anew, number = dict(prepared), 0
        for found in (self.train, self.gap):
            drive = found.drive(drive) if found else drive
        for name in CHANGED:
            anew[name] = []
            for record in groups[name]:
                traces = [(line.frequency, line.traces[number]) for line in self.lines]
                anew[name].append(
                    prepare(
                        record,
                        drive,
                        _amplified(self.slow, more[number] if more else None),
                        traces,
                        self.gap.width if self.gap else 0.0,
                        self.courses[number] if self.courses else None,
                        self.gap.pull if self.gap else 0.0,
                    )
                )
                number += 1
        return anew


def _amplified(slow, more):
    """``amplifier`` of `preparation.prepare`: with a `Slowness`, or without, and ``more`` [V], or nothing."""
    apply = slow.apply if slow else None
    if more is None:
        return apply
    return lambda command, period: (apply(command, period) if apply else command) + more


def find_known(groups, drive):
    """({group: [`Prepared`]}, `Known`) of records {group: [`Record`]} in the groups learn, held and base."""
    prompt = {name: side_by_side(lambda record: prepare(record, drive), group) for name, group in groups.items()}
    known = Known(courses=courses(prompt))
    if known.courses:
        prompt = known.prepare(groups, drive, prompt)
    prepared, known = _slow_or_loose(groups, prompt, drive, known)
    if known.slow is not None and known.gap is None:
        prepared, known = _train_instead(groups, prompt, drive, prepared, known)
    lines = _lines(prepared, drive)
    if lines:
        known = dataclasses.replace(known, lines=tuple(lines))
        prepared = known.prepare(groups, drive, prepared)
        lines = remainder_taken(lines, *([Resonance(p, drive) for p in prepared[name]] for name in ("learn", "held")))
        known = dataclasses.replace(known, lines=tuple(lines))
        prepared = known.prepare(groups, drive, prepared)
        if known.slow is not None:
            prepared, known = _slow_without_lines(groups, prepared, drive, known)
    if known.train is None and known.gap is None:
        train = _far_train(prepared, drive)
        if train is not None:
            known = dataclasses.replace(known, train=train)
            prepared = known.prepare(groups, drive, prepared)
            prepared, known = _slow_behind(groups, prepared, drive, known)
    return prepared, known


def slow_beside(more, groups, prepared, drive, known):
    """({group: [`Prepared`]}, `Known`) with the slow amplifier found anew beside its gain, offset and dead band; None
    where that neither changes its time by more than its error nor makes clear what it is.

    A soft drive is looked for anew, too: an amplifier of a wrong time leaves a swing.

    Parameters
    ----------
    more : voltage (n,) [V] of those faults for each learning, then each held-out record, `find_slowness`.
    groups, prepared, drive, known : as in `find_known`, and what it found.
    """
    plain = dataclasses.replace(known, train=None)
    prepared = plain.prepare(groups, drive, prepared) if known.train is not None else prepared
    slow, before = find_slowness(prepared, drive, more), known.slow
    if slow is None or (slow.effect, slow.rival, bool(slow.lag)) == (
            before.effect, before.rival, bool(before.lag)) and abs(slow.total - before.total) < before.stderr:
        return None
    known = dataclasses.replace(plain, slow=slow)
    if known.gap is None:
        period = prepared["learn"][0].period
        terminals = [slow.apply(voltage, period) for voltage in more]
        train = _far_train(known.prepare(groups, drive, prepared, terminals), drive)
        known = dataclasses.replace(known, train=train)
    return known.prepare(groups, drive, prepared), known


def _slow_without_lines(groups, prepared, drive, known):
    """The slow amplifier judged anew where the floor's lines are known by now: the loop answers them, and so does the
    stage's reading, from which the motor's speed comes at such frequencies."""
    prompt = dataclasses.replace(known, slow=None)
    anew = prompt.prepare(groups, drive, prepared)
    slow = find_slowness(anew, drive)
    return (prepared, known) if slow is not None and _holds_most(slow) else (anew, prompt)


def _slow_behind(groups, prepared, drive, known):
    """The slow amplifier judged anew where the drive train, whose swing looks like a lag of it, is known by now."""
    slow = find_slowness(prepared, drive) if known.slow is not None else None
    if slow is None:
        return prepared, known
    known = dataclasses.replace(known, slow=slow)
    return known.prepare(groups, drive, prepared), known


def _far_train(prepared, drive):
    """`resonant.Train` of the records if it is far softer than the model's, else None."""
    if not _all_currents(prepared):
        return None
    train = fit_train(*([Resonance(p, drive) for p in prepared[name]] for name in ("learn", "base")))
    return train if train is not None and train.stiffness * FAR <= 1.0 else None


def _train_instead(groups, prompt, drive, prepared, known):
    """What is known if a drive train that swings, of which the command's channel knows nothing, looked like a slow
    amplifier."""
    train = _far_train(prompt, drive)
    if train is None:
        return prepared, known
    other = dataclasses.replace(known, slow=None, train=train)
    corrected = other.prepare(groups, drive, prompt)
    slow = find_slowness(corrected, drive)
    if slow is not None and slow.gain > SWING * known.slow.gain:
        return prepared, known
    if slow is not None:
        other = dataclasses.replace(other, slow=slow)
        corrected = other.prepare(groups, drive, prompt)
    return corrected, other


def _holds_most(slow):
    """Whether a `Slowness` explains most of what stands above the noise of its own channel in the held-out records."""
    return slow.held >= MOST * (slow.held_before - slow.held_usual)


def _slow_or_loose(groups, prepared, drive, known):
    """Slowness and gap: the gap first, as in its rattle the amplifier cannot be judged; and again with a slow
    amplifier, whose lateness moves the motor's travel."""
    def with_gap():
        gap = find_gap(prepared, drive)
        return (gap, dataclasses.replace(known, gap=gap)) if gap is not None else (None, known)

    before = known
    gap, known = with_gap()
    if gap is not None:
        prepared = known.prepare(groups, drive, prepared)
    prompt = prepared, known
    slow = find_slowness(prepared, drive)
    if slow is None or (gap is not None and not _holds_most(slow)):
        return prepared, known
    # the motor's speed was computed with a prompt amplifier, then with one that is not slow enough, and so on
    for _ in range(MOST_ROUNDS):
        known = dataclasses.replace(before, slow=slow)
        prepared = known.prepare(groups, drive, prepared)
        again = find_slowness(prepared, drive)
        settled = again is None or abs(again.total - slow.total) < SETTLED * slow.total
        slow = again or slow
        if settled:
            break
    if not _holds_most(slow):
        return prompt      # a dead band, in which the loop hunts, holds a lag's share of what it does to the command
    known = dataclasses.replace(before, slow=slow)
    prepared = known.prepare(groups, drive, prepared)
    if gap is None and _left_of_windup(prepared, drive) > WORSE * _left_of_windup(prompt[0], drive):
        return prompt      # the motor does not go where such an amplifier would drive it
    found, known = with_gap()
    if gap is not None and found is None and stands_out(prepared, drive):
        return prompt      # a lag that moves the motor to where a gap, plain without it, is none is the rattle's own
    return (known.prepare(groups, drive, prepared) if found is not None else prepared), known


def _left_of_windup(prepared, drive):
    """χ² [1] of the wind-up of the learning records, as they are ``prepared``."""
    channels = [Windup(p, drive) for p in prepared["learn"]]
    return sum(float((one.whiten(one.residual[:, None])[0] ** 2).sum()) for one in channels)


def _all_currents(prepared):
    return all(p.has_current for name in CHANGED for p in prepared[name])


def _lines(prepared, drive):
    """Lines in the resting parts of the records, if all have a current."""
    if not _all_currents(prepared):
        return []
    return find_lines(*([Resonance(p, drive) for p in prepared[name]] for name in ("learn", "held", "base")))
