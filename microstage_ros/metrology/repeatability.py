"""Accuracy of repeated moves to one target: bias, four sigma and how well ten moves know it."""

from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv


class Repeatability(NamedTuple):
    """Of the errors of n moves (m)."""

    count: int
    mean: float
    four_sigma: float
    low: float
    high: float


def repeatability(errors, confidence=0.95):
    """Bias, 4 s and its confidence interval.

    s is the standard deviation with n - 1; (n - 1) s^2 / sigma^2 is chi-square with n - 1 degrees of freedom
    for normal errors, so the interval of 4 sigma is 4 s sqrt((n - 1) / chi2_q). At n = 10 it reaches from 0.69
    to 1.83 times 4 s.

    Parameters
    ----------
    errors : position - target of each move [m], shape (n,).

    Returns
    -------
    `Repeatability`; NaN where n is below 2.
    """
    errors = np.asarray(errors, float)
    n = len(errors)
    if n < 2:
        return Repeatability(n, float(errors.mean()) if n else np.nan, np.nan, np.nan, np.nan)
    four = 4.0 * float(errors.std(ddof=1))
    tail = (1.0 - confidence) / 2.0
    low, high = (np.sqrt((n - 1) / (2.0 * gammaincinv((n - 1) / 2.0, q))) for q in (1.0 - tail, tail))
    return Repeatability(n, float(errors.mean()), four, float(four * low), float(four * high))
