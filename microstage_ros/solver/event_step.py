"""A period in chunks: how the axis is taken through events, and through all that a quiet period leaves out.

The period is walked in chunks T/2^level. A chunk is tried as a whole; if a block would reach its
limit, a sliding contact would reverse, the backlash would open or close, or the Stribeck curve
would bend too much inside it, the chunk is halved, down to T/1024, where the event is carried out.
So an event is placed to within 0.1 µs.
"""

import math

import numpy as np

from microstage_ros.model.effects.forces import effect_force
from microstage_ros.model.plant_record import LEVELS, SLOTS
from microstage_ros.numerics.compiled import compiled, inlined_before_typing, internal, not_inlined
from microstage_ros.solver.contact import (
    crosses,
    direction_factor,
    limit_and_slopes,
    release,
    settle_limit,
    stick_all,
    stuck_force,
)
from microstage_ros.solver.drive import drive_torque
from microstage_ros.solver.event_free import far, slip_level
from microstage_ros.solver.linear_core import (
    F1,
    O_I,
    O_OMEGA,
    O_OMEGA_MID,
    O_THETA,
    O_V,
    O_X,
    T1,
    T2,
    TICKS,
    build_mode,
)
from microstage_ros.solver.other_laws import any_law, follow_law
from microstage_ros.solver.slip import (
    NEAR,
    change,
    change_of_rate,
    corrections,
    corrections_near,
    decay,
    forgotten,
    near,
    relax,
    with_change,
)
from microstage_ros.solver.vectors import add_columns, mode_rows

FINEST_BEND = 7                # level below which a bend is no longer refined
DONE, EVENT, COARSE, EVENT_AT_END = (np.int64(k) for k in range(4))       # what came of a chunk
COUNT = 2.0 ** np.arange(LEVELS)          # chunks of a level in a period
SHARE = 0.5 ** np.arange(LEVELS)          # length of a level's chunk, of the period


@inlined_before_typing
def slot_of(plant, state, work):
    """Slot of the present mode, as it was left; looked up only if the matrices were dropped."""
    if work.slot < 0:
        work.slot = _mode(plant, state, work)
    return work.slot


@internal
def _mode(plant, state, work):
    """Slot of the matrices of the present mode, made if it is new."""
    not_inlined()
    ca, cg = state.actuator, state.guideway
    side = 1 if state.side != 0 else 0
    key = ca.mask | (cg.mask << 8) | (side << 16)
    slot = (key ^ (key >> 6) ^ (key >> 11)) & (SLOTS - 1)
    if work.key[slot] != key:
        a, g = plant.actuator, plant.guideway
        if a.law + g.law > 0 and not any_law(work):
            raise ValueError("the work record was made for a plant with block friction: new_work(plant)")
        damp_a = a.viscous + (a.stick_damping if ca.slip_weight == 0.0 else 0.0)
        damp_g = g.viscous + (g.stick_damping if cg.slip_weight == 0.0 else 0.0)
        if math.isnan(work.resistance):
            work.resistance = plant.resistance * (1.0 + state.heat)
        build_mode(plant, ca.stuck_stiffness, damp_a, cg.stuck_stiffness + plant.flexure,
                   damp_g + plant.flexure_damping, side,
                   work.resistance, work.constant_change, work.matrix[slot])
        work.key[slot] = key
    return slot


@internal
def walk(plant, state, work, u, start, end, level):
    """Walk from tick ``start`` to tick ``end`` of the period with the amplifier at ``u``, beginning at ``level``."""
    not_inlined()
    slot = slot_of(plant, state, work)
    base = plant.base_level
    position = start
    event_before = end if level > base else np.int64(-1)       # a chunk that ends here is known to hold an event
    while position < end:
        size = TICKS >> level
        while size > end - position or (position & (size - 1)) != 0:
            level += 1
            size >>= 1
        if position + size == event_before and level < LEVELS - 1:
            level += 1
            continue
        done = _chunk(plant, state, work, u, slot, level)
        if done == EVENT or done == COARSE:
            if done == EVENT:
                event_before = position + size
            level += 1
            continue
        position += size
        if done == EVENT_AT_END:
            _switch(plant, state, work)
            slot = _mode(plant, state, work)
            work.slot = slot
        while level > base and (position & (2 * size - 1)) == 0:       # the longest chunk that begins here
            level -= 1
            size *= 2


@internal
def _switch(plant, state, work):
    """Carry out the events that the finest chunk ended on."""
    not_inlined()
    a, g, ca, cg = plant.actuator, plant.guideway, state.actuator, state.guideway
    if ca.slip_weight > 0.0 and state.omega * ca.direction < 0.0:
        stick_all(a, ca)
    elif ca.mask != 0:
        release(a, ca, work.turned, state.omega * plant.per_gear)
    if cg.slip_weight > 0.0 and state.v * cg.direction < 0.0:
        stick_all(g, cg)
    elif cg.mask != 0:
        release(g, cg, work.moved, state.v)
    if plant.gap > 0.0:
        d = _play(plant, state.theta, state.x)
        state.side = 1 if d > 0.5 * plant.gap else (-1 if d < -0.5 * plant.gap else 0)


