"""Verdict, causes, shares and gain from what was selected, judged on held-out records."""

import math

from scipy.stats import chi2

from microstage_ros.diagnosis.catalogue import CONTAINS
from microstage_ros.diagnosis.residuals.evidence_set import Choice, Evidences, Trial
from microstage_ros.diagnosis.result import Finding, Improvement, OverallImprovement, Rivals
from microstage_ros.diagnosis.selection.agreement import (
    CERTAIN,
    HALF,
    OF_ONE,
    SIGMAS,
    agrees_with_itself,
    clear_part,
    has_two_sizes,
    in_baseline,
    is_the_first,
    leads,
    log_tail,
    shortfall,
    unsteadiness,
)
from microstage_ros.diagnosis.selection.ledger import ledger_of, usual_size
from microstage_ros.diagnosis.selection.mass_or_drive import RESONANT, resonance_is, shown_by_rattle
from microstage_ros.diagnosis.selection.selection import (
    MISFIT,
    RIVAL_MARGIN,
    acceptable,
    best_forms,
    level_or_viscous,
    misfit,
)
from microstage_ros.diagnosis.selection.splinters import FAINT_GAIN, FRICTIONS, LEVEL, stand_side_by_side
from microstage_ros.model.effects import REGISTRY

# and share of its own gain; calibrated by: validation.margins --kind two --world second --seed 18001 --cases 100
# (0.016 to 0.062)
RIVAL_SHARE = 0.02
# the same in the torque without a baseline, which would say what of the lead is the model's own error; calibrated by:
# `test/diagnosis/cases/plain_programmes.py --no-baseline --programme "there and back" --effect viscous_change --seed
# 926` (friction along the stroke led by 0.15; on moves to and fro the speed is a function of the place)
UNSEEN_SHARE = 0.2
# χ² per row over the baseline's that no healthy record reaches; calibrated by: validation.margins (1.04 to 1.54)
SCATTER = 1.35
LARGEST_ASYMMETRY = REGISTRY["direction_asymmetry"].parameters["asymmetry"].maximum   # of the guideways' limits
ONE_FORCE = {"gravity_tilt", "direction_asymmetry"}
# share of a tilt's gain from which the asymmetry, but for the record's first 40 µm the same, explains it too
CONSTANT = 0.5
# times the model's own noise that a healthy channel may show where no baseline says what it usually shows; derived:
# with `SCATTER` twice, as a figure of one significant digit is uncertain by a factor of two
UNSEEN = 2.0 / SCATTER
# times its own part that may be left in the channel of a cause of no one size; in the torque calibrated by: microstage
# campaign --world second --kind two --seed 10301, case 81 (4.6 beside a tilt that was none)
STRANGER, STRANGER_IN_TORQUE = 6.0, 3.0
# relative standard error of a size, by how stretches scatter, up to which it is one and the same; calibrated by:
# microstage campaign --world second --kind two --seed 8205, case 5 (an encoder's error beside a drift, 0.0996)
SIZE_OF_NO_STRANGER = 0.12
# of what is left between the two readings that a cause must hold if only one of them tells of it; derived: what a size
# of the other that is off by a third leaves of it, squared
READING_SHARE = 0.1
# of what a cause takes from its channel that may be left there above the noise; derived: a size that is off by a fifth
# leaves a twenty-fifth
UNCLEAR = 0.05
SLACK = 1.5   # times what chance makes of a shape, but `LOOSE`; calibrated by: validation.margins (1.41 to 1.52)
MOST_LEFT = 0.3     # of what stood out, up to which it is explained; calibrated by: validation.margins (0.24 to 0.33)
ALONE = 2.0             # times its threshold that a dependence must reach if only the learning records show it
# χ² on held-out records that a cause must hold: the geometric mean of 83 and 158; calibrated by: microstage campaign
# --world second, seeds 901 (healthy: 44, 47, 63, 83 and 578 held by wrong names), 921, 923, 941 (right ones: 158 and
# more)
LEAST_EVIDENCE = 115.0
# of what stood out, above which something is left; calibrated by: validation.margins --kind two --world second --seed
# 18001 --cases 100 (0.004 to 0.113)
LEFT_SHARE = 0.08
METRIC = ("rms of the residual over its noise, all channels; a channel in which nothing stands out and no cause shows"
          " is noise, and enters the floor as it is")
