"""Compiled solvers of others for the same equations: Dormand–Prince and Runge–Kutta 4 in numba, SUNDIALS in C.

The right-hand side is that of `peers.Equations`, written out in scalars so that numba compiles it; state
z = [i, ω, θ, v, x, F_a…, F_g…]. `numba.njit` stands here without this project's cache: it is how a user would do it.
"""

import math

import numba
import numpy as np

SAFETY, LEAST, MOST = 0.9, 0.2, 5.0  # of an adaptive step: usual factors (Hairer, Nørsett, Wanner, II.4)


def packed(equations):
    """(numbers, blocks) of `Equations`, all SI: parameters (11,) in the order of `rates`; two arrays per contact.

    [k…, α…], shape (2, n), and [F_s, F_C, V, δ, C, σ, drops], shape (7,).
    """
    p = equations.p
    numbers = np.array(
        [
            p[name]
            for name in (
                "resistance",
                "inductance",
                "back_emf",
                "torque_constant",
                "inertia",
                "gear",
                "ratio",
                "stiffness",
                "damping",
                "mass",
                "period",
            )
        ]
    )
    blocks = []
    for contact in equations.contacts:
        blocks += [
            np.stack([contact["k"], contact["alpha"]]),
            np.array(
                [
                    contact["static"],
                    contact["coulomb"],
                    contact["velocity"],
                    contact["exponent"],
                    contact["attraction"],
                    contact["viscous"],
                    float(contact["drops"]),
                ]
            ),
        ]
    return numbers, tuple(blocks)


@numba.njit(error_model="numpy")
def contact_rates(shape, numbers, force, w, out):
    """dF/dt of a contact's blocks into ``out``; returns Σ F."""
    s = numbers[1]
    if numbers[6] > 0.0:
        s += (numbers[0] - numbers[1]) * math.exp(-((abs(w) / numbers[2]) ** numbers[3]))
    sign, total = math.copysign(1.0, w), 0.0
    for j in range(shape.shape[1]):
        f = force[j]
        total += f
        if f * sign >= shape[1, j] * s * (1.0 - 1e-9):
            out[j] = 0.0 if math.isinf(numbers[4]) else numbers[4] * (sign * shape[1, j] - f / s)
        else:
            out[j] = shape[0, j] * w
    return total


@numba.njit(error_model="numpy")
def rates(z, u, p, blocks, out):
    """dz/dt at voltage u into ``out``."""
    n = 5 + blocks[0].shape[1]
    w = z[1] / p[5]
    spring = p[7] * (p[6] * z[2] - z[4]) + p[8] * (p[6] * z[1] - z[3])
    actuator = contact_rates(blocks[0], blocks[1], z[5:n], w, out[5:n])
    guideway = contact_rates(blocks[2], blocks[3], z[n:], z[3], out[n:])
    out[0] = (u - p[0] * z[0] - p[2] * z[1]) / p[1]
    out[1] = (p[3] * z[0] - actuator - blocks[1][5] * w - p[6] * spring) / p[4]
    out[2] = z[1]
    out[3] = (spring - guideway - blocks[3][5] * z[3]) / p[9]
    out[4] = z[3]


@numba.njit(error_model="numpy")
def runge_kutta(z, voltage, p, blocks, substeps, x):
    """Stage positions after each period with fixed-step Runge–Kutta 4."""
    dt = p[10] / substeps
    a, b, c, d = np.empty_like(z), np.empty_like(z), np.empty_like(z), np.empty_like(z)
    for k in range(len(voltage)):
        for _ in range(substeps):
            rates(z, voltage[k], p, blocks, a)
            rates(z + 0.5 * dt * a, voltage[k], p, blocks, b)
            rates(z + 0.5 * dt * b, voltage[k], p, blocks, c)
            rates(z + dt * c, voltage[k], p, blocks, d)
            z = z + dt / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        x[k] = z[4]


@numba.njit(error_model="numpy")
def dormand_prince(z, voltage, p, blocks, rtol, scale, x):
    """Stage positions after each period with the adaptive Dormand–Prince 5(4) pair (the method of scipy's RK45)."""
    k1, k2, k3, k4, k5, k6, k7 = [np.empty_like(z) for _ in range(7)]
    dt = p[10] / 50.0
    for k in range(len(voltage)):
        t, u = 0.0, voltage[k]
        while t < p[10] * (1.0 - 1e-12):
            h = min(dt, p[10] - t)
            rates(z, u, p, blocks, k1)
            rates(z + h * (k1 / 5), u, p, blocks, k2)
            rates(z + h * (3 / 40 * k1 + 9 / 40 * k2), u, p, blocks, k3)
            rates(z + h * (44 / 45 * k1 - 56 / 15 * k2 + 32 / 9 * k3), u, p, blocks, k4)
            rates(
                z + h * (19372 / 6561 * k1 - 25360 / 2187 * k2 + 64448 / 6561 * k3 - 212 / 729 * k4), u, p, blocks, k5
            )
            rates(
                z + h * (9017 / 3168 * k1 - 355 / 33 * k2 + 46732 / 5247 * k3 + 49 / 176 * k4 - 5103 / 18656 * k5),
                u,
                p,
                blocks,
                k6,
            )
            new = z + h * (35 / 384 * k1 + 500 / 1113 * k3 + 125 / 192 * k4 - 2187 / 6784 * k5 + 11 / 84 * k6)
            rates(new, u, p, blocks, k7)
            wrong = h * (
                71 / 57600 * k1 - 71 / 16695 * k3 + 71 / 1920 * k4 - 17253 / 339200 * k5 + 22 / 525 * k6 - k7 / 40
            )
            error = math.sqrt(np.mean((wrong / (rtol * (scale + np.maximum(np.abs(z), np.abs(new))))) ** 2))
            if error <= 1.0:
                t, z = t + h, new
            dt = h * min(MOST, max(LEAST, SAFETY * max(error, 1e-10) ** -0.2))
        x[k] = z[4]


def solve_compiled(equations, voltage, method, accuracy, scale):
    """Stage positions (n,) [m] by `runge_kutta` or `dormand_prince`.

    ``equations``: `Equations`; ``voltage`` (n,) [V], each held for a period; ``method``: one of the two functions;
    ``accuracy``: substeps of the former, relative tolerance of the latter [1]; ``scale``: `sizes`, shape (size,).
    """
    numbers, blocks = packed(equations)
    x = np.empty(len(voltage))
    if method is runge_kutta:
        method(np.zeros(equations.size), voltage, numbers, blocks, accuracy, x)
    else:
        method(np.zeros(equations.size), voltage, numbers, blocks, accuracy, scale, x)
    return x


def solve_with_sundials(equations, voltage, rtol, scale):
    """Stage positions (n,) [m] by SUNDIALS CVODE (C, variable-order BDF) with the compiled right-hand side.

    ``equations``: `Equations`; ``voltage`` (n,) [V]; ``rtol`` [1] times ``scale``, `sizes` of shape (size,), is the
    absolute tolerance. Raises ImportError where the package scikit-sundae is not installed.
    """
    from sksundae.cvode import CVODE

    numbers, blocks = packed(equations)
    z, x, period = np.zeros(equations.size), np.empty(len(voltage)), equations.p["period"]
    held = [0.0]
    solver = CVODE(lambda t, y, yp: rates(y, held[0], numbers, blocks, yp), rtol=rtol, atol=scale * rtol, method="BDF")
    for k, u in enumerate(voltage):
        held[0] = float(u)
        z = solver.solve(np.array([0.0, period]), z).y[-1]
        x[k] = z[4]
    return x