@internal
def _chunk(plant, state, work, u, slot, level):
    """Try one chunk: DONE, or EVENT_AT_END of the finest; else nothing has changed: EVENT inside, or too COARSE."""
    g, ca, cg = plant.guideway, state.actuator, state.guideway
    m = work.matrix
    h = plant.period * SHARE[level]
    torque, force = _steady_forces(plant, state, h)
    pull, f0, fade = -ca.direction * ca.slip_weight, ca.slip_force, 1.0
    grow = ca.slip_change * SHARE[level]
    slipping = ca.slip_weight > 0.0
    if slipping and math.isinf(plant.actuator.attraction):
        f0 = slip_level(plant.actuator, ca, state.omega * plant.per_gear)
    f1 = f0
    t0, t1 = torque + pull * f0, pull * grow
    push = force - cg.direction * cg.slip_weight * cg.slip_force
    if any_law(work):   # integrated by extrapolation over short chunks (Adams–Bashforth)
        t0 -= ca.law_force
        t1 -= ca.law_force - ca.law_before
        push -= cg.law_force
    rows = mode_rows(m, slot, level, state.current, state.omega, state.v, u, t0, t1, push)
    if slipping:
        d1, d2, f1, fade, coarse = _slip(plant, state, rows, f0, grow, h, level)
        if coarse:
            return COARSE
        rows = add_columns(rows, m, slot, level, T1, d1, T2, d2)
    if g.drops == 1 and cg.slip_weight > 0.0:
        rise = -cg.direction * cg.slip_weight * (_guide_slip(plant, cg, state.v, rows[O_V], h)[0] - cg.slip_force)
        rows = add_columns(rows, m, slot, level, F1, rise, F1, 0.0)
    if any_law(work):
        rows = add_columns(rows, m, slot, level, F1, cg.law_before - cg.law_force, F1, 0.0)
    event = _event(plant, state, rows)
    if event:
        if level < LEVELS - 1:
            return EVENT
        work.turned, work.moved = rows[O_THETA], rows[O_X]
    _accept(plant, state, work, rows, f1, f1 - f0, fade, h, level)
    return EVENT_AT_END if event else DONE


@inlined_before_typing
def _slip(plant, state, rows, f0, grow, h, level):
    """(what `corrections` gives, slip force at the end, decay of its offsets, too COARSE) of a chunk.

    Its ``rows`` were guessed.
    """
    a, ca, omega0 = plant.actuator, state.actuator, state.omega
    pull = -ca.direction * ca.slip_weight
    to_mid, to_end, reach = rows[O_OMEGA_MID] - omega0, rows[O_OMEGA] - omega0, NEAR * abs(omega0)
    if a.smooth_slip == 1 and abs(to_mid) <= reach and abs(to_end) <= reach:
        s, per_s, slope, bend = limit_and_slopes(a, abs(omega0) * plant.per_gear)
        level_factor = ca.factor * direction_factor(a, ca.direction)
        k1, k2 = change_of_rate(s, slope, bend, ca.direction * plant.per_gear)
        mid, mid_m, mid_1, end, end_m, end_1, fade = near(a.attraction * h / level_factor * per_s, f0, s * level_factor)
        linear, square = corrections_near((mid, mid_m, mid_1, end, end_m, end_1), pull, f0, grow)
        by_mid, by_end = change(k1, k2, to_mid), change(k1, k2, to_end)
        f1 = with_change((end, end_m, end_1), by_mid, by_end)
        return with_change(linear, by_mid, by_end), with_change(square, by_mid, by_end), f1, fade, False
    f_mid, f1, fade, bent = far(plant, ca, omega0, rows[O_OMEGA_MID], rows[O_OMEGA], f0, h)
    d1, d2 = corrections(pull, f0, f_mid, f1, grow)
    return d1, d2, f1, fade, bent and level < FINEST_BEND


@internal
def _guide_slip(plant, c, v0, v1, h):
    """(slip force of the guideway after a chunk in which its velocity goes from v0 to v1, decay of its offsets)."""
    g = plant.guideway
    s1 = slip_level(g, c, v1)
    if math.isinf(g.attraction):
        return s1, 0.0
    s0 = slip_level(g, c, v0)
    _, force, fade = relax(g.attraction, c.slip_force, s0, slip_level(g, c, 0.5 * (v0 + v1)), s1, h)
    return force, fade


@inlined_before_typing
def _steady_forces(plant, state, h):
    """(torque at the motor, force at the stage) that do not depend on the slip, about the chunk's middle."""
    torque, force = -stuck_force(state.actuator), plant.push - stuck_force(state.guideway)
    if plant.plain == 1:
        spring = plant.stiffness * (plant.ratio * state.theta - state.x)
        return torque - plant.ratio * spring, force + spring
    more_torque, more_force = _other_forces(plant, state, h)
    return torque + more_torque, force + more_force


