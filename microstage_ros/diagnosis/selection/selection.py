"""Which causes: forward and backward over the catalogue, on the evidence of all channels together."""

import itertools
import math

import numpy as np

from microstage_ros.diagnosis.catalogue import CONTAINS
from microstage_ros.diagnosis.residuals.evidence_set import Choice, Evidences, Trial
from microstage_ros.diagnosis.selection.agreement import agrees_with_itself, in_baseline, is_wave_of_baseline
from microstage_ros.diagnosis.selection.mass_or_drive import (
    DECISIVE,
    FAST,
    RESONANT,
    alike,
    behind_gap,
    mass_beyond_baseline,
    mass_confirmed,
    payload_on_another_drive,
    resonance_is,
    stiffness_agrees,
    stiffness_of,
)
from microstage_ros.diagnosis.selection.sizes import sizes_of, width
from microstage_ros.diagnosis.selection.splinters import (
    ALONG_STROKE,
    FRICTIONS,
    LEVEL,
    is_splinter,
    wider_keys,
    without_splinters,
)
from microstage_ros.diagnosis.selection.stepwise import forward
from microstage_ros.diagnosis.selection.stroke_profile import (
    CLEARLY_LESS,
    is_flat,
    is_level_of_a_profile,
    is_wave_of_friction,
    profile_of,
    uneven_as_ever,
)

RIVAL_MARGIN = 12.0     # χ² by which a cause must beat every other name; derived: odds of exp(12/2), 400 to one
# of the gain expected on held-out records that must arrive; calibrated by: validation.margins --kind two --world second
# --seed 18001 --cases 100 (0.084 to 0.119)
HELD_SHARE = 0.1
DOMINANCE = 0.5              # of the gain of a stronger name that does not stand, below which a weaker one is not taken
WITHOUT_FRICTION = frozenset({"windup", "position"})     # channels in which there is no friction law
# strongest trials of which two may stand together; calibrated by: microstage campaign --world second --kind two --seed
# 12701, case 80 (the strongest two)
PAIRED = 4
ONE_RESONANCE = 0.5          # of the gain of payload and soft drive, that the payload alone must reach
# by how much less a simpler effect may explain than one that contains it: χ², or a share; calibrated by:
# validation.margins --kind single --world second --seed 18011 --cases 60 (23.9 to 25.3 and 0.050 to 0.0605)
SIMPLER, SIMPLER_SHARE = 25.0, 0.06
# a tilt is a cable that pulls alike everywhere; derived: a constant force and a spring's are linear in their sizes, and
# neither is a model's error
EXACTLY_PART = ("gravity_tilt",)
MISFIT = 0.5                 # a wider shape may explain at most this share beside the named one


def best_forms(evidences, effect, choices):
    """The effect in its best form of each channel, beside ``choices``: a `Trial`, or None if no form makes sense."""
    used, gain, sizes = [], 0.0, 0
    beside_drive = effect == "payload_change" and any(c.effect == "drive_compliance" for c in choices)
    for channel in evidences.learn:
        if beside_drive and channel in FAST:
            continue        # what swings there is the drive's
        forms = [form for form in evidences.forms if form.effect == effect and form.channel == channel]
        keys = Evidences._keys(channel, choices)
        before = evidences.channel_gain(channel, choices)
        best = None
        for form in forms:
            if form.key in keys:
                continue
            beta, _, total = evidences.learn[channel].fit([*keys, form.key])
            own = beta[len(beta) - width(evidences, channel, form):]
            if not form.possible(own, evidences.frame):
                continue
            more = total / evidences.scatter[channel] - before
            score = more
            if effect == ALONG_STROKE:
                if is_wave_of_baseline(evidences, form, choices):
                    continue
                # a wave of the machine's own, which the baseline shows as well, is not the form of a change
                more -= evidences.usual(channel, form.key)
                # a fine profile has many sizes: the held-out records help to decide how fine it may be
                score = more + evidences.held_more(channel, keys, form.key)
            if best is None or score - 2 * len(own) > best[3] - 2 * best[1]:
                best = (more, len(own), form, score)
        # derived: Akaike's criterion, and a relative likelihood of e⁻² beyond it
        if best and (best[0] > 2 * best[1] + 4 or not used):
            gain, sizes = gain + best[0], sizes + best[1]
            used.append(best[2])
    if not used:
        return None
    if len(used) > 1:  # a form that makes held-out records worse in its channel is not this effect's trace there
        good = [f for f in used if evidences.held_gain([*choices, Choice(effect, (f,))], [f.channel])
                > evidences.held_gain(choices, [f.channel])]
        if 0 < len(good) < len(used):
            used = good
            gain = evidences.gain([*choices, Choice(effect, tuple(used))]) - evidences.gain(choices)
            sizes = sum(width(evidences, f.channel, f) for f in used)
    trial = Trial(Choice(effect, tuple(used)), gain, sizes)
    trial.held = evidences.held_gain([*choices, trial.choice]) - evidences.held_gain(choices)
    return trial


