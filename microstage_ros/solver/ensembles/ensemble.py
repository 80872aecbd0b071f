"""Axes stepped side by side, one per lane of a processor's vector: the quiet periods of an ensemble.

The chain from speed to slip force to speed leaves a processor waiting most of a period; in lanes the axes share the
wait. A period that is quiet, one chunk without an event, is done for all lanes at once by the formulas of `step`. An
axis with an event in it does that period alone (`step.quick_period`). Either way its result is, to the bit, what it
would be by itself.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from microstage_ros.model.plant_record import INPUTS
from microstage_ros.numerics.compiled import compiled, inlined_before_typing, internal, not_inlined, always_inlined
from microstage_ros.numerics.random import normal
from microstage_ros.solver.contact import ENTRIES, FRACTION_BITS, START_MASK, cubics
from microstage_ros.solver.ensembles.lanes import LANES, choose, lanes_set, load, nearest, store, table_pieces
from microstage_ros.solver.event_free import Moving, write_state, guard_of, slip_of
from microstage_ros.solver.linear_core import (
    F0,
    O_I,
    O_OMEGA,
    O_OMEGA_MID,
    O_THETA,
    O_V,
    O_X,
    OMEGA,
    T0,
    T1,
    T2,
    I,
    U,
    V,
    aligned,
    forget,
    new_works,
)
from microstage_ros.solver.slip import (
    LEAST_OFFSET,
    NEAR,
    SERIES_END,
    change,
    change_of_rate,
    corrections_near,
    decay_series,
    near_with,
    with_change,
)
from microstage_ros.solver.step import advance_in_registers, quick_period, read_state
from microstage_ros.solver.variability import vary_now
from microstage_ros.solver.vectors import fused

ROWS = 6
ALL = (1 << LANES) - 1
#: Rows of ``numbers`` (len(NUMBERS), LANES): the state, what a mode keeps, and the plants' own.
NUMBERS = (
    "current", "omega", "v", "theta", "x", "time", "voltage",
    "a_force", "a_stiffness", "a_stretch", "a_ahead", "a_behind", "a_guard",
    "g_force", "g_stiffness", "g_stretch", "g_ahead", "g_behind", "g_guard",
    "slip_force", "slip_change", "slip_offset", "pull", "direction", "turn", "slip_level", "pace", "guide_slip",
    "guide_direction",
    "random_travel", "random_wait", "random_travel_step", "random_time_step",
    "period", "ratio", "per_gear", "spring", "push",
    "dac_range", "quantum", "per_quantum", "amplifier_offset", "gain", "limit", "noise",
)
(CURRENT, SPEED, STAGE_SPEED, THETA, X, TIME, VOLTAGE,
 A_FORCE, A_STIFFNESS, A_STRETCH, A_AHEAD, A_BEHIND, A_GUARD, G_FORCE, G_STIFFNESS, G_STRETCH, G_AHEAD, G_BEHIND,
 G_GUARD,
 SLIP_FORCE, SLIP_CHANGE, SLIP_OFFSET, PULL, DIRECTION, TURN, SLIP_LEVEL, PACE, GUIDE_SLIP, GUIDE_DIRECTION,
 RANDOM_TRAVEL, RANDOM_WAIT, TRAVEL_STEP, TIME_STEP,
 PERIOD, RATIO, PER_GEAR, SPRING, PUSH,
 DAC_RANGE, QUANTUM, PER_QUANTUM, OFFSET, GAIN, LIMIT, NOISE) = range(len(NUMBERS))


def respond_batch(plants, voltage, states, threads=2):
    """Advance many axes (arrays of `PLANT` and `STATE` records, states changed in place) by the same voltage.

    ``plants`` and ``states``: shape (axes,); ``voltage`` (periods,) [V].
    ``threads`` [1]: the axes are shared out over so many; the result depends neither on it nor on the other axes.
    """
    voltage = np.ascontiguousarray(voltage, float)
    works = [new_works(LANES, plants) for _ in range(threads)]
    shares = zip(np.array_split(plants, threads), np.array_split(states, threads), works)
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(lambda share: run_share(*share, new_space(), voltage), shares))


def new_space():
    """(numbers, matrix, addresses and first cells of the tables) of one group of `LANES` axes."""
    return aligned(float, len(NUMBERS), LANES), aligned(float, INPUTS * ROWS, LANES), aligned(np.int64, 2, LANES)


@compiled
def run_share(plants, states, works, space, voltage):
    """Hold ``voltage`` [V] (one per period) on all axes, ``works``: `LANES` records, ``space``: `new_space`."""
    first = 0
    while first < len(plants):
        count = min(LANES, len(plants) - first)
        if count > 1 and _may_share(plants[first : first + count]):
            _run_group(plants[first : first + count], states[first : first + count], works, space, voltage)
        else:
            count = 1
            _run_alone(plants[first], states[first], works[0], voltage)
        first += count


@internal
def _run_alone(plant, state, work, voltage):
    not_inlined()
    forget(work)
    moving, held = read_state(plant, state, work)
    for n in range(voltage.size):
        moving, held = advance_in_registers(plant, state, work, moving, held, voltage[n])
    write_state(state, moving)


@internal
def _may_share(plants):
    """Whether these plants have nothing but what the lanes know: noise, random friction, any parameters."""
    for plant in plants:
        if plant.quick == 0 or plant.modulated == 1 or plant.dead_half > 0.0:
            return False
    return True


@internal
def _run_group(plants, states, works, space, voltage):
    not_inlined()
    numbers, matrix, tables = space
    rows, columns, places = numbers.ctypes.data, matrix.ctypes.data, tables.ctypes.data
    numbers[:] = 0.0
    matrix[:] = 0.0
    for row in (A_AHEAD, A_BEHIND, A_GUARD, G_AHEAD, G_BEHIND, G_GUARD):       # a lane without an axis has no events
        numbers[row] = np.inf
    noisy, varies = False, False
    for k in range(len(plants)):
        plant = plants[k]
        forget(works[k])
        tables[0, k], tables[1, k] = plant.actuator.sliding.ctypes.data, plant.actuator.first_cell
        _take_plant(plant, numbers, k)
        numbers[TIME, k], numbers[RANDOM_TRAVEL, k], numbers[RANDOM_WAIT, k] = (
            states[k].time,
            states[k].random_travel,
            states[k].random_wait,
        )
        _take(plant, states[k], works[k], numbers, matrix, k)
        noisy |= plant.amplifier_noise > 0.0
        varies |= plant.varies == 1
    for k in range(len(plants), LANES):
        tables[:, k] = tables[:, 0]
    for n in range(voltage.size):
        if noisy:
            for k in range(len(plants)):
                if plants[k].amplifier_noise > 0.0:
                    numbers[NOISE, k] = plants[k].amplifier_noise * normal(states[k].random)
        if varies:
            due = _waited(rows)
            if due:
                _vary_lanes(plants, states, works, numbers, due)
        ahead, f1, fade, rough = _period(rows, columns, places, voltage[n])
        if rough:
            _store(states, numbers, rough)
        _keep(rows, ahead, f1, fade)
        if rough:
            _periods_alone(plants, states, works, numbers, matrix, rough)
    _store(states, numbers, ALL)
    for k in range(len(plants)):
        states[k].time = numbers[TIME, k]
        states[k].periods += voltage.size
        if plants[k].varies == 1:
            states[k].random_travel, states[k].random_wait = numbers[RANDOM_TRAVEL, k], numbers[RANDOM_WAIT, k]


@internal
def _periods_alone(plants, states, works, numbers, matrix, which):
    """The period of the lanes ``which`` (bit k: lane k), whose states are as at its start."""
    not_inlined()
    for k in range(len(plants)):
        if (which >> k) & 1:
            quick_period(plants[k], states[k], works[k], numbers[VOLTAGE, k])
            _take(plants[k], states[k], works[k], numbers, matrix, k)


@internal
def _take_plant(plant, numbers, k):
    """The plant's numbers into lane k."""
    numbers[PERIOD, k], numbers[RATIO, k], numbers[PER_GEAR, k] = plant.period, plant.ratio, plant.per_gear
    numbers[TRAVEL_STEP, k] = plant.random_travel_step if plant.varies == 1 else np.inf
    numbers[TIME_STEP, k] = plant.random_time_step if plant.varies == 1 else np.inf
    numbers[SPRING, k], numbers[PUSH, k] = plant.stiffness, plant.push
    numbers[DAC_RANGE, k], numbers[QUANTUM, k], numbers[PER_QUANTUM,
                                                        k] = plant.dac_range, plant.quantum, plant.per_quantum
    numbers[OFFSET, k], numbers[GAIN, k], numbers[LIMIT, k] = plant.amplifier_offset, plant.gain, plant.limit