COORDINATES = {
    "position": "position", "direction": "direction", "acceleration": "acceleration", "voltage": "voltage",
    "time": "time", "friction in time": "time", "viscous in time": "time", "velocity": "velocity", "speed": "velocity",
}
#: Healthy axes show a little; calibrated by: validation.margins --kind two --world second --seed 9812 --cases 15
LOOSE = {"generic:acceleration": 30.0, "generic:velocity": 3.0,     # 4.9 to 126; 2.3 to 3.02; and 2.8 to 3.2;
         "generic:friction in time": 3.0, "generic:viscous in time": 3.0, "generic:time": 3.0}  # 2.98 to 3.4; to 4.1
#: Times that in the torque where no baseline says what the axis shows of the model's own errors; calibrated by:
#: `test/diagnosis/cases/plain_programmes.py --kind healthy --no-baseline --cases 8 --seed 1500` and the same with
#: `--law self_tuning` (0.51 of this by speed and 0.55 by acceleration at most; with `--cases 4 --seed 1700` and 1750,
#: since friction at rest is its mean, 0.19 and 0.55)
UNSEEN_LOOSE = {"generic:velocity": 8.0, "generic:time": 5.0, "generic:acceleration": 3.0,
                "generic:friction in time": 3.0, "generic:viscous in time": 3.0}


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
        trial = best_forms(evidences, effect, others)
        if {effect, choice.effect} == set(RESONANT):
            said = None if trial is None else resonance_is(evidences, {choice.effect: own, effect: trial}, others)
            # beside causes that stand by now it may be the other one
            found += [effect] if said in ("open", effect) else []
            continue
        if is_constant_force(evidences, choice, effect, others):
            found.append(effect)
            continue
        if trial is None or not acceptable(evidences, trial, others):
            continue
        pair = evidences, choice, trial.choice, others
        if stand_side_by_side(*pair):
            continue
        lead = own.gain + own.held - 2 * own.sizes - (trial.gain + trial.held - 2 * trial.sizes)
        clear = lead >= _rival_share(evidences, choice) * own.gain or is_the_first(*pair)
        if lead < RIVAL_MARGIN or not clear or not _leads(*pair):
            found.append(effect)
    return found


def _rival_share(evidences, choice):
    """Share of a choice's own gain [1] by which it must lead."""
    in_torque = any(form.channel == "torque" for form in choice.forms)
    return UNSEEN_SHARE if in_torque and not evidences.base.get("torque") else RIVAL_SHARE


def _leads(evidences, choice, other, others):
    """Whether the stretches of the records agree that one name explains more than another.

    χ² knows the noise alone. In the torque, the model's own errors are larger on a machine of another friction law, and
    a name may lead by hundreds because of one breakaway. The other channels have no friction law in them. An asymmetry
    of another law's friction is nearer to the constant force of a tilt than to the model's, and neither is right to the
    last.
    """
    if any(form.channel != "torque" for form in (*choice.forms, *other.forms)):
        return True
    lead = evidences.lead(choice, other, others)
    if lead is None:
        return True
    if (choice.effect, other.effect) == ("gravity_tilt", "direction_asymmetry") and lead[0] + SIGMAS * lead[1] < HALF:
        return False
    return leads(lead, clear_part(evidences.lead_of_baseline(choice, other, others)))


def is_constant_force(evidences, choice, effect, others):
    """Whether a tilt may as well be an asymmetry of the guideways alone.

    Limits F (1 + a sgn v) are F sgn v and the constant force a F, the whole hysteresis moved along with it; only the
    force's size tells: an asymmetry cannot make more of it than the friction there is.
    """
    if {choice.effect, effect} != ONE_FORCE or "torque" not in evidences.learn:
        return False
    if effect == "gravity_tilt":
        return any(form.variant == "guideway" for form in choice.forms)
    form = next((f for f in evidences.forms if f.effect == effect and f.variant == "guideway"), None)
    if form is None:
        return False
    keys = Evidences._keys("torque", others)
    beta, covariance, gain = evidences.learn["torque"].fit([*keys, form.key])
    gain = gain / evidences.scatter["torque"] - evidences.channel_gain("torque", others)
    own = evidences.channel_gain("torque", [*others, choice]) - evidences.channel_gain("torque", others)
    within = abs(beta[-1]) - 3.0 * math.sqrt(covariance[-1, -1] * evidences.scatter["torque"]) < LARGEST_ASYMMETRY
    return bool(within and gain > CONSTANT * own)


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
        threshold = chi2.isf(math.exp(LEVEL), count) * LOOSE.get(form.effect, SLACK)
        if form.channel == "torque" and not evidences.base.get("torque"):
            threshold *= UNSEEN_LOOSE.get(form.effect, 1.0)
        threshold = max(threshold, 3.0 * evidences.usual(form.channel, form.key))
        if after > threshold:
            shape = Choice(form.effect, (form,))
            threshold = max(threshold, after * shortfall(evidences, shape, choices))
        held = evidences.held_more(form.channel, Evidences._keys(form.channel, choices), form.key)
        if after > threshold and (in_baseline(evidences, shape, choices)
                                  or not agrees_with_itself(evidences, shape, choices)):
            held = 0.0      # not there beyond what the baseline shows of it
        found.append((Finding(form.channel, COORDINATES[form.effect.split(":")[1]], before / count, threshold / count,
                              after / count), held))
    return found


