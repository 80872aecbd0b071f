"""Uncertainty: sandwich covariances of serially correlated residuals, bootstrap, profile likelihood.

Sources: sandwich of independent groups, here blocks of rows: K.-Y. Liang, S. L. Zeger, Biometrika 73 (1986); bootstrap:
B. Efron, R. Tibshirani, An Introduction to the Bootstrap, Chapman & Hall 1993; profile likelihood: S. S. Wilks, Annals
of Mathematical Statistics 9 (1938).
"""

import math

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2
from scipy.stats import t as student

from microstage_ros.numerics.compiled import compiled

LEVEL = 0.95


def block_covariance(regressors, residuals, block):
    """Covariance of least-squares estimates whose residuals hang together over ``block`` rows.

    The sandwich (WᵀW)⁻¹ (Σ_b s_b s_bᵀ) (WᵀW)⁻¹ with s_b the sum of w·e over block b, times
    n_b / (n_b − p) for the finite number of blocks n_b.

    Parameters
    ----------
    regressors : W, shape (n, p).
    residuals : e, shape (n,).
    block : rows per block [1]; longer than the residual's memory, and leaving more than p blocks.

    Returns
    -------
    ndarray, shape (p, p).
    """
    parameters = regressors.shape[1]
    blocks = max(len(residuals) // int(block), parameters + 1)
    scores = np.array([part.sum(axis=0) for part in np.array_split(regressors * residuals[:, None], blocks)])
    bread = np.linalg.pinv(regressors.T @ regressors)
    return bread @ (scores.T @ scores) @ bread * blocks / (blocks - parameters)


@compiled
def _running_score(regressors, way, length, total):
    """Adds Σ_ij w_i w_jᵀ exp(−|s_i − s_j| / ℓ) to ``total``, (p, p), rows in the order of the way s."""
    rows, parameters = regressors.shape
    before = np.zeros(parameters)  # Σ_{j < i} w_j exp(−(s_i − s_j) / ℓ)
    for i in range(rows):
        if i:
            before *= math.exp(-(way[i] - way[i - 1]) / length)
        for a in range(parameters):
            for b in range(parameters):
                both = regressors[i, a] * before[b] + before[a] * regressors[i, b]
                total[a, b] += both + regressors[i, a] * regressors[i, b]
        for a in range(parameters):
            before[a] += regressors[i, a]


def correlated_score(regressors, way, length):
    """Covariance of Σ_i w_i q_i where q has variance one and correlation exp(−|s_i − s_j| / ℓ), shape (p, p).

    Parameters
    ----------
    regressors : W, shape (n, p). way : s of each row, not falling, shape (n,), [m] or [s].
    length : ℓ, correlation length of an Ornstein–Uhlenbeck process, > 0, [m] or [s] as the way.
    """
    total = np.zeros((regressors.shape[1],) * 2)
    _running_score(np.ascontiguousarray(regressors, float), np.ascontiguousarray(way, float), float(length), total)
    return total


def correlation(covariance):
    """Correlation matrix of a ``covariance``, both (p, p); what has no variance correlates with nothing."""
    spread = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    with np.errstate(invalid="ignore", divide="ignore"):
        matrix = covariance / np.outer(spread, spread)
    matrix[~np.isfinite(matrix)] = 0.0
    np.fill_diagonal(matrix, 1.0)
    return matrix


def bootstrap(estimator, repeats, seed, resamples=200):
    """Bootstrap over repeats: ``estimator(indices)`` on resampled repeats.

    Parameters
    ----------
    estimator : indices, shape (repeats,) -> values, shape (p,).
    repeats : number of repeats (independent experiments).
    seed, resamples : of the resampling, and how many [1].

    Returns
    -------
    values, stderr, low, high, covariance : estimates on all repeats; standard uncertainty, widened by
        sqrt(n / (n − 1)) for the small sample; 95 % interval with Student's factor of n − 1 degrees of
        freedom; covariance of the resampled estimates.
    """
    generator = np.random.default_rng(seed)
    values = np.atleast_1d(estimator(np.arange(repeats)))
    draws = np.array([np.atleast_1d(estimator(generator.integers(repeats, size=repeats))) for _ in range(resamples)])
    covariance = np.atleast_2d(np.cov(draws.T)) * repeats / max(repeats - 1, 1)
    stderr = np.sqrt(np.diag(covariance))
    factor = student.ppf(0.5 + 0.5 * LEVEL, max(repeats - 1, 1))
    return values, stderr, values - factor * stderr, values + factor * stderr, covariance


def profile_interval(deviance, best, low_bound, high_bound, spread, level=LEVEL):
    """Ends of the profile-likelihood interval of one parameter.

    Parameters
    ----------
    deviance : value -> −2 log likelihood with all other parameters fitted anew.
    best : value of least deviance [unit of the parameter].
    low_bound, high_bound : where the search ends [unit of the parameter]; an end not found inside is returned as
        ∓ infinity.
    spread : first guess of the distance to the ends, > 0 [unit of the parameter].
    level : probability that the interval is to hold [1].

    Returns
    -------
    low, high : where the deviance is by χ²₁(level) (3.84 for 95 %) above its least value.
    """
    limit = deviance(best) + chi2.ppf(level, 1)
    return tuple(_crossing(deviance, limit, best, bound, sign * spread)
                 for sign, bound in ((-1.0, low_bound), (1.0, high_bound)))


def _crossing(deviance, limit, best, bound, step):
    """First value beyond ``best`` in the direction of ``step`` at which the deviance passes the limit."""
    inside = best
    for _ in range(40):
        outside = best + step
        beyond = (outside - bound) * np.sign(step) >= 0.0
        outside = bound if beyond else outside
        if deviance(outside) > limit:
            return brentq(lambda v: deviance(v) - limit, inside, outside, rtol=1e-4)
        if beyond:
            return np.inf * np.sign(step)
        inside, step = outside, 1.8 * step
    return np.inf * np.sign(step)
