"""Coloured noise made white, so that ordinary least squares becomes generalised least squares.

Both filters are linear with gains that do not depend on the data: the same filter goes over the
residual and over every candidate's columns, and the innovations have variance one.
"""

import numpy as np
from scipy.signal import lfilter

from microstage_ros.numerics.compiled import compiled


def whiten_states(matrix, gains, keeps, spreads, white):
    """Innovations of ``matrix`` (n, k) under independent first-order processes seen through time-varying gains.

    y_n = Σ_s gains[n, s] p_s[n] + e,   p_s[n+1] = keeps[n, s] p_s[n] + noise,   var p_s = spreads[s]²,
    var e = white[n], ``white`` of shape (n,). Returns (n, k), scaled to unit variance, and −2 ln of the likelihood's
    determinant part, Σ ln S_n.
    """
    return _kalman(np.ascontiguousarray(matrix), gains, keeps, np.asarray(spreads) ** 2, white)


@compiled
def _kalman(matrix, gains, keeps, variances, white):
    rows, columns = matrix.shape
    states = gains.shape[1]
    out = np.empty((rows, columns))
    mean = np.zeros((states, columns))
    p = np.zeros((states, states))
    for s in range(states):
        p[s, s] = variances[s]
    gain = np.empty(states)
    determinant = 0.0
    for n in range(rows):
        total = white[n]
        for a in range(states):
            gain[a] = 0.0
            for b in range(states):
                gain[a] += p[a, b] * gains[n, b]
            total += gains[n, a] * gain[a]
        determinant += np.log(total)
        root = 1.0 / np.sqrt(total)
        for c in range(columns):
            error = matrix[n, c]
            for a in range(states):
                error -= gains[n, a] * mean[a, c]
            out[n, c] = error * root
            for a in range(states):
                mean[a, c] = keeps[n, a] * (mean[a, c] + gain[a] / total * error)
        for a in range(states):
            for b in range(states):
                p[a, b] = keeps[n, a] * keeps[n, b] * (p[a, b] - gain[a] * gain[b] / total)
            p[a, a] += (1.0 - keeps[n, a] ** 2) * variances[a]
    return out, determinant


def predicted(ratio):
    """Variance that a random walk's filter predicts, over the noise's [1]: p of p² = q (p + 1), ``ratio`` q = (step /
    noise)² [1], the root of the stationary Riccati equation."""
    # derived: the root of a quadratic equation
    return 0.5 * (ratio + np.sqrt(ratio**2 + 4.0 * ratio))


def whiten_walk(matrix, step, noise):
    """Innovations of ``matrix`` (n, k): a random walk of ``step`` per row, read with white ``noise``, both standard
    deviations in the unit of the matrix.

    Constant gain; the first row's level is unknown and is taken as it is read.
    """
    p = predicted((step / noise) ** 2)
    keep = 1.0 / (1.0 + p)
    centred = matrix - matrix[:1]
    return lfilter([1.0, -1.0], [1.0, -keep], centred, axis=0) / (noise * np.sqrt(1.0 + p))