@internal
def _take(plant, state, work, numbers, matrix, k):
    """The state and its mode's matrix of a whole period into lane k."""
    not_inlined()
    moving, held = read_state(plant, state, work)
    numbers[CURRENT, k], numbers[SPEED, k], numbers[STAGE_SPEED, k] = moving.current, moving.omega, moving.v
    numbers[THETA, k], numbers[X, k] = moving.theta, moving.x
    numbers[A_STRETCH, k], numbers[G_STRETCH, k] = moving.a_stretch, moving.g_stretch
    numbers[SLIP_FORCE, k], numbers[SLIP_CHANGE, k], numbers[SLIP_OFFSET, k] = (
        moving.slip_force,
        moving.slip_change,
        moving.slip_offset,
    )
    numbers[PULL, k], numbers[DIRECTION, k], numbers[TURN, k] = held.pull, held.direction, held.turn
    numbers[GUIDE_DIRECTION, k] = held.guide_direction
    numbers[A_FORCE, k], numbers[A_STIFFNESS, k], numbers[A_AHEAD, k], numbers[A_BEHIND, k] = (
        held.a_force, held.a_stiffness, held.a_ahead, held.a_behind)
    numbers[G_FORCE, k], numbers[G_STIFFNESS, k], numbers[G_AHEAD, k], numbers[G_BEHIND, k] = (
        held.g_force, held.g_stiffness, held.g_ahead, held.g_behind)
    numbers[SLIP_LEVEL, k], numbers[PACE, k], numbers[GUIDE_SLIP, k] = held.slip_level, held.pace, held.guide_slip
    numbers[A_GUARD, k], numbers[G_GUARD, k] = held.a_guard, held.g_guard
    for j in range(INPUTS):
        for row in range(ROWS):
            matrix[j * ROWS + row, k] = work.matrix[held.slot, 0, j, row]


