"""A quiet period: one chunk, no event, of a plant that is ``quick``.

What such periods change is carried from one to the next as plain numbers (`Moving`), beside what they leave as it is
(`Held`), so that a loop of many keeps them in registers; a period that is not quiet is done by `step` on the state,
from which both are taken anew.
"""

from typing import NamedTuple

import numpy as np

from microstage_ros.numerics.compiled import inlined_before_typing, internal, not_inlined, always_inlined
from microstage_ros.solver.contact import crosses, direction_factor, limit, limit_and_slopes
from microstage_ros.solver.linear_core import O_I, O_OMEGA, O_OMEGA_MID, O_THETA, O_V, O_X, T1, T2
from microstage_ros.solver.slip import (
    NEAR,
    change,
    change_of_rate,
    corrections,
    corrections_near,
    forgotten,
    near,
    relax,
    with_change,
)
from microstage_ros.solver.vectors import add_columns, fused, mode_rows

BEND = 2e-3                    # largest second difference of s(w) over a chunk, of the static limit
# what came of a period; not literals, or numba would compile for each
EVENT_FREE, LOOKED, EVENT, COARSE = (np.int64(k) for k in range(4))


class Moving(NamedTuple):
    """What a quiet period changes; fields of `records.STATE`, those of the contacts with a_, g_ or slip_ before."""

    current: float
    omega: float
    theta: float
    v: float
    x: float
    a_stretch: float
    g_stretch: float
    slip_force: float
    slip_change: float
    slip_offset: float


class Held(NamedTuple):
    """What stays as long as periods are without event.

    The sticking blocks, where they must be looked at, and the slip at both contacts.
    """

    slot: int
    a_force: float
    a_stiffness: float
    a_ahead: float
    a_behind: float
    a_guard: float
    g_force: float
    g_stiffness: float
    g_ahead: float
    g_behind: float
    g_guard: float
    pull: float                # −direction · Σα of the slipping blocks, 0: none
    direction: float           # 0: none slips
    turn: float                # dw/dω of the speed
    slip_level: float          # factor on s(w)
    pace: float                # C T / slip_level
    guide_slip: float          # force of the slipping blocks
    guide_direction: float


@inlined_before_typing
def moving_of(state):
    """`Moving` of a state."""
    a, g = state.actuator, state.guideway
    return Moving(state.current, state.omega, state.theta, state.v, state.x, a.stretch, g.stretch, a.slip_force,
                  a.slip_change, a.slip_offset)


@inlined_before_typing
def held_of(plant, state, slot):
    """`Held` of a state whose mode's matrices are in ``slot``."""
    a, g = state.actuator, state.guideway
    a_ahead, a_behind, a_guard = _bounds(a)
    g_ahead, g_behind, g_guard = _bounds(g)
    direction = a.direction if a.slip_weight > 0.0 else 0.0
    level, pace, guide_slip = slip_of(plant, state)
    return Held(
        slot, a.stuck_weight_force, a.stuck_stiffness, a_ahead, a_behind, a_guard, g.stuck_weight_force,
        g.stuck_stiffness,
        g_ahead, g_behind, g_guard, -direction * a.slip_weight, direction, direction * plant.per_gear, level, pace,
        guide_slip,
        g.direction if g.slip_weight > 0.0 else 0.0)


@inlined_before_typing
def slip_of(plant, state):
    """(slip_level, pace, guide_slip) of `Held`: what changes with the factors on the limits, beside the guards."""
    a, g = state.actuator, state.guideway
    level = a.factor * direction_factor(plant.actuator, a.direction)
    return level, plant.actuator.attraction * plant.period / level, g.direction * g.slip_weight * g.slip_force


@inlined_before_typing
def _bounds(c):
    """(ahead, behind, guard) of a contact; without sticking blocks there is nothing to guard."""
    if c.mask == 0:
        return np.inf, np.inf, np.inf
    return c.ahead, c.behind, c.guard


@inlined_before_typing
def guard_of(c):
    """Speed below which a contact need not be looked at."""
    return c.guard if c.mask != 0 else np.inf


@inlined_before_typing
def write_state(state, moving):
    """`Moving` back into the state it was taken from."""
    a, g = state.actuator, state.guideway
    state.current, state.omega, state.theta, state.v, state.x = (
        moving.current,
        moving.omega,
        moving.theta,
        moving.v,
        moving.x,
    )
    if a.mask != 0:
        a.stretch = moving.a_stretch
    if g.mask != 0:
        g.stretch = moving.g_stretch
    a.slip_force, a.slip_change, a.slip_offset = moving.slip_force, moving.slip_change, moving.slip_offset