def misfit(evidences, choice, choices):
    """Share that a wider nameless shape explains beside the named cause: 0 if the name says it all.

    What the healthy axis shows of the shape, too, is no misfit. Beside another cause of the channel, whose own misfit a
    wide shape finds worth fitting, it is the share on held-out records.
    """
    others = [c for c in choices if c is not choice]
    own = evidences.gain([*others, choice]) - evidences.gain(others)
    own_held = evidences.held_gain([*others, choice]) - evidences.held_gain(others)
    worst = 0.0
    for channel in {form.channel for form in choice.forms}:
        keys = Evidences._keys(channel, [*others, choice])
        for pair in wider_keys(evidences, choice.effect, channel):
            where = evidences.learn[channel].where[pair[1]]
            more = evidences.more(channel, keys, pair[1]) - 2.0 * (where.stop - where.start) - evidences.usual(*pair)
            share = more / (own + max(more, 0.0))
            if any(other.keys(channel) for other in others):
                held = evidences.held_more(channel, keys, pair[1])
                # derived: a divisor, never nothing
                share = min(share, held / (max(own_held, 1e-9) + max(held, 0.0)))
            worst = max(worst, share)
    return worst


def acceptable(evidences, trial, choices):
    """Whether a further cause stands: significant, there on held-out records, not in the baseline, not a splinter."""
    if trial is None or trial.log_p > LEVEL:
        return False
    rows = {c: evidences.held[c].rows / max(evidences.learn[c].rows, 1) for c in evidences.held}
    share = np.mean([rows[form.channel] for form in trial.choice.forms])
    # a cable slack where the held-out records go pulls little there
    expected = min(share * trial.gain, evidences.signal(trial.choice, choices))
    # derived: a χ² of 5 of one size is a chance of 0.025
    if trial.held < 5.0 or trial.held < HELD_SHARE * expected:
        return False
    if not _channels_agree(evidences, trial.choice, choices) or is_level_of_a_profile(evidences, trial.choice, choices):
        return False
    if not _leaves_possible(evidences, trial.choice, choices):
        return False
    if any(refuses(evidences, trial.choice, choices) for refuses in (in_baseline, uneven_as_ever, is_flat)):
        return False
    if misfit(evidences, trial.choice, [*choices, trial.choice]) >= MISFIT or is_splinter(evidences, trial, choices):
        return False
    return agrees_with_itself(evidences, trial.choice, choices) and not is_wave_of_friction(
        evidences, trial.choice, choices)


def _leaves_possible(evidences, choice, choices):
    """Whether the causes that were chosen keep possible sizes beside a further one: a gap beside a payload of less than
    nothing is none of the two."""
    for channel in {form.channel for form in choice.forms}:
        forms = {form.key: form for other in choices for form in other.forms if form.channel == channel}
        sizes = evidences.learn[channel].sizes([*forms, *choice.keys(channel)]) if forms else {}
        if not all(form.possible(sizes[key], evidences.frame) for key, form in forms.items()):
            return False
    return True


