"""The sliding curve of each direction, the head of every law's packed parameters, and exact relaxation.

A packed law is one flat float64 array. Its first ``OWN`` entries are the same for all laws, five for
each direction of motion; the law's own parameters follow:

    [static, coulomb, stribeck_velocity, stribeck_exponent, viscous]  for velocity > 0
    [static, coulomb, stribeck_velocity, stribeck_exponent, viscous]  for velocity < 0
    [the law's own ...]
"""

import dataclasses
import math
import numbers

from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.errors import InputError

STATIC, COULOMB, STRIBECK_VELOCITY, STRIBECK_EXPONENT, VISCOUS = range(5)
DIRECTION_WIDTH = 5
OWN = 2 * DIRECTION_WIDTH


@dataclasses.dataclass(frozen=True)
class SlidingCurve:
    """Friction of steady sliding in one direction (paper Eq. 2, and the viscous part of Eq. 8).

    |s(w)| = coulomb + (static − coulomb) exp(−|w / stribeck_velocity|^stribeck_exponent)

    Units: F is the law's force (N, or N m at a shaft), q its displacement (m or rad).

    Parameters
    ----------
    static : limit at the start of sliding [F], > 0.
    coulomb : limit in fast sliding [F], 0 < coulomb <= static; None: the same as static (no drop).
    stribeck_velocity : [q/s], > 0.
    stribeck_exponent : shape of the drop [1], > 0.
    viscous : added to the friction outside every limit [F s/q], >= 0.
    """

    static: float
    coulomb: float | None = None
    stribeck_velocity: float = 1.0
    stribeck_exponent: float = 1.0
    viscous: float = 0.0

    def __post_init__(self):
        if self.coulomb is None:
            object.__setattr__(self, "coulomb", self.static)
        for name in ("static", "coulomb", "stribeck_velocity", "stribeck_exponent"):
            require_positive(name, getattr(self, name))
        require_not_negative("viscous", self.viscous)
        if self.coulomb > self.static:
            raise InputError("coulomb", self.coulomb, f"at most the static limit, {self.static!r}")

    def pack(self):
        """The five entries of one direction, as a list."""
        return [float(getattr(self, field.name)) for field in dataclasses.fields(self)]


def require_positive(name, value):
    """Refuse anything but a finite number above zero, naming the parameter (InputError)."""
    if not (isinstance(value, numbers.Real) and math.isfinite(value) and value > 0.0):
        raise InputError(name, value, "a finite number > 0")


def require_not_negative(name, value):
    """Refuse anything but a finite number of at least zero, naming the parameter (InputError)."""
    if not (isinstance(value, numbers.Real) and math.isfinite(value) and value >= 0.0):
        raise InputError(name, value, "a finite number >= 0")


@compiled
def sliding_limit(parameters, direction, speed, limit_factor):
    """|s| of the sliding curve [F] for motion in ``direction`` (its sign) at ``speed`` >= 0 [q/s].

    ``limit_factor`` [1] multiplies the curve: random or position-dependent friction.
    """
    head = 0 if direction >= 0.0 else DIRECTION_WIDTH
    static = parameters[head + STATIC]
    coulomb = parameters[head + COULOMB]
    if static == coulomb:
        return limit_factor * static
    ratio = speed / parameters[head + STRIBECK_VELOCITY]
    drop = (static - coulomb) * math.exp(-(ratio ** parameters[head + STRIBECK_EXPONENT]))
    return limit_factor * (coulomb + drop)


@compiled
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
