"""MODEL's equations once more, written independently: explicit Runge–Kutta 4 with tiny steps.

Every block is its own state, nothing is aggregated, no matrix exponential, no table. Used only to
check the compiled step; slow by design.
"""

import math

import numba
import numpy as np

R, L, KE, KM, J = 3.41, 75e-6, 6.589014636e-3, 6.59e-3, 1e-7
N, PITCH, KC, DC, M = 19.0, 2e-3, 1.2e7, 600.0, 3.06
LEAD = PITCH / (2 * math.pi)
KA = np.array([1.159, 0.064417, 0.013066, 0.008027, 0.002043, 0.000961])
AA = np.array([0.575, 0.160, 0.059, 0.120, 0.051, 0.034])
AA = AA / AA.sum()
MS, MC, WS, DELTA, C, SIGMA = 219e-6, 125.6e-6, 0.18, 0.9, 1.0, 10.51e-6
SLOPES = np.array([454610.0, 111088.0, 45601.0, 16402.0, 6899.0, 4295.0])
SHARES = np.array([0.378, 0.138, 0.148, 0.177, 0.112, 0.046])
SHARES = SHARES / SHARES.sum()
FS, SIGMA_G = 0.9, 20.0
ENDS = np.cumsum(SHARES * FS / SLOPES)
KG = SLOPES - np.append(SLOPES[1:], 0.0)
AG = KG * ENDS / FS


@numba.njit(cache=True)
def _rates(z, u, stuck_a, stuck_g, d):
    """z = [i, ω, θ, v, x, six torques, six forces]."""
    i, w, th, v, x = z[0], z[1], z[2], z[3], z[4]
    wr = w / N
    s = MC + (MS - MC) * math.exp(-((abs(wr) / WS) ** DELTA)) if wr != 0.0 else MS
    sign = 1.0 if wr > 0 else (-1.0 if wr < 0 else 0.0)
    mf, fg = SIGMA * wr, SIGMA_G * v
    for j in range(6):
        mf += z[5 + j]
        fg += z[11 + j]
        d[5 + j] = KA[j] * wr if stuck_a[j] else C * (sign * AA[j] - z[5 + j] / s)
        d[11 + j] = KG[j] * v if stuck_g[j] else 0.0
    fc = KC * (LEAD * th / N - x) + DC * (LEAD * wr - v)
    d[0] = (u - R * i - KE * w) / L
    d[1] = (KM * i - mf - LEAD / N * fc) / J
    d[2] = w
    d[3] = (fc - fg) / M
    d[4] = v


@numba.njit(cache=True)
def run(voltage, substeps, period, every):
    """Stage position at the start of every ``every``-th period, from rest with relaxed contacts."""
    z, d1, d2, d3, d4 = np.zeros(17), np.zeros(17), np.zeros(17), np.zeros(17), np.zeros(17)
    stuck_a, stuck_g = np.ones(6, np.bool_), np.ones(6, np.bool_)
    out = np.empty(voltage.size // every)
    dt = period / substeps
    for n in range(voltage.size):
        if n % every == 0:
            out[n // every] = z[4]
        u = min(max(voltage[n], -6.0), 6.0)
        for _ in range(substeps):
            w0, v0 = z[1], z[3]
            _rates(z, u, stuck_a, stuck_g, d1)
            _rates(z + 0.5 * dt * d1, u, stuck_a, stuck_g, d2)
            _rates(z + 0.5 * dt * d2, u, stuck_a, stuck_g, d3)
            _rates(z + dt * d3, u, stuck_a, stuck_g, d4)
            z += dt / 6.0 * (d1 + 2.0 * d2 + 2.0 * d3 + d4)
            w1, v1 = z[1], z[3]
            if w0 * w1 < 0.0:
                stuck_a[:] = True
            if v0 * v1 < 0.0:
                stuck_g[:] = True
            s = MC + (MS - MC) * math.exp(-((abs(w1 / N) / WS) ** DELTA)) if w1 != 0.0 else MS
            sa, sg = (1.0 if w1 > 0 else -1.0), (1.0 if v1 > 0 else -1.0)
            for j in range(6):
                if stuck_a[j] and z[5 + j] * sa >= AA[j] * s:
                    stuck_a[j] = False
                if stuck_g[j] and z[11 + j] * sg >= AG[j] * FS:
                    stuck_g[j] = False
                    z[11 + j] = AG[j] * FS * sg
    return out