def leftovers(found):
    """Findings that stand after the causes were taken out, and on the held-out records too."""
    # derived: five standard errors
    return [finding for finding, held in found if finding.left > finding.threshold and held > 25.0]


def of_learning_records(found):
    """Findings so strong in the learning records that they stand although the held-out ones do not show them."""
    return [finding for finding, _ in found if finding.left > ALONE * finding.threshold]


def verdict_of(causes, rivals, left, remaining, above):
    """One of `diagnosis.VERDICTS`.

    Parameters
    ----------
    causes : what is sure. rivals : open questions.
    left : significant dependences that no cause explains.
    remaining : share of what stood out that is left where the causes are [1], `Ledger.remaining`.
    above : channels whose residual, after the causes, stands above the noise floor.

    Returns
    -------
    ``explained`` only where nothing stands above the floor any more.
    """
    if rivals:
        return "undetermined"
    if not causes:
        return "unexplained" if left or above else "agrees"
    if above or (left and remaining > LEFT_SHARE):
        return "partly_explained"
    return "explained" if remaining < MOST_LEFT else "partly_explained"


def stands_out(evidences, choices):
    """Channels whose residual, after the causes, scatters more on every record group than a healthy axis's does.

    A baseline that is quieter than the noise model, as it happened to rest near the middle of a count, is no yardstick:
    up to the model's own noise nothing stands out.
    """
    found = []
    for channel in evidences.held:
        usual = max(usual_size(evidences, channel), 1.0) * (1.0 if channel in evidences.base else UNSEEN)
        keys = Evidences._keys(channel, choices)
        beta = evidences.learn[channel].fit(keys)[0]
        sizes = [(group.energy() - group.reduction(keys, beta)) / group.rows
                 for group in (evidences.learn[channel], evidences.held[channel])]
        if min(sizes) > usual * SCATTER and _louder(evidences, channel, choices):
            found.append(channel)
    return found


def _louder(evidences, channel, choices):
    """Whether the learning records scatter more than the baseline beyond how stretches of each differ among themselves.

    Friction that jumps every few seconds is of one size in few stretches only.
    """
    said = evidences.loudness(channel, choices, "learn")
    if said is None or channel in evidences.base and evidences.mostly_louder(channel, choices):
        return True
    usual = (evidences.loudness(channel, [], "base") if channel in evidences.base else None) or (1.0, 0.0, 0.0)
    usual = (max(usual[0], 1.0), *usual[1:])
    more = said[0] - usual[0], math.hypot(said[1], usual[1]), said[2] + usual[2]
    return log_tail(more) < OF_ONE - math.log(len(evidences.learn))


def without_strangers(evidences, choices):
    """Drop causes that explain next to nothing of the channel in which they show most, while much more stands out
    there: the nearest name is no answer. It has another size wherever one looks; a cause of one size is none such.
    Beside another cause of that channel, one of another size in the held-out than in the learning records is none."""
    kept = list(choices)
    for choice in choices:
        others, left = [c for c in kept if c is not choice], ledger_of(evidences, kept).left
        channel, own = _main_channel(evidences, choice, kept, others)
        if shown_by_rattle(evidences, choice) or channel not in stands_out(evidences, kept):
            continue
        small = left[channel] < (STRANGER_IN_TORQUE if channel == "torque" else STRANGER) * max(own, 0.0)
        of_no_size = not small and unsteadiness(evidences, choice, others) > SIZE_OF_NO_STRANGER
        if of_no_size or any(o.keys(channel) for o in others) and has_two_sizes(evidences, choice, others):
            kept = others
    return _shown_by_more_than_the_reading(evidences, kept)


