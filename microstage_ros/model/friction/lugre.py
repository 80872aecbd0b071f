"""LuGre: bristles whose mean deflection z follows the sliding curve.

    dz/dt = w − σ₀ |w| z / |s(w)|,     F = σ₀ z + σ₁ dz/dt + σ w

The state kept is the bristle force σ₀ z. Along the way q of a stretch it relaxes onto sgn(w) |s| with
the exponent σ₀ ∫ dq / |s|, which is exact for a constant curve and second order otherwise. σ₁ is
capped where it would make the law return energy it never stored
(:func:`~microstage_ros.model.friction.curve.passive_damping`). Sources: C. Canudas de Wit, H. Olsson,
K. J. Åström, P. Lischinsky, "A new model for control of systems with friction", IEEE Transactions on
Automatic Control 40 (1995).
"""

import dataclasses

from microstage_ros.model.friction.curve import (
    OWN,
    passive_damping,
    relax,
    require_not_negative,
    require_positive,
    sliding_limit,
)
from microstage_ros.numerics.compiled import compiled

TITLE = "LuGre"
STIFFNESS, DAMPING = OWN, OWN + 1


@dataclasses.dataclass(frozen=True)
class Parameters:
    """Own parameters of LuGre.

    Parameters
    ----------
    stiffness : σ₀ of the bristles [F/q].
    damping : σ₁, micro-damping [F s/q], >= 0.
    """

    stiffness: float
    damping: float = 0.0

    def __post_init__(self):
        require_positive("stiffness", self.stiffness)
        require_not_negative("damping", self.damping)

    def pack(self):
        """Own entries of the packed law."""
        return [self.stiffness, self.damping]


def state_size(packed):
    """Entries of the state: the bristle force σ₀ z."""
    return 1


@compiled
def stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor):
    """Force without its viscous part at the end of a stretch of motion in one direction."""
    if direction == 0.0:
        return state[0]
    s_start = sliding_limit(parameters, direction, speed_start, limit_factor)
    s_end = sliding_limit(parameters, direction, speed_end, limit_factor)
    reach = 0.5 * parameters[STIFFNESS] * duration * (speed_start / s_start + speed_end / s_end)
    bristle = relax(direction * state[0], s_start, s_end, reach)
    state[0] = direction * bristle
    damping = passive_damping(parameters[DAMPING], s_end, speed_end, 4.0)
    return direction * (bristle + damping * speed_end * (1.0 - bristle / s_end))


def stored_energy(parameters, state):
    """Elastic energy (σ₀ z)² / 2σ₀ [F q]."""
    return float(state[0] ** 2 / (2.0 * parameters[STIFFNESS]))
