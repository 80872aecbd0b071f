"""The compiled step: one control period of the axis, exact between friction events.

The period is walked in chunks T/2^level. A chunk is tried as a whole; if a block would reach its
limit, a sliding contact would reverse, the backlash would open or close, or the Stribeck curve
would bend too much inside it, the chunk is halved, down to T/1024, where the event is carried out.
So a quiet period costs one small matrix product, and an event is placed to within 0.1 µs.
"""

import math

import numpy as np

from microstage_ros.axis.amplifier import amplifier_output, delayed_output, lag_output, warm_up
from microstage_ros.axis.compiled import compiled
from microstage_ros.axis.contact import (
    block_force, crosses, direction_factor, follow_law, limit, move_stuck, release, settle_limit, stick_all,
)
from microstage_ros.axis.linear_core import (
    F0, F1, I, O_I, O_OMEGA, O_OMEGA_MID, O_THETA, O_V, O_X, OMEGA, T0, T1, T2, TICKS, V, build_mode,
)
from microstage_ros.axis.records import LEVELS, OUTPUTS, SLOTS
from microstage_ros.axis.slip import decay, relax
from microstage_ros.axis.variability import vary

BEND = 2e-3                    # largest second difference of s(w) over a chunk, of the static limit
FINEST_BEND = 7                # level below which a bend is no longer refined
LAG_SPANS = 16                 # pieces of a period in which a lagging amplifier's output is constant
U = 3                          # input column of the voltage


@compiled
def advance(plant, state, work, voltage):
    """One control period T with ``voltage`` (V, before the converter) held.

    ``plant``: record `PLANT`; ``state``: record `STATE`, changed in place; ``work``: see `linear_core.new_work`.
    """
    u = amplifier_output(plant, state, voltage)
    if plant.varies == 1:
        vary(plant, state)
    late, split, pieces = u, 0, 1
    if plant.electrical == 1:
        warm_up(plant, state, work)
        late, u, split = delayed_output(plant, state, u)
        pieces = LAG_SPANS if plant.actuator_lag > 0.0 else 2
    start = 0
    for k in range(pieces):
        end = TICKS
        if pieces == 2 and k == 0:
            end = split
        elif pieces > 2:
            end = (k + 1) * TICKS // pieces
        target = late if start < split else u
        if plant.actuator_lag > 0.0:
            state.voltage = lag_output(plant, state, target, (end - start) / TICKS)
        else:
            state.voltage = target
        _span(plant, state, work, state.voltage, start, end)
        start = end
    state.time += plant.period
    state.periods += 1
    state.torque_friction = block_force(state.actuator) + plant.actuator.viscous * state.omega * plant.per_gear
    state.guide_friction = block_force(state.guideway) + plant.guideway.viscous * state.v


@compiled
def _slot(plant, state, work):
    """Slot of the present mode, as it was left; looked up only if the matrices were dropped."""
    if work.slot < 0:
        work.slot = _mode(plant, state, work)
    return work.slot


@compiled
def _mode(plant, state, work):
    """Slot of the matrices of the present mode, made if it is new."""
    ca, cg = state.actuator, state.guideway
    side = 1 if state.side != 0 else 0
    key = ca.mask | (cg.mask << 8) | (side << 16)
    slot = (key ^ (key >> 6) ^ (key >> 11)) & (SLOTS - 1)
    if work.key[slot] != key:
        a, g = plant.actuator, plant.guideway
        damp_a = a.viscous + (a.stick_damping if ca.slip_weight == 0.0 else 0.0)
        damp_g = g.viscous + (g.stick_damping if cg.slip_weight == 0.0 else 0.0)
        if math.isnan(work.resistance):
            work.resistance = plant.resistance * (1.0 + state.heat)
        build_mode(plant, ca.stuck_stiffness, damp_a, cg.stuck_stiffness, damp_g, side, work.resistance, work.matrix[slot])
        work.key[slot] = key
    return slot


@compiled
def _span(plant, state, work, u, start, end):
    """Walk from tick ``start`` to tick ``end`` of the period with the amplifier at ``u``."""
    slot = _slot(plant, state, work)
    base = plant.base_level
    position, level = start, base
    while position < end:
        size = TICKS >> level
        while size > end - position or (position & (size - 1)) != 0:
            level += 1
            size >>= 1
        done = _chunk(plant, state, work, u, slot, level)
        if done == 0:
            level += 1
            continue
        position += size
        if done == 2:
            _switch(plant, state, work)
            slot = _mode(plant, state, work)
            work.slot = slot
        elif level > base and (position & (2 * size - 1)) == 0:
            level -= 1


