"""The compiled step: one control period of the axis, exact between friction events.

A period without an event is one small matrix product and the slip's few products (`quiet`); any other is walked in
chunks (`walk`).
"""

import numpy as np

from microstage_ros.numerics.compiled import compiled, inlined_before_typing, internal, not_inlined, always_inlined
from microstage_ros.solver.amplifier import amplifier_output, delayed_output, lag_output, warm_up
from microstage_ros.solver.contact import block_force
from microstage_ros.solver.drive import shape_command
from microstage_ros.solver.event_free import (
    COARSE,
    EVENT,
    LOOKED,
    EVENT_FREE,
    write_state,
    held_of,
    moving_of,
    try_period,
)
from microstage_ros.solver.event_step import slot_of, walk
from microstage_ros.solver.linear_core import TICKS
from microstage_ros.solver.variability import vary_now, waited

LAG_SPANS = 16                 # pieces of a period in which a lagging amplifier's output is constant


@compiled
def advance(plant, state, work, voltage):
    """One control period T with ``voltage`` (V, before the converter) held.

    ``plant``: record `PLANT`; ``state``: record `STATE`, changed in place; ``work``: see `linear_core.new_work`.
    """
    moving, held = read_state(plant, state, work)
    moving, held = advance_in_registers(plant, state, work, moving, held, voltage)
    write_state(state, moving)


@inlined_before_typing
def read_state(plant, state, work):
    """(`event_free.Moving`, `event_free.Held`) of a state, for `advance_in_registers`."""
    return moving_of(state), held_of(plant, state, slot_of(plant, state, work))


@always_inlined
def advance_in_registers(plant, state, work, moving, held, voltage):
    """`advance` on what `read_state` gave.

    Returns the same a period later. `event_free.write_state` brings the state up to date.
    """
    u = amplifier_output(plant, state, voltage)
    if plant.varies == 1 and waited(plant, state, moving.v):
        write_state(state, moving)
        vary_now(plant, state)
        moving, held = read_state(plant, state, work)
    after, found = moving, EVENT
    if plant.quick == 1:
        state.voltage = u
        after, found = try_period(plant, state, work, moving, held, u)
    if found == EVENT_FREE:
        moving = after
    elif found == LOOKED:
        moving, held = after, held_of(plant, state, held.slot)
    else:
        write_state(state, after)
        _other_period(plant, state, work, u, found)
        moving, held = read_state(plant, state, work)
    state.time += plant.period
    state.periods += 1
    return moving, held


@internal
def quick_period(plant, state, work, u):
    """`advance` of a plant that is ``quick``, from the amplifier's output on."""
    not_inlined()
    state.voltage = u
    moving, held = read_state(plant, state, work)
    after, found = try_period(plant, state, work, moving, held, u)
    write_state(state, after)
    if found == EVENT or found == COARSE:
        _other_period(plant, state, work, u, found)


@internal
def _other_period(plant, state, work, u, found):
    """A period that is not quiet; ``found``: what `try_period` said of it, if it was tried."""
    not_inlined()
    if plant.quick == 1:
        start = found - found                # not a literal: numba would compile once more for it
        walk(plant, state, work, u, start, start + TICKS, start + (found == EVENT))
    else:
        _advance_pieces(plant, state, work, u)


@internal
def _advance_pieces(plant, state, work, u):
    """A period whose voltage changes inside it (delay, lag), or that is always walked in parts."""
    not_inlined()
    if plant.shaped == 1:
        u = shape_command(plant, state, work, u)
    late, split, pieces = u, 0, 1
    if plant.electrical == 1:
        warm_up(plant, state, work)
        late, u, split = delayed_output(plant, state, u)
        pieces = LAG_SPANS if plant.actuator_lag > 0.0 else 2
    start = np.int64(0)
    for k in range(pieces):
        end = np.int64(TICKS)
        if pieces == 2 and k == 0:
            end = np.int64(split)
        elif pieces > 2:
            end = np.int64((k + 1) * TICKS // pieces)
        target = late if start < split else u
        if plant.actuator_lag > 0.0:
            state.voltage = lag_output(plant, state, target, (end - start) / TICKS)
        else:
            state.voltage = target
        walk(plant, state, work, state.voltage, start, end, plant.base_level)
        start = end


@internal
def note_friction(plant, state):
    """Write the friction of both contacts at this moment into the state [N m at the motor, N]."""
    state.torque_friction = block_force(state.actuator) + plant.actuator.viscous * state.omega * plant.per_gear
    state.guide_friction = block_force(state.guideway) + plant.guideway.viscous * state.v


