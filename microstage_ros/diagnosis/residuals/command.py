"""Command against current, fast part: residual = R i_s + K_E (N/r) v − u[n−1] − K (u_a − u)  [V], slower parts removed.

The current settles within a period (L/R is a fifth of it), so it answers row n − 1 of the command and
nothing else; a delay or a lag of the amplifier shows as the missing part of the command's changes.

The motor's speed v comes from the back-EMF, below some 500 Hz, so from the very voltage u_a that was taken for the
amplifier's; of an error of that it takes the part K (`preparation.speed_share`). So a delay that is not known yet shows
without that part, c − K c, and what an amplifier that is known by then, u_a ≠ u, has put into v is taken out.

A law that feeds back the measured current puts its noise e into the next rows of the command, and a running mean that
is taken from both reaches these: of ± h rows it makes a correlation of the order of 1/h, which is no lag. So `WINDOW`
is as wide as the error of v allows.

Noise: the amplifier's, white. A row further off than `FURTHEST` weighs as much as one that is so far off; its weight
holds for the residual and the forms alike. With the residual alone cut off, a delay would explain only a third of a
step at which the drive is switched off.
"""

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import oaconvolve

from microstage_ros.diagnosis.preprocessing.smoothing import spread_of

# periods; calibrated by: `test/diagnosis/cases/plain_programmes.py --effect actuator_lag`, with 9, 21 and 41 here (seed
# 7000: lags up to 51, 4 and 0.3 % too long; but the wider, the more of a lag does a gap of the drive feign)
WINDOW = 21
FURTHEST = 30.0  # standard deviations; derived: no noise comes there, a step or a gap in the record does


class Command:
    """Residual of one record; ``command`` is the rounded voltage that each current answers, slow parts kept; ``prompt``
    what of it an amplifier without delay or lag puts out, the command itself where nothing else is known;
    ``winding`` is T R/L."""

    name, unit = "command", "V"

    def __init__(self, prepared, drive):
        self.prepared, self.drive = prepared, drive
        p = prepared
        self.command = self.prompt = p.commanded
        self.winding = p.period * drive.resistance / drive.inductance
        voltage = drive.resistance * p.settled + drive.back_emf / drive.lever * p.speed
        self.residual = voltage - p.commanded - self.in_speed(p.answered - p.commanded)
        # derived: half of the noise of the shipped axis's amplifier; a record with less has none
        self.noise = max(spread_of(self.fast(self.residual[:, None])[:, 0]), 0.5e-3)
        off = np.abs(self.fast(self.residual[:, None])) / self.noise  # (n, 1)
        self._weight = FURTHEST / np.maximum(off, FURTHEST)

    def in_speed(self, voltage):
        """What the motor's speed takes of an error of the ``voltage`` (n,) that it was found from, K_E (N/r) v, shape
        (n,) [V]."""
        share = self.prepared.speed_share
        padded = np.pad(voltage, len(share) // 2, mode="edge")
        return oaconvolve(padded, share, mode="valid")

    def beside_speed(self, voltage):
        """How a ``voltage`` (n,) [V] that the amplifier puts out, and nobody knows of, shows in the residual: c − K c,
        shape (n, 1)."""
        return (voltage - self.in_speed(voltage))[:, None]

    @staticmethod
    def fast(matrix):
        """The columns of ``matrix`` (n, k) without their running mean."""
        return matrix - uniform_filter1d(matrix, WINDOW, axis=0, mode="nearest")

    def whiten(self, matrix):
        """Unit-variance columns of ``matrix`` (n, k), the first of them the residual, and 0."""
        return self._weight * self.fast(matrix) / self.noise, 0.0
