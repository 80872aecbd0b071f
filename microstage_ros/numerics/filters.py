"""Filters without phase, for records that are whole."""

import numpy as np
from scipy import signal


def low_pass(values: np.ndarray, edge: float, period: float) -> np.ndarray:
    """Zero-phase fourth-order Butterworth low-pass, forward and backward, along the first axis.

    Parameters
    ----------
    values : shape (n,) or (n, k), at least 16 rows.
    edge : of the pass band of one pass [Hz], below half the sampling rate.
    period : of sampling [s].

    Returns
    -------
    The same shape as ``values``.
    """
    sections = signal.butter(4, edge * 2.0 * period, output="sos")
    return signal.sosfiltfilt(sections, values, axis=0)
