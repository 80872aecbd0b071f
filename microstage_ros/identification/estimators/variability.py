"""Random friction as a process: how large, over which travel, over which time, and what repeats.

The relative deviation q of the friction from its curve is modelled as the axis file has it: a sum of two
Ornstein–Uhlenbeck processes,

    cov q = σ² [ p exp(−Δs / ℓ) + (1 − p) exp(−Δt / τ) ],

Δs travel, Δt time. Both are Markov, so a Kalman filter over the samples gives the exact likelihood at
any spacing; its maximum gives σ, p, ℓ, τ and the noise of the samples, its profile their intervals.

Derived: the exact step of an Ornstein–Uhlenbeck process over a distance d is q → a q + σ √(1 − a²) n, a = exp(−d/ℓ), n
a standard normal number; the likelihood is the product of the normal densities of the filter's innovations.
"""

import math

import numpy as np
from scipy.optimize import minimize

from microstage_ros.identification.estimators.estimate import Identification, from_interval
from microstage_ros.identification.estimators.intervals import profile_interval
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.errors import InputError

KEYS = ("variability.relative", "variability.travel_share", "variability.travel_length", "variability.time_length")
UNITS = ("1", "1", "m", "s")
EXPERIMENTS = (
    "slow constant-velocity runs in which friction can be read would",
    "slow and fast runs over the same stroke would: they cover unlike travel in like time",
    "constant-velocity runs over many lengths (2 mm and more) would",
    "holding or slow running for several minutes would",
)
LEAST_POINTS = 30


@compiled
def _filter(deviation, travel, time, restart, variance, share, length, duration, noise, sums):
    """Kalman filter of the two processes; adds log |S| and the three sums of the concentrated mean to ``sums``.

    sums: [Σ log S, Σ e_y² / S, Σ e_y e_1 / S, Σ e_1² / S] with e_y the innovation of the data and e_1 that
    of a constant one, so that the mean of q is fitted in closed form.
    """
    va, vb = variance * share, variance * (1.0 - share)
    a = b = ca = cb = 0.0  # states driven by the data, and by the constant
    paa, pbb, pab = va, vb, 0.0
    for k in range(len(deviation)):
        if restart[k]:
            a = b = ca = cb = pab = 0.0
            paa, pbb = va, vb
        else:
            fa = math.exp(-(travel[k] - travel[k - 1]) / length)
            fb = math.exp(-(time[k] - time[k - 1]) / duration)
            a, ca, b, cb = a * fa, ca * fa, b * fb, cb * fb
            paa = paa * fa * fa + va * (1.0 - fa * fa)
            pbb = pbb * fb * fb + vb * (1.0 - fb * fb)
            pab = pab * fa * fb
        s = paa + pbb + 2.0 * pab + noise
        ey, e1 = deviation[k] - a - b, 1.0 - ca - cb
        sums[0] += math.log(s)
        sums[1] += ey * ey / s
        sums[2] += ey * e1 / s
        sums[3] += e1 * e1 / s
        ga, gb = (paa + pab) / s, (pbb + pab) / s
        a, b, ca, cb = a + ga * ey, b + gb * ey, ca + ga * e1, cb + gb * e1
        paa, pbb, pab = paa - ga * ga * s, pbb - gb * gb * s, pab - ga * gb * s


class VariabilityLikelihood:
    """−2 log likelihood of the process in (log σ, logit p, log ℓ, log τ, log noise).

    Parameters
    ----------
    deviation : q of each sample [1], shape (n,).
    travel, time : way covered so far [m] and time [s] of each sample, rising within a run, shape (n,).
    restart : True where a new, independent run begins, shape (n,).
    """

    def __init__(self, deviation, travel, time, restart):
        self.data = tuple(np.ascontiguousarray(v, dtype=float) for v in (deviation, travel, time))
        self.restart = np.ascontiguousarray(restart, dtype=bool)
        self.restart[0] = True

    def natural(self, parameters):
        """(σ [1], p [1], ℓ [m], τ [s], noise [1]) from the unbounded ``parameters``, shape (5,)."""
        log_sigma, logit, log_length, log_time, log_noise = parameters
        return (math.exp(log_sigma), 1.0 / (1.0 + math.exp(-logit)), math.exp(log_length), math.exp(log_time),
                math.exp(log_noise))

    def __call__(self, parameters):
        """−2 log likelihood with the mean concentrated out."""
        sigma, share, length, duration, noise = self.natural(np.clip(parameters, -60.0, 60.0))
        sums = np.zeros(4)
        _filter(*self.data, self.restart, sigma**2, share, length, duration, noise**2, sums)
        return sums[0] + sums[1] - sums[2] ** 2 / sums[3]

    def fit(self, start, fixed=None):
        """Least deviance from ``start``, shape (5,); ``fixed`` {index of (5,): value} is held.

        Returns (parameters (5,), deviance [1]).
        """
        fixed = fixed or {}
        free = [i for i in range(5) if i not in fixed]
        full = np.array(start, dtype=float)
        full[list(fixed)] = list(fixed.values())

        def deviance(part):
            trial = full.copy()
            trial[free] = part
            return self(trial) + 1e-3 * np.sum((trial - start) ** 2)  # a weak pull keeps what is undetermined finite

        found = minimize(deviance, full[free], method="L-BFGS-B", options={"maxiter": 60})
        full[free] = found.x
        return full, self(full)


