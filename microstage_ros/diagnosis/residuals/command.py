"""Command against current, fast part: residual = R i_s + K_E (N/r) v − u[n−1]  [V], slower parts removed.

The current settles within a period (L/R is a fifth of it), so it answers row n − 1 of the command and
nothing else; a delay or a lag of the amplifier shows as the missing part of the command's changes.
Noise: the amplifier's, white. A row further off than `FURTHEST` weighs as much as one that is so far off; its weight
holds for the residual and the forms alike. With the residual alone cut off, a delay would explain only a third of a
step at which the drive is switched off.
"""

import numpy as np
from scipy.ndimage import uniform_filter1d

from microstage_ros.diagnosis.preprocessing.smoothing import spread_of

# periods; derived: a mean of 9 at 10 kHz takes half away at 670 Hz; below, the motor itself moves, and the wind-up
# channel judges
WINDOW = 9
REACH = WINDOW // 2  # periods; derived: the running mean that is taken away reaches as far
FURTHEST = 30.0  # standard deviations; derived: no noise comes there, a step or a gap in the record does


class Command:
    """Residual of one record; ``command`` is the rounded voltage that each current answers, slow parts kept;
    ``winding`` is T R/L; ``alone``: whether
    the command's neighbours, `nuisance`, are not taken out of residual and forms."""

    name, unit = "command", "V"

    def __init__(self, prepared, drive):
        self.prepared, self.drive = prepared, drive
        p = prepared
        self.command = p.commanded
        self.winding = p.period * drive.resistance / drive.inductance
        voltage = drive.resistance * p.settled + drive.back_emf / drive.lever * p.speed
        self.residual = voltage - p.commanded
        self.noise = max(spread_of(self.fast(self.residual[:, None])[:, 0]), 0.5e-3)
        off = np.abs(self.fast(self.residual[:, None])) / self.noise  # (n, 1)
        self._weight = FURTHEST / np.maximum(off, FURTHEST)
        self.alone = False

    def nuisance(self):
        """The command's neighbours, as many periods before as after, (n, REACH).

        Motor speed comes from the back-EMF, so from the command, smoothed without delay. An amplifier of another gain
        shows through it on both sides of a change alike; a delay or a lag shows after it alone. None if the command is
        to stand ``alone``.
        """
        if self.alone:
            return None
        padded = np.pad(self.command, REACH, mode="edge")
        n = len(self.command)
        return np.stack([padded[REACH - k:][:n] + padded[REACH + k:][:n] for k in range(1, REACH + 1)], axis=1)

    @staticmethod
    def fast(matrix):
        """The columns of ``matrix`` (n, k) without their running mean."""
        return matrix - uniform_filter1d(matrix, WINDOW, axis=0, mode="nearest")

    def whiten(self, matrix):
        """Unit-variance columns of ``matrix`` (n, k), the first of them the residual, and 0."""
        return self._weight * self.fast(matrix) / self.noise, 0.0