@internal
def _vary_lanes(plants, states, works, numbers, which):
    """Random friction a step on, of the lanes ``which`` (bit k: lane k)."""
    not_inlined()
    for k in range(len(plants)):
        if (which >> k) & 1:
            state = states[k]
            state.random_travel, state.random_wait = numbers[RANDOM_TRAVEL, k], numbers[RANDOM_WAIT, k]
            vary_now(plants[k], state)
            numbers[RANDOM_TRAVEL, k], numbers[RANDOM_WAIT, k] = state.random_travel, state.random_wait
            numbers[SLIP_LEVEL, k], numbers[PACE, k], numbers[GUIDE_SLIP, k] = slip_of(plants[k], state)
            numbers[A_GUARD, k], numbers[G_GUARD, k] = guard_of(state.actuator), guard_of(state.guideway)


@internal
def _store(states, numbers, which):
    """The lanes ``which`` (bit k: lane k) back into their states."""
    not_inlined()
    for k in range(len(states)):
        if (which >> k) & 1:
            states[k].voltage = numbers[VOLTAGE, k]
            write_state(states[k], Moving(
                numbers[CURRENT, k], numbers[SPEED, k], numbers[THETA, k], numbers[STAGE_SPEED, k], numbers[X, k],
                numbers[A_STRETCH, k], numbers[G_STRETCH, k], numbers[SLIP_FORCE, k], numbers[SLIP_CHANGE, k],
                numbers[SLIP_OFFSET, k]))


@always_inlined
def _waited(numbers):
    """`variability.waited`: the lanes that are due, bit k: lane k."""
    travel = load(numbers, RANDOM_TRAVEL) + abs(load(numbers, PERIOD) * load(numbers, STAGE_SPEED))
    wait = load(numbers, RANDOM_WAIT) + load(numbers, PERIOD)
    store(numbers, RANDOM_TRAVEL, travel)
    store(numbers, RANDOM_WAIT, wait)
    return lanes_set((travel > load(numbers, TRAVEL_STEP)) | (wait > load(numbers, TIME_STEP)))


