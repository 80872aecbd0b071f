"""Verdict, causes, shares and gain from what was selected, judged on held-out records."""

import dataclasses
import math

import numpy as np
from scipy.stats import chi2

from microstage_ros.diagnosis.catalogue import CONTAINS
from microstage_ros.diagnosis.residuals.evidence_set import Evidences, Trial
from microstage_ros.diagnosis.result import Finding, Gain, OverallGain, Rivals
from microstage_ros.diagnosis.selection.selection import (
    FRICTIONS,
    LEVEL,
    acceptable,
    best_forms,
    level_or_viscous,
    profile_of,
)

RIVAL_MARGIN = 12.0     # χ² by which a cause must beat every other name
RIVAL_SHARE = 0.02      # and share of its own gain
FLAT = 0.5              # spread of a profile over its mean, below which it is a level
SCATTER = 1.35          # χ² per row over the baseline's that no healthy record reaches
STRANGER = {"torque": 40.0}  # times its own part that may be left in the channel of a named cause; friction is random
STRANGER_ELSE = 6.0
READING_SHARE = 0.1     # of what is left between the two readings that a cause must hold if only one of them tells of it
ALONE = 2.0             # times its threshold that a dependence must reach if only the learning records show it
LEFT_SHARE = 0.08       # of what stood out, above which something is left
COORDINATES = {
    "position": "position", "time": "time", "friction in time": "time", "viscous in time": "time",
    "velocity": "velocity", "speed": "velocity",
    "acceleration": "acceleration", "voltage": "voltage", "direction": "direction",
}
#: Shapes that healthy axes show a little of, by factors on the threshold.
LOOSE = {"generic:acceleration": 30.0, "generic:velocity": 3.0, "generic:friction in time": 3.0,
         "generic:viscous in time": 3.0, "generic:time": 3.0}


@dataclasses.dataclass
class Ledger:
    """χ² of the held-out records: before, after the causes, at the floor, rows; and each cause's own part."""

    before: float = 0.0
    after: float = 0.0
    floor: float = 0.0
    rows: int = 0
    parts: dict = dataclasses.field(default_factory=dict)

    @property
    def excess(self):
        """What stood out of the noise."""
        return max(self.before - self.floor, 1e-9)


def ledger_of(evidences, choices, generic):
    """`Ledger` over the evidences' channels."""
    book = Ledger()
    for channel, held in evidences.held.items():
        scale = evidences.scatter[channel]
        keys = Evidences._keys(channel, choices)
        beta, _, _ = evidences.learn[channel].fit(keys)
        after = (held.energy() - held.reduction(keys, beta)) / scale
        floor = (held.energy() - _own_reach(held, keys, [f for f in generic if f.channel == channel])) / scale
        book.before += held.energy() / scale
        book.after += after
        book.floor += min(floor, after)
        book.rows += held.rows
    for choice in choices:
        others = [c for c in choices if c is not choice]
        book.parts[choice.effect] = max(evidences.held_gain(choices) - evidences.held_gain(others), 0.0)
    return book


def _own_reach(held, keys, generic):
    """What the causes, fitted to the held-out records themselves, and significant nameless shapes would reach."""
    taken, reach = list(keys), held.fit(keys)[2] - len(held.indices(keys)) if keys else 0.0
    for form in generic:
        count = len(held.indices([form.key]))
        more = held.fit([*taken, form.key])[2] - held.fit(taken)[2]
        if more > chi2.isf(1e-6, count) * LOOSE.get(form.effect, 1.5):
            taken.append(form.key)
            reach += more - count
    return max(reach, 0.0)


def rivals_of(evidences, choice, choices, effects):
    """Other names that explain as much as this one: list of effect ids."""
    others = [c for c in choices if c.effect != choice.effect]
    own = best_or_same(evidences, choice, others)
    found = []
    if level_or_viscous(evidences, choices) == choice:
        effects = [effect for effect in effects if effect not in FRICTIONS]
    for effect in effects:
        if effect in {c.effect for c in choices} or effect in CONTAINS.get(choice.effect, ()):
            continue
        if effect == "drive_compliance" and choice.effect == "payload_change":
            continue  # the guideway's friction has proved the payload (`selection`)
        trial = best_forms(evidences, effect, others)
        if trial is None or not acceptable(evidences, trial, others) or _level(evidences, trial.choice, others):
            continue
        lead = own.gain + own.held - 2 * own.sizes - (trial.gain + trial.held - 2 * trial.sizes)
        if lead < max(RIVAL_MARGIN, RIVAL_SHARE * own.gain):
            found.append(effect)
    return found


def _level(evidences, choice, others):
    """Whether friction along the stroke is but another level of it: then the name says nothing of a place."""
    if choice.effect != "position_dependent_friction":
        return False
    mean, spread = profile_of(evidences, choice, [*others, choice])
    return spread < FLAT * abs(mean)


def best_or_same(evidences, choice, others):
    """Gain of a choice as it stands beside the others."""
    gain = evidences.gain([*others, choice]) - evidences.gain(others)
    held = evidences.held_gain([*others, choice]) - evidences.held_gain(others)
    sizes = sum(len(evidences.learn[f.channel].indices([f.key])) for f in choice.forms)
    return Trial(choice, gain, sizes, held)


