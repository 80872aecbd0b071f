"""From the voltage command to the voltage at the motor: converter, amplifier, delay, warm winding."""

import math

import numpy as np

from microstage_ros.model.plant_record import DELAY
from microstage_ros.numerics.compiled import inlined_before_typing, internal
from microstage_ros.numerics.random import normal
from microstage_ros.solver.linear_core import TICKS
from microstage_ros.solver.vectors import fused

REBUILD = 2e-4                 # relative change of the resistance that remakes the matrices


@inlined_before_typing
def amplifier_output(plant, state, voltage):
    """u_a = clip(gain · dead(DAC(u) + offset) + noise): V at the motor, or N on a force-driven stage."""
    u = min(max(voltage, -plant.dac_range), plant.dac_range)
    if plant.quantum > 0.0:
        u = fused(plant.quantum, np.rint(u * plant.per_quantum), plant.amplifier_offset)
    else:
        u += plant.amplifier_offset
    if plant.dead_half > 0.0:
        u = math.copysign(max(abs(u) - plant.dead_half, 0.0), u)
    u *= plant.gain
    if plant.amplifier_noise > 0.0:
        u += plant.amplifier_noise * normal(state.random)
    return min(max(u, -plant.limit), plant.limit)


@internal
def delayed_output(plant, state, u):
    """(output until the split, output after it, split in ticks) of a delay by whole and broken periods."""
    state.pending[state.pending_at] = u
    late = plant.delay / plant.period
    whole = int(late)
    split = int(round((late - whole) * TICKS))
    now = state.pending[(state.pending_at - whole + DELAY) % DELAY]
    before = state.pending[(state.pending_at - whole - 1 + DELAY) % DELAY]
    state.pending_at = (state.pending_at + 1) % DELAY
    return before, now, split


@internal
def lag_output(plant, state, target, share):
    """Mean output of a lagging amplifier over a ``share`` of the period; moves its state to the end of it."""
    pace = share * plant.period / plant.actuator_lag
    fade = math.exp(-pace)
    gap = state.lagged_voltage - target
    state.lagged_voltage = target + gap * fade
    return target + gap * (1.0 - fade) / pace


@internal
def warm_up(plant, state, work):
    """dh/dt = rise R i² − h/τ over one period; matrices of another resistance are dropped."""
    power = plant.resistance * (1.0 + state.heat) * state.current * state.current
    state.heat += plant.period * (plant.rise_per_joule * power - state.heat / plant.rise_time)
    resistance = plant.resistance * (1.0 + state.heat)
    if not abs(resistance - work.resistance) <= REBUILD * plant.resistance:
        work.key[:] = -1
        work.slot = -1
        work.resistance = resistance