def _main_channel(evidences, choice, kept, others):
    """The channel in which a cause holds most of the held-out χ², and how much: a soft drive that explains the
    resonance is no stranger because of the millionth part of it that shows as deflection."""
    own = {channel: evidences.held_gain(kept, [channel]) - evidences.held_gain(others, [channel])
           for channel in sorted({form.channel for form in choice.forms})}
    return max(own.items(), key=lambda item: item[1])


def without_faint(evidences, choices, beside=0.0):
    """Drop causes that hold less than they need on held-out records, the faintest first.

    A size of no reality can agree with itself: at one chance in a hundred, on every hundredth healthy axis.
    ``beside``: χ² [1] of the held-out records taken by causes that are modelled outside the regression.
    """
    kept = list(choices)
    while kept:
        spare = [_spare(evidences, choice, [o for o in kept if o is not choice], beside) for choice in kept]
        if min(spare) >= 0.0:
            break
        del kept[spare.index(min(spare))]
    return kept


def _spare(evidences, choice, others, beside=0.0):
    """χ² that a cause holds on held-out records beyond what it needs: `LEAST_EVIDENCE`; of what the learning records
    show twice as clearly, all that it can hold there, as the held-out records may hardly go where it is. An axis on
    which another cause is clear is no healthy one: a size that is certain needs to be there only."""
    learned, held = (gain([*others, choice]) - gain(others) for gain in (evidences.gain, evidences.held_gain))
    needed = LEAST_EVIDENCE
    clear = beside + evidences.held_gain(others) >= LEAST_EVIDENCE
    if clear and unsteadiness(evidences, choice, others) < CERTAIN:
        needed = FAINT_GAIN
    if learned >= 2.0 * LEAST_EVIDENCE:
        needed = min(needed, max(evidences.signal(choice, others), FAINT_GAIN))
    return held - needed


def that_agree(evidences, choices):
    """Those that still agree with themselves, go beyond the baseline and are no misfit, with their sizes refined and
    beside each other."""
    return [c for c in choices if agrees_with_itself(evidences, c, [o for o in choices if o is not c])
            and misfit(evidences, c, choices) < MISFIT]


def _shown_by_more_than_the_reading(evidences, choices):
    """Without causes that only the stage's reading tells of, where the two readings differ by more than these explain;
    a cause that explains its own channel down to the noise is none of them."""
    # what late readings leave between the two is no shape, and has its name
    late = "sampling_jitter" in {c.effect for c in choices}
    if late or "position" not in stands_out(evidences, choices):
        return choices
    left = ledger_of(evidences, choices).left
    kept = []
    for choice in choices:
        others = [c for c in choices if c is not choice]
        channel, most = _main_channel(evidences, choice, choices, others)
        own = evidences.held_gain(choices) - evidences.held_gain(others)
        by_reading = {form.channel for form in choice.forms} <= {"windup", "resonance"}
        if not by_reading or own > READING_SHARE * left["position"] or left[channel] < UNCLEAR * most:
            kept.append(choice)
    return kept


def overall_gain(book, names):
    """`OverallImprovement` as root mean square of the standardised residual, with the interval of after; the floor is
    the book's."""
    rows = max(book.rows, 1)
    before, after, floor = (math.sqrt(max(v, 0.0) / rows) for v in (book.before, book.after, book.floor))
    # derived: 95 % of a Gaussian; the relative standard error of an rms of n values is 1/√(2n)
    half = 1.96 / math.sqrt(2.0 * rows) * after
    return OverallImprovement(METRIC, "1", tuple(names), before, after, floor, (after - half, after + half))


def rivals_entry(ids):
    """`Rivals` of one trace; the run file that separates them is made where the answer is written."""
    names = " and ".join(ids)
    why = f"{names} leave the same trace in these records: neither fits the held-out record better than the other."
    return Rivals(tuple(ids), why, {})


def cause_gain(evidences, choice, choices, units):
    """`Improvement` of one cause in the channel where it shows most: rms before and after, in the channel's unit."""
    others = [c for c in choices if c is not choice]
    best = max({f.channel for f in choice.forms},
               key=lambda ch: evidences.held_gain(choices, [ch]) - evidences.held_gain(others, [ch]))
    held, (factor, unit) = evidences.held[best], units[best]
    energy = held.energy() / evidences.scatter[best]
    before = energy - evidences.held_gain(others, [best])
    after = energy - evidences.held_gain(choices, [best])
    rms = lambda value: factor * math.sqrt(max(value, 0.0) / max(held.rows, 1))
    return best, Improvement(rms(before), rms(after), unit)
