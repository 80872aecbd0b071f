"""Sizes of the named effects in the words and units of the catalogue, with standard errors that few baseline runs
widen."""

import math

import numpy as np
from scipy.stats import t as t_distribution

from microstage_ros.diagnosis.result import Parameter

NORMAL_95 = 1.959964      # a reader multiplies a standard error by this; `widening` makes that a 95 % interval


def widening(dof):
    """Factor [1] on a standard error so that ± 1.96 of it is the 95 % interval of Student's law with ``dof`` [1]."""
    return float(t_distribution.ppf(0.975, dof)) / NORMAL_95


def mean_scale(channel, codes):
    """Mean of the channel's scale over conditions, in the unit of the channel."""
    return float(np.mean([channel.scale[c] for c in codes if c in channel.scale]))


def parameters_of(name, parts, beta, covariance, context, shown, reach=1.0):
    """{parameter: `Parameter`} of an effect.

    ``parts``: column names in order; ``beta`` (k,), ``covariance`` (k, k): relative sizes; ``context``: `Context`;
    ``shown``: name of the channel in which the effect shows; ``reach``: rms of the leading column over its coordinates
    [1].

    A force that shows in the following error alone has its size as what it adds to the error (``error_m``): how much
    force that is, only the loop's stiffness tells.
    """
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale, unit = context.scale(shown), context.channels[shown].unit
    first = parts[0]
    b, s = float(beta[0]), float(sigma[0])
    top, stroke = context.top_speed, context.stroke
    place = context.place_unit
    if shown == "error" and (first == "gain" or first.endswith("in error")):
        return {"error_m" if unit == "m" else "error": Parameter(abs(b) * reach * scale, s * reach * scale, unit)}
    if name == "friction_level_change" and first == "dead zone":
        relative = _of_coulomb(b, s, scale, context.coulomb(shown))
        if relative:
            return {"coulomb_factor": Parameter(1.0 + relative[0], relative[1], "1")}
    if name in ("friction_level_change", "amplifier_gain"):
        return {"factor": Parameter(1.0 + b, s, "1")}
    if name == "resistance_rise":
        return {"initial": Parameter(b, s, "1")}
    if name == "viscous_change":
        out = {"coefficient_change": Parameter(b * scale / top, s * scale / top, f"{unit} s/{place}")}
        known = context.viscous(shown)
        if known is not None:
            out = {
                "factor": Parameter(
                    1.0 + b * scale / top / known[0],
                    math.hypot(s * scale / top / known[0], b * scale / top * known[1] / known[0] ** 2),
                    "1",
                ),
                **out,
            }
        return out
    if name == "nonlinear_viscous":
        return {"coefficient": Parameter(b * scale / top**2, s * scale / top**2, f"{unit} s²/{place}²")}
    if name == "direction_asymmetry":
        relative = _of_coulomb(b, s, scale, context.coulomb(shown))
        if relative is None:
            return {"relative_asymmetry": Parameter(b, s, "1")}
        return {"asymmetry": Parameter(relative[0], relative[1], "1")}
    if name in ("gravity_tilt", "amplifier_offset"):
        return {("offset_V" if name == "amplifier_offset" else "force"): Parameter(b * scale, s * scale, unit)}
    if name == "amplifier_deadband":
        return {"half_width_V": Parameter(b * scale, s * scale, unit)}
    if name == "cable_spring":
        factor = 2.0 * scale / stroke
        return {"stiffness": Parameter(b * factor, s * factor, f"{unit}/{place}")}
    if name == "position_dependent_friction":
        if first == "bumps":
            return {"amplitude": _of_bumps(beta, covariance)}
        return {"amplitude": _of_waves(beta, covariance, parts)}
    if name == "torque_ripple" and first == "rough":
        return {"roughness_factor": Parameter(math.exp(b), math.exp(b) * s, "1")}
    if name in ("torque_ripple", "screw_pitch_error"):
        k = int(np.argmax(np.abs(beta)))
        out = {
            ("amplitude_m" if name == "screw_pitch_error" else "amplitude"): Parameter(
                float(beta[k]) * scale, float(sigma[k]) * scale, unit
            )
        }
        order = context.dominant_order()
        return {**out, "cycles_per_turn": Parameter(float(order), 0.0, "1")} if order else out
    if name == "payload_change":
        return _inertia(b, s, scale, context, shown)
    if name == "rising_static_friction":
        return {"rate_per_decade": Parameter(b, s, "1")}
    if name == "backlash":
        out = {"width_m": Parameter(2.0 * b * scale, 2.0 * s * scale, context.place_unit)}
        lead = context.facts.get("lead")
        return (
            {**out, "width_rad": Parameter(4.0 * math.pi * b * scale / lead, 4.0 * math.pi * s * scale / lead, "rad")}
            if lead
            else out
        )
    if name == "transport_delay":
        return {"delay_s": Parameter(b * scale / top, s * scale / top, "s")}
    if name == "actuator_lag":
        sharp = context.top_acceleration
        return {"error_per_acceleration": Parameter(b * scale / sharp, s * scale / sharp, "s²")}
    if name == "scale_error":
        # a reading too long lessens the error
        return {"relative": Parameter(-2.0 * b * scale / stroke, 2.0 * s * scale / stroke, "1")}
    if name in ("floor_vibration", "sampling_jitter"):
        return {"roughness_factor": Parameter(math.exp(b), math.exp(b) * s, "1")}
    if name == "presliding_creep":
        # on in the direction of motion lessens the error
        return {"amplitude_m": Parameter(-b * scale, s * scale, unit)}
    return {"relative_change": Parameter(b, s, "1")}


