"""Whether a cause is more than the misfit of a larger one of its channel: a splinter of it."""

import math

from scipy.stats import chi2

from microstage_ros.diagnosis.catalogue import WIDER
from microstage_ros.diagnosis.prerequisites.amplifier import LEAST_GAIN
from microstage_ros.diagnosis.prerequisites.growth import OTHER_POWER
from microstage_ros.diagnosis.selection.agreement import HALF, unsteadiness
from microstage_ros.diagnosis.selection.stroke_profile import profile_of

# of one candidate; derived: some hundred candidates at 10⁻⁶ name a cause of a healthy axis by chance in 10⁻⁴ of the
# cases
LEVEL = math.log(1e-6)
# share of all gain on held-out records below which a further cause is not reported; derived: a size of the largest that
# is off by 3 % leaves as much, squared
FAINT = 1.0e-3
# and χ² above which it is reported all the same; derived: one size reaches it by chance in 10⁻¹⁴ of the cases
FAINT_GAIN = LEAST_GAIN
# share of what its channel's others explain above which a cause is no misfit of them; calibrated by: validation.margins
# --kind two --world second --seed 9812 --cases 15 (0.13 to 0.21)
MAJOR = 0.15
# a further cause must explain this share of what its channel's others explain; calibrated by: validation.margins (0.001
# to 0.062)
MINOR = 0.03
# beside a plain factor or constant, whose form is known to the last; calibrated by: microstage campaign --world second
# --kind two --seed 2101, case 26 (a warm winding beside an amplifier's gain holds 0.0074)
EXACT = 0.005
#: Effects whose columns are linear in their size: no grid and no power of them leaves a misfit that is steady, too.
LINEAR = ("amplifier_gain", "amplifier_offset", "scale_error", "refractive_index", "friction_level_change",
          "viscous_change", "gravity_tilt", "cable_spring", "torque_ripple", "encoder_sde", "screw_pitch_error",
          "sampling_jitter")
# relative standard error of its size below which a small cause is none of a larger one's misfit; calibrated by:
# microstage campaign --world second --kind two --seed 6105, cases 16, 29 and 45 (0.006 to 0.043, all there)
STEADY = 0.05
# beside a growth whose power was fitted; derived: a power that is off by a fiftieth (`growth.UNSURE`), squared
FITTED = 4.0e-4
#: and more beside those whose forms are a coarse grid that leaves that much; less beside those above; calibrated by:
#: validation.margins --kind two --world second --seed 18001 --cases 100 (0.13 and more beside rising static friction,
#: 0.18 to 0.40 beside creep, 0.05 and more beside friction along the stroke, as much beside a gap)
MINOR_BESIDE = {"amplifier_gain": EXACT, "amplifier_offset": EXACT, "scale_error": EXACT,
                "rising_static_friction": 0.25, "presliding_creep": 0.25, "nonlinear_viscous": FITTED, "backlash": 0.08,
                "position_dependent_friction": 0.08}
# of a small cause's gain that must be left beside a wider shape of the larger one; calibrated by: the same (0.18 to
# 0.54)
OWN_SHARE = 0.2
FRICTIONS = ("friction_level_change", "viscous_change")
#: What flips with the direction leaves nothing that does not, however much of it there is.
FLIPS = (*FRICTIONS, "nonlinear_viscous", "frictional_lag", "rising_static_friction", "presliding_creep")
FLIPS_NOT = ("gravity_tilt", "cable_spring")
#: What the speed alone sets leaves nothing that needs rest. A profile along the stroke may be but a level.
OF_SPEED = ("viscous_change", "nonlinear_viscous")
OF_REST = ("rising_static_friction", "presliding_creep")
#: What pulls one way, but for the first micrometres after a reversal.
ONE_FORCE = ("gravity_tilt", "direction_asymmetry")
ALONG_STROKE = "position_dependent_friction"
#: An error of the screw goes with its angle, a gain with the command at any size: a dead band leaves neither, whatever
#: its width.
NOT_SWALLOWED, SWALLOWS = ("screw_pitch_error", "amplifier_gain"), "amplifier_deadband"
#: What goes with the motor's turns, of whatever order, knows no rest and no direction.
OF_TURNS = "torque_ripple"


def wider_keys(evidences, effect, channel):
    """(channel, key) of the nameless shapes that hold this effect in this channel."""
    wanted = WIDER.get(effect, ())
    return [(channel, form.key) for form in evidences.forms if form.effect in wanted and form.channel == channel]


def is_splinter(evidences, trial, choices):
    """Whether the gain is but the misfit of a cause already named: small beside it, or gone with a wider shape of
    it, and of no one size."""
    if _of_one_size(evidences, trial.choice, choices):
        return False
    for form in trial.choice.forms:
        channel = form.channel
        there = [c for c in choices if c.keys(channel)]
        if not there:
            return False
        minor, explained = (
            max(MINOR_BESIDE.get(c.effect, MINOR) for c in there),
            evidences.channel_gain(channel, choices),
        )
        if _no_part_of(evidences, trial.choice, there, choices):
            return False
        if trial.gain < minor * explained:
            continue
        if trial.gain > max(minor, MAJOR) * explained:
            return False
        extra = [pair for c in there for pair in wider_keys(evidences, c.effect, channel)]
        more = evidences.channel_gain(channel, [*choices, trial.choice], extra)
        more -= evidences.channel_gain(channel, choices, extra)
        if chi2.logsf(max(more, 0.0), trial.sizes) < LEVEL and more > OWN_SHARE * trial.gain:
            return False
    return True


