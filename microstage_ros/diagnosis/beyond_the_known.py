"""What of the chosen causes is more than known faults, never modelled to the last nanometre, leave behind.

A slow amplifier, a gap, lines of the floor and a soft drive are found before all else and taken into the model
(`prerequisites`). What they leave of themselves has the shape of other causes, in some channels more than in others.
"""

from microstage_ros.diagnosis.prerequisites.lateness import OTHER_TIME
from microstage_ros.diagnosis.residuals.evidence_set import Choice
from microstage_ros.diagnosis.selection import judge
from microstage_ros.diagnosis.selection.agreement import CERTAIN, held_out_records_show, unsteadiness
from microstage_ros.diagnosis.selection.mass_or_drive import RESONANT
from microstage_ros.diagnosis.selection.selection import acceptable
from microstage_ros.diagnosis.selection.splinters import FLIPS_NOT, OF_REST, STEADY, stands_beside, wider_keys

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


def taken(known, course):
    """χ² [1] of the held-out records taken by causes that are modelled outside the regression: a slow amplifier, lines
    of the floor, a drift of its own course, a gap."""
    parts = [line.held for line in known.lines]
    parts += [known.slow.held] if known.slow is not None else []
    parts += [course.held_before - course.held_after] if course is not None else []
    parts += [max(known.gap.held_before - known.gap.held_after, known.gap.taken)] if known.gap is not None else []
    return sum(parts)


def beyond_the_known(evidences, choices, known, rests=True):
    """Choices that are more than what the known prerequisites, never modelled to the last nanometre, leave behind.

    ``rests``: whether the axis ever does; a loop that swings between the amplifier's limits shows nothing of rest.
    """
    if known.slow is not None:
        clear = _clear_of(evidences, choices, known.slow.held, SLOW_SHARE)
        choices = [c for c in choices if c in clear or c.effect in OF_PLACE or _is_constant(evidences, c, choices)
                   or _beside_any_time(evidences, c, choices)]
    if known.gap is not None:
        gap = known.gap
        held = max(gap.held_before - gap.held_after, gap.taken)
        both = (FOLLOWED_SHARE, FOLLOWED_SWUNG_SHARE) if gap.rattles else (RATTLE_SHARE, SWUNG_SHARE)
        # the drive train is no better modelled than the gap; where it is soft it holds a thousand times the gap's χ²
        loose = max(gap.held_loose - gap.held_after, 0.0) if gap.far else 0.0
        clear = _clear_of(evidences, choices, max(held, loose), both[0])
        swung = _clear_of(evidences, choices, held, both[1])
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
        rested = [c for c in choices if rests and c.effect in OF_REST and _beside_any_speed(evidences, c, choices)]
        # a swing of one amplitude has one range of speeds: level, viscosity and power of the speed look alike there
        feigned = SWUNG if rests else (*SWUNG, "friction_level_change")
        kept = [c for c in choices if c in soft or c.effect not in feigned or c in (*swung, *rested)]
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