def findings_of(evidences, choices, generic):
    """How strongly each channel's residual depends on each coordinate, before and after the causes."""
    found = []
    for form in (form for form in generic if form.channel in evidences.learn):
        learn = evidences.learn[form.channel]
        count = len(learn.indices([form.key]))
        before = evidences.channel_gain(form.channel, [], [(form.channel, form.key)])
        after = evidences.channel_gain(form.channel, choices, [(form.channel, form.key)])
        after -= evidences.channel_gain(form.channel, choices)
        threshold = chi2.isf(1e-6, count) * LOOSE.get(form.effect, 1.5)
        base = evidences.base.get(form.channel)
        if base is not None:
            usual = base.fit([form.key])[2] / evidences.scatter[form.channel]
            threshold = max(threshold, 3.0 * usual * learn.rows / base.rows)
        held = evidences.held_more(form.channel, Evidences._keys(form.channel, choices), form.key)
        found.append((Finding(form.channel, COORDINATES[form.effect.split(":")[1]], before / count, threshold / count,
                              after / count), held))
    return found


def leftovers(found):
    """Findings that stand after the causes were taken out, and on the held-out records too."""
    return [finding for finding, held in found if finding.left > finding.threshold and held > 25.0]


def of_learning_records(found):
    """Findings so strong in the learning records that they stand although the held-out ones do not show them."""
    return [finding for finding, _ in found if finding.left > ALONE * finding.threshold]


def verdict_of(causes, rivals, left, book, stands_out):
    """One of `diagnosis.VERDICTS`.

    ``left``: significant dependences that no cause explains; ``stands_out``: whether anything did before.
    """
    if rivals:
        return "undetermined"
    if not causes:
        return "unexplained" if left or stands_out else "agrees"
    remaining = (book.after - book.floor) / book.excess
    if left and remaining > LEFT_SHARE:
        return "partly_explained"
    return "explained" if remaining < 0.3 else "partly_explained"


def stands_out(evidences, choices):
    """Channels whose residual, after the causes, scatters more on every record group than the baseline does."""
    found = []
    for channel, base in evidences.base.items():
        usual = base.energy() / base.rows
        keys = Evidences._keys(channel, choices)
        beta = evidences.learn[channel].fit(keys)[0]
        ratios = [(group.energy() - group.reduction(keys, beta)) / group.rows / usual
                  for group in (evidences.learn[channel], evidences.held[channel])]
        if min(ratios) > SCATTER:
            found.append(channel)
    return found


def without_strangers(evidences, choices):
    """Drop causes that explain next to nothing of a channel in which much more stands out: the nearest name is no answer."""
    kept = list(choices)
    for choice in choices:
        others = [c for c in kept if c is not choice]
        for channel in {form.channel for form in choice.forms} & set(stands_out(evidences, kept)):
            held, base = evidences.held[channel], evidences.base[channel]
            keys = Evidences._keys(channel, kept)
            beta = evidences.learn[channel].fit(keys)[0]
            left = held.energy() - held.reduction(keys, beta) - held.rows * base.energy() / base.rows
            own = (evidences.held_gain(kept, [channel]) - evidences.held_gain(others, [channel])) * evidences.scatter[channel]
            if left > STRANGER.get(channel, STRANGER_ELSE) * max(own, 0.0):
                kept = others
                break
    return _told_by_a_reading(evidences, kept)


def _told_by_a_reading(evidences, choices):
    """Without causes that only the stage's reading tells of, where the two readings differ by more than these explain."""
    if "position" not in stands_out(evidences, choices):
        return choices
    held, base = evidences.held["position"], evidences.base["position"]
    keys = Evidences._keys("position", choices)
    left = held.energy() - held.reduction(keys, evidences.learn["position"].fit(keys)[0]) - held.rows * base.energy() / base.rows
    kept = []
    for choice in choices:
        own = evidences.held_gain(choices) - evidences.held_gain([c for c in choices if c is not choice])
        by_reading = {form.channel for form in choice.forms} <= {"windup", "resonance"}
        if not by_reading or own > READING_SHARE * left / evidences.scatter["position"]:
            kept.append(choice)
    return kept


def overall_gain(book, names):
    """`OverallGain` as root mean square of the standardised residual, with the interval of after."""
    rows = max(book.rows, 1)
    before, after, floor = (math.sqrt(max(v, 0.0) / rows) for v in (book.before, book.after, book.floor))
    half = 1.96 / math.sqrt(2.0 * rows) * after
    return OverallGain("rms of the residual over its noise, all channels", "1", tuple(names), before, after, floor,
                       (after - half, after + half))


def rivals_entry(ids):
    """`Rivals` of one trace; the run file that separates them is made where the answer is written."""
    names = " and ".join(ids)
    why = f"{names} leave the same trace in these records: neither fits the held-out record better than the other."
    return Rivals(tuple(ids), why, {})


def probability_of(trial):
    """Probability that a cause is real, from its significance over some hundred candidates (at most 0.999)."""
    return float(np.clip(1.0 - math.exp(min(trial.log_p - LEVEL, 0.0)) * 0.1, 0.5, 0.999))


def cause_gain(evidences, choice, choices, units):
    """`Gain` of one cause in the channel where it shows most: rms before and after, in the channel's unit."""
    others = [c for c in choices if c is not choice]
    best = max({f.channel for f in choice.forms},
               key=lambda ch: evidences.held_gain(choices, [ch]) - evidences.held_gain(others, [ch]))
    held, (factor, unit) = evidences.held[best], units[best]
    energy = held.energy() / evidences.scatter[best]
    before = energy - evidences.held_gain(others, [best])
    after = energy - evidences.held_gain(choices, [best])
    rms = lambda value: factor * math.sqrt(max(value, 0.0) / max(held.rows, 1))
    return best, Gain(rms(before), rms(after), unit)