def _channels_agree(evidences, choice, choices):
    """Whether the channels tell one size: a payload shows in friction and in resonance with the same mass, or it is
    none, as more friction alone is no mass; a soft drive in resonance and in wind-up with the same stiffness. Nor is a
    cable one whose force the torque does not know, or knows as another than the drive train that it bends."""
    if choice.effect == "cable_spring":
        springs = {f.channel: sizes_of(evidences, choice, choices, f)[0]["stiffness_N_m"][:2] for f in choice.forms}
        if set(springs) != {"torque", "windup"}:
            return "torque" in springs
        (torque, stderr), (windup, error) = springs["torque"], springs["windup"]
        soft = stiffness_of(evidences, choices)     # which the cable bends so much further
        torque, stderr = torque / soft, stderr / soft
        return alike(windup, torque) or abs(windup - torque) < DECISIVE * math.hypot(stderr, error)
    if choice.effect == "drive_compliance":
        return stiffness_agrees(evidences, choice, choices)
    if choice.effect != "payload_change":
        return True
    masses = {form.channel: sizes_of(evidences, choice, choices, form)[0]["mass_kg"][:2] for form in choice.forms}
    if evidences.frame.rattled_mass:    # behind a gap the rattle tells what the resonance would
        masses["resonance"] = (evidences.frame.rattled_mass, 0.0)
    elif "torque" in masses and (behind_gap(evidences) or "drive_compliance" in {c.effect for c in choices}):
        return mass_confirmed(evidences, choices)     # as the resonance is the soft drive's
    if not {"torque", "resonance"} <= set(masses):
        return False
    (friction, stderr), (resonance, _) = masses["torque"], masses["resonance"]
    return abs(friction) > 3.0 * stderr and alike(resonance, friction)


class _Balance:
    """The evidence of all channels as a `stepwise.ResidualModel`; its state is the list of `Choice`."""

    def __init__(self, evidences, effects):
        self.evidences, self.effects = evidences, effects

    def count(self, choices):
        """Causes so far."""
        return len(choices)

    def trials(self, choices):
        """Every effect that is not taken yet in its best form, the strongest first."""
        taken = {c.effect for c in choices}
        trials = [best_forms(self.evidences, effect, choices) for effect in self.effects if effect not in taken]
        return sorted((t for t in trials if t is not None), key=lambda t: 2 * t.sizes - t.gain)

    def first_standing(self, trials, choices):
        """See `_first_acceptable`, and `_standing_pair` where no single trial stands."""
        return _first_acceptable(self.evidences, trials, choices) or _standing_pair(self.evidences, trials, choices)

    def extended(self, choices, winner, trials):
        """With the winner, or the simpler effect that it contains, or the pair; pruned."""
        if isinstance(winner, tuple):
            return prune(self.evidences, [*choices, *(trial.choice for trial in winner)])
        return prune(self.evidences, [*choices, _simpler(self.evidences, winner, trials, choices).choice])


def select(evidences, effects):
    """Forward, then backward: the list of `Choice`, and the trials of the last round that lost."""
    most = len(effects)
    balance = _Balance(evidences, effects)
    choices, lost = forward(balance, [], most)
    renamed = _renamed(evidences, choices, effects)
    if renamed != choices:
        choices, lost = forward(balance, prune(evidences, renamed), most)
    choices = mass_or_stiffness(evidences, choices)
    best = level_or_viscous(evidences, choices)
    if best is not None:
        choices = [best if c.effect in FRICTIONS else c for c in choices]
    return without_splinters(evidences, choices), lost