@compiled
def _switch(plant, state, work):
    """Carry out the events that the finest chunk ended on."""
    a, g, ca, cg = plant.actuator, plant.guideway, state.actuator, state.guideway
    if ca.slip_weight > 0.0 and state.omega * ca.direction < 0.0:
        stick_all(a, ca)
    elif ca.mask != 0:
        release(a, ca, work.out[O_THETA], state.omega * plant.per_gear)
    if cg.slip_weight > 0.0 and state.v * cg.direction < 0.0:
        stick_all(g, cg)
    elif cg.mask != 0:
        release(g, cg, work.out[O_X], state.v)
    if plant.gap > 0.0:
        d = plant.ratio * state.theta - state.x
        state.side = 1 if d > 0.5 * plant.gap else (-1 if d < -0.5 * plant.gap else 0)


@compiled
def _slip_level(contact, c, w):
    """λ s(w) of a contact at velocity w, with its direction and, if it has one, its lag."""
    return c.factor * direction_factor(contact, w) * limit(contact, c.lagged if contact.lag > 0.0 else w)


@compiled
def _row(m, p, q, o, i, omega, v, u, t0, t1, f0):
    """One output of the mode's matrix times its inputs."""
    start = (m[p, q, I, o] * i + m[p, q, OMEGA, o] * omega) + (m[p, q, V, o] * v + m[p, q, U, o] * u)
    driven = (m[p, q, T0, o] * t0 + m[p, q, F0, o] * f0) + m[p, q, T1, o] * t1
    return start + driven


@compiled
def _chunk(plant, state, work, u, slot, level):
    """Try one chunk. 0: must be halved; 1: done; 2: done, and an event waits at its end."""
    a, g, ca, cg = plant.actuator, plant.guideway, state.actuator, state.guideway
    m, out = work.matrix, work.out
    h = plant.period / (1 << level)
    per_gear, omega0, v0 = plant.per_gear, state.omega, state.v
    slipping = ca.slip_weight > 0.0
    pull = -ca.direction * ca.slip_weight
    torque, force = _steady_forces(plant, state, h)
    f0 = ca.slip_force
    f_mid, f1, s0, s_mid, s1, fade, grow = f0, f0, 0.0, 0.0, 0.0, 1.0, 0.0
    if slipping:
        s0 = ca.slip_limit if a.lag == 0.0 else _slip_level(a, ca, omega0 * per_gear)
        if math.isinf(a.attraction):
            f0 = s0
        grow = ca.slip_slope * h
    t0, t1 = torque + pull * f0, pull * grow
    if a.law > 0:          # the other laws are integrated by extrapolation over short chunks (Adams–Bashforth)
        t0 -= ca.law_force
        t1 -= ca.law_force - ca.law_before
    glide = -cg.direction * cg.slip_weight * cg.slip_force
    push = force + glide - cg.law_force
    p, q = np.uint64(slot), np.uint64(level)
    o0 = _row(m, p, q, 0, state.current, omega0, v0, u, t0, t1, push)
    o1 = _row(m, p, q, 1, state.current, omega0, v0, u, t0, t1, push)
    o2 = _row(m, p, q, 2, state.current, omega0, v0, u, t0, t1, push)
    o3 = _row(m, p, q, 3, state.current, omega0, v0, u, t0, t1, push)
    o4 = _row(m, p, q, 4, state.current, omega0, v0, u, t0, t1, push)
    o5 = _row(m, p, q, 5, state.current, omega0, v0, u, t0, t1, push)
    out[0], out[1], out[2], out[3], out[4], out[5] = o0, o1, o2, o3, o4, o5
    if slipping:
        s_mid, s1 = _slip_level(a, ca, out[O_OMEGA_MID] * per_gear), _slip_level(a, ca, out[O_OMEGA] * per_gear)
        if a.drops == 1 and level < FINEST_BEND and abs(s0 - 2.0 * s_mid + s1) > BEND * a.static:
            return 0
        f_mid, f1, fade = relax(a.attraction, f0, s0, s_mid, s1, h)
        d1, d2 = pull * (4.0 * f_mid - 3.0 * f0 - f1 - grow), pull * (2.0 * f0 - 4.0 * f_mid + 2.0 * f1)
        for o in range(OUTPUTS):
            out[o] += m[p, q, T1, o] * d1 + m[p, q, T2, o] * d2
    if cg.slip_weight > 0.0 and g.drops == 1:
        rise = -cg.direction * cg.slip_weight * (_slip_level(g, cg, out[O_V]) - cg.slip_force)
        for o in range(OUTPUTS):
            out[o] += m[slot, level, F1, o] * rise
    if g.law > 0:
        for o in range(OUTPUTS):
            out[o] -= m[p, q, F1, o] * (cg.law_force - cg.law_before)
    event = _event(plant, state, out)
    if event and level < LEVELS - 1:
        return 0
    _accept(plant, state, out, f0, f1, s1, fade, slipping, h)
    return 2 if event else 1


