"""Encoder against interferometer: residual = interferometer − encoder [m], in means over half a millisecond.

Neither friction nor drive can enter. Noise: white, and the rounding of the encoder, which repeats
while the stage rests (a slow process that about a count of travel renews). How large it is follows from the count that
the record shows and from the encoder's noise: only noise makes a mean of counts tell more than the nearest count.
"""

import math

import numpy as np
from scipy.ndimage import maximum_filter1d

from microstage_ros.diagnosis.catalogue.form import splines
from microstage_ros.diagnosis.preprocessing.smoothing import REST_SPEED, block_means, reading_noise, triangle
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
# m; derived: a third of the standard deviation of an interferometer's reading of 1 nm over a block
LEAST_WAVE = 1.5e-10
MOST_ORDERS = 4     # derived: with a noise of a quarter of a count the second has a thousandth of the first
# periods; derived: 10 nm of noise leave 0.6 nm, of which a count of 25 nm is forty times as much
SMOOTH = 201
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


def rounding_orders(count, noise):
    """Orders k [1] of what rounding leaves (`rounding_left`) whose amplitude q/(π k) e^(−2π²k²σ²/q²) is `LEAST_WAVE` at
    least, (n,); ``count`` q [m], ``noise`` σ [m]."""
    if not count > 0.0:
        return np.zeros(0, int)
    order = np.arange(1, MOST_ORDERS + 1)
    return order[count / (math.pi * order) * np.exp(-2.0 * (math.pi * order * noise / count) ** 2) > LEAST_WAVE]


def _place_of(prepared):
    """Where the stage is, shape (n,) [m]: `Prepared.stage_position`, and a mean over `SMOOTH` periods where it rests.

    The reading's own noise is in the residual, too. A resting stage that is known no better than to some nanometres
    would explain it: by an error of the encoder with a short period, or of its scale.
    """
    slow = triangle(prepared.stage, SMOOTH)
    speed = maximum_filter1d(np.abs(np.gradient(slow, prepared.period)), 2 * SMOOTH + 1, mode="nearest")
    return np.where(speed < REST_SPEED, slow, prepared.stage_position)


class Position:
    """Residual of one record; attributes as in `residuals.mechanical.Mechanical`, and ``place`` (n,) [m]."""

    name, unit = "position", "m"

    def __init__(self, prepared, drive):
        self.prepared, self.drive = prepared, drive
        self.drifts = False     # set where the record takes a course of its own, see `slow_drift`
        self.growth = 0.0       # variance of a reading over its squared speed [s²], where it is late at random
        self.place = _place_of(prepared)
        self.time, self.position, self.speed = (self.mean(v) for v in (
            prepared.time, self.place, prepared.stage_speed))
        difference = prepared.interferometer - prepared.encoder
        self.residual = self.mean(difference)
        self.residual -= np.median(self.residual)
        self.scatter = reading_noise(difference) / np.sqrt(BLOCK)
        self.count = count = prepared.count or drive.encoder_resolution
        self.rounding = max(UNSURE * rounding_left(count, drive.encoder_noise), LEAST_ROUNDING)
        self.orders = rounding_orders(count, drive.encoder_noise)
        self.renewal = max(RENEWAL * count, LEAST_RENEWAL)

    def mean(self, values):
        """Block means of a signal, ``values`` of shape (n,) or (n, k)."""
        return block_means(values, BLOCK)

    def nuisance(self):
        """Columns (blocks, k) [1] that are free: the homing offset, one constant per record, or the record's own
        course, which holds it; and the rounding, which is a function of the place: sin and cos of 2πk x/q, as far as
        noise leaves any of it (`rounding_left`).

        A stage that comes back to the same few places finds the same error there each time. Within less than a signal
        period nobody knows the phase of the interpolation error that the axis file states, as after another homing it
        is another: its harmonics are free, too.
        """
        course = course_columns(self.time) if self.drifts else np.ones((len(self.residual), 1))
        p, drive = self.prepared, self.drive
        turns = [2.0 * np.pi * k * self.place / self.count for k in self.orders]
        if np.ptp(p.stage_position) < drive.signal_period:
            turns += [2.0 * np.pi * n * self.place / drive.signal_period
                      for n, size in enumerate(drive.interpolation, 1) if size]
        return np.column_stack([course, *(self.mean(wave(turn)) for turn in turns for wave in (np.sin, np.cos))])

    def whiten(self, matrix):
        """Unit-variance innovations of ``matrix`` (blocks, k), and Σ ln S."""
        # the floor's lines moved the scale, too, before they were taken out of its reading
        p = self.prepared
        shaken = self.speed + self.mean(np.gradient(p.shake, p.period)) if np.any(p.shake) else self.speed
        step = np.abs(shaken) * BLOCK * p.period
        keeps = np.exp(-step / self.renewal - BLOCK * p.period / RENEWAL_TIME)[:, None]
        white = self.scatter**2 + self.growth * self.speed**2 / BLOCK
        return whiten_states(matrix, np.ones((len(step), 1)), keeps, (self.rounding,), white)