def _renamed(evidences, choices, effects):
    """The choices with every name asked again beside the others, which were not known yet when it was taken.

    A viscosity beside friction that lags looks like a power of the speed as long as the lag is unknown. A wider effect
    always explains more than the simpler one that it contains, and is no other name of it.
    """
    kept = list(choices)
    for place in range(len(kept) if len(kept) > 1 else 0):
        mine, others = kept[place], [c for c in kept if c is not kept[place]]
        channels = {form.channel for form in mine.forms}
        barred = {c.effect for c in kept}.union(CONTAINS.get(mine.effect, ()))
        free = {f.effect for f in evidences.forms if f.channel in channels and f.effect in effects} - barred
        trials = [best_forms(evidences, effect, others) for effect in sorted(free)]
        own = evidences.gain(kept) - evidences.gain(others)
        least = own - 2 * sum(width(evidences, f.channel, f) for f in mine.forms) + RIVAL_MARGIN
        better = [t for t in trials if t is not None and t.gain - 2 * t.sizes > least]
        for trial in sorted(better, key=lambda t: 2 * t.sizes - t.gain):
            if acceptable(evidences, trial, others):
                kept[place] = trial.choice
                break
    return kept


def level_or_viscous(evidences, choices):
    """Beside friction along the stroke, which may hold a level of its own: the `Choice` of the two that leaves the
    profile the smaller mean, or None if there is no such question, or no answer."""
    profile = next((c for c in choices if c.effect == "position_dependent_friction"), None)
    if profile is None or sum(c.effect in FRICTIONS for c in choices) != 1:
        return None
    others = [c for c in choices if c.effect not in FRICTIONS]
    trials = {effect: best_forms(evidences, effect, others) for effect in FRICTIONS}
    if None in trials.values():
        return None
    means = sorted((abs(profile_of(evidences, profile, [*others, t.choice])[0]), e) for e, t in trials.items())
    best = trials[means[0][1]]
    clear = means[0][0] < CLEARLY_LESS * means[1][0] and acceptable(evidences, best, others)
    return best.choice if clear else None


def _one_resonance(evidences, choices):
    """Beside a payload that its friction proves, the resonance is the payload's too, unless it says much less than a
    drive."""
    if not {"payload_change", "drive_compliance"} <= {c.effect for c in choices}:
        return choices
    others = [c for c in choices if c.effect not in ("payload_change", "drive_compliance")]
    alone = best_forms(evidences, "payload_change", others)
    both = evidences.gain(choices) - evidences.gain(others)
    return [*others, alone.choice] if alone and alone.gain > ONE_RESONANCE * both else choices


def mass_or_stiffness(evidences, choices):
    """A payload, or a soft drive: the resonance and the wind-up hardly distinguish them, the torque balance does.

    A mass loads the guideways and takes torque at accelerations of any frequency; a soft drive takes none away from its
    resonance. Where the balance tells a mass that agrees with the resonance's, it is a payload; where it excludes that
    mass, a soft drive; where it tells another one, both.
    """
    others = [c for c in choices if c.effect not in RESONANT]
    if len(others) == len(choices):
        return choices
    trials = {effect: best_forms(evidences, effect, others) for effect in RESONANT}
    drive = trials["drive_compliance"]
    payload = payload_on_another_drive(evidences, drive.choice, others) if drive is not None else None
    if payload is not None:
        return [*others, drive.choice, payload]
    choices = _one_resonance(evidences, choices)
    if sum(c.effect in RESONANT for c in choices) != 1:
        return choices
    said = resonance_is(evidences, trials, others)
    if said in RESONANT and acceptable(evidences, trials[said], others):
        return [*others, trials[said].choice]
    if said == "payload_change" and mass_beyond_baseline(evidences, trials[said].choice, others):
        # the size that the torque balance tells is not the payload's alone
        return [*others, Choice(said, tuple(form for form in trials[said].choice.forms if form.channel != "torque"))]
    return choices


