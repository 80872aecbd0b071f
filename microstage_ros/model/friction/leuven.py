"""Leuven: LuGre's rate equation with a hysteresis of non-local memory in place of the linear bristle.

    dz/dt = w (1 − sgn(w) sgn(F_h) |F_h(z) / s(w)|^n),     F = F_h(z) + σ₁ dz/dt + σ w

F_h(z) is the hysteresis: virgin curve, branches from the last reversal scaled by two, and a memory of
the reversals still open. It is held, in the modified form of 2002, by Maxwell-slip elements driven by z: they
remember what the two stacks of reversal points of the first form remember (the tests run such stacks
beside them), cannot overflow, and stay passive when the limits change. A stretch is split where an
element reaches its limit; in between, the rate equation is linearised at the start of a substep and
solved exactly (exponential Rosenbrock, second order), never past |s|. σ₁ is capped as in LuGre, at
|s| / |w|. Sources: J. Swevers, F. Al-Bender, C. Ganseman, T. Prajogo, "An integrated friction model
structure with improved presliding behavior for accurate friction compensation", IEEE Transactions on
Automatic Control 45 (2000); V. Lampaert, J. Swevers, F. Al-Bender, "Modification of the Leuven
integrated friction model structure", ibid. 47 (2002).
"""

import math

from microstage_ros.model.friction.blocks import (
    COUNT,
    STIFFNESS,
    block_parameters,
    blocks_energy,
    drag_blocks,
    pack_blocks,
)
from microstage_ros.model.friction.curve import STRIBECK, passive_damping, sliding_limit
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.spec import Spec, not_negative

TITLE = "Leuven"
SUBSTEPS = 16  # at most, in one stretch
SUBSTEP_SHARE = 0.25  # of the limit that F_h may rise in a substep before more substeps are taken
# of the limit: this near to it F_h decays onto it, which one substep solves; what the linearisation leaves is of the
# square of this
SETTLED = 0.02
PARAMETERS = {
    **block_parameters("elements of the hysteresis"),
    "damping": not_negative("N m s/rad", "σ₁, micro-damping", default=0.0),
    "exponent": Spec("1", 1.0, 50.0, "n, how late the transition to sliding begins", default=6.0),
}
CURVE = STRIBECK
FAMILY = "own"
EXAMPLE = {"damping": 1e-4}   # on the contact of the properties, estimates
SAYS = {
    "Stribeck curve": True,
    "frictional lag": True,
    "rising static friction": True,
    "stick-slip": True,
    "memory: return point": True,
    "memory: wipe-out": True,
}


def pack(values):
    """Own entries of the packed law, from a mapping of `PARAMETERS`."""
    return [*pack_blocks(values["stiffness"], values["weight"]), values["damping"], values["exponent"]]


def state_size(packed):
    """Entries of the state: the force of each element of the hysteresis."""
    return int(packed[COUNT])


@compiled
def free_elements(parameters, state, direction, limit_factor):
    """(Σ k of the elements that do not slip towards ``direction``, the way of z to the next one's limit)."""
    n = int(parameters[COUNT])
    limit = sliding_limit(parameters, direction, 0.0, limit_factor)
    tangent, way = 0.0, math.inf
    for i in range(n):
        stiffness = parameters[STIFFNESS + i]
        headroom = (parameters[STIFFNESS + n + i] * limit - direction * state[i]) / stiffness
        if headroom > 0.0:
            tangent += stiffness
            way = min(way, headroom)
    return tangent, way


@compiled
def hysteresis(parameters, state):
    """F_h = Σ F_i [F]."""
    total = 0.0
    for i in range(int(parameters[COUNT])):
        total += state[i]
    return total


@compiled
def follow(parameters, state, direction, distance, limit, limit_factor):
    """Carry z along ``distance`` of motion with the sliding limit held at ``limit``."""
    exponent = parameters[STIFFNESS + 2 * int(parameters[COUNT]) + 1]
    for _ in range(4 * int(parameters[COUNT]) + 8):  # each round but the last ends at an element's limit
        force = direction * hysteresis(parameters, state)
        steepness = abs(force / limit) ** (exponent - 1.0)
        rate = 1.0 - steepness * force / limit
        if rate == 0.0 or distance <= 0.0:
            return
        sense = math.copysign(1.0, rate)
        tangent, way = free_elements(parameters, state, sense * direction, limit_factor)
        if tangent == 0.0:
            return
        decay = exponent * steepness * tangent / limit
        small = decay * distance < 1e-9
        move = abs(rate) * (distance if small else -math.expm1(-decay * distance) / decay)
        if force < limit:
            move = min(move, (limit - force) / tangent)
        if move <= way:
            drag_blocks(parameters, state, direction * sense * move, limit_factor)
            return
        distance -= way / abs(rate) if small else -math.log1p(-decay * way / abs(rate)) / decay
        drag_blocks(parameters, state, direction * sense * way * (1.0 + 1e-12), limit_factor)


@compiled
def stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor):
    """Force without its viscous part at the end of a stretch of motion in one direction."""
    if direction == 0.0:
        return hysteresis(parameters, state)
    s_end = sliding_limit(parameters, direction, speed_end, limit_factor)
    tangent, _ = free_elements(parameters, state, direction, limit_factor)
    rise = 0.5 * (speed_start + speed_end) * duration * tangent / (SUBSTEP_SHARE * s_end)
    substeps = 1
    if rise > 1.0:
        s_start = sliding_limit(parameters, direction, speed_start, limit_factor)
        before = direction * hysteresis(parameters, state)
        if max(abs(s_start - before), abs(s_end - before)) > SETTLED * s_end:
            substeps = 1 + int(min(rise, SUBSTEPS - 1.0))
    step, acceleration = duration / substeps, (speed_end - speed_start) / substeps
    for i in range(substeps):
        speed = speed_start + acceleration * (i + 0.5)
        limit = sliding_limit(parameters, direction, speed, limit_factor)
        follow(parameters, state, direction, speed * step, limit, limit_factor)
    n = int(parameters[COUNT])
    force = direction * hysteresis(parameters, state)
    if parameters[STIFFNESS + 2 * n] == 0.0:
        return direction * force
    rate = 1.0 - math.copysign(abs(force / s_end) ** parameters[STIFFNESS + 2 * n + 1], force)
    damping = passive_damping(parameters[STIFFNESS + 2 * n], s_end, speed_end, 1.0)
    return direction * (force + damping * speed_end * rate)


stored_energy = blocks_energy
