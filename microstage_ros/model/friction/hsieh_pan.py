"""Hsieh and Pan: a nonlinear spring with memory in series with plastic flow that creeps and hardens.

    x = e + p,     F_h(e): Maxwell-slip blocks (hysteresis, memory, wipe-out),     F = F_h + σ w
    dp/dt = c sinh(λ (F_h − H p) / F_s)          creep, slowed by the back force H p (work hardening)

A pre-sliding law: beyond it the force stays at F_s, without a Stribeck drop. The publication gives the
two modules and the qualitative behaviour; the constitutive functions chosen here (Iwan's blocks,
Eyring's flow, linear kinematic hardening) are this project's, the fewest that show it. The blocks are
exact; the flow is a backward-Euler step on a monotone scalar equation, solved by bracketing: first
order, dissipative and bounded at any step. Source: C. Hsieh, Y.-C. Pan, "Dynamic behavior and modelling
of the pre-sliding static friction", Wear 242 (2000).
"""

import math

from microstage_ros.model.friction.blocks import (
    COUNT,
    STIFFNESS,
    block_parameters,
    blocks_energy,
    drag_blocks,
    pack_blocks,
    try_blocks,
)
from microstage_ros.model.friction.curve import LIMIT, sliding_limit
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.spec import positive

TITLE = "Hsieh–Pan"
ROUNDS = 60  # of the bracketing at most; it usually ends after five
TOLERANCE = 1e-12  # of the bracket
PARAMETERS = {
    **block_parameters("blocks of the spring"),
    "creep_velocity": positive("rad/s", "c, flow velocity of the plastic module"),
    "sharpness": positive("1", "λ, how steeply creep depends on the load"),
    "hardening": positive("N m/rad", "H, back force per plastic displacement"),
}
CURVE = LIMIT
FAMILY = "own"
EXAMPLE = {"creep_velocity": 1e-8, "sharpness": 8.0, "hardening": 0.2}   # on the contact of the properties, estimates
SAYS = {
    "creep under constant load": True,
    "memory: return point": True,
    "memory: wipe-out": True,
}


def pack(values):
    """Own entries of the packed law, from a mapping of `PARAMETERS`."""
    return [*pack_blocks(values["stiffness"], values["weight"]),
            *(values[key] for key in ("creep_velocity", "sharpness", "hardening"))]


def state_size(packed):
    """Entries of the state (n + 1,): the force of each block [F], then the plastic displacement p [q]."""
    return int(packed[COUNT]) + 1


@compiled
def mismatch(parameters, state, displacement, flow, flow_scale, force_scale, limit_factor):
    """Force that ``flow`` in this step needs, less the force that drives it [F]: rises with ``flow``."""
    n = int(parameters[COUNT])
    hardening = parameters[STIFFNESS + 2 * n + 2]
    spring = try_blocks(parameters, state, displacement - flow, limit_factor)
    return force_scale * math.asinh(flow / flow_scale) - (spring - hardening * (state[n] + flow))


@compiled
def plastic_flow(parameters, state, displacement, duration, limit_factor):
    """Plastic displacement in a step of ``displacement`` over ``duration`` [q] (Illinois bracketing)."""
    n = int(parameters[COUNT])
    flow_scale = parameters[STIFFNESS + 2 * n] * duration
    hardening = parameters[STIFFNESS + 2 * n + 2]
    drive = try_blocks(parameters, state, displacement, limit_factor) - hardening * state[n]
    if drive == 0.0 or flow_scale == 0.0:
        return 0.0
    force_scale = sliding_limit(parameters, drive, 0.0, limit_factor) / parameters[STIFFNESS + 2 * n + 1]
    low, at_low = 0.0, -drive
    high = drive / hardening  # there the back force alone has eaten the drive
    load = abs(drive) / force_scale
    if load < 30.0:
        high = math.copysign(min(abs(high), flow_scale * math.sinh(load)), drive)
    at_high = mismatch(parameters, state, displacement, high, flow_scale, force_scale, limit_factor)
    width = abs(high)
    flow = high
    for _ in range(ROUNDS):
        if at_high == at_low or abs(high - low) <= TOLERANCE * width:
            break
        flow = high - at_high * (high - low) / (at_high - at_low)
        at_flow = mismatch(parameters, state, displacement, flow, flow_scale, force_scale, limit_factor)
        if at_flow == 0.0:
            break
        if at_flow * at_high < 0.0:
            low, at_low = high, at_high
        else:
            at_low *= 0.5
        high, at_high = flow, at_flow
    return flow


@compiled
def stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor):
    """Force without its viscous part at the end of a stretch; creep goes on at rest (direction 0)."""
    displacement = direction * 0.5 * (speed_start + speed_end) * duration
    flow = plastic_flow(parameters, state, displacement, duration, limit_factor)
    state[int(parameters[COUNT])] += flow
    return drag_blocks(parameters, state, displacement - flow, limit_factor)


def stored_energy(parameters, state):
    """Elastic energy of the blocks and of the back force, H p² / 2 [F q]."""
    n = int(parameters[COUNT])
    return blocks_energy(parameters, state) + 0.5 * parameters[STIFFNESS + 2 * n + 2] * float(state[n]) ** 2
