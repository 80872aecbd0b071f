"""Dahl's law: one elasto-plastic state, friction as a function of displacement only.

    dF/dx = k (1 − sgn(w) F / F_C)^i,     F_C: the Coulomb limit of the direction of motion

With u = 1 − sgn(w) F / F_C this is du/dq = −(k / F_C) u^i, solved in closed form over any distance q:
u = u₀ e^(−kq/F_C) for i = 1, else u^(1−i) = u₀^(1−i) + (i − 1) k q / F_C. The sliding limit has no
Stribeck drop. Source: P. R. Dahl, "A solid friction model", Aerospace Corporation TOR-0158(3107-18)-1
(1968).
"""

import dataclasses
import math

from microstage_ros.model.friction.curve import COULOMB, DIRECTION_WIDTH, OWN, require_positive
from microstage_ros.numerics.compiled import compiled

TITLE = "Dahl"
STIFFNESS, EXPONENT = OWN, OWN + 1


@dataclasses.dataclass(frozen=True)
class Parameters:
    """Own parameters of Dahl's law.

    Parameters
    ----------
    stiffness : k, slope dF/dx at F = 0 [F/q].
    exponent : i, shape of the approach to the limit [1].
    """

    stiffness: float
    exponent: float = 1.0

    def __post_init__(self):
        require_positive("stiffness", self.stiffness)
        require_positive("exponent", self.exponent)

    def pack(self):
        """Own entries of the packed law."""
        return [self.stiffness, self.exponent]


def state_size(packed):
    """Entries of the state: the force F."""
    return 1


@compiled
def stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor):
    """Force without its viscous part at the end of a stretch of motion in one direction."""
    distance = 0.5 * (speed_start + speed_end) * duration
    if distance > 0.0:
        limit = limit_factor * parameters[COULOMB if direction > 0.0 else DIRECTION_WIDTH + COULOMB]
        exponent = parameters[EXPONENT]
        u = max(1.0 - direction * state[0] / limit, 0.0)  # below 0 only if the limit has just fallen
        reach = parameters[STIFFNESS] * distance / limit
        if exponent == 1.0:
            u *= math.exp(-reach)
        elif u > 0.0:
            power = u ** (1.0 - exponent) + (exponent - 1.0) * reach
            u = power ** (1.0 / (1.0 - exponent)) if power > 0.0 else 0.0
        state[0] = direction * limit * (1.0 - u)
    return state[0]


def stored_energy(parameters, state):
    """Elastic energy F² / 2k [F q]."""
    return float(state[0] ** 2 / (2.0 * parameters[STIFFNESS]))
