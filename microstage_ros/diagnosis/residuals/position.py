"""Encoder against interferometer: residual = interferometer − encoder [m], in means over half a millisecond.

Neither friction nor drive can enter. Noise: white, and the rounding of the encoder, which repeats
while the stage rests (a slow process that about a count of travel renews). How large it is follows from the count that
the record shows and from the encoder's noise: only noise makes a mean of counts tell more than the nearest count.
"""

import math

import numpy as np

from microstage_ros.diagnosis.catalogue.form import splines
from microstage_ros.diagnosis.preprocessing.smoothing import reading_noise
from microstage_ros.diagnosis.preprocessing.whitening import whiten_states

BLOCK = 5   # periods; derived: half a millisecond, as `resonance.BLOCK`, at 10 kHz
LEAST_ROUNDING = 1.5e-9   # m, in a mean at rest; derived: UNSURE · `rounding_left` (25 nm, 8 nm) of the shipped encoder
UNSURE = 2.0        # times what the stated noise leaves: an encoder quieter than its file says leaves more
# counts of travel; calibrated by: validation.variation --group rounding (half and double: the same answers)
RENEWAL = 0.8
# s in which the rounding of a resting stage is another; calibrated by: validation.variation --group forgetting (half
# and double: the same answers)
RENEWAL_TIME = 10.0
LEAST_RENEWAL = 2.0e-8    # m; derived: RENEWAL · 25 nm
ORDERS = 200        # of the series; derived: the rest is 0.0015 of the sum's root even without noise
# s between the knots of a record's own course of drift; calibrated by: validation.variation --group course (half and
# double: the same answers)
PIECE = 2.5


def course_columns(time):
    """Splines in time that make a course of drift, shape (rows, k)."""
    return splines(time, 0.0, float(time[-1]), max(round(float(time[-1]) / PIECE), 2))


def rounding_left(count, noise):
    """Standard deviation [m] of what rounding to counts leaves in a mean over many readings of one place.

    Mean of round((x + n)/q) q − x over Gaussian n of standard deviation σ: Σₖ (−1)ᵏ q/(π k) e^(−2π²k²σ²/q²) sin(2πk
    x/q), of which the root mean square over x is taken (Widrow and Kollár, Quantization Noise, 2008); q/√12 without
    noise.

    Parameters
    ----------
    count : q [m]. noise : σ of one reading [m].
    """
    if not count > 0.0:
        return 0.0
    order = np.arange(1, ORDERS)
    return float(
        math.sqrt(
            np.sum((count / (math.pi * order)) ** 2 / 2.0 * np.exp(-((2.0 * math.pi * order * noise / count) ** 2)))
        )
    )


class Position:
    """Residual of one record; attributes as in `residuals.mechanical.Mechanical`."""

    name, unit = "position", "m"

    def __init__(self, prepared, drive):
        self.prepared, self.drive = prepared, drive
        self.drifts = False     # set where the record takes a course of its own, see `slow_drift`
        self.growth = 0.0       # variance of a reading over its squared speed [s²], where it is late at random
        self.time, self.position, self.speed = (self.mean(v) for v in (
            prepared.time, prepared.stage_position, prepared.stage_speed))
        difference = prepared.interferometer - prepared.encoder
        self.residual = self.mean(difference)
        self.residual -= np.median(self.residual)
        self.scatter = reading_noise(difference) / np.sqrt(BLOCK)
        count = prepared.count or drive.encoder_resolution
        self.rounding = max(UNSURE * rounding_left(count, drive.encoder_noise), LEAST_ROUNDING)
        self.renewal = max(RENEWAL * count, LEAST_RENEWAL)

    def mean(self, values):
        """Block means of a signal, ``values`` of shape (n,) or (n, k)."""
        rows = len(values) // BLOCK * BLOCK
        return values[:rows].reshape(-1, BLOCK, *values.shape[1:]).mean(axis=1)

    def nuisance(self):
        """Homing offset, one constant per record, or the record's own course, which holds it."""
        return course_columns(self.time) if self.drifts else np.ones((len(self.residual), 1))

    def whiten(self, matrix):
        """Unit-variance innovations of ``matrix`` (blocks, k), and Σ ln S."""
        # the floor's lines moved the scale, too, before they were taken out of its reading
        p = self.prepared
        shaken = self.speed + self.mean(np.gradient(p.shake, p.period)) if np.any(p.shake) else self.speed
        step = np.abs(shaken) * BLOCK * p.period
        keeps = np.exp(-step / self.renewal - BLOCK * p.period / RENEWAL_TIME)[:, None]
        white = self.scatter**2 + self.growth * self.speed**2 / BLOCK
        return whiten_states(matrix, np.ones((len(step), 1)), keeps, (self.rounding,), white)
