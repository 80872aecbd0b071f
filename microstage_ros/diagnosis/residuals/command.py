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
step at which the drive is switched off. A row whose current was not read has no weight.
"""

import numpy as np
from scipy.signal import oaconvolve

from microstage_ros.diagnosis.preprocessing.smoothing import spread_of
from microstage_ros.numerics.compiled import compiled

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
        fast = _fast_part(self.residual[:, None], WINDOW, np.ones(len(self.residual)))[:, 0]
        # derived: half of the noise of the shipped axis's amplifier; a record with less has none
        self.noise = max(spread_of(fast), 0.5e-3)
        off = np.abs(fast) / self.noise
        # (n,); a current that was not read was made of this very command
        self._weight = np.where(p.unread, 0.0, FURTHEST / np.maximum(off, FURTHEST))
        self._shown = {}

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

    def put_out(self, voltage):
        """Take it for known that a prompt amplifier would put out this ``voltage`` (n,) [V]."""
        self.prompt = voltage
        self._shown.pop("prompt", None)

    def filtered(self, amplifier):
        """How an amplifier that makes ``amplifier(command)`` of its command shows, less the command: shape (n, 1) [V].

        ``amplifier`` is linear and the same at all times, so that K may come before it, and is computed once for all of
        them. It sees a command that stands still before the record's first row and after its last.
        """
        reach = len(self.prepared.speed_share) // 2
        late = amplifier(self._beside("prompt")) - self._beside("command")
        return late[reach:len(late) - reach, None]

    def _beside(self, name):
        """c − K c of the attribute ``name``, half of K's length of rows longer at both ends."""
        if name not in self._shown:
            reach = len(self.prepared.speed_share) // 2
            self._shown[name] = self.beside_speed(np.pad(getattr(self, name), reach, mode="edge"))[:, 0]
        return self._shown[name]

    def whiten(self, matrix):
        """Unit-variance columns of ``matrix`` (n, k), the first of them the residual, and 0."""
        return _fast_part(np.ascontiguousarray(matrix), WINDOW, self._weight / self.noise), 0.0


@compiled
def _fast_part(matrix, window, weight):
    """Columns of ``matrix`` (n, k) without their running mean over ``window`` rows, times ``weight`` (n,)."""
    rows, half = len(matrix), window // 2
    out = np.empty_like(matrix)
    for k in range(matrix.shape[1]):
        total = 0.0
        for i in range(-half, half + 1):
            total += matrix[min(max(i, 0), rows - 1), k]
        for i in range(rows):
            out[i, k] = (matrix[i, k] - total / window) * weight[i]
            total += matrix[min(i + half + 1, rows - 1), k] - matrix[max(i - half, 0), k]
    return out
