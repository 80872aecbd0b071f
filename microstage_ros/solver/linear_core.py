"""The axis between two friction events: a linear system, solved exactly.

While no block changes between sticking and slipping, and the backlash stays on its side, the axis
is linear in [i, ω, Δθ, v, Δx] (Δ: since the start of the chunk) with polynomial inputs: voltage u,
torque τ0 + τ1 (t/h) + τ2 (t/h)², force φ0 + φ1 (t/h). Its solution over a chunk of length h is one
matrix, found by the exponential of the system augmented with its inputs (C. F. Van Loan, Computing
integrals involving the matrix exponential, IEEE TAC 23, 1978). Chunks are T/2^level, so a level's
matrix is the square of the next finer one, and an event inside a period is found by halving.

A *mode* is one combination of sticking blocks and backlash side; its matrices are made when it
first occurs and kept in the work arrays.
"""

import math

import numpy as np

from microstage_ros.model.plant_record import INPUTS, LAW_WORK, LEVELS, OUTPUTS, WORK
from microstage_ros.numerics.compiled import compiled, internal, not_inlined
from microstage_ros.solver.vectors import add_row, mix_rows

TICKS = 1 << (LEVELS - 1)
I, OMEGA, V, U, T0, T1, T2, F0, F1 = range(INPUTS)
O_I, O_OMEGA, O_THETA, O_V, O_X, O_OMEGA_MID = range(6)
PACE = 1e4                     # 1/s, about the pace of the axis
_STATES, _SIZE = 5, 11         # i ω θ v x | u | torque chain of 3 | force chain of 2
_SOURCES = (0, 1, 3, 5, 6, 7, 8, 9, 10)      # of the inputs I … F1


def new_work(*plants):
    """An empty work record for one thread that will step these plants (see `forget` between two of them).

    Without plants, or with one whose contact has a law that is not made of blocks, it serves any plant; the
    step for blocks alone compiles in half the time.
    """
    blocks = plants and not any(plant[contact]["law"] for plant in plants for contact in ("actuator", "guideway"))
    work = aligned(WORK if blocks else LAW_WORK, 1)[0]
    forget(work)
    return work


def new_works(count, plants):
    """An array of work records, shape (``count``,), for an array of plants (n,), each to be made ready by `forget`."""
    blocks = not any(np.any(plants[contact]["law"]) for contact in ("actuator", "guideway"))
    return aligned(WORK if blocks else LAW_WORK, count)


def aligned(kind, *shape):
    """Zeros that begin at a cache line."""
    size = np.dtype(kind).itemsize * math.prod(shape)
    space = np.zeros(size + 64, np.uint8)
    skip = -space.ctypes.data % 64
    return space[skip : skip + size].view(kind).reshape(shape)


@compiled
def forget(work):
    """Make a work record ready for another plant."""
    work.key[:] = -1
    work.slot = -1
    work.resistance = np.nan
    work.constant_change = 0.0


@internal
def _system(plant, stiff_a, damp_a, stiff_g, damp_g, in_contact, resistance, change, a):
    """Fill the augmented system matrix; returns the inertia at the motor. ``change``: of k_M and K_E, relative.

    Rows and columns are exchanged: a[j, i] is what state or input j does to state i.
    Stage coordinates are taken in motor radians (x/ratio), torques and forces as accelerations, so that
    the entries are alike in size and the exponential keeps its digits.
    """
    ratio, gear, mass = plant.ratio, plant.gear, plant.mass
    inertia = plant.inertia
    if plant.rigid == 1:
        inertia += mass * ratio * ratio
        a[2, 1] = -(stiff_a / gear + ratio * ratio * stiff_g) / inertia
        a[1, 1] = -(damp_a / gear + ratio * ratio * damp_g) / inertia
        a[9, 1] = 1.0
    else:
        k, d = plant.stiffness * in_contact, plant.damping * in_contact
        k_motor, d_motor = ratio * ratio * k / inertia, ratio * ratio * d / inertia
        a[1, 1], a[2, 1], a[3, 1], a[4, 1] = (
            -damp_a / gear / inertia - d_motor,
            -stiff_a / gear / inertia - k_motor,
            d_motor,
            k_motor,
        )
        a[1, 3], a[2, 3], a[3, 3], a[4, 3] = d / mass, k / mass, -(d + damp_g) / mass, -(k + stiff_g) / mass
        a[9, 3] = 1.0
        a[3, 4] = 1.0
    a[1, 2] = 1.0
    a[6, 1] = 1.0
    a[0, 0] = -resistance / plant.inductance
    a[1, 0] = -plant.back_emf * (1.0 + change) / plant.inductance
    a[5, 0] = plant.electrical_input / plant.inductance
    a[0, 1] = plant.torque_constant * (1.0 + change) / inertia
    a[5, 1] = plant.direct / inertia
    a[1, 1] -= plant.motor_damping / inertia
    return inertia