@compiled
def _steady_forces(plant, state, h):
    """(torque at the motor, force at the stage) that do not depend on the slip, about the chunk's middle."""
    ratio = plant.ratio
    torque, force = -state.actuator.stuck_weight_force, plant.push - state.guideway.stuck_weight_force
    if plant.plain == 1:
        spring = plant.stiffness * (ratio * state.theta - state.x)
        return torque - ratio * spring, force + spring
    if plant.rigid == 0 and state.side != 0:
        d = ratio * state.theta - state.x - 0.5 * plant.gap * state.side
        if plant.leads > 0 or plant.lead_slope != 0.0:
            d += lead_error(plant, (state.theta + 0.5 * h * state.omega) / plant.gear)
        torque -= ratio * plant.stiffness * d
        force += plant.stiffness * d
    force -= plant.cable * (state.x + 0.5 * h * state.v - plant.anchor)
    if plant.smooth == 1:
        torque += _smooth_torque(plant, state.theta + 0.5 * h * state.omega, state.omega)
        force -= _beyond_viscous(plant.guideway, state.v)
    return torque, force


@compiled
def lead_error(plant, phi):
    """Error of the lead at screw angle φ [m]."""
    error = plant.lead_slope * plant.screw_ratio * phi
    for k in range(plant.leads):
        error += plant.lead_amplitude[k] * math.sin(plant.lead_number[k] * phi + plant.lead_phase[k])
    return error


@compiled
def _smooth_torque(plant, theta, omega):
    """Cogging and nonlinear viscous torque at the motor [N m]."""
    torque = -_beyond_viscous(plant.actuator, omega / plant.gear)
    for k in range(plant.cogs):
        torque += plant.cog_amplitude[k] * math.sin(plant.cog_number[k] * theta + plant.cog_phase[k])
    return torque


@compiled
def _beyond_viscous(contact, w):
    """What σ w leaves out: σ · viscous_asymmetry · |w| + c g(|w|)^n sgn w, g = |w| or V (1 − exp(−|w|/V))."""
    speed = abs(w)
    force = contact.viscous * contact.viscous_asymmetry * speed
    if contact.quadratic == 0.0 or w == 0.0:
        return force
    if contact.saturation > 0.0:
        speed = contact.saturation * (1.0 - math.exp(-speed / contact.saturation))
    size = contact.quadratic * speed**contact.power
    return force + (size if w > 0.0 else -size)


@compiled
def _event(plant, state, out):
    """Whether the tried chunk holds an event: a reversal in slip, a block at its limit, the gap's edge."""
    ca, cg = state.actuator, state.guideway
    if ca.slip_weight > 0.0 and out[O_OMEGA] * ca.direction < 0.0:
        return True
    if cg.slip_weight > 0.0 and out[O_V] * cg.direction < 0.0:
        return True
    if ca.mask != 0 and crosses(plant.actuator, ca, out[O_THETA] * plant.per_gear, out[O_OMEGA] * plant.per_gear):
        return True
    if cg.mask != 0 and crosses(plant.guideway, cg, out[O_X], out[O_V]):
        return True
    if plant.gap > 0.0:
        d = plant.ratio * (state.theta + out[O_THETA]) - (state.x + out[O_X])
        side = 1 if d > 0.5 * plant.gap else (-1 if d < -0.5 * plant.gap else 0)
        return side != state.side
    return False


@compiled
def _accept(plant, state, out, f0, f1, s1, fade, slipping, h):
    """Take the tried chunk: new state, stretched blocks, relaxed slip force."""
    a, g, ca, cg = plant.actuator, plant.guideway, state.actuator, state.guideway
    if a.law > 0:
        follow_law(a, ca, state.omega * plant.per_gear, out[O_OMEGA] * plant.per_gear, h)
    if g.law > 0:
        follow_law(g, cg, state.v, out[O_V], h)
    state.current, state.omega, state.v = out[O_I], out[O_OMEGA], out[O_V]
    state.theta += out[O_THETA]
    state.x += out[O_X]
    if ca.mask != 0:
        move_stuck(ca, out[O_THETA] * plant.per_gear)
    if cg.mask != 0:
        move_stuck(cg, out[O_X])
    if slipping:
        ca.slip_force = f1
        ca.slip_limit = s1
        ca.slip_slope = (f1 - f0) / h
        ca.slip_offset *= fade
    if a.lag > 0.0:
        ca.lagged += (abs(state.omega) * plant.per_gear - ca.lagged) * (1.0 - decay(h / a.lag))
    if g.drops == 1 or g.lag > 0.0:
        cg.lagged += (abs(state.v) - cg.lagged) * (1.0 - decay(h / max(g.lag, 1e-12)))
        settle_limit(g, cg, state.v)
