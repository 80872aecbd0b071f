"""Centred running means, without phase, and the white noise of a reading."""

import numpy as np

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


def reading_noise(reading):
    """Standard deviation of a position reading's white noise from its third differences, by their quartiles [m]."""
    differences = np.diff(reading, 3)
    return max(spread_of(differences) / np.sqrt(THIRD_DIFFERENCE), LEAST_READING)


def spread_of(values):
    """Standard deviation of Gaussian ``values`` (n,) [any unit] from their quartiles, which outliers do not move."""
    # derived: the quartiles
    return np.subtract(*np.percentile(values, [75.0, 25.0])) / QUARTILES