def _of_one_size(evidences, choice, others):
    """Whether a cause has one size in all stretches, and all beside it in its channel are linear in theirs."""
    channels = {form.channel for form in choice.forms}
    beside = [other for other in others if channels & {form.channel for form in other.forms}]
    linear = all(one.effect in LINEAR for one in beside)
    return linear and unsteadiness(evidences, choice, others) < STEADY


def _no_part_of(evidences, choice, larger, choices):
    """Whether a cause stands beside the larger ones whatever else their shape may be: then it is no misfit of them."""
    extra = []
    for one in larger:
        if one.effect in OF_SPEED and _is_level(evidences, choice, choices):
            return False
        shapes = _whatever_else(evidences, choice.effect, one)
        if not shapes:
            return False
        extra += shapes
    return stands_beside(evidences, choice, choices, extra)


def _is_level(evidences, choice, choices):
    """Whether friction along the stroke is, by its mean, as much a level, which a viscosity leaves where the speed is
    ever the same."""
    if choice.effect != ALONG_STROKE:
        return False
    mean, spread = profile_of(evidences, choice, [*choices, choice])
    return HALF * spread < abs(mean)


def stands_beside(evidences, choice, choices, shapes):
    """Whether a cause gains more than half as much beside ``shapes``, (channel, key) each, in their channels."""
    alone = evidences.gain([*choices, choice]) - evidences.gain(choices)
    beside = 0.0
    for channel in {channel for channel, _ in shapes}:
        beside += evidences.channel_gain(channel, [*choices, choice], shapes)
        beside -= evidences.channel_gain(channel, choices, shapes)
    return beside > HALF * alone


def stand_side_by_side(evidences, choice, other, others):
    """Whether a cause explains, beside another name, more than half of what it does without it, on the learning and on
    the held-out records: then that name explains something else, and takes nobody's place."""
    alone, beside = [*others, choice], [*others, other]
    return all(gain([*beside, choice]) - gain(beside) > HALF * (gain(alone) - gain(others))
               for gain in (evidences.gain, evidences.held_gain))


def _whatever_else(evidences, effect, larger):
    """(channel, key) of the nameless shapes that hold all that a larger `Choice` may leave beside itself, and not the
    ``effect``; none where there are no such shapes."""
    beside = ((FLIPS_NOT, FLIPS), ((*OF_REST, ALONG_STROKE), OF_SPEED), ((ALONG_STROKE,), FLIPS_NOT))
    if effect in (ALONG_STROKE, *OF_REST, *FLIPS_NOT, *FRICTIONS) and larger.effect in OF_REST:
        return [("torque", form.key) for form in evidences.forms if form.effect in OF_REST and form.effect != effect]
    if any(effect in ours and larger.effect in theirs for ours, theirs in beside):
        return wider_keys(evidences, larger.effect, "torque")
    if effect in FLIPS and larger.effect == OF_TURNS or effect in NOT_SWALLOWED and larger.effect == SWALLOWS:
        return [(form.channel, form.key) for form in evidences.forms if form.effect == larger.effect]
    if effect in FRICTIONS and larger.effect == "nonlinear_viscous" and not any("," in f.variant for f in larger.forms):
        return [("torque", form.key) for form in evidences.forms if form.effect == OTHER_POWER]
    return []


def one_force(evidences, choices, rivals):
    """Choices and rivals where a tilt and an asymmetry were chosen on a machine of another friction law.

    An asymmetry of that law is neither the one that is replayed nor a constant force, and both together are nearer than
    either. They are two causes if the fainter one holds more than a misfit does; else one, and which is open.
    """
    both = [c for c in choices if c.effect in ONE_FORCE]
    others = [c for c in choices if c not in both]
    if len(both) < len(ONE_FORCE) or evidences.frame.drive.actuator.law < 0:
        return choices, rivals
    whole, *alone = (evidences.gain([*others, *some]) - evidences.gain(others) for some in (both, *([c] for c in both)))
    if whole - max(alone) > MAJOR * whole:
        return choices, rivals
    stronger, fainter = both if alone[0] >= alone[1] else both[::-1]
    return [c for c in choices if c is not fainter], {**rivals, stronger.effect: [fainter.effect]}


def without_splinters(evidences, choices):
    """Drop causes whose part on held-out records is small beside another one's in the same channel, worst first."""
    kept = list(choices)
    while len(kept) > 1:
        parts = {
            c.effect: evidences.held_gain(kept) - evidences.held_gain([o for o in kept if o is not c]) for c in kept
        }
        weak = min(parts.values()) < min(FAINT * sum(parts.values()), FAINT_GAIN)
        small = [c for c in kept if weak and parts[c.effect] == min(parts.values())] or [
            c for c in kept if any(_small_beside(evidences, c, o, kept) for o in kept if o is not c)]
        if not small:
            break
        kept.remove(min(small, key=lambda c: parts[c.effect]))
    return kept


def _small_beside(evidences, choice, other, kept):
    """Whether a cause holds little of what another one does where both show, and next to nothing elsewhere."""
    def part(one, channels):
        return evidences.held_gain(kept, channels) - evidences.held_gain([o for o in kept if o is not one], channels)

    own = {form.channel for form in choice.forms}
    shared = sorted(own & {form.channel for form in other.forms})
    others = [c for c in kept if c is not choice]
    if _no_part_of(evidences, choice, [other], others) or _of_one_size(evidences, choice, others):
        return False
    minor = min(MINOR, MINOR_BESIDE.get(other.effect, MINOR))
    if not shared or part(choice, shared) >= minor * part(other, shared):
        return False
    return part(choice, sorted(own - set(shared))) < FAINT_GAIN if own - set(shared) else True