@internal
def _other_forces(plant, state, h):
    """Torque and force of the drive train with backlash or errors of the lead, of cables, and of what is smooth."""
    not_inlined()
    torque, force = 0.0, 0.0
    if plant.rigid == 0 and state.side != 0:
        d = plant.ratio * state.theta - state.x - 0.5 * plant.gap * state.side
        if plant.leads > 0 or plant.lead_slope != 0.0:
            d += lead_error(plant, (state.theta + 0.5 * h * state.omega) / plant.gear)
        torque, force = -plant.ratio * plant.stiffness * d, plant.stiffness * d
    force -= plant.cable * (state.x + 0.5 * h * state.v - plant.anchor) + plant.flexure * state.x
    if plant.smooth == 1:
        torque += _smooth_torque(plant, state.theta + 0.5 * h * state.omega, state.omega)
        if plant.pulls == 1:
            torque += drive_torque(plant, state, state.theta + 0.5 * h * state.omega, state.omega)
        force -= _beyond_viscous(plant.guideway, state.v)
        force += effect_force(plant, state.x + 0.5 * h * state.v, state.v, state.time)
    return torque, force


@compiled
def lead_error(plant, phi):
    """Error of the lead at screw angle φ [m]."""
    error = plant.lead_slope * plant.screw_ratio * phi
    for k in range(plant.leads):
        error += plant.lead_amplitude[k] * math.sin(plant.lead_number[k] * phi + plant.lead_phase[k])
    return error


@internal
def _play(plant, theta, x):
    """How far [m] the motor at angle θ is ahead of a stage at x: r φ/N and the error of the lead there, less x.

    A flank is touched where it exceeds half of the gap.
    """
    d = plant.ratio * theta - x
    if plant.leads > 0 or plant.lead_slope != 0.0:
        d += lead_error(plant, theta / plant.gear)
    return d


@internal
def _smooth_torque(plant, theta, omega):
    """Cogging and nonlinear viscous torque at the motor [N m]."""
    torque = -_beyond_viscous(plant.actuator, omega / plant.gear)
    for k in range(plant.cogs):
        torque += plant.cog_amplitude[k] * math.sin(plant.cog_number[k] * theta + plant.cog_phase[k])
    return torque


@internal
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


@inlined_before_typing
def _event(plant, state, rows):
    """Whether the tried chunk holds an event: a reversal in slip, a block at its limit, the gap's edge."""
    ca, cg = state.actuator, state.guideway
    if ca.slip_weight > 0.0 and rows[O_OMEGA] * ca.direction < 0.0:
        return True
    if cg.slip_weight > 0.0 and rows[O_V] * cg.direction < 0.0:
        return True
    if ca.mask != 0 and crosses(plant.actuator, ca, rows[O_THETA] * plant.per_gear, rows[O_OMEGA] * plant.per_gear):
        return True
    if cg.mask != 0 and crosses(plant.guideway, cg, rows[O_X], rows[O_V]):
        return True
    if plant.gap > 0.0:
        d = _play(plant, state.theta + rows[O_THETA], state.x + rows[O_X])
        side = 1 if d > 0.5 * plant.gap else (-1 if d < -0.5 * plant.gap else 0)
        return side != state.side
    return False


@inlined_before_typing
def _accept(plant, state, work, rows, f1, gained, fade, h, level):
    """Take the tried chunk: new state, stretched blocks, relaxed slip force, which ``gained`` so much."""
    a, g, ca, cg = plant.actuator, plant.guideway, state.actuator, state.guideway
    if any_law(work):
        if a.law > 0:
            follow_law(work, a, ca, state.omega * plant.per_gear, rows[O_OMEGA] * plant.per_gear, h)
        if g.law > 0:
            follow_law(work, g, cg, state.v, rows[O_V], h)
    if g.drops == 1 and cg.slip_weight > 0.0:
        cg.slip_force, fade_g = _guide_slip(plant, cg, state.v, rows[O_V], h)
        cg.slip_offset = forgotten(cg.slip_offset * fade_g)
    state.current, state.omega, state.v = rows[O_I], rows[O_OMEGA], rows[O_V]
    state.theta += rows[O_THETA]
    state.x += rows[O_X]
    if ca.mask != 0:
        ca.stretch += rows[O_THETA] * plant.per_gear
    if cg.mask != 0:
        cg.stretch += rows[O_X]
    if ca.slip_weight > 0.0:
        ca.slip_force, ca.slip_change = f1, gained * COUNT[level]
        ca.slip_offset = forgotten(ca.slip_offset * fade)
    if a.follows == 1 or g.follows == 1:
        _follow(plant, state, h)


@internal
def _follow(plant, state, h):
    """Let lagging limits follow the velocities, and a guideway's slip force its limit."""
    not_inlined()
    a, g, ca, cg = plant.actuator, plant.guideway, state.actuator, state.guideway
    if a.lag > 0.0:
        ca.lagged += (abs(state.omega) * plant.per_gear - ca.lagged) * (1.0 - decay(h / a.lag))
    if g.drops == 1 or g.lag > 0.0:
        cg.lagged += (abs(state.v) - cg.lagged) * (1.0 - decay(h / max(g.lag, 1e-12)))
        settle_limit(g, cg, state.v)