@internal
def _times(x, y, scale, out):
    """Out = scale · y x (rows and columns exchanged), of the states' rows of y."""
    not_inlined()
    for j in range(_SIZE):
        mix_rows(out, j, scale * x[j, 0], scale * x[j, 1], scale * x[j, 2], scale * x[j, 3], scale * x[j, 4], y)


@internal
def _horner(x, a, scale, out):
    """Out = 1 + scale · x a; what a does to the inputs (u constant, torque a chain of three, force of two) is known."""
    not_inlined()
    _times(a, x, scale, out)
    for j in (7, 8, 10):
        add_row(out, j, scale, x, j - 1)
    for i in range(_STATES):
        out[i, i] += 1.0


@internal
def _exponential(a, h, result, spare):
    """The states' part of exp(a h) into ``result``.

    Scaled until the norm is below 1/16, Taylor to order 8, squared back.
    """
    not_inlined()
    norm = 0.0
    for i in range(_STATES):       # in units of time of 1/PACE, so that speeds and positions weigh alike
        row = abs(a[0, i]) + abs(a[1, i]) + abs(a[3, i]) + (abs(a[2, i]) + abs(a[4, i])) / PACE
        norm = max(norm, row * (PACE if i == 2 or i == 4 else 1.0))
    pieces = 1.0
    while norm * h > pieces / 16.0 and pieces < 1e18:
        pieces *= 4.0              # two squarings
    h /= pieces
    result[:, :] = 0.0
    for i in range(_STATES):
        result[i, i] = 1.0
    for order in range(8, 0, -2):
        _horner(result, a, h / order, spare)
        _horner(spare, a, h / (order - 1), result)
    while pieces > 1.0:
        _square(result, h, spare)
        _square(spare, 2.0 * h, result)
        h *= 4.0
        pieces *= 0.25


@internal
def _square(e, h, out):
    """Out = exp(2 a h) of e = exp(a h)."""
    not_inlined()
    _times(e, e, 1.0, out)
    for j in range(_STATES, _SIZE):
        add_row(out, j, 1.0, e, j)
    for j in (7, 8, 10):
        add_row(out, j, h, e, j - 1)
    add_row(out, 8, 0.5 * h * h, e, 6)


@internal
def _write_level(e, half, h, plant, inertia, out):
    """Pick the used parts of the exponentials over h and h/2 into one level's matrix, in SI units."""
    not_inlined()
    rigid, ratio = plant.rigid == 1, plant.ratio
    per_inertia, per_h = 1.0 / inertia, 1.0 / h
    push = ratio * per_inertia if rigid else 1.0 / (plant.mass * ratio)
    v, x = (1, 2) if rigid else (3, 4)
    units = (1.0, 1.0, 0.0 if rigid else 1.0 / ratio, 1.0, per_inertia, per_inertia * per_h,
             2.0 * per_inertia * per_h * per_h,
             push, push * per_h)
    for column in range(INPUTS):
        source, unit = _SOURCES[column], units[column]
        metres = unit * ratio
        out[column, O_I], out[column, O_OMEGA], out[column, O_THETA] = (
            unit * e[source, 0],
            unit * e[source, 1],
            unit * e[source, 2],
        )
        out[column, O_V], out[column, O_X], out[column, O_OMEGA_MID] = (
            metres * e[source, v],
            metres * e[source, x],
            unit * half[source, 1],
        )


@compiled
def build_mode(plant, stiff_a, damp_a, stiff_g, damp_g, in_contact, resistance, change, matrices):
    """All levels' matrices of one mode into ``matrices`` (LEVELS, INPUTS, OUTPUTS).

    ``change``: of k_M and K_E, relative.
    """
    a, half, e = np.zeros((_SIZE, OUTPUTS)), np.empty((_SIZE, OUTPUTS)), np.empty((_SIZE, OUTPUTS))
    inertia = _system(plant, stiff_a, damp_a, stiff_g, damp_g, in_contact, resistance, change, a)
    h = plant.period / TICKS
    _exponential(a, 0.5 * h, half, e)
    for level in range(LEVELS - 1, -1, -1):
        _square(half, 0.5 * h, e)
        _write_level(e, half, h, plant, inertia, matrices[level])
        half, e = e, half
        h *= 2.0