def identify_variability(deviation, travel, time, restart):
    """σ, p, ℓ and τ of the random friction with 95 % profile-likelihood intervals.

    Parameters as `VariabilityLikelihood`: ``deviation`` [1], ``travel`` [m], ``time`` [s], ``restart``, each (n,).
    Returns `Identification` with the keys of `KEYS`.
    Raises InputError for fewer than 30 samples.
    """
    if len(deviation) < LEAST_POINTS:
        raise InputError("variability", f"{len(deviation)} samples of friction", f"at least {LEAST_POINTS}")
    likelihood = VariabilityLikelihood(deviation, travel, time, restart)
    steps = np.diff(likelihood.data[1])[~likelihood.restart[1:]]
    start = np.array([np.log(np.std(deviation)), 1.0, np.log(10.0 * np.median(steps[steps > 0])), np.log(10.0),
                      np.log(0.2 * np.std(deviation))])
    fits = [likelihood.fit(start + shift) for shift in ([0, 0, 0, 0, 0], [0, -2, 1, 1, 0], [0, 0, 2, -1, -2])]
    best, _ = min(fits, key=lambda fit: fit[1])
    result = Identification()
    natural = likelihood.natural(best)
    for i, key in enumerate(KEYS):
        low, high = _profile(likelihood, best, i)
        spread = (high - low) / 3.92 if np.isfinite(high - low) else np.inf
        result.add(from_interval(key, natural[i], spread, UNITS[i], low, high, "profile likelihood", EXPERIMENTS[i]))
    if result.estimates[KEYS[0]].determined:
        result.remarks.append(
            f"Friction varies by {natural[0]:.1%} (standard deviation); noise of one sample {natural[4]:.2%}."
        )
    return result


def _profile(likelihood, best, index):
    """Natural-scale ends of the interval of parameter ``index``."""
    bounds = ((-12.0, 2.0), (-7.0, 7.0), (-23.0, 2.0), (-9.0, 12.0))[index]

    def deviance(value):
        return likelihood.fit(best, {index: value})[1]

    ends = profile_interval(deviance, best[index], *bounds, spread=0.2)
    at = [np.array(best), np.array(best)]
    natural = []
    for end, copy, limit in zip(ends, at, ((0.0, 0.0, 0.0, 0.0), (np.inf, 1.0, np.inf, np.inf))):
        copy[index] = np.clip(end, *bounds)
        natural.append(likelihood.natural(copy)[index] if np.isfinite(end) else limit[index])
    return tuple(natural)


def position_locked_share(position, deviation, travel, cell, separation):
    """Share of the variance of q that comes back at the same position on a later pass.

    Mean product of pairs in one cell of position whose travel differs by more than ``separation`` [m], over the
    variance. Zero for the processes above; one for friction that is a function of position.

    Parameters
    ----------
    position, deviation, travel : shape (n,): [m], [1], [m].
    cell : size of a cell [m].
    separation : least travel between two visits [m].

    Returns
    -------
    share, pairs : NaN when there is no such pair, and the number of pairs.
    """
    centred = deviation - np.mean(deviation)
    cells = np.floor(position / cell).astype(int)
    order = np.argsort(cells, kind="stable")
    products = []
    for group in np.split(order, np.flatnonzero(np.diff(cells[order])) + 1):
        first, second = np.triu_indices(len(group), 1)
        far = np.abs(travel[group[second]] - travel[group[first]]) > separation
        products.append((centred[group[first]] * centred[group[second]])[far])
    every = np.concatenate(products)
    return (float(every.mean() / centred.var()), len(every)) if len(every) else (float("nan"), 0)
