"""Centred running means, without phase, means over blocks, and the white noise of a reading."""

import numpy as np

from microstage_ros.numerics.compiled import compiled

QUARTILES = 1.349       # interquartile range of a Gaussian of unit variance; derived: 2 Φ⁻¹(3/4)
MEDIAN_SIZE = 0.6745    # median of its sizes; derived: Φ⁻¹(3/4)
# variance of a third difference of white noise, over the noise's; derived: 1² + 3² + 3² + 1²
THIRD_DIFFERENCE = 20.0
# m/s; calibrated by: validation.variation --group lines (half and double: the same answers)
REST_SPEED = 2.0e-5
LEAST_READING = 1.0e-10     # m; derived: a hundredth of the 10 nm of a reading's noise, where a record has none


def triangle(values, width):
    """Centred triangular running mean of ``values`` (n,): two running means of odd ``width`` [1], ends padded."""
    return _boxcar(_boxcar(values, width), width)


def _boxcar(values, width):
    """Centred running mean of odd ``width``, ends padded with the end values."""
    padded = np.pad(values, width // 2, mode="edge")
    sums = np.cumsum(np.concatenate([[0.0], padded]))
    return (sums[width:] - sums[:-width]) / width


def block_means(values, block):
    """Means of a signal, ``values`` of shape (n,) or (n, k), over every ``block`` [1] of its rows: (n // block,) or
    (n // block, k), in the same unit."""
    rows = len(values) // block * block
    if values.ndim > 1 and values.shape[1] > 1:      # numpy's sum over an axis before the last takes ten times as long
        return _sums(np.ascontiguousarray(values, float), block) / block
    return values[:rows].reshape(-1, block, *values.shape[1:]).mean(axis=1)


@compiled
def _sums(values, block):
    sums = np.empty((len(values) // block, values.shape[1]))
    for row in range(len(sums)):
        sums[row] = values[row * block]
        for n in range(row * block + 1, (row + 1) * block):
            for k in range(values.shape[1]):
                sums[row, k] += values[n, k]
    return sums


def reading_noise(reading):
    """Standard deviation of a position reading's white noise from its third differences, by their quartiles [m]."""
    differences = np.diff(reading, 3)
    return max(spread_of(differences) / np.sqrt(THIRD_DIFFERENCE), LEAST_READING)


def spread_of(values):
    """Standard deviation of Gaussian ``values`` (n,) [any unit] from their quartiles, which outliers do not move."""
    # derived: the quartiles
    return np.subtract(*np.percentile(values, [75.0, 25.0])) / QUARTILES
