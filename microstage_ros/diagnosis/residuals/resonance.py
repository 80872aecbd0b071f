"""Stage against motor, fast part: how the drive train passes on what the motor does above some 50 Hz.

    residual = x − H(s) (r/N) θ + G(s) F_g        [m], means over half a millisecond, slower parts removed
    H = (D_c s + K_c)/(m s² + D_c s + K_c),  G = 1/(m s² + D_c s + K_c)

The motor's θ is the back-EMF's, which holds the amplifier's noise. Where the motor hardly moves, θ is that noise alone,
and a drive that passes on less of it fits better: a soft one. So blocks in which H (r/N) θ is no larger than noise
makes it have no weight.
"""

import functools
import math

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from microstage_ros.diagnosis.preprocessing.motion import smooth_motion
from microstage_ros.diagnosis.preprocessing.preparation import SHARE_ROWS, TRAVEL_NOISE, stage_filter
from microstage_ros.diagnosis.preprocessing.smoothing import MEDIAN_SIZE, block_means
from microstage_ros.diagnosis.residuals.transmission_deflection import LEAST_NOISE
from microstage_ros.numerics.compiled import compiled
from microstage_ros.signals.travel import motor_travel

# s; at least a period; calibrated by: validation.variation --group swing (half and double: the same answers)
BLOCK = 5.0e-4
# s: slower parts belong to the wind-up channel; calibrated by: validation.variation --group swing (half and double: the
# same answers)
WINDOW = 1.05e-2
NEAR = round(WINDOW / BLOCK)   # blocks over which the local size is taken; derived: those of one `WINDOW`
# blocks over which the size of the whitened residual is a median; calibrated by: validation.variation --group size
# (half and double: the same answers)
LOCAL = 101
# local size of a whitened residual that noise alone reaches; derived: five standard deviations above that of `NEAR`
CALM = 1.0 + 5.0 / (2.0 * NEAR) ** 0.5
# times the power that the amplifier's noise makes in θ; derived: at ten a fit is short by a tenth of what θ passes on,
# and an amplifier of three times the stated noise alone does not reach it
MOVES = 10.0


class Resonance:
    """Residual of one record; attributes as in `channels.mechanical.Mechanical`."""

    name, unit = "resonance", "m"

    def __init__(self, prepared, drive):
        self.prepared, self.drive = prepared, drive
        p = prepared
        self.block = max(round(BLOCK / p.period), 1)
        self._window = 2 * int(0.5 * WINDOW / (self.block * p.period)) + 1
        self.time, self.position, self.speed = (self.mean(v) for v in (p.time, p.position, p.speed))
        self.force = p.guideway + drive.guideway.viscous * p.stage_speed
        self._nominal = self.predict()
        self.residual = self.mean(p.stage - p.stage[0]) - self._nominal
        self.noise = p.stage_noise / np.sqrt(self.block)
        self.weight = self._weight()

    def mean(self, values):
        """Block means of a signal, ``values`` of shape (n,) or (n, k)."""
        return block_means(values, self.block)

    def predict(self, stiffness=1.0, damping=1.0, mass=1.0, load=1.0):
        """Stage position from the motor's [m], in block means, with the factors ``stiffness``, ``damping``, ``mass``
        and ``load`` [1] on K_c, D_c, m and the guideway force."""
        factors = {"stiffness": stiffness, "damping": damping, "mass": mass}
        b, a = stage_filter(self.drive, self.prepared.period, **factors)
        g, _ = stage_filter(self.drive, self.prepared.period, **factors, force=True)
        return _passed_on(self.prepared.travel, self.force, b, -load * g, a, self.block)

    def passed_on(self, travel):
        """Stage position [m], in block means, from a motor's ``travel`` (n,) [m] alone."""
        b, a = stage_filter(self.drive, self.prepared.period)
        return _passed_on(travel, np.zeros(len(travel)), b, np.zeros(3), a, self.block)

    def change(self, stiffness=1.0, damping=1.0, mass=1.0, load=1.0):
        """`predict` with these factors ``stiffness``, ``damping``, ``mass``, ``load`` [1] less `predict` without any
        [m]."""
        return self.predict(stiffness, damping, mass, load) - self._nominal

    def _weight(self):
        """One over the local size of the whitened residual where that is well above the noise.

        Rattle in a gap or a resonance far off the model cannot be followed cycle by cycle; such stretches
        must not outvote the rest.
        """
        white = self._fast(self.residual) / self.noise
        local = median_filter(np.abs(white), LOCAL, mode="nearest") / MEDIAN_SIZE
        # derived: noise comes so far once in 16 000 rows
        clipped = np.minimum(np.abs(white), 4.0 * np.maximum(local, 1.0))
        power = uniform_filter1d(clipped**2, NEAR, mode="nearest")
        moving = uniform_filter1d(self._fast(self._nominal) ** 2, NEAR, mode="nearest")
        # derived: a step's rounding is uniform, step/√12
        noise = max(math.hypot(self.drive.amplifier_noise, self.drive.converter_step / math.sqrt(12.0)), LEAST_NOISE)
        least = MOVES * (noise * _feigned(self.drive, self.prepared.period, self.block, self._window)) ** 2
        return np.where(moving > least, 1.0 / np.maximum(np.sqrt(power) / CALM, 1.0), 0.0)

    def _fast(self, values):
        """Without the running mean along the first axis."""
        return values - uniform_filter1d(values, self._window, axis=0, mode="nearest")

    def whiten(self, matrix):
        """Unit-variance columns of ``matrix`` (blocks, k), and 0."""
        return self._fast(matrix) / self.noise * self.weight[:, None], 0.0


@functools.lru_cache(maxsize=64)    # derived: memory alone, no result depends on it
def _feigned(drive, period, block, window):
    """Standard deviation of the fast part of H (r/N) θ, in means over ``block`` periods without those over ``window``
    blocks, by a white noise of 1 V of the amplifier [m/V]; ``period`` [s]."""
    voltage, still = np.zeros(SHARE_ROWS), np.zeros(SHARE_ROWS)
    voltage[SHARE_ROWS // 2] = 1.0
    travel = smooth_motion(motor_travel(voltage, still, drive, period), still, drive, period, TRAVEL_NOISE).position
    b, a = stage_filter(drive, period)
    means = uniform_filter1d(_passed_on(travel, still, b, np.zeros(3), a, 1), block)
    return float(np.sqrt(np.sum((means - uniform_filter1d(means, block * window)) ** 2)))


@compiled
def _passed_on(travel, force, b, g, a, block):
    """Means over blocks of (b(z) travel + g(z) force) / a(z), second order, from rest, in transposed direct form II."""
    out = np.empty(travel.size // block)
    first, second = 0.0, 0.0
    for k in range(out.size):
        total = 0.0
        for i in range(k * block, (k + 1) * block):
            x, f = travel[i], force[i]
            y = b[0] * x + g[0] * f + first
            first = b[1] * x + g[1] * f - a[1] * y + second
            second = b[2] * x + g[2] * f - a[2] * y
            total += y
        out[k] = total / block
    return out
