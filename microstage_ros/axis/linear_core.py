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

import numpy as np

from microstage_ros.axis.compiled import compiled, internal
from microstage_ros.axis.records import INPUTS, LAW_WORK, LEVELS, WORK

TICKS = 1 << (LEVELS - 1)
I, OMEGA, V, U, T0, T1, T2, F0, F1 = range(INPUTS)
O_I, O_OMEGA, O_THETA, O_V, O_X, O_OMEGA_MID = range(6)
_STATES, _SIZE = 5, 12         # i ω θ v x | u | torque chain of 3 | force chain of 2 | unused


def new_work(*plants):
    """An empty work record for one thread that will step these plants (see `forget` between two of them).

    Without plants, or with one whose contact has a law that is not made of blocks, it serves any plant; the
    step for blocks alone compiles in half the time. Its memory begins at a cache line.
    """
    blocks = plants and not any(int(plant[contact]["law"]) for plant in plants for contact in ("actuator", "guideway"))
    kind = WORK if blocks else LAW_WORK
    space = np.zeros(kind.itemsize + 64, np.uint8)
    skip = -space.ctypes.data % 64
    work = space[skip : skip + kind.itemsize].view(kind)[0]
    forget(work)
    return work


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
    """out = scale · x y, of the states' columns of x; plain loops, array expressions cost seconds of compiling."""
    for i in range(_STATES):
        for j in range(_SIZE):
            total = x[i, 0] * y[0, j]
            for k in range(1, _STATES):
                total += x[i, k] * y[k, j]
            out[i, j] = scale * total


@internal
def _exponential(a, h, result, term, spare):
    """The states' rows of exp(a h) into ``result``: scaled until the norm is below 1/4, Taylor to order 12, squared back.

    The rows of the inputs (u constant, torque a chain of three, force of two) are known and not stored.
    """
    norm = 0.0
    for i in range(_STATES):
        row = 0.0
        for j in range(_SIZE):
            row += abs(a[i, j])
        norm = max(norm, row)
    pieces = 1.0
    while norm * h > 0.25 * pieces and pieces < 1e18:
        pieces *= 2.0
    h /= pieces
    for i in range(_STATES):
        for j in range(_SIZE):
            result[i, j] = term[i, j] = 1.0 if i == j else 0.0
    for order in range(1, 13):
        scale = h / order
        _times(term, a, scale, spare)
        for i in range(_STATES):
            spare[i, 7] += scale * term[i, 6]
            spare[i, 8] += scale * term[i, 7]
            spare[i, 10] += scale * term[i, 9]
        for i in range(_STATES):
            for j in range(_SIZE):
                term[i, j] = spare[i, j]
                result[i, j] += spare[i, j]
    while pieces > 1.0:
        _square(result, h, spare)
        for i in range(_STATES):
            for j in range(_SIZE):
                result[i, j] = spare[i, j]
        h *= 2.0
        pieces *= 0.5


@internal
def _square(e, h, out):
    """out = exp(2 a h) of e = exp(a h)."""
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
    source = (0, 1, 3, 5, 6, 7, 8, 9, 10)
    ratio, rigid = plant.ratio, plant.rigid == 1
    push = ratio / inertia if rigid else 1.0 / (plant.mass * ratio)
    unit = (1.0, 1.0, 0.0 if rigid else 1.0 / ratio, 1.0, 1.0 / inertia, 1.0 / inertia / h, 2.0 / inertia / (h * h), push, push / h)
    v_row, x_row = (1, 2) if rigid else (3, 4)
    for j in range(INPUTS):
        s, f = source[j], unit[j]
        out[j, O_I], out[j, O_OMEGA], out[j, O_THETA] = f * e[0, s], f * e[1, s], f * e[2, s]
        out[j, O_V], out[j, O_X] = f * ratio * e[v_row, s], f * ratio * e[x_row, s]
        out[j, O_OMEGA_MID], out[j, 6], out[j, 7] = f * half[1, s], 0.0, 0.0


@compiled
def build_mode(plant, stiff_a, damp_a, stiff_g, damp_g, in_contact, resistance, matrices):
    """All levels' matrices of one mode into ``matrices`` (LEVELS, INPUTS, OUTPUTS)."""
    a, half = np.zeros((_STATES, _SIZE)), np.zeros((_STATES, _SIZE))
    e, spare = np.zeros((_STATES, _SIZE)), np.zeros((_STATES, _SIZE))
    inertia = _system(plant, stiff_a, damp_a, stiff_g, damp_g, in_contact, resistance, a)
    h = plant.period / TICKS
    _exponential(a, 0.5 * h, half, e, spare)
    for level in range(LEVELS - 1, -1, -1):
        _square(half, 0.5 * h, e)
        _write_level(e, half, h, plant, inertia, matrices[level])
        half, e = e, half
        h *= 2.0
