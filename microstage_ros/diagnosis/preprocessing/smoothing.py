"""Centred running means, without phase, and the white noise of a reading."""

import numpy as np


def triangle(values, width):
    """Centred triangular running mean of ``values`` (n,): two running means of odd ``width`` [1], ends padded."""
    return _boxcar(_boxcar(values, width), width)


def _boxcar(values, width):
    """Centred running mean of odd ``width``, ends padded with the end values."""
    padded = np.pad(values, width // 2, mode="edge")
    sums = np.cumsum(np.concatenate([[0.0], padded]))
    return (sums[width:] - sums[:-width]) / width


def reading_noise(reading):
    """Standard deviation of a position reading's white noise from its third differences, robustly [m]."""
    differences = np.diff(reading, 3)
    spread = np.subtract(*np.percentile(differences, [75.0, 25.0])) / 1.349
    return max(spread / np.sqrt(20.0), 1.0e-10)
