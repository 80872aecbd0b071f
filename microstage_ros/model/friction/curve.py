"""The sliding curve of each direction, the head of every law's packed parameters, and exact relaxation.

A packed law is one flat float64 array. Its first ``OWN`` entries are the same for all laws, five for
each direction of motion; the law's own parameters follow:

    [static, coulomb, stribeck_velocity, stribeck_exponent, viscous]  for velocity > 0
    [static, coulomb, stribeck_velocity, stribeck_exponent, viscous]  for velocity < 0
    [the law's own ...]
"""

import math

import numpy

from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec, not_negative, positive

STATIC, COULOMB, STRIBECK_VELOCITY, STRIBECK_EXPONENT, VISCOUS = range(5)
DIRECTION_WIDTH = 5
OWN = 2 * DIRECTION_WIDTH


#: The sliding curve's parameters, at the screw angle; ``coulomb`` None: the same as ``static``, no drop.
SLIDING = {
    "static": positive("N m", "F_s, limit at the start of sliding"),
    "coulomb": positive("N m", "F_C, limit in fast sliding, at most F_s"),
    "stribeck_velocity": positive("rad/s", "V_S, Stribeck velocity"),
    "stribeck_exponent": Spec("1", 0.1, 5.0, "δ, shape of the drop"),
    "viscous": not_negative("N m s/rad", "σ, added to the friction outside every limit", default=0.0),
}
LIMIT = ("static", "viscous")      # what a law without a Stribeck drop has of them
STRIBECK = tuple(SLIDING)


def stribeck_curve(speed, static, coulomb, velocity, exponent):
    """|s(w)| = F_C + (F_s − F_C) exp(−|w/V_S|^δ) (paper Eq. 2) [F], same shape as ``speed`` [q/s].

    ``static`` F_s and ``coulomb`` F_C [F], Stribeck ``velocity`` V_S [q/s], ``exponent`` δ [1].
    """
    return coulomb + (static - coulomb) * numpy.exp(-((numpy.abs(speed) / velocity) ** exponent))


def stribeck_slope(speed, static, coulomb, velocity, exponent):
    """d|s|/d|w| of `stribeck_curve` at one ``speed`` >= 0 [F s/q]; at rest, where δ < 1 has none, that at V_S / 10⁹.

    ``static`` and ``coulomb`` [F], ``velocity`` V_S [q/s], ``exponent`` δ [1] as there.
    """
    ratio = max(speed / velocity, 1e-9)
    return -(static - coulomb) * exponent / velocity * ratio ** (exponent - 1) * math.exp(-(ratio**exponent))


def pack_curve(values):
    """The five entries of one direction: [static, coulomb, stribeck_velocity, stribeck_exponent, viscous].

    Parameters
    ----------
    values : {name: number in the unit of its spec} of `SLIDING`; ``static`` is required, ``coulomb``
        at most ``static`` and the same where it is missing; a missing Stribeck velocity or exponent is 1, a missing
        viscous part 0.

    Raises
    ------
    InputError : a number missing or out of range.
    """
    if values.get("static") is None:
        raise InputError("static", None, SLIDING["static"].expected)
    usual = {"coulomb": values["static"], "stribeck_velocity": 1.0, "stribeck_exponent": 1.0, "viscous": 0.0}
    given = {**usual, **{name: value for name, value in values.items() if value is not None}}
    static, coulomb, *rest = (spec.check(given[name], name) for name, spec in SLIDING.items())
    if coulomb > static:
        raise InputError("coulomb", coulomb, f"at most the static limit, {static!r}")
    return [static, coulomb, *rest]


@compiled(makes_arrays=False)
def sliding_limit(parameters, direction, speed, limit_factor):
    """|s| of the sliding curve [F] for motion in ``direction`` (its sign) at ``speed`` >= 0 [q/s].

    ``limit_factor`` [1] multiplies the curve: random or position-dependent friction.
    """
    head = 0 if direction >= 0.0 else DIRECTION_WIDTH
    static = parameters[head + STATIC]
    coulomb = parameters[head + COULOMB]
    if static == coulomb:
        return limit_factor * static
    if speed == 0.0:    # the power and the exponential take longer than all the rest; the same to the last bit
        return limit_factor * (coulomb + (static - coulomb))
    ratio = speed / parameters[head + STRIBECK_VELOCITY]
    drop = (static - coulomb) * math.exp(-(ratio ** parameters[head + STRIBECK_EXPONENT]))
    return limit_factor * (coulomb + drop)


@compiled(makes_arrays=False)
def viscous_force(parameters, velocity):
    """Viscous part σ(sgn w) w [F] of the sliding curve at ``velocity`` [q/s]."""
    head = 0 if velocity >= 0.0 else DIRECTION_WIDTH
    return parameters[head + VISCOUS] * velocity


@compiled
def relax(value, target_start, target_end, exponent):
    """Solve dy/dτ = target(τ) − y over τ = 0 … ``exponent`` for a target that moves linearly in τ.

    y(Λ) = g₁ + (y₀ − g₀) e^(−Λ) − (g₁ − g₀) (1 − e^(−Λ)) / Λ

    The weights of y₀, g₀ and g₁ are never negative and add up to one, so the result lies between
    them whatever the step: this is why the laws stay bounded at any step and velocity.
    """
    if exponent < 1e-9:
        return value + (target_start - value) * exponent
    decay = -math.expm1(-exponent)  # 1 − e^(−Λ), accurate for small Λ
    return target_end + (value - target_start) * (1.0 - decay) - (target_end - target_start) * decay / exponent


@compiled
def passive_damping(damping, limit, speed, share):
    """Micro-damping σ₁ that keeps a bristle law passive: min(σ₁, share · |s| / |w|) [F s/q].

    With σ₁ constant a bristle law returns more energy than it stored once σ₁ |w| > 4 |s| (N. Barahona
    and C. Canudas de Wit, "Passivity of the LuGre model revisited", Automatica 2003, give the condition
    on the viscous damping instead). The cap acts only at speeds above that and never in steady sliding.
    """
    ceiling = share * limit
    return damping if damping * speed <= ceiling else ceiling / speed
