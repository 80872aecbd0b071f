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

from microstage_ros.axis.compiled import compiled
from microstage_ros.axis.records import INPUTS, LEVELS, WORK

TICKS = 1 << (LEVELS - 1)
I, OMEGA, V, U, T0, T1, T2, F0, F1 = range(INPUTS)
O_I, O_OMEGA, O_THETA, O_V, O_X, O_OMEGA_MID, O_V_MID = range(7)
_SIZE = 11                     # i ω θ v x | u | torque chain of 3 | force chain of 2


def new_work():
    """An empty work record for one thread (see `forget` before another plant)."""
    work = np.zeros(1, WORK)[0]
    forget(work)
    return work


@compiled
def forget(work):
    """Make a work record ready for another plant."""
    work.key[:] = -1
    work.slot = -1
    work.resistance = np.nan


@compiled
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
    a[6, 7] = 1.0
    a[7, 8] = 1.0
    a[9, 10] = 1.0
    return inertia


@compiled
def _exponential(a, h, result, term, spare):
    """exp(a h) into ``result``: scaled until the norm is below 2^-6, Taylor to order 10, squared back.

    Plain loops: array expressions cost seconds of compiling.
    """
    norm = 0.0
    for i in range(_SIZE):
        row = 0.0
        for j in range(_SIZE):
            row += abs(a[i, j])
        norm = max(norm, row * h)
    halvings = 0
    while norm > 0.015625 and halvings < 60:
        norm *= 0.5
        halvings += 1
    for i in range(_SIZE):
        for j in range(_SIZE):
            result[i, j] = term[i, j] = 1.0 if i == j else 0.0
    for order in range(1, 11):
        _product(term, a, h / 2.0**halvings / order, spare)
        for i in range(_SIZE):
            for j in range(_SIZE):
                term[i, j] = spare[i, j]
                result[i, j] += spare[i, j]
    for _ in range(halvings):
        _square(result, spare)


@compiled
def _product(a, b, scale, c):
    """c = scale · a b; small matrices, no BLAS."""
    for i in range(_SIZE):
        for j in range(_SIZE):
            c[i, j] = 0.0
        for k in range(_SIZE):
            f = scale * a[i, k]
            if f != 0.0:
                for j in range(_SIZE):
                    c[i, j] += f * b[k, j]


@compiled
def _square(a, spare):
    """a ← a a."""
    _product(a, a, 1.0, spare)
    for i in range(_SIZE):
        for j in range(_SIZE):
            a[i, j] = spare[i, j]


@compiled
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
        out[j, O_OMEGA_MID], out[j, O_V_MID], out[j, 7] = f * half[1, s], f * ratio * half[v_row, s], 0.0


@compiled
def build_mode(plant, stiff_a, damp_a, stiff_g, damp_g, in_contact, resistance, matrices):
    """All levels' matrices of one mode into ``matrices`` (LEVELS, INPUTS, OUTPUTS)."""
    a, half, e = np.zeros((_SIZE, _SIZE)), np.zeros((_SIZE, _SIZE)), np.zeros((_SIZE, _SIZE))
    spare = np.zeros((_SIZE, _SIZE))
    inertia = _system(plant, stiff_a, damp_a, stiff_g, damp_g, in_contact, resistance, a)
    h = plant.period / TICKS
    _exponential(a, 0.5 * h, half, e, spare)
    for level in range(LEVELS - 1, -1, -1):
        _product(half, half, 1.0, e)
        _write_level(e, half, h, plant, inertia, matrices[level])
        for i in range(_SIZE):
            for j in range(_SIZE):
                half[i, j] = e[i, j]
        h *= 2.0