@always_inlined
def _period(numbers, matrix, tables, voltage):
    """One period of all lanes: (rows, slip force, decay of its offsets, lanes that are not quiet: bit k, lane k)."""
    u = _amplified(numbers, voltage)
    omega0, v0, direction = load(numbers, SPEED), load(numbers, STAGE_SPEED), load(numbers, DIRECTION)
    spring = load(numbers, SPRING) * (load(numbers, RATIO) * load(numbers, THETA) - load(numbers, X))
    pull, f0 = load(numbers, PULL), load(numbers, SLIP_FORCE)
    grow = load(numbers, SLIP_CHANGE)
    t0 = (-_stuck_force(numbers, A_FORCE, A_STIFFNESS, A_STRETCH) - load(numbers, RATIO) * spring) + pull * f0
    push = (load(numbers, PUSH) - _stuck_force(numbers, G_FORCE, G_STIFFNESS, G_STRETCH) + spring) - load(numbers,
                                                                                                          GUIDE_SLIP)
    rows = _rows(matrix, load(numbers, CURRENT), omega0, v0, u, t0, pull * grow, push)
    no_event_yet, f1, fade = direction == direction, f0, load(numbers, SLIP_OFFSET)
    if lanes_set(direction == 0.0) != ALL:
        rows, no_event_yet, f1, fade = _slip(numbers, matrix, tables, rows, omega0, direction, pull, f0, grow)
    rough = ALL - lanes_set(no_event_yet & _no_event(numbers, rows))
    return rows, f1, fade, rough


@inlined_before_typing
def _stuck_force(numbers, force, stiffness, stretch):
    """`contact.stuck_force`."""
    return fused(load(numbers, stiffness), load(numbers, stretch), load(numbers, force))


@inlined_before_typing
def _amplified(numbers, voltage):
    """`amplifier.amplifier_output`."""
    span, quantum, limit = load(numbers, DAC_RANGE), load(numbers, QUANTUM), load(numbers, LIMIT)
    u = _clipped(voltage, span)
    offset = load(numbers, OFFSET)
    u = choose(quantum > 0.0, fused(quantum, nearest(u * load(numbers, PER_QUANTUM)), offset), u + offset)
    u = _clipped(u * load(numbers, GAIN) + load(numbers, NOISE), limit)
    store(numbers, VOLTAGE, u)
    return u


@inlined_before_typing
def _clipped(u, limit):
    low = choose(limit > u, u, limit)
    return choose(-limit < low, low, -limit)


@inlined_before_typing
def _rows(matrix, i, omega, v, u, t0, t1, f0):
    """`vectors.mode_rows`."""
    return (
        _row(matrix, O_I, i, omega, v, u, t0, t1, f0), _row(matrix, O_OMEGA, i, omega, v, u, t0, t1, f0),
        _row(matrix, O_THETA, i, omega, v, u, t0, t1, f0), _row(matrix, O_V, i, omega, v, u, t0, t1, f0),
        _row(matrix, O_X, i, omega, v, u, t0, t1, f0), _row(matrix, O_OMEGA_MID, i, omega, v, u, t0, t1, f0),
    )


@inlined_before_typing
def _row(matrix, row, i, omega, v, u, t0, t1, f0):
    state = fused(_at(matrix, V, row), v, fused(_at(matrix, OMEGA, row), omega, _at(matrix, I, row) * i))
    driven = fused(_at(matrix, T0, row), t0, fused(_at(matrix, F0, row), f0, _at(matrix, T1, row) * t1))
    return fused(_at(matrix, U, row), u, state + driven)


@inlined_before_typing
def _at(matrix, column, row):
    return load(matrix, column * ROWS + row)


