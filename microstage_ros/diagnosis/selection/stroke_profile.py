"""Friction along the stroke: how much of it is a level, and whether the healthy axis varies as much."""

import math

import numpy as np

from microstage_ros.diagnosis.catalogue.friction import waves_form
from microstage_ros.diagnosis.residuals.evidence_set import Evidences
from microstage_ros.diagnosis.selection.sizes import sizes_of, width

CLEARLY_LESS = 0.5           # of the other's mean
FLAT = 0.5                   # spread of a profile over its mean, below which it is a level
# times the healthy friction's own unevenness; derived: five waves of one size that all add up where the records
# are have √5 times the standard deviation that they have along the whole stroke
UNEVEN = math.sqrt(5.0)
# of a ripple's gain beside friction's waves; calibrated by: microstage campaign --kind single, second world, seed
# 19011, cases 51 (0.10, a wave) and 23 (0.99, a ripple), and the first, seed 19021, case 27 (0.997)
KEPT = 0.25


def uneven_as_ever(evidences, choice, choices):
    """Whether friction along the stroke varies no more than the healthy axis's own does.

    Where the baseline was not, the axis's own profile is unknown; only its size is known, and how its waves add up on
    one part of the stroke is not how they do on another.
    """
    if choice.effect != "position_dependent_friction":
        return False
    beta = evidences.learn["torque"].fit(Evidences._keys("torque", [*choices, choice]))[0]
    own = beta[len(beta) - sum(width(evidences, "torque", form) for form in choice.forms):]
    if any(form.variant.startswith("wave") for form in choice.forms):
        spread = math.sqrt(0.5 * float(own @ own))
    else:
        spread = profile_of(evidences, choice, [*choices, choice])[1]
    return spread < UNEVEN * evidences.own_profile


def is_wave_of_friction(evidences, choice, choices):
    """Whether a ripple is but friction that waves along the stroke: most of its gain is gone beside such waves of the
    same periods.

    Friction turns round with the direction, and a torque of the motor does not. But where a stage swings on a soft
    drive, the motor is tens of micrometres ahead of it whichever way it goes; over the motor's angle the mean of the
    friction's waves is then the same in both directions.
    """
    if choice.effect != "torque_ripple" or evidences._rows_of("torque", "learn") is None:
        return False
    turn = 2.0 * math.pi * evidences.frame.drive.lever
    for form in (form for form in choice.forms if form.channel == "torque"):
        cycles = np.atleast_1d(sizes_of(evidences, choice, choices, form)[1]["cycles_per_turn"])
        if evidences.kept_beside(choice, choices, waves_form(turn / cycles)) < KEPT:
            return True
    return False


def is_level_of_a_profile(evidences, choice, choices):
    """Whether a change of level is but the other side of friction along the stroke, whose mean grows by it."""
    profile = next((c for c in choices if c.effect == "position_dependent_friction"), None)
    if choice.effect != "friction_level_change" or profile is None:
        return False
    alone, beside = (abs(profile_of(evidences, profile, chosen)[0]) for chosen in (choices, [*choices, choice]))
    return beside > CLEARLY_LESS * alone


def is_flat(evidences, choice, choices):
    """Whether friction along the stroke is but another level of it: then the name says nothing of a place."""
    if choice.effect != "position_dependent_friction":
        return False
    mean, spread = profile_of(evidences, choice, [*choices, choice])
    return spread < FLAT * abs(mean)


def profile_of(evidences, profile, choices):
    """Mean and standard deviation of the friction's factors along the stroke, less one, weighted by how well the
    records tell them; ``profile`` is one of the choices."""
    evidence, keys = evidences.learn["torque"], Evidences._keys("torque", choices)
    beta, _, _ = evidence.fit(keys)
    own, every = evidence.indices(profile.keys("torque")), list(evidence.indices(keys))
    values, weight = beta[[every.index(i) for i in own]], np.diag(evidence.matrix)[own]
    mean = float(values @ weight / weight.sum())
    return mean, float(np.sqrt((values - mean) ** 2 @ weight / weight.sum()))
