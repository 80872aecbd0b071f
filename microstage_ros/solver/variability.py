"""What scales the friction limits from period to period: chance, position, dwell; and creep.

Random friction: q = q_travel + q_time, two Ornstein–Uhlenbeck processes, one over the travel of the
stage and one over time, clipped. They are advanced exactly, whenever the
stage has moved by a small part of the length or a small part of the time has passed.
"""

import math

from microstage_ros.model.plant_record import PROFILE
from microstage_ros.numerics.compiled import compiled, inlined_before_typing, internal, not_inlined
from microstage_ros.numerics.random import normal
from microstage_ros.solver.contact import regroup
from microstage_ros.solver.slip import decay

TRAVEL_STEP = 1 / 2000         # of the correlation length: `records.PLANT`'s random_travel_step
TIME_STEP = 1 / 10000          # of the correlation time: random_time_step


@compiled
def vary(plant, state):
    """Set the limit factor of both contacts for the coming period."""
    if waited(plant, state, state.v):
        vary_now(plant, state)


@inlined_before_typing
def waited(plant, state, v):
    """Count the coming period at stage velocity v; whether `vary_now` is to be called."""
    state.random_travel += abs(plant.period * v)
    state.random_wait += plant.period
    due = state.random_travel > plant.random_travel_step or state.random_wait > plant.random_time_step
    return plant.modulated == 1 or due


@internal
def vary_now(plant, state):
    """`vary` when something has changed."""
    not_inlined()
    travel, wait = 0.0, 0.0
    if state.random_travel > plant.random_travel_step:
        travel, state.random_travel = state.random_travel, 0.0
    if state.random_wait > plant.random_time_step:
        wait, state.random_wait = state.random_wait, 0.0
    by_travel = _pace(travel / plant.random_length)
    by_time = _pace(wait / plant.random_time)
    _vary_contact(plant, plant.actuator, state.actuator, state, by_travel, by_time)
    _vary_contact(plant, plant.guideway, state.guideway, state, by_travel, by_time)


@internal
def _vary_contact(plant, contact, c, state, by_travel, by_time):
    if contact.random > 0.0:
        _random_walk(plant, contact, c, state, by_travel, by_time)
    factor = contact.level * (1.0 + c.q)
    if plant.modulated == 1:
        moved = abs(plant.period * state.v)
        factor *= _profile(contact, state.x + 0.5 * plant.period * state.v) * (1.0 + _age(plant, contact, c, moved))
        if contact.creep_amplitude > 0.0:
            _creep(contact, c, plant.period, moved)
        if c.mask != 0:
            regroup(contact, c)
    if math.isinf(contact.attraction):
        c.slip_force *= factor / c.factor
    c.factor = factor
    if factor < c.least_factor:
        c.guard = -1.0


@inlined_before_typing
def _pace(step):
    """(what is kept, share of chance) of an Ornstein–Uhlenbeck process a ``step`` later, exact in law.

    ``step`` is in the process's own length.
    """
    if step == 0.0:
        return 1.0, 0.0
    keep = decay(step)
    return keep, math.sqrt(1.0 - keep * keep)


@inlined_before_typing
def _random_walk(plant, contact, c, state, by_travel, by_time):
    """Advance q by the paces of its two processes, each where it has one."""
    if by_travel[1] > 0.0:
        c.q_travel = by_travel[0] * c.q_travel + contact.random * plant.random_share_root * by_travel[1] * normal(
            state.random
        )
    if by_time[1] > 0.0:
        c.q_time = by_time[0] * c.q_time + contact.random * plant.random_rest_root * by_time[1] * normal(state.random)
    c.q = min(max(c.q_travel + c.q_time, -plant.random_clip), plant.random_clip)


@internal
def _profile(contact, x):
    """Factor of the limits at stage position x."""
    not_inlined()
    factor = 1.0
    for k in range(contact.ripples):
        factor += contact.ripple_amplitude[k] * math.sin(contact.ripple_number[k] * x + contact.ripple_phase[k])
    if contact.profiled == 1:
        place = (x - contact.profile_low) / (contact.profile_high - contact.profile_low) * PROFILE
        place = min(max(place, 0.0), PROFILE - 1e-9)
        cell = int(place)
        factor *= contact.profile[cell] + (place - cell) * (contact.profile[cell + 1] - contact.profile[cell])
    return factor


@internal
def _age(plant, contact, c, moved):
    """Relative growth of the limits by dwell; travel wipes it out."""
    not_inlined()
    if contact.aging_rate == 0.0:
        return 0.0
    if c.mask != 0 or contact.law > 0:        # without blocks nothing says what sticks: travel alone tells
        c.dwell += plant.period
    fade = math.exp(-moved / contact.aging_release)
    c.dwell *= fade
    c.aged = max(c.aged * fade, contact.aging_rate * math.log10(1.0 + c.dwell / contact.aging_time))
    return c.aged


@internal
def _creep(contact, c, period, moved):
    """Flow of the sticking blocks over one period, see `effects.friction.PreslidingCreep`."""
    not_inlined()
    regroup(contact, c)
    flow = contact.creep_amplitude * period / (c.held + contact.creep_time)
    c.held = (c.held + period) * math.exp(-moved / contact.creep_release)
    for j in range(contact.blocks):
        if c.stuck[j] == 1.0:
            c.force[j] *= 1.0 - min(contact.kappa[j] * flow / (c.factor * contact.static), 0.5)