def _first_acceptable(evidences, trials, choices):
    """The strongest trial that stands, unless a much stronger one of the same channel does not: then nothing fits
    there. What the baseline shows, too, and a wave of friction is no change, and stands in nothing's way."""
    blocked = {}
    for trial in trials:
        channels = {form.channel for form in trial.choice.forms}
        if any(trial.gain < DOMINANCE * blocked.get(channel, 0.0) for channel in channels):
            continue
        if acceptable(evidences, trial, choices):
            return trial
        if trial.log_p < LEVEL and not _machines_own(evidences, trial.choice, choices):
            for channel in channels - _swung(trial, choices):
                part = evidences.channel_gain(channel, [*choices, trial.choice])
                part -= evidences.channel_gain(channel, choices)
                blocked[channel] = max(blocked.get(channel, 0.0), part)
    return None


def _machines_own(evidences, choice, choices):
    """Whether the healthy machine shows as much, or may: it is in the baseline, or a wave of its friction."""
    return in_baseline(evidences, choice, choices) or is_wave_of_friction(evidences, choice, choices)


def _standing_pair(evidences, trials, choices):
    """The strongest two trials of one channel that stand beside each other though neither stands alone, or None.

    Where one is as large as the other each is the other's misfit, and what the learning records say of one alone the
    held-out ones deny: a gain and a dead band, an error of the scale and a refractive index. Together they explain at
    least what the strongest of the channel does. Of the torque that is not asked, as the machine's friction law may be
    another one, nor behind a gap, which leaves something of its own.
    """
    if behind_gap(evidences):
        return None
    strong = [t for t in trials[:PAIRED] if t.log_p < LEVEL and not in_baseline(evidences, t.choice, choices)]
    for one, other in itertools.combinations(strong, 2):
        shared = WITHOUT_FRICTION.intersection(*({f.channel for f in t.choice.forms} for t in (one, other)))
        second = best_forms(evidences, other.choice.effect, [*choices, one.choice]) if shared else None
        first = best_forms(evidences, one.choice.effect, [*choices, second.choice]) if second is not None else None
        if first is None or second is None or not all(
                acceptable(evidences, trial, [*choices, beside.choice])
                for trial, beside in ((first, second), (second, first))):
            continue
        both = evidences.gain([*choices, first.choice, second.choice]) - evidences.gain(choices)
        if both > max(t.gain for t in trials if shared & {f.channel for f in t.choice.forms}):
            return first, second
    return None


def _swung(trial, choices):
    """Channels in which an effect that does not stand is in nobody's way: a soft drive leaves an inertia of its swing
    in the torque, which is no mass."""
    soft = any(choice.effect == "drive_compliance" for choice in choices)
    return {"torque"} if soft and trial.choice.effect == "payload_change" else set()


def _simpler(evidences, winner, trials, choices):
    """The simpler effect that the winner contains, if it explains as much, or more of the held-out records."""
    for trial in trials:
        wider = winner.choice.effect in CONTAINS.get(trial.choice.effect, ())
        if wider and (_as_much(trial, winner) or trial.held > winner.held) and acceptable(evidences, trial, choices):
            return trial
    return winner


def _as_much(trial, wider):
    """Whether a `Trial` explains as much as one of a wider effect that contains it: down to noise where the forms of
    both are exact."""
    if trial.choice.effect in EXACTLY_PART:
        return wider.gain + wider.held - 2 * wider.sizes - (trial.gain + trial.held - 2 * trial.sizes) < RIVAL_MARGIN
    pairs = (trial.gain, wider.gain), (trial.held, wider.held)
    return all(own > other - max(SIMPLER, SIMPLER_SHARE * other) for own, other in pairs)


def prune(evidences, choices):
    """Refine every cause's form beside the others, and drop those that no longer stand."""
    kept = list(choices)
    for choice in list(choices):
        others = [c for c in kept if c.effect != choice.effect]
        again = best_forms(evidences, choice.effect, others)
        if again is None or again.log_p > LEVEL or again.held < 0.0:
            kept = others
        else:
            kept = [again.choice if c.effect == choice.effect else c for c in kept]
    return kept
