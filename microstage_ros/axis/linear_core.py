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

from microstage_ros.axis.compiled import compiled, internal, seldom
from microstage_ros.axis.records import INPUTS, LAW_WORK, LEVELS, WORK
from microstage_ros.axis.vectors import mix_rows

TICKS = 1 << (LEVELS - 1)
I, OMEGA, V, U, T0, T1, T2, F0, F1 = range(INPUTS)
O_I, O_OMEGA, O_THETA, O_V, O_X, O_OMEGA_MID = range(6)
PACE = 1e4                     # 1/s, about the pace of the axis
_STATES, _SIZE = 5, 12         # i ω θ v x | u | torque chain of 3 | force chain of 2 | unused


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
    """An array of ``count`` work records for an array of plants, each to be made ready by `forget`."""
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


@internal
def _system(plant, stiff_a, damp_a, stiff_g, damp_g, in_contact, resistance, a):
    """Fill the augmented system matrix; returns the inertia at the motor.

    Stage coordinates are taken in motor radians (x/ratio), torques and forces as accelerations, so that
    the entries are alike in size and the exponential keeps its digits.
    """
    ratio, gear, mass = plant.ratio, plant.gear, plant.mass
    inertia = plant.inertia
    if plant.rigid == 1:
        inertia += mass * ratio * ratio
        a[1, 2] = -(stiff_a / gear + ratio * ratio * stiff_g) / inertia
        a[1, 1] = -(damp_a / gear + ratio * ratio * damp_g) / inertia
        a[1, 9] = 1.0
    else:
        k, d = plant.stiffness * in_contact, plant.damping * in_contact
        k_motor, d_motor = ratio * ratio * k / inertia, ratio * ratio * d / inertia
        a[1, 1], a[1, 2], a[1, 3], a[1, 4] = -damp_a / gear / inertia - d_motor, -stiff_a / gear / inertia - k_motor, d_motor, k_motor
        a[3, 1], a[3, 2], a[3, 3], a[3, 4] = d / mass, k / mass, -(d + damp_g) / mass, -(k + stiff_g) / mass
        a[3, 9] = 1.0
        a[4, 3] = 1.0
    a[2, 1] = 1.0
    a[1, 6] = 1.0
    if plant.force_drive == 1:
        a[1, 5] = ratio / inertia
    else:
        a[0, 0] = -resistance / plant.inductance
        a[0, 1] = -plant.back_emf / plant.inductance
        a[0, 5] = 1.0 / plant.inductance
        a[1, 0] = plant.torque_constant / inertia
    return inertia


@internal
def _times(x, y, scale, out):
    """out = scale · x y, of the states' columns of x."""
    seldom()
    for i in range(_STATES):
        mix_rows(out, i, scale * x[i, 0], scale * x[i, 1], scale * x[i, 2], scale * x[i, 3], scale * x[i, 4], y)


@internal
def _horner(x, a, scale, out):
    """out = 1 + scale · x a, the states' rows; a's rows of the inputs (u constant, torque a chain of three, force of two) are known."""
    seldom()
    _times(x, a, scale, out)
    for i in range(_STATES):
        out[i, 7] += scale * x[i, 6]
        out[i, 8] += scale * x[i, 7]
        out[i, 10] += scale * x[i, 9]
        out[i, i] += 1.0


@internal
def _exponential(a, h, result, spare):
    """The states' rows of exp(a h) into ``result``: scaled until the norm is below 1/16, Taylor to order 8, squared back."""
    seldom()
    norm = 0.0
    for i in range(_STATES):       # in units of time of 1/PACE, so that speeds and positions weigh alike
        row = abs(a[i, 0]) + abs(a[i, 1]) + abs(a[i, 3]) + (abs(a[i, 2]) + abs(a[i, 4])) / PACE
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
    """out = exp(2 a h) of e = exp(a h)."""
    seldom()
    _times(e, e, 1.0, out)
    for i in range(_STATES):
        out[i, 5] += e[i, 5]
        out[i, 6] += e[i, 6]
        out[i, 7] += e[i, 7] + h * e[i, 6]
        out[i, 8] += e[i, 8] + h * (e[i, 7] + 0.5 * h * e[i, 6])
        out[i, 9] += e[i, 9]
        out[i, 10] += e[i, 10] + h * e[i, 9]


@internal
def _write_level(e, half, h, plant, inertia, out):
    """Pick the used rows and columns of the exponentials over h and h/2 into one level's matrix, in SI units."""
    rigid, ratio = plant.rigid == 1, plant.ratio
    per_inertia = 1.0 / inertia
    push = ratio * per_inertia if rigid else 1.0 / (plant.mass * ratio)
    v, x = (1, 2) if rigid else (3, 4)
    _write_column(e, half, 0, v, x, 1.0, ratio, out[I])
    _write_column(e, half, 1, v, x, 1.0, ratio, out[OMEGA])
    _write_column(e, half, 3, v, x, 0.0 if rigid else 1.0 / ratio, ratio, out[V])
    _write_column(e, half, 5, v, x, 1.0, ratio, out[U])
    _write_column(e, half, 6, v, x, per_inertia, ratio, out[T0])
    _write_column(e, half, 7, v, x, per_inertia / h, ratio, out[T1])
    _write_column(e, half, 8, v, x, 2.0 * per_inertia / (h * h), ratio, out[T2])
    _write_column(e, half, 9, v, x, push, ratio, out[F0])
    _write_column(e, half, 10, v, x, push / h, ratio, out[F1])


@internal
def _write_column(e, half, source, v, x, unit, ratio, out):
    seldom()
    metres = unit * ratio
    out[O_I], out[O_OMEGA], out[O_THETA] = unit * e[0, source], unit * e[1, source], unit * e[2, source]
    out[O_V], out[O_X], out[O_OMEGA_MID] = metres * e[v, source], metres * e[x, source], unit * half[1, source]


@compiled
def build_mode(plant, stiff_a, damp_a, stiff_g, damp_g, in_contact, resistance, matrices):
    """All levels' matrices of one mode into ``matrices`` (LEVELS, INPUTS, OUTPUTS)."""
    a, half, e = np.zeros((_STATES, _SIZE)), np.empty((_STATES, _SIZE)), np.empty((_STATES, _SIZE))
    inertia = _system(plant, stiff_a, damp_a, stiff_g, damp_g, in_contact, resistance, a)
    h = plant.period / TICKS
    _exponential(a, 0.5 * h, half, e)
    for level in range(LEVELS - 1, -1, -1):
        _square(half, 0.5 * h, e)
        _write_level(e, half, h, plant, inertia, matrices[level])
        half, e = e, half
        h *= 2.0