@always_inlined
def try_period(plant, state, work, moving, held, u):
    """A period with the amplifier at ``u``: (`Moving` after it, QUIET); LOOKED if ``held`` must be taken anew.

    Not quiet: (`Moving` before it, EVENT, or COARSE if it changes the speed too much).
    """
    m, slot, whole = work.matrix, held.slot, np.int64(0)
    omega0, f0, pull = moving.omega, moving.slip_force, held.pull
    spring = plant.stiffness * (plant.ratio * moving.theta - moving.x)
    torque = -fused(held.a_stiffness, moving.a_stretch, held.a_force) - plant.ratio * spring
    push = (plant.push - fused(held.g_stiffness, moving.g_stretch, held.g_force) + spring) - held.guide_slip
    rows = mode_rows(m, slot, whole, moving.current, omega0, moving.v, u, torque + pull * f0, pull * moving.slip_change,
                     push)
    f1, offset = f0, moving.slip_offset
    if held.direction != 0.0:
        s, per_s, slope, bend = limit_and_slopes(plant.actuator, abs(omega0) * plant.per_gear)
        k1, k2 = change_of_rate(s, slope, bend, held.turn)
        mid, mid_m, mid_1, end, end_m, end_1, fade = near(held.pace * per_s, f0, s * held.slip_level)
        linear, square = corrections_near((mid, mid_m, mid_1, end, end_m, end_1), pull, f0, moving.slip_change)
        to_mid, to_end, reach = rows[O_OMEGA_MID] - omega0, rows[O_OMEGA] - omega0, NEAR * abs(omega0)
        if abs(to_mid) <= reach and abs(to_end) <= reach:
            by_mid, by_end = change(k1, k2, to_mid), change(k1, k2, to_end)
            d1, d2, f1 = with_change(linear, by_mid, by_end), with_change(square, by_mid,
                                                                          by_end), with_change((end, end_m, end_1),
                                                                                               by_mid, by_end)
        else:
            f_mid, f1, fade, bent = far(plant, state.actuator, omega0, rows[O_OMEGA_MID], rows[O_OMEGA], f0,
                                        plant.period)
            if bent:
                return moving, COARSE
            d1, d2 = corrections(pull, f0, f_mid, f1, moving.slip_change)
        rows = add_columns(rows, m, slot, whole, T1, d1, T2, d2)
        offset = forgotten(offset * fade)
    turned, moved = rows[O_THETA] * plant.per_gear, rows[O_X]
    a_stretch, g_stretch = moving.a_stretch + turned, moving.g_stretch + moved
    found = EVENT_FREE
    if rows[O_OMEGA] * held.direction < 0.0 or rows[O_V] * held.guide_direction < 0.0:
        return moving, EVENT
    if not ((a_stretch < held.a_ahead or turned <= 0.0) and (-a_stretch < held.a_behind or turned >= 0.0)
            and (g_stretch < held.g_ahead or moved <= 0.0) and (-g_stretch < held.g_behind or moved >= 0.0)
            and abs(rows[O_OMEGA]) * plant.per_gear < held.a_guard and abs(rows[O_V]) < held.g_guard):
        found = _look(plant, state, moving.a_stretch, moving.g_stretch, turned, rows[O_OMEGA] * plant.per_gear, moved,
                      rows[O_V])
        if found == EVENT:
            return Moving(moving.current, omega0, moving.theta, moving.v, moving.x, state.actuator.stretch,
                          state.guideway.stretch,
                          f0, moving.slip_change, moving.slip_offset), EVENT
        a_stretch, g_stretch = state.actuator.stretch + turned, state.guideway.stretch + moved
    return Moving(rows[O_I], rows[O_OMEGA], moving.theta + rows[O_THETA], rows[O_V], moving.x + rows[O_X], a_stretch,
                  g_stretch,
                  f1, f1 - f0, offset), found


@internal
def slip_level(contact, c, w):
    """λ s(w) of a contact at velocity w, with its direction and, if it has one, its lag."""
    return c.factor * direction_factor(contact, w) * limit(contact, c.lagged if contact.lag > 0.0 else w)


@internal
def far(plant, c, omega0, omega_mid, omega1, f0, h):
    """`relax` at the actuator, and whether the limit bends too much over the chunk for it."""
    not_inlined()
    a = plant.actuator
    s0, s_mid = slip_level(a, c, omega0 * plant.per_gear), slip_level(a, c, omega_mid * plant.per_gear)
    s1 = slip_level(a, c, omega1 * plant.per_gear)
    f_mid, f1, fade = relax(a.attraction, f0, s0, s_mid, s1, h)
    return f_mid, f1, fade, a.drops == 1 and abs(s0 - 2.0 * s_mid + s1) > BEND * a.static


@internal
def _look(plant, state, a_stretch, g_stretch, turned, w, moved, v):
    """EVENT if a sticking block comes to its limit in this period, else LOOKED.

    The travels of the period, and the velocities at its end, are given.
    """
    not_inlined()
    a, g = state.actuator, state.guideway
    if a.mask != 0:
        a.stretch = a_stretch
    if g.mask != 0:
        g.stretch = g_stretch
    if a.mask != 0 and crosses(plant.actuator, a, turned, w) or g.mask != 0 and crosses(plant.guideway, g, moved, v):
        return EVENT
    return LOOKED
