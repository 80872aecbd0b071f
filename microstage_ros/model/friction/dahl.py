"""Dahl's law: one elasto-plastic state, friction as a function of displacement only.

    dF/dx = k (1 − sgn(w) F / F_C)^i,     F_C: the Coulomb limit of the direction of motion

With u = 1 − sgn(w) F / F_C this is du/dq = −(k / F_C) u^i, solved in closed form over any distance q:
u = u₀ e^(−kq/F_C) for i = 1, else u^(1−i) = u₀^(1−i) + (i − 1) k q / F_C. The sliding limit has no
Stribeck drop. Source: P. R. Dahl, "A solid friction model", Aerospace Corporation TOR-0158(3107-18)-1
(1968).
"""

import math

from microstage_ros.model.friction.curve import COULOMB, DIRECTION_WIDTH, LIMIT, OWN
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.spec import positive

TITLE = "Dahl"
STIFFNESS, EXPONENT = OWN, OWN + 1
PARAMETERS = {
    "stiffness": positive("N m/rad", "k, slope dF/dx at F = 0"),
    "exponent": positive("1", "i, shape of the approach to the limit", default=1.0),
}
CURVE = LIMIT
FAMILY = "own"
SAYS = {
    "pre-sliding hysteresis": True,
    "frictional lag": False,
    "memory: return point": False,
    "memory: wipe-out": False,
    "Stribeck curve": False,
    "stick-slip": False,
}


def pack(values):
    """Own entries of the packed law, from a mapping of `PARAMETERS`."""
    return [values["stiffness"], values["exponent"]]


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
