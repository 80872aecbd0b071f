"""An encoder that stands while the motor turns, shown by the back-EMF: (u − R i) / (volts per speed), summed over
time.

Current and encoder are read at the ends of periods: u − R i is that of the speed there, and the way over a period that
of the mean of both ends (trapezoidal rule). At 1 ms the ends alone would be wrong by 1.5 µm where a slide at 3 mm/s
begins or turns round.
"""

import math

import numpy as np

from microstage_ros.commissioning.findings import refused

LONGEST = 0.1  # window that is looked at [s]
UNSEEN, UNSEEN_STILL = 3e-6, 1e-6
"""Motion by the back-EMF that the encoder need not show [m]: of a drive train that winds up; and where the encoder
stands on one count, for even a train that winds up moves the stage by a count through the elasticity of its
friction."""
DOUBT = 0.05  # of the voltage: the resistance within some per cent
SAME = (
    0.5  # counts within which the encoder stands: on one. Two would be shown while a train winds up at a slow reversal
)
BRAKE = 0.9  # of the voltage limit, against the motion, once the encoder is found dead
BRAKED = 0.85  # of the time that the model asks: the inertia is known within some ten per cent
LEAST_ROWS = 3  # periods in which the encoder has to stand: about a turning point it does so in one or two
BLIND_ROWS = LEAST_ROWS + 1.0  # periods until a standing encoder is answered, beside the way that it need not show
SAFE_WAY = 8e-6  # that the stage may go from the last good reading until it stands [m]
SHOWN, SHOWN_ROUGHLY = (
    0.4,
    0.1,
)  # of the motor's motion; less is none. Roughly: constants of the sketch, a scale still unchecked


class EncoderWatch:
    """Compares encoder and back-EMF over all windows of up to `LONGEST` that end now.

    Parameters
    ----------
    period : s. resistance : ohm. volts_per_speed : V s/m at the stage; too large a number makes the watch slower, not
        wrong. offset : of the current [A]. count : of the encoder [m].
    inertia, friction : V s²/m and V, as `open_loop.Strokes` has them; inertia 0: not known, nothing is braked.
    rough : resistance and volts_per_speed are not measured yet.
    """

    def __init__(
        self, period, resistance, volts_per_speed, offset=0.0, count=0.0, inertia=0.0, friction=0.0, rough=False
    ):
        self._same, self.inertia, self._friction = SAME * count, inertia, max(friction, 0.0)
        self._kept = 1.0 - period / LONGEST
        self._offset = offset if math.isfinite(offset) else 0.0
        self._period, self.resistance, self.volts_per_speed = period, resistance, volts_per_speed
        self._shown = SHOWN_ROUGHLY if rough else SHOWN
        self._doubt = (2.0 if rough else 1.0) * DOUBT
        self.unseen = (UNSEEN, UNSEEN_STILL)
        self.begin()

    def begin(self):
        """A run begins: what was before does not count."""
        self._row, self._turned, self._sums = 0, 0.0, [(0, 0.0, 0.0, 0.0)]
        self._place, self._drop, self._volts, self._same_rows, self._end = math.inf, 0.0, 0.0, 0, 0.0
        self._most = self.unseen[1] * self.volts_per_speed / self._period

    def turned(self, voltage, current):
        """Way of the motor [m at the stage] over rows of voltage [V] and current [A], by the speeds at the ends of
        periods; a reading answers the voltage of the row before."""
        return (
            float(np.nansum(voltage[:-1] - self.resistance * (current[1:] - self._offset)))
            / self.volts_per_speed
            * self._period
        )

    def turned_at_most(self, voltage, current, first):
        """Largest way [m] that the motor may have turned from row ``first`` [1] to the end, under ``voltage`` [V] of
        shape (n,)."""
        way = float(np.abs(voltage[first:]).sum()) / self.volts_per_speed * self._period
        return abs(self.turned(voltage[first:], current[first:])) + self._doubt * way

    def row(self, encoder, voltage, current):
        """One period: the encoder [m], the voltage [V] held before it, the current [A]. Raises Refused (encoder_dead)
        where the motor turns by its back-EMF, over the last `LONGEST` with fading memory, while the encoder stands.
        """
        before = self._end
        if current == current:
            self._end = voltage - self.resistance * (current - self._offset)
        if abs(encoder - self._place) > self._same:
            self._place, self._drop, self._volts, self._same_rows = encoder, 0.0, 0.0, 0
            return
        self._same_rows += 1
        if self._same_rows > 1 and current == current:  # in the first row the motor may just have turned round
            self._drop = drop = self._kept * self._drop + 0.5 * (before + self._end)
            self._volts = self._kept * self._volts + abs(voltage)
            if self._same_rows >= LEAST_ROWS and abs(drop) > self._most + self._doubt * self._volts:
                self._refuse(drop * self._period / self.volts_per_speed, 0.0)

    def speed(self, voltages, currents):
        """Speed of the motor [m/s at the stage] by voltages [V] and the currents [A] that answer them."""
        seen = [u - self.resistance * (i - self._offset) for u, i in zip(voltages, currents) if i == i]
        return sum(seen) / len(seen) / self.volts_per_speed if seen else 0.0

    def brake_time(self, speed, voltage):
        """Time [s] in which ``voltage`` [V] against a motion of ``speed`` [m/s] ends it: m dv/dt = −(u + friction) − k
        v."""
        return (
            self.inertia
            / self.volts_per_speed
            * math.log1p(self.volts_per_speed * abs(speed) / (voltage + self._friction))
        )

    def safe_speed(self, limit):
        """Speed [m/s] from which the stage stands within `SAFE_WAY` after the last good reading, at a voltage limit
        [V]."""
        slowing = BRAKED * BRAKE * limit / max(self.inertia, 1e-9)
        blind = BLIND_ROWS * self._period * slowing
        return math.sqrt(blind**2 + 2.0 * slowing * (SAFE_WAY - self.unseen[1])) - blind

    def look(self, encoder, voltage, current, n):
        """Look at all rows up to ``n`` [1], of ``voltage`` [V]. Raises Refused (encoder_dead)."""
        first = self._row
        _, _, way, _ = self._sums[-1]
        part = slice(first, n + 1)
        self._turned += self.turned(voltage[part], current[part])
        half = 0.5 * self.turned(voltage[n - 1:n + 1], current[n - 1:n + 1])  # of the last row: half at either end
        turned = self._turned - half
        way += float(np.abs(voltage[first:n]).sum()) / self.volts_per_speed * self._period
        if first == 0:
            self._sums[0] = 0, 0.0, 0.0, float(encoder[0])
        self._sums.append((n, turned, way, float(encoder[n])))
        self._row = n
        while self._sums[0][0] < n - LONGEST / self._period:
            self._sums.pop(0)
        _, before, ways, places = np.array(self._sums).T
        turned, way, moved = turned - before, way - ways, encoder[n] - places
        dead = (np.abs(turned - moved) > self.unseen[0] + self._doubt * way) & (
            np.abs(moved) < self._shown * np.abs(turned)
        )
        if dead.any():
            k = int(np.argmax(dead))
            self._refuse(turned[k], moved[k])

    def _refuse(self, turned, moved):
        raise refused(
            "encoder_dead",
            moved,
            "m",
            f"the motor turned as for {turned * 1e6:.3g} µm (by its back-EMF) while the "
            f"encoder showed {moved * 1e6:.3g} µm",
        )
