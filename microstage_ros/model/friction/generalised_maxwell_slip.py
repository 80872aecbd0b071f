"""Generalised Maxwell-slip: Maxwell-slip blocks that relax onto the Stribeck curve while they slip.

    stick   dF_i/dt = k_i w                                until F_i sgn(w) >= α_i |s(w)|, then slip
    slip    dF_i/dt = C (sgn(w) α_i − F_i / |s(w)|)        until w changes sign, then stick
    F = Σ F_i + σ w

Over a stretch in one direction |s| is taken as linear in time between its values at the two ends. The
start of slip is then the root of a quadratic, and slip is the exact relaxation onto a moving target
(:func:`~microstage_ros.model.friction.curve.relax`): second order in the step, bounded at any step. A
block at rest keeps force and mode.

These equations are not passive: while w is small a slipping block climbs back towards α_i F_s within
|s|/C although it has hardly moved, and returns that energy on the reversal. ``passive`` adds the
condition dF_i sgn(w) <= k_i |dq| in slip (a block loads no faster than its own spring), which removes
this and changes nothing else. Sources: V. Lampaert, F. Al-Bender, J. Swevers, "A generalized
Maxwell-slip friction model appropriate for control purposes" (2003); F. Al-Bender, V. Lampaert,
J. Swevers, "The generalized Maxwell-slip model", IEEE Transactions on Automatic Control 50 (2005);
paper Eqs. 1–8. The condition ``passive`` is this project's.
"""

import math

from microstage_ros.model.friction.blocks import COUNT, STIFFNESS, block_parameters, blocks_energy, pack_blocks
from microstage_ros.model.friction.curve import STRIBECK, relax, sliding_limit
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.spec import Spec, positive

TITLE = "GMS"
PARAMETERS = {
    **block_parameters(),
    "attraction": positive("N m/s", "C, how fast a slipping block follows the curve"),
}
CURVE = STRIBECK
LIBRARY_ONLY = {"passive": Spec("1", 0.0, 1.0, "1: a slipping block loads no faster than its own spring", default=0.0)}
FAMILY = "blocks"
EXAMPLE = {"attraction": 1.0}   # on the contact of the properties, estimates
SAYS = {
    "Stribeck curve": True,
    "pre-sliding hysteresis": True,
    "memory: return point": True,
    "memory: wipe-out": True,
    "frictional lag": True,
    "stick-slip": True,
}


def pack(values):
    """Own entries of the packed law, from a mapping of `PARAMETERS`."""
    return [*pack_blocks(values["stiffness"], values["weight"]), values["attraction"],
            float(values.get("passive", 0.0))]


def state_size(packed):
    """Entries of the state (2 n,): the force of each block [F], then the direction (−1, 0, 1) it slips in [1]."""
    return 2 * int(packed[COUNT])


@compiled
def time_to_limit(gap, gap_rate, curvature, duration):
    """First root t in [0, duration] of gap − gap_rate t − curvature t² = 0, for gap > 0; −1 if none."""
    if gap_rate * duration + curvature * duration * duration < gap:
        return -1.0
    # the form of the quadratic formula that does not cancel, also for curvature → 0
    root = math.sqrt(max(gap_rate * gap_rate + 4.0 * curvature * gap, 0.0))
    return min(2.0 * gap / (gap_rate + root), duration) if gap_rate + root > 0.0 else duration


@compiled
def stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor):
    """Force without its viscous part at the end of a stretch of motion in one direction."""
    n = int(parameters[COUNT])
    total = 0.0
    if direction == 0.0 or duration <= 0.0:
        for i in range(n):
            total += state[i]
        return total
    attraction, passive = parameters[STIFFNESS + 2 * n], parameters[STIFFNESS + 2 * n + 1]
    s_start = sliding_limit(parameters, direction, speed_start, limit_factor)
    s_end = sliding_limit(parameters, direction, speed_end, limit_factor)
    s_rate = (s_end - s_start) / duration
    acceleration = (speed_end - speed_start) / duration
    for i in range(n):
        stiffness, weight = parameters[STIFFNESS + i], parameters[STIFFNESS + n + i]
        force = direction * state[i]  # along the motion
        begin, s_begin = 0.0, s_start
        if state[n + i] != direction:
            gap = weight * s_start - force
            if gap > 0.0:
                begin = time_to_limit(
                    gap, stiffness * speed_start - weight * s_rate, 0.5 * stiffness * acceleration, duration
                )
            if begin < 0.0:  # sticks to the end
                force += stiffness * 0.5 * (speed_start + speed_end) * duration
                state[n + i] = 0.0
            else:
                s_begin = s_start + s_rate * begin
                if gap > 0.0:
                    force = weight * s_begin
                state[n + i] = direction
        if begin >= 0.0:
            rest = duration - begin
            exponent = 0.5 * attraction * rest * (1.0 / s_begin + 1.0 / s_end)
            slipped = relax(force, weight * s_begin, weight * s_end, exponent)
            if passive != 0.0:
                way = 0.5 * (speed_start + acceleration * begin + speed_end) * rest
                slipped = min(slipped, force + stiffness * way)
            force = slipped
        state[i] = direction * force
        total += state[i]
    return total


stored_energy = blocks_energy