def _of_coulomb(b, s, scale, coulomb):
    """(value, stderr) of a size relative to the Coulomb level instead of the channel's scale, or None if that is
    unknown."""
    if coulomb is None:
        return None
    value = b * scale / coulomb[0]
    return value, math.hypot(s * scale / coulomb[0], value * coulomb[1] / coulomb[0])


def _inertia(b, s, scale, context, shown):
    sharp = context.top_acceleration
    out = {
        f"{shown}_per_acceleration": Parameter(
            b * scale / sharp, s * scale / sharp, f"{context.channels[shown].unit} s²/{context.place_unit}"
        )
    }
    own = context.inertia(shown) if shown == "effort" else None
    if own:
        factor = b * scale / sharp / own
        out = {"inertia_factor": Parameter(1.0 + factor, s * scale / sharp / abs(own), "1"), **out}
        if "mass" in context.facts:
            mass = context.facts["mass"]
            out = {"mass_kg": Parameter(mass * factor, mass * s * scale / sharp / abs(own), "kg"), **out}
    return out


def _of_waves(beta, covariance, parts):
    """Half the range of the friction's change along the stroke, and its standard error (linearised)."""
    count = len(beta) // (2 if parts.count("waves") > 1 else 1)
    waves = beta[:count]
    u = np.linspace(0.0, 1.0, 101)
    shapes = np.stack([np.cos(np.pi * k * u) for k in range(1, count + 1)], axis=1)
    curve = shapes @ waves
    slope = 0.5 * (shapes[np.argmax(curve)] - shapes[np.argmin(curve)])
    sigma = float(np.sqrt(max(slope @ covariance[:count, :count] @ slope, 0.0)))
    return Parameter(float(0.5 * np.ptp(curve)), sigma, "1")


def _of_bumps(beta, covariance):
    """Half the range over the support points, and its standard error."""
    high, low = int(np.argmax(beta)), int(np.argmin(beta))
    variance = covariance[high, high] + covariance[low, low] - 2.0 * covariance[high, low]
    return Parameter(float(0.5 * np.ptp(beta)), float(0.5 * np.sqrt(max(variance, 0.0))), "1")