@inlined_before_typing
def _slip(numbers, matrix, tables, rows, omega0, direction, pull, f0, grow):
    """(rows, lanes that `slip.near` holds for, slip force at the end, decay of the offsets).

    As in `event_free.try_period`.
    """
    pieces = table_pieces(tables, abs(omega0) * load(numbers, PER_GEAR), FRACTION_BITS, START_MASK, ENTRIES)
    s, per_s, slope, bend = cubics(pieces[1], pieces[2:])
    level = load(numbers, SLIP_LEVEL)
    k1, k2 = change_of_rate(s, slope, bend, load(numbers, TURN))
    g = load(numbers, PACE) * per_s
    course = near_with(g, decay_series(0.5 * g), f0, s * level)
    to_mid, to_end, reach = rows[O_OMEGA_MID] - omega0, rows[O_OMEGA] - omega0, NEAR * abs(omega0)
    by_mid, by_end = change(k1, k2, to_mid), change(k1, k2, to_end)
    linear, square = corrections_near(course[:6], pull, f0, grow)
    d1, d2, f1 = with_change(linear, by_mid, by_end), with_change(square, by_mid, by_end), with_change(course[3:6],
                                                                                                       by_mid, by_end)
    slips = ~(direction == 0.0)
    near = pieces[0] & (0.5 * g < SERIES_END) & (abs(to_mid) <= reach) & (abs(to_end) <= reach)
    d1, d2 = choose(slips, d1, 0.0), choose(slips, d2, 0.0)
    offset = load(numbers, SLIP_OFFSET)
    less = offset * course[6]
    less = choose(less > LEAST_OFFSET, less, 0.0)      # `slip.forgotten`
    return (
        (_corrected(matrix, O_I, rows, d1, d2), _corrected(matrix, O_OMEGA, rows, d1, d2),
         _corrected(matrix, O_THETA, rows, d1, d2),
         _corrected(matrix, O_V, rows, d1, d2), _corrected(matrix, O_X, rows, d1, d2), rows[O_OMEGA_MID]),
        near | ~slips, choose(slips, f1, f0), choose(slips, less, offset),
    )


@inlined_before_typing
def _corrected(matrix, row, rows, d1, d2):
    return fused(_at(matrix, T2, row), d2, fused(_at(matrix, T1, row), d1, rows[row]))


@inlined_before_typing
def _no_event(numbers, rows):
    """Lanes without a reversal in slip and, for certain, without a block at its limit; see `event_free.try_period`."""
    on = rows[O_OMEGA] * load(numbers, DIRECTION) >= 0.0
    on = on & (rows[O_V] * load(numbers, GUIDE_DIRECTION) >= 0.0)
    turned, moved = _stretched(numbers, rows)
    on = on & ((turned < load(numbers, A_AHEAD)) | (rows[O_THETA] <= 0.0)) & ((-turned
                                                                               < load(numbers,
                                                                                      A_BEHIND)) | (rows[O_THETA]
                                                                                                    >= 0.0))
    on = on & ((moved < load(numbers, G_AHEAD)) | (rows[O_X] <= 0.0)) & ((-moved < load(numbers, G_BEHIND)) | (rows[O_X]
                                                                                                               >= 0.0))
    return on & (abs(rows[O_OMEGA]) * load(numbers, PER_GEAR) < load(numbers, A_GUARD)) & (abs(rows[O_V])
                                                                                           < load(numbers, G_GUARD))


@inlined_before_typing
def _stretched(numbers, rows):
    """Stretch of the sticking blocks of both contacts after the period."""
    return load(numbers, A_STRETCH) + rows[O_THETA] * load(numbers, PER_GEAR), load(numbers, G_STRETCH) + rows[O_X]


@inlined_before_typing
def _keep(numbers, rows, f1, fade):
    """What `event_free.try_period` returns, kept."""
    f0 = load(numbers, SLIP_FORCE)
    turned, moved = _stretched(numbers, rows)
    store(numbers, CURRENT, rows[O_I])
    store(numbers, SPEED, rows[O_OMEGA])
    store(numbers, STAGE_SPEED, rows[O_V])
    store(numbers, THETA, load(numbers, THETA) + rows[O_THETA])
    store(numbers, X, load(numbers, X) + rows[O_X])
    store(numbers, A_STRETCH, turned)
    store(numbers, G_STRETCH, moved)
    store(numbers, SLIP_FORCE, f1)
    store(numbers, SLIP_CHANGE, f1 - f0)
    store(numbers, SLIP_OFFSET, fade)
    store(numbers, TIME, load(numbers, TIME) + load(numbers, PERIOD))
