"""The sizes of what was selected: parameters with their standard errors, the error of the form itself among them."""

import dataclasses
import math

from microstage_ros.diagnosis.residuals.evidence_set import Evidences
from microstage_ros.diagnosis.result import Parameter

#: Standard errors of a channel, by what simulated cases show beyond the noise model (random friction is no
#: exact sum of two processes, and is clipped).
CAUTION = {"torque": 2.0}
#: Share of a size that is not known because the form itself is not (a grid of shapes, a soft flank, a noisy input);
#: where an effect shows in several channels, the share differs by channel; calibrated by: microstage campaign
#: --form-errors (`validation.form_errors`), of several sizes of an effect the largest; a gap too narrow to be found
#: first and a profile of many sizes by campaigns of their own (--world second --kind single --seed 17001, with --effect
#: position_dependent_friction --cases 8, and with --effect backlash --cases 6 --strength 0.02 and 0.1)
FORM_ERROR = {
    "resistance_rise": 0.15,                     # 0.10 to 0.20
    "thermal_drift": 0.045,                      # 0.016 to 0.045
    "nonlinear_viscous": 0.16,                   # 0.019 to 0.16
    "rising_static_friction": 0.39,              # 0.27 to 0.60
    "presliding_creep": 0.3,                     # 0.18 to 0.36
    "frictional_lag": 0.09,                      # 0.067 to 0.13
    "friction_level_change": 0.037,              # 0.0012 to 0.037
    "cable_spring": 0.035,                       # 0.0033 to 0.035
    "direction_asymmetry": 0.03,                 # 0.0017 to 0.030
    "viscous_change": 0.011,                     # 0.0039 to 0.011
    "refractive_index": 0.0074,                  # 0.0057 to 0.010
    "backlash": 0.08,                            # 0.0001 to 0.11
    "position_dependent_friction": 0.12,         # 0.014 to 0.13
    ("drive_compliance", "resonance"): 0.06,     # 0.020 to 0.058
    ("drive_compliance", "windup"): 0.03,        # inside the same
    # friction that varies at random moves the resonance's and the torque's, mostly to less mass; calibrated by:
    # test/diagnosis/cases/plain_programmes.py --kind single --effect payload_change --no-baseline --by-channel
    ("payload_change", "resonance"): 0.12,       # off by −0.26 to −0.022, −0.098 in the median (seed 9951, both laws)
    ("payload_change", "windup"): 0.035,         # −0.087 to 0.061
    ("payload_change", "torque"): 0.12,          # −0.21 to 0.088
}
# of all others; calibrated by: the same (0.0029 to 0.0066 of late readings, 0.0008 to 0.0067 of an encoder's second
# amplitude, up to 0.0041 of all others, which are not stated better than these)
LEAST_FORM_ERROR = 0.005
# of the stage's mass that is left whatever is taken off it; source: `model.effects.drive.PayloadChange`
LEAST_MASS_SHARE = 0.05


def form_error(effect, channel=None):
    """`FORM_ERROR` of an effect, in a channel."""
    return FORM_ERROR.get((effect, channel), FORM_ERROR.get(effect, LEAST_FORM_ERROR))


def width(evidences, channel, form):
    """Number of sizes of a form [1]."""
    where = evidences.learn[channel].where[form.key]
    return where.stop - where.start


def sizes_of(evidences, choice, others, form):
    """(parameters, effect) of one form fitted beside the other choices on the learning records.

    A standard error holds the noise, as the model has it, and the error of the form.
    """
    beta, covariance, keys = _fitted(evidences, choice, others, form)
    parameters, effect = form.sizes(beta, covariance, evidences.frame)
    return _with_form_error(parameters, form), effect


def stated_sizes(evidences, choice, others, form):
    """`sizes_of` as they are stated: the noise is also how stretches of the records disagree, whichever is larger.

    What another friction law leaves is no noise of the model, and moves a size by many of the noise's standard errors.
    """
    beta, covariance, keys = _fitted(evidences, choice, others, form)
    parameters, effect = form.sizes(beta, covariance, evidences.frame)
    scattered = evidences.scattered_covariance(form.channel, keys)
    if scattered is not None:
        scattered = form.sizes(beta, scattered[-len(beta):, -len(beta):], evidences.frame)[0]
        parameters = {name: (value, max(stderr, scattered[name][1]), unit)
                      for name, (value, stderr, unit) in parameters.items()}
    return _with_form_error(parameters, form), effect


def pooled(sizes):
    """`Parameter` that several channels tell, ``sizes`` (a list of `Parameter`): their mean weighted by the inverse
    variances, with a standard error that grows as they disagree, by the Birge ratio √(χ²/(n − 1)), and is no smaller
    than the least of theirs, which may share what they err by. Source: R. T. Birge, The calculation of errors by the
    method of least squares, Phys. Rev. 40 (1932) 207."""
    if len(sizes) == 1:
        return sizes[0]
    weights = [1.0 / size.stderr**2 for size in sizes]
    mean = sum(weight * size.value for weight, size in zip(weights, sizes)) / sum(weights)
    spread = sum(weight * (size.value - mean) ** 2 for weight, size in zip(weights, sizes)) / (len(sizes) - 1)
    stderr = math.sqrt(max(spread, 1.0) / sum(weights))
    return dataclasses.replace(sizes[0], value=mean, stderr=max(stderr, min(size.stderr for size in sizes)))


