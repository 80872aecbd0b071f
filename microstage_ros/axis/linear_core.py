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
from microstage_ros.axis.records import INPUTS, LEVELS, OUTPUTS, WORK

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
    """Fill the augmented system matrix: stiffness and damping of both contacts, at φ and at x."""
    ratio, gear = plant.ratio, plant.gear
    if plant.rigid == 1:
        inertia = plant.inertia + plant.mass * ratio * ratio
        a[1, 2] = -(stiff_a / gear + ratio * ratio * stiff_g) / inertia
        a[1, 1] = -(damp_a / gear + ratio * ratio * damp_g) / inertia
        a[1, 9] = ratio / inertia
    else:
        inertia = plant.inertia
        k = plant.stiffness * in_contact
        d = plant.damping * in_contact
        a[1, 2] = -(stiff_a / gear + ratio * ratio * k) / inertia
        a[1, 1] = -(damp_a / gear + ratio * ratio * d) / inertia
        a[1, 3] = ratio * d / inertia
        a[1, 4] = ratio * k / inertia
        a[3, 1] = ratio * d / plant.mass
        a[3, 2] = ratio * k / plant.mass
        a[3, 3] = -(d + damp_g) / plant.mass
        a[3, 4] = -(k + stiff_g) / plant.mass
        a[3, 9] = 1.0 / plant.mass
        a[4, 3] = 1.0
    a[2, 1] = 1.0
    a[1, 6] = 1.0 / inertia
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


@compiled
def _exponential(a, h):
    """exp(a h): scaled until the norm is below 2^-6, Taylor to order 10, squared back."""
    norm = np.max(np.sum(np.abs(a), axis=1)) * h
    halvings = 0
    while norm > 0.015625 and halvings < 60:
        norm *= 0.5
        halvings += 1
    step = a * (h / 2.0**halvings)
    result = np.eye(_SIZE)
    term = np.eye(_SIZE)
    for order in range(1, 11):
        term = _product(term, step) / order
        result += term
    for _ in range(halvings):
        result = _product(result, result)
    return result


@compiled
def _product(a, b):
    """Plain matrix product; small matrices, no BLAS."""
    c = np.zeros((_SIZE, _SIZE))
    for i in range(_SIZE):
        for k in range(_SIZE):
            f = a[i, k]
            if f != 0.0:
                for j in range(_SIZE):
                    c[i, j] += f * b[k, j]
    return c


@compiled
def _write_level(e, half, h, rigid, ratio, out):
    """Pick the used rows and columns of the exponentials over h and h/2 into one level's matrix."""
    source = (0, 1, 3, 5, 6, 7, 8, 9, 10)
    for j in range(INPUTS):
        s = source[j]
        scale = 1.0
        if j == T1 or j == F1:
            scale = 1.0 / h
        elif j == T2:
            scale = 2.0 / (h * h)
        out[j, O_I] = scale * e[0, s]
        out[j, O_OMEGA] = scale * e[1, s]
        out[j, O_THETA] = scale * e[2, s]
        out[j, O_V] = scale * (ratio * e[1, s] if rigid == 1 else e[3, s])
        out[j, O_X] = scale * (ratio * e[2, s] if rigid == 1 else e[4, s])
        out[j, O_OMEGA_MID] = scale * half[1, s]
        out[j, O_V_MID] = scale * (ratio * half[1, s] if rigid == 1 else half[3, s])
        out[j, 7] = 0.0
    if rigid == 1:
        for o in range(OUTPUTS):
            out[V, o] = 0.0


@compiled
def build_mode(plant, stiff_a, damp_a, stiff_g, damp_g, in_contact, resistance, matrices):
    """All levels' matrices of one mode into ``matrices`` (LEVELS, INPUTS, OUTPUTS)."""
    a = np.zeros((_SIZE, _SIZE))
    _system(plant, stiff_a, damp_a, stiff_g, damp_g, in_contact, resistance, a)
    h = plant.period / TICKS
    half = _exponential(a, 0.5 * h)
    for level in range(LEVELS - 1, -1, -1):
        e = _product(half, half)
        _write_level(e, half, h, plant.rigid, plant.ratio, matrices[level])
        half = e
        h *= 2.0
