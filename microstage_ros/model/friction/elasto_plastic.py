"""Elasto-plastic law: LuGre with bristles that are purely elastic below a breakaway deflection.

    dz/dt = w (1 − a(z, w) sgn(w) σ₀ z / |s(w)|),     F = σ₀ z + σ₁ dz/dt + σ w
    a = 0                             for sgn(z) ≠ sgn(w) or σ₀|z| <= B
    a = ½ + ½ sin(π (σ₀|z| − (|s| + B)/2) / (|s| − B))   between
    a = 1                             for σ₀|z| >= |s|

B is ``breakaway_share`` of the Coulomb limit. Below it nothing creeps, so the law does not drift under
small oscillation. A stretch is split where σ₀|z| reaches B; beyond it, a is held over a substep at its
value in the middle (second order) and the relaxation with that value is exact, never past |s|. σ₁ is
capped as in LuGre. Source: P. Dupont, V. Hayward, B. Armstrong, F. Altpeter, "Single state elastoplastic
friction models", IEEE Transactions on Automatic Control 47 (2002).
"""

import math

from microstage_ros.model.friction.curve import (
    COULOMB,
    DIRECTION_WIDTH,
    OWN,
    STRIBECK,
    passive_damping,
    relax,
    sliding_limit,
)
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.spec import Spec, not_negative, positive

TITLE = "elasto-plastic"
STIFFNESS, DAMPING, BREAKAWAY_SHARE = OWN, OWN + 1, OWN + 2
SUBSTEPS = 16  # at most, in one stretch
SUBSTEP_SHARE = 0.2  # of the blend zone that a substep may cross before more substeps are taken
PARAMETERS = {
    "stiffness": positive("N m/rad", "σ₀ of the bristles"),
    "damping": not_negative("N m s/rad", "σ₁, micro-damping", default=0.0),
    "breakaway_share": Spec("1", 1e-6, 1.0 - 1e-6, "B as a share of the Coulomb limit", default=0.7),
}
CURVE = STRIBECK
FAMILY = "own"
EXAMPLE = {"damping": 1e-4}   # on the contact of the properties, estimates


def pack(values):
    """Own entries of the packed law, from a mapping of `PARAMETERS`."""
    return [values["stiffness"], values["damping"], values["breakaway_share"]]


def state_size(packed):
    """Entries of the state: the bristle force σ₀ z."""
    return 1


@compiled
def plastic_share(bristle, breakaway, limit):
    """a(z, w) for a bristle force counted along the motion [1]."""
    if bristle <= breakaway:
        return 0.0
    if bristle >= limit:
        return 1.0
    return 0.5 + 0.5 * math.sin(math.pi * (bristle - 0.5 * (limit + breakaway)) / (limit - breakaway))


@compiled
def blended(bristle, share, limit, reach):
    """Bristle force after relaxing with a fixed plastic ``share`` over reach = σ₀ Δq / |s|."""
    if share * reach < 1e-9:
        moved = bristle + limit * reach
    else:
        moved = relax(bristle, limit / share, limit / share, share * reach)
    return min(moved, max(bristle, limit))


@compiled
def stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor):
    """Force without its viscous part at the end of a stretch of motion in one direction."""
    if direction == 0.0:
        return state[0]
    stiffness = parameters[STIFFNESS]
    coulomb = parameters[COULOMB if direction > 0.0 else DIRECTION_WIDTH + COULOMB]
    breakaway = parameters[BREAKAWAY_SHARE] * coulomb * limit_factor
    s_end = sliding_limit(parameters, direction, speed_end, limit_factor)
    bristle = direction * state[0]
    zones = 0.5 * (speed_start + speed_end) * duration * stiffness / (SUBSTEP_SHARE * (s_end - breakaway))
    substeps = 1 + int(min(zones, SUBSTEPS - 1.0))
    step, acceleration = duration / substeps, (speed_end - speed_start) / substeps
    for i in range(substeps):
        speed = speed_start + acceleration * (i + 0.5)
        limit = sliding_limit(parameters, direction, speed, limit_factor)
        rise = stiffness * speed * step
        elastic = min(rise, max(breakaway - bristle, 0.0))
        bristle += elastic
        if rise > elastic:
            reach = (rise - elastic) / limit
            guess = blended(bristle, plastic_share(bristle, breakaway, limit), limit, reach)
            middle = plastic_share(0.5 * (bristle + guess), breakaway, limit)
            bristle = blended(bristle, middle, limit, reach)
    state[0] = direction * bristle
    damping = passive_damping(parameters[DAMPING], s_end, speed_end, 4.0)
    rate = 1.0 - plastic_share(bristle, breakaway, s_end) * bristle / s_end
    return direction * (bristle + damping * speed_end * rate)


def stored_energy(parameters, state):
    """Elastic energy (σ₀ z)² / 2σ₀ [F q]."""
    return float(state[0] ** 2 / (2.0 * parameters[STIFFNESS]))
