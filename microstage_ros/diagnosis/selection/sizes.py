"""The sizes of what was selected: parameters with their standard errors, the error of the form itself among them."""

import math

from microstage_ros.diagnosis.residuals.evidence_set import Evidences

#: Standard errors of a channel, by what simulated cases show beyond the noise model (random friction is no
#: exact sum of two processes, and is clipped).
CAUTION = {"torque": 2.0}
#: Share of a size that is not known because the form itself is not (a grid of shapes, a soft flank, a noisy input);
#: where an effect shows in several channels, the share differs by channel.
FORM_ERROR = {
    "backlash": 0.08, "resistance_rise": 0.15, "thermal_drift": 0.05, "nonlinear_viscous": 0.2,
    "rising_static_friction": 0.25, "presliding_creep": 0.3, "frictional_lag": 0.05, "friction_level_change": 0.1,
    "cable_spring": 0.08, "position_dependent_friction": 0.12, "direction_asymmetry": 0.05, "viscous_change": 0.05,
    ("drive_compliance", "resonance"): 0.08, ("drive_compliance", "windup"): 0.03,
    ("payload_change", "resonance"): 0.1, ("payload_change", "windup"): 0.1, ("payload_change", "torque"): 0.05,
}


def form_error(effect, channel=None):
    """`FORM_ERROR` of an effect, in a channel."""
    return FORM_ERROR.get((effect, channel), FORM_ERROR.get(effect, 0.005))


def width(evidences, channel, form):
    """Number of sizes of a form [1]."""
    where = evidences.learn[channel].where[form.key]
    return where.stop - where.start


def sizes_of(evidences, choice, others, form):
    """(parameters, effect) of one form fitted beside the other choices on the learning records."""
    evidence = evidences.learn[form.channel]
    keys = Evidences._keys(form.channel, [c for c in others if c.effect != choice.effect])
    beta, covariance, _ = evidence.fit([*keys, form.key])
    n = width(evidences, form.channel, form)
    scale = evidences.scatter[form.channel] * CAUTION.get(form.channel, 1.0) ** 2
    parameters, effect = form.sizes(beta[-n:], covariance[-n:, -n:] * scale, evidences.frame)
    share = form_error(form.effect, form.channel)
    # a factor is one plus its size: the error of the form is a share of what was added
    return {name: (value, math.hypot(stderr, share * abs(value - (name == "factor"))), unit)
            for name, (value, stderr, unit) in parameters.items()}, effect
