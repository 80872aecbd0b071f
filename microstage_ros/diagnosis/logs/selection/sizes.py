"""Sizes of the named effects in the words and units of the catalogue, with standard errors that few baseline runs
widen."""

import dataclasses
import functools
import math

import numpy as np
from scipy.stats import t as t_distribution

from microstage_ros.diagnosis.logs.selection.context import Context
from microstage_ros.diagnosis.result import Parameter

NORMAL_95 = 1.959964      # a reader multiplies a standard error by this; `widening` makes that a 95 % interval


def widening(dof):
    """Factor [1] on a standard error so that ± 1.96 of it is the 95 % interval of Student's law with ``dof`` [1]."""
    return float(t_distribution.ppf(0.975, dof)) / NORMAL_95


@dataclasses.dataclass(frozen=True)
class Fitted:
    """The columns of one effect with their relative sizes, and what gives these a unit.

    ``parts``: column names in order; ``beta`` (k,), ``covariance`` (k, k): relative sizes; ``context``: `Context`;
    ``shown``: name of the channel in which the effect shows; ``reach``: rms of the leading column over its coordinates
    [1].
    """

    parts: list
    beta: np.ndarray
    covariance: np.ndarray
    context: Context
    shown: str
    reach: float = 1.0

    @functools.cached_property
    def sigma(self):
        """Standard errors of the relative sizes (k,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @functools.cached_property
    def scale(self):
        """Scale of the channel, in its unit."""
        return self.context.scale(self.shown)

    @property
    def unit(self):
        """Unit of the channel."""
        return self.context.channels[self.shown].unit

    def times(self, factor, unit, k=0, beside=0.0):
        """`Parameter` beside + factor × size number ``k``, in ``unit``."""
        value, error = float(self.beta[k]), float(self.sigma[k])
        return Parameter(beside + value * factor, error * abs(factor), unit)

    def of_coulomb(self, beside=0.0):
        """`Parameter` beside + the leading size relative to the Coulomb level in place of the channel's scale, or None
        if that is unknown."""
        level = self.context.coulomb(self.shown)
        if level is None:
            return None
        value, error = float(self.beta[0]) * self.scale / level[0], float(self.sigma[0]) * self.scale / level[0]
        return Parameter(beside + value, math.hypot(error, value * level[1] / level[0]), "1")


def parameters_of(name, fitted: Fitted):
    """{parameter: `Parameter`} of the effect ``name`` from its `Fitted` columns.

    A force that shows in the following error alone has its size as what it adds to the error (``error_m``): how much
    force that is, only the loop's stiffness tells.
    """
    first = fitted.parts[0]
    if fitted.shown == "error" and (first == "gain" or first.endswith("in error")):
        added = fitted.times(fitted.reach * fitted.scale, fitted.unit)
        return {"error_m" if fitted.unit == "m" else "error": dataclasses.replace(added, value=abs(added.value))}
    return SIZES[name](fitted) if name in SIZES else {"relative_change": fitted.times(1.0, "1")}


def _factor(fitted):
    return {"factor": fitted.times(1.0, "1", beside=1.0)}


def _gain(fitted):
    """A weaker amplifier is asked for more: what is asked for, over what it was, is 1/factor."""
    asked = fitted.times(1.0, "1", beside=1.0)
    return {"factor": Parameter(1.0 / asked.value, asked.stderr / asked.value**2, "1")}


def _offset(fitted):
    """What an amplifier adds by itself is not asked for."""
    added = fitted.times(fitted.scale, fitted.unit)
    return {"offset_V": dataclasses.replace(added, value=-added.value)}


def _level(fitted):
    relative = fitted.of_coulomb(beside=1.0) if fitted.parts[0] == "dead zone" else None
    return {"coulomb_factor": relative} if relative else _factor(fitted)


def _asymmetry(fitted):
    relative = fitted.of_coulomb()
    return {"asymmetry": relative} if relative else {"relative_asymmetry": fitted.times(1.0, "1")}


def _viscous(fitted):
    context = fitted.context
    change = fitted.times(fitted.scale / context.top_speed, f"{fitted.unit} s/{context.place_unit}")
    known = context.viscous(fitted.shown)
    if known is None:
        return {"coefficient_change": change}
    error = math.hypot(change.stderr / known[0], change.value * known[1] / known[0] ** 2)
    return {"factor": Parameter(1.0 + change.value / known[0], error, "1"), "coefficient_change": change}


def _quadratic(fitted):
    context = fitted.context
    unit = f"{fitted.unit} s²/{context.place_unit}²"
    return {"coefficient": fitted.times(fitted.scale / context.top_speed**2, unit)}


def _in_unit_of_channel(parameter):
    """Function of `Fitted` that gives one ``parameter`` in the unit of the channel."""
    return lambda fitted: {parameter: fitted.times(fitted.scale, fitted.unit)}


def _relative(parameter):
    """Function of `Fitted` that gives one pure number."""
    return lambda fitted: {parameter: fitted.times(1.0, "1")}


def _spring(fitted):
    context = fitted.context
    return {"stiffness": fitted.times(2.0 * fitted.scale / context.stroke, f"{fitted.unit}/{context.place_unit}")}


def _along_the_stroke(fitted):
    if fitted.parts[0] == "bumps":
        return {"amplitude": _of_bumps(fitted.beta, fitted.covariance)}
    return {"amplitude": _of_waves(fitted.beta, fitted.covariance, fitted.parts)}


def _roughness(fitted):
    factor = math.exp(float(fitted.beta[0]))
    return {"roughness_factor": Parameter(factor, factor * float(fitted.sigma[0]), "1")}


def _of_turns(parameter):
    """Function of `Fitted` for what repeats with the turn: the largest amplitude, as ``parameter``, and its order."""
    def sizes(fitted):
        if fitted.parts[0] == "rough":
            return _roughness(fitted)
        order = fitted.context.dominant_order()
        largest = fitted.times(fitted.scale, fitted.unit, int(np.argmax(np.abs(fitted.beta))))
        return {parameter: largest, **({"cycles_per_turn": Parameter(float(order), 0.0, "1")} if order else {})}

    return sizes


def _payload(fitted):
    context, b, s = fitted.context, float(fitted.beta[0]), float(fitted.sigma[0])
    per_acceleration = fitted.scale / context.top_acceleration
    unit = f"{fitted.unit} s²/{context.place_unit}"
    out = {f"{fitted.shown}_per_acceleration": fitted.times(per_acceleration, unit)}
    own = context.inertia(fitted.shown) if fitted.shown == "effort" else None
    if not own:
        return out
    change, error = b * per_acceleration / own, s * per_acceleration / abs(own)
    out = {"inertia_factor": Parameter(1.0 + change, error, "1"), **out}
    if "mass" not in context.facts:
        return out
    mass = context.facts["mass"]
    return {"mass_kg": Parameter(mass * change, mass * error, "kg"), **out}


def _lost_motion(fitted):
    out = {"width_m": fitted.times(2.0 * fitted.scale, fitted.context.place_unit)}
    lead = fitted.context.facts.get("lead")
    return {**out, "width_rad": fitted.times(4.0 * math.pi * fitted.scale / lead, "rad")} if lead else out


def _delay(fitted):
    return {"delay_s": fitted.times(fitted.scale / fitted.context.top_speed, "s")}


def _lag(fitted):
    return {"error_per_acceleration": fitted.times(fitted.scale / fitted.context.top_acceleration, "s²")}


def _scale(fitted):
    # a reading too short adds to the error
    return {"relative": fitted.times(2.0 * fitted.scale / fitted.context.stroke, "1")}


def _creep(fitted):
    # on in the direction of motion lessens the error
    return {"amplitude_m": fitted.times(-fitted.scale, fitted.unit)}


#: Effect to the function of `Fitted` that gives its parameters in the words of the catalogue.
SIZES = {
    "friction_level_change": _level,
    "amplifier_gain": _gain,
    "resistance_rise": _relative("initial"),
    "viscous_change": _viscous,
    "nonlinear_viscous": _quadratic,
    "direction_asymmetry": _asymmetry,
    "gravity_tilt": _in_unit_of_channel("force"),
    "amplifier_offset": _offset,
    "amplifier_deadband": _in_unit_of_channel("half_width_V"),
    "cable_spring": _spring,
    "position_dependent_friction": _along_the_stroke,
    "torque_ripple": _of_turns("amplitude"),
    "screw_pitch_error": _of_turns("amplitude_m"),
    "payload_change": _payload,
    "rising_static_friction": _relative("rate_per_decade"),
    "backlash": _lost_motion,
    "transport_delay": _delay,
    "actuator_lag": _lag,
    "scale_error": _scale,
    "floor_vibration": _roughness,
    "sampling_jitter": _roughness,
    "presliding_creep": _creep,
}


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