def with_rattled_mass(causes, mass, stderr):
    """These `Cause` with the ``mass`` [kg] of a payload that a rattle in a gap tells, and its ``stderr`` [kg].

    Stiffness over mass comes from the hits themselves; the torque balance, in which every hit leaves some friction, is
    off by more than its error.
    """
    rattled = {"parameters": {"mass_kg": Parameter(mass, stderr, "kg")}, "effect": {"mass_kg": mass}}
    return [dataclasses.replace(c, **rattled) if c.id == "payload_change" else c for c in causes]


def effect_of(evidences, choices, effect):
    """Entry of the ``effects`` section of the first form of one ``effect`` among the ``choices``; None if it is
    not."""
    choice = next((c for c in choices if c.effect == effect), None)
    return None if choice is None else sizes_of(evidences, choice, choices, choice.forms[0])[1]


def offset_of(evidences, choices):
    """The amplifier's offset [V] at its input, of `Choice`s fitted by ``evidences`` together; 0 where none was
    chosen."""
    if all(c.effect != "amplifier_offset" for c in choices):
        return 0.0
    sizes = evidences.learn["windup"].sizes(Evidences._keys("windup", choices))
    gain = 1.0 + sum(float(value[0]) for (effect, _), value in sizes.items() if effect == "amplifier_gain")
    return float(sizes["amplifier_offset", ""][0]) / gain


def before_the_gain(causes):
    """The causes with offset and dead band of an amplifier as they are at its input, u_a = gain · dead(u + offset), and
    not behind its gain, where they were found."""
    gain = next((c.parameters["factor"].value for c in causes if c.id == "amplifier_gain"), 1.0)
    names = {"amplifier_offset": "offset_V", "amplifier_deadband": "half_width_V"}
    changed = []
    for cause in causes:
        name = names.get(cause.id)
        if name is not None and gain != 1.0:
            found = cause.parameters[name]
            before = dataclasses.replace(found, value=found.value / gain, stderr=found.stderr / gain)
            cause = dataclasses.replace(cause, parameters={**cause.parameters, name: before},
                                        effect={**cause.effect, name: cause.effect[name] / gain})
        changed.append(cause)
    return changed


def with_payload(causes, mass):
    """These `Cause` with a tilt's angle, and a drive train's factors, for the stage of ``mass`` m [kg] and the payload
    M named beside them.

    The force that was fitted is (m + M) g sin α, and stiffness and damping over mass are K/(m + M) and D/(m + M); the
    uncertainty of M is one of the angle and of the factors, too.
    """
    payload = next((c.parameters["mass_kg"] for c in causes if c.id == "payload_change"), None)
    if payload is None:
        return list(causes)
    whole = max(mass + payload.value, LEAST_MASS_SHARE * mass)
    change = {"gravity_tilt": _pulled, "drive_compliance": _stiffened}
    return [change[c.id](c, whole / mass, payload.stderr / whole) if c.id in change else c for c in causes]


def _pulled(tilt, ratio, share):
    """A ``tilt`` of a stage of ``ratio`` times the mass, known to a ``share``."""
    angle = tilt.parameters["angle_rad"]
    value = math.asin(max(min(math.sin(angle.value) / ratio, 1.0), -1.0))
    stderr = math.hypot(angle.stderr / ratio, value * share)
    return dataclasses.replace(tilt, parameters={"angle_rad": dataclasses.replace(angle, value=value, stderr=stderr)},
                               effect={**tilt.effect, "angle_rad": value})


def _stiffened(drive, ratio, share):
    """A ``drive`` train behind a stage of ``ratio`` times the mass, known to a ``share``."""
    parameters = {
        name: dataclasses.replace(p, value=ratio * p.value, stderr=ratio * math.hypot(p.stderr, share * p.value))
        for name, p in drive.parameters.items()
    }
    effect = {name: ratio * value if name in parameters else value for name, value in drive.effect.items()}
    return dataclasses.replace(drive, parameters=parameters, effect=effect)


def _fitted(evidences, choice, others, form):
    """Sizes (n,) of a form beside the other choices, their covariance (n, n) by the noise model, and all keys."""
    keys = Evidences._keys(form.channel, [c for c in others if c.effect != choice.effect])
    beta, covariance, _ = evidences.learn[form.channel].fit([*keys, form.key])
    n = width(evidences, form.channel, form)
    scale = evidences.scatter[form.channel] * CAUTION.get(form.channel, 1.0) ** 2
    return beta[-n:], covariance[-n:, -n:] * scale, [*keys, form.key]


def _with_form_error(parameters, form):
    """The error of the form added, a share of what was added: a factor is one plus its size."""
    share = form_error(form.effect, form.channel)
    return {name: (value, math.hypot(stderr, share * abs(value - (name == "factor"))), unit)
            for name, (value, stderr, unit) in parameters.items()}
