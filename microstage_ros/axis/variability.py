"""What scales the friction limits from period to period: chance, position, dwell; and creep.

Random friction: q = q_travel + q_time, two Ornstein–Uhlenbeck processes, one over the travel of the
stage and one over time, clipped. They are advanced exactly, whenever the
stage has moved by a small part of the length or a small part of the time has passed.
"""

import math

from microstage_ros.axis.compiled import compiled, inlined, internal, seldom
from microstage_ros.axis.contact import regroup
from microstage_ros.axis.random import normal
from microstage_ros.axis.records import PROFILE
from microstage_ros.axis.slip import decay

TRAVEL_STEP = 1 / 2000         # of the correlation length
TIME_STEP = 1 / 10000          # of the correlation time


@compiled
def vary(plant, state):
    """Set the limit factor of both contacts for the coming period."""
    middle = state.x + 0.5 * plant.period * state.v
    moved = abs(plant.period * state.v)
    _vary_contact(plant, plant.actuator, state.actuator, state, middle, moved)
    _vary_contact(plant, plant.guideway, state.guideway, state, middle, moved)


@inlined
def _vary_contact(plant, contact, c, state, x, moved):
    changed = plant.modulated == 1
    if contact.random > 0.0:
        changed |= _random_walk(plant, contact, c, state, moved)
    if not changed:
        return
    factor = contact.level * (1.0 + c.q)
    if plant.modulated == 1:
        factor *= _profile(contact, x) * (1.0 + _age(plant, contact, c, moved))
        if contact.creep_amplitude > 0.0:
            _creep(contact, c, plant.period, moved)
    change = factor / c.factor
    c.factor = factor
    if math.isinf(contact.attraction):
        c.slip_force *= change
    if c.mask != 0:
        regroup(contact, c)


@inlined
def _random_walk(plant, contact, c, state, moved):
    """Advance q if it is due; whether it was. Each of its parts in its own steps."""
    c.random_travel += moved
    c.random_wait += plant.period
    travel_due = c.random_travel > TRAVEL_STEP * plant.random_length
    time_due = c.random_wait > TIME_STEP * plant.random_time
    if travel_due:
        c.q_travel = _wander(c.q_travel, c.random_travel / plant.random_length, contact.random * plant.random_share_root, state)
        c.random_travel = 0.0
    if time_due:
        c.q_time = _wander(c.q_time, c.random_wait / plant.random_time, contact.random * plant.random_rest_root, state)
        c.random_wait = 0.0
    c.q = min(max(c.q_travel + c.q_time, -plant.random_clip), plant.random_clip)
    return travel_due or time_due


@inlined
def _wander(q, step, deviation, state):
    """An Ornstein–Uhlenbeck process of that standard deviation a ``step`` (in its own length) later, exact in law."""
    keep = decay(step)
    return keep * q + deviation * math.sqrt(1.0 - keep * keep) * normal(state.random)


@internal
def _profile(contact, x):
    """Factor of the limits at stage position x."""
    seldom()
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
    seldom()
    if contact.aging_rate == 0.0:
        return 0.0
    if c.mask != 0:
        c.dwell += plant.period
    fade = math.exp(-moved / contact.aging_release)
    c.dwell *= fade
    c.aged = max(c.aged * fade, contact.aging_rate * math.log10(1.0 + c.dwell / contact.aging_time))
    return c.aged


@internal
def _creep(contact, c, period, moved):
    """Flow of the sticking blocks over one period, see `effects.friction.PreslidingCreep`."""
    seldom()
    regroup(contact, c)
    flow = contact.creep_amplitude * period / (c.held + contact.creep_time)
    c.held = (c.held + period) * math.exp(-moved / contact.creep_release)
    for j in range(contact.blocks):
        if c.stuck[j] == 1.0:
            c.force[j] *= 1.0 - min(contact.kappa[j] * flow / (c.factor * contact.static), 0.5)
