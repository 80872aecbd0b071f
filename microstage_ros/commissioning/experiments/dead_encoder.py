"""An encoder that stands while the motor turns, told by the back-EMF: (u − R i) / (volts per speed), summed over time."""

import math

import numpy as np

from microstage_ros.commissioning.findings import refused

LONGEST = 0.1  # window that is looked at [s]
UNSEEN, UNSEEN_STILL = 3e-6, 1e-6
"""Motion by the back-EMF that the encoder need not show [m]: of a drive train that winds up; and where the encoder stands on one
count, for even a train that winds up moves the stage by a count through the elasticity of its friction."""
DOUBT = 0.05  # of the voltage: the resistance within some per cent
SHOWN, SHOWN_ROUGHLY = 0.4, 0.1  # of the motor's motion; less is none. Roughly: constants of the sketch, a scale still unchecked


class EncoderWatch:
    """Compares encoder and back-EMF over all windows of up to `LONGEST` that end now.

    Parameters
    ----------
    period : s. resistance : ohm. volts_per_speed : V s/m at the stage; too large a number makes the watch slower, not wrong.
    offset : of the current [A].
    rough : the two are not measured yet.
    """

    def __init__(self, period, resistance, volts_per_speed, offset=0.0, rough=False):
        self._offset = offset if math.isfinite(offset) else 0.0
        self._period, self.resistance, self.volts_per_speed = period, resistance, volts_per_speed
        self._shown = SHOWN_ROUGHLY if rough else SHOWN
        self._doubt = (2.0 if rough else 1.0) * DOUBT
        self.unseen = (UNSEEN, UNSEEN_STILL)
        self.begin()

    def begin(self):
        """A run begins: what was before does not count."""
        self._row, self._sums = 0, [(0, 0.0, 0.0, 0.0)]

    def turned(self, voltage, current):
        """Way of the motor [m at the stage] over rows of voltage [V] and current [A]; a reading answers the voltage of the row before."""
        return float(np.nansum(voltage[:-1] - self.resistance * (current[1:] - self._offset))) / self.volts_per_speed * self._period

    def turned_at_most(self, voltage, current, first):
        """Largest way [m] that the motor may have turned from row ``first`` to the end."""
        way = float(np.abs(voltage[first:]).sum()) / self.volts_per_speed * self._period
        return abs(self.turned(voltage[first:], current[first:])) + self._doubt * way

    def still(self, voltage, current, n, same):
        """Look at the last rows up to ``n``, ``same`` of them, in which the encoder has shown one number. Raises Refused (encoder_dead)."""
        part = slice(max(n - min(same, int(LONGEST / self._period)), 0), n + 1)
        turned = self.turned(voltage[part], current[part])
        way = float(np.abs(voltage[part]).sum()) / self.volts_per_speed * self._period
        if abs(turned) > self.unseen[1] + self._doubt * way:
            self._refuse(turned, 0.0)

    def look(self, encoder, voltage, current, n):
        """Look at all rows up to ``n``. Raises Refused (encoder_dead)."""
        first = self._row
        _, turned, way, _ = self._sums[-1]
        part = slice(first, n + 1)
        turned += self.turned(voltage[part], current[part])
        way += float(np.abs(voltage[first:n]).sum()) / self.volts_per_speed * self._period
        if first == 0:
            self._sums[0] = 0, 0.0, 0.0, float(encoder[0])
        self._sums.append((n, turned, way, float(encoder[n])))
        self._row = n
        while self._sums[0][0] < n - LONGEST / self._period:
            self._sums.pop(0)
        _, before, ways, places = np.array(self._sums).T
        turned, way, moved = turned - before, way - ways, encoder[n] - places
        dead = (np.abs(turned - moved) > self.unseen[0] + self._doubt * way) & (np.abs(moved) < self._shown * np.abs(turned))
        if dead.any():
            k = int(np.argmax(dead))
            self._refuse(turned[k], moved[k])

    def _refuse(self, turned, moved):
        raise refused("encoder_dead", moved, "m", f"the motor turned as for {turned * 1e6:.3g} µm (by its back-EMF) while the "
                      f"encoder showed {moved * 1e6:.3g} µm")
