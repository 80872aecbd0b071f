"""An encoder that stands while the motor turns, shown by the back-EMF: (u − R i) / (volts per speed), summed over
time.

Current and encoder are read at the ends of periods: u − R i is that of the speed there, and the way over a period that
of the mean of both ends (trapezoidal rule). At 1 ms the ends alone would be wrong by 1.5 µm where a slide at 3 mm/s
begins or turns round.
"""

import math
from dataclasses import dataclass

import numpy as np

from microstage_ros.commissioning.findings import refused

LONGEST = 0.1  # window that is looked at [s]
UNSEEN, UNSEEN_STILL = 3e-6, 1e-6
"""Motion by the back-EMF that the encoder need not show [m]: of a drive train that winds up; and, at least, where the
encoder stands on one count, for even a train that winds up moves the stage by a count through the elasticity of its
friction. `Standing` says how much more it is at speed; never more than the first."""
DOUBT = 0.05  # of the voltage: the resistance within some per cent
SAME = (
    0.5  # counts within which the encoder stands: on one. Two would be shown while a train winds up at a slow reversal
)
BRAKE = 0.9  # of the voltage limit, against the motion, once the encoder is found dead
BRAKED = 0.85  # of the time that the model asks: the inertia is known within some ten per cent
LEAST_ROWS = 3  # periods in which the encoder has to stand: about a turning point it does so in one or two
BLIND_ROWS = LEAST_ROWS + 1.0  # periods until a standing encoder is answered, beside the way that it need not show
SAFE_WAY = 8e-6  # that the stage may go from the last good reading until it stands [m]
ROUNDS = 12  # of a speed on which its own allowance depends; each leaves less than a third of the error
SHOWN, SHOWN_ROUGHLY = (
    0.4,
    0.1,
)  # of the motor's motion; less is none. Roughly: constants of the sketch, a scale still unchecked
SIGMAS = 2.0  # standard deviations of a measured resonance
STAGE_FRICTION = "contacts.guideway.static", "contacts.guideway.coulomb"


@dataclass(frozen=True)
class Standing:
    """How far the motor may go on while a live stage stands within one count.

    A stage that swings on its drive train beside a motor at the speed v stands longest where its own speed and
    acceleration are zero together. The train then winds up as k v t and moves the stage by x = v ω² t³/6, ω² = k/m,
    there and before; it stays within a count c for 2 (3 c/(v ω²))^(1/3), in which the motor goes 2 (3 c v²/ω²)^(1/3).
    Friction at the stage holds it for another 2 F/k, from one direction to the other. (Newton's law of the stage; the
    torque of the motor does not bound it, most of which accelerates the rotor.) An encoder that stood before its last
    step says so: the step is that of the same cubic.

    Attributes
    ----------
    count : within which a standing encoder reads one number [m]. softest, stiffest : ω² of the stage on the train
        [rad²/s²], within which it lies. friction_way : 2 F/k [m].
    """

    count: float
    softest: float
    stiffest: float
    friction_way: float

    def way(self, speed):
        """Largest way [m] of the motor at ``speed`` [m/s], between `UNSEEN_STILL` and `UNSEEN`."""
        swung = 2.0 * (3.0 * self.count * speed * speed / self.softest) ** (1.0 / 3.0)
        return min(max(swung + self.friction_way, UNSEEN_STILL), UNSEEN)

    def last_step(self, speed, period):
        """Largest reading [m] of a live encoder's motion over the ``period`` [s] before it stands, beside a motor at
        ``speed`` [m/s]; either reading may be a count off. Nothing where the motor stands."""
        if speed <= 0.0:
            return 0.0
        edge = (3.0 * self.count / (speed * self.stiffest)) ** (1.0 / 3.0)
        return speed * self.stiffest * ((edge + period) ** 3 - edge**3) / 6.0 + 2.0 * self.count


RIGID = Standing(0.0, math.inf, math.inf, 0.0)
"""Of a stage that goes with its motor."""


def standing(sketch, count, fit=None):
    """`Standing` by the tolerances of a sketch; by the measured resonance once there is one.

    ``sketch``: `Sketch`; ``count``: within which a standing encoder reads one number [m]; ``fit``: `PlantFit` or None.
    """
    axis = sketch.axis
    if axis.choices["transmission.type"] == "rigid":
        return RIGID
    factor = {key: 1.0 + sketch.tolerance[key] for key in ("stage.mass", "transmission.stiffness", *STAGE_FRICTION)
              if axis.has(key)}
    stiffness, mass = axis.value("transmission.stiffness"), axis.value("stage.mass")
    doubt = factor["transmission.stiffness"] * factor["stage.mass"]
    square, friction = stiffness / mass, [axis.value(key) * factor[key] for key in STAGE_FRICTION if axis.has(key)]
    if fit is not None and SIGMAS * fit.resonance_error < 1.0:
        square = fit.values["transmission.stiffness"] / mass
        doubt = min(1.0 / (1.0 - SIGMAS * fit.resonance_error) ** 2, doubt)
    held = 2.0 * max(friction, default=0.0) * factor["transmission.stiffness"] / stiffness
    return Standing(count, square / doubt, square * doubt, held)


class EncoderWatch:
    """Compares encoder and back-EMF over all windows of up to `LONGEST` that end now.

    Parameters
    ----------
    period : s. resistance : ohm. volts_per_speed : V s/m at the stage; too large a number makes the watch slower, not
        wrong. offset : of the current [A]. count : of the encoder [m].
    inertia, friction : V s²/m and V, as `open_loop.Strokes` has them; inertia 0: not known, nothing is braked.
    rough : resistance and volts_per_speed are not measured yet. standing : `Standing` of the stage.
    """

    def __init__(
        self,
        period,
        resistance,
        volts_per_speed,
        offset=0.0,
        count=0.0,
        inertia=0.0,
        friction=0.0,
        rough=False,
        standing=RIGID,
    ):
        self._same, self.inertia, self._friction = SAME * count, inertia, max(friction, 0.0)
        self._kept = 1.0 - period / LONGEST
        self._offset = offset if math.isfinite(offset) else 0.0
        self._period, self.resistance, self.volts_per_speed = period, resistance, volts_per_speed
        self._shown = SHOWN_ROUGHLY if rough else SHOWN
        self._doubt = (2.0 if rough else 1.0) * DOUBT
        self.unseen, self.standing = (UNSEEN, UNSEEN_STILL), standing
        self.begin()

    def begin(self):
        """A run begins: what was before does not count."""
        self._row, self._turned, self._sums = 0, 0.0, [(0, 0.0, 0.0, 0.0)]
        self._place, self._drop, self._volts, self._same_rows, self._end = math.inf, 0.0, 0.0, 0, 0.0
        self._step = 0.0
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
        moved = abs(encoder - self._place)
        if moved > self._same:
            self._step = moved if math.isfinite(moved) else 0.0
            self._place, self._drop, self._volts, self._same_rows = encoder, 0.0, 0.0, 0
            return
        self._same_rows += 1
        if self._same_rows > 1 and current == current:  # in the first row the motor may just have turned round
            self._drop = drop = self._kept * self._drop + 0.5 * (before + self._end)
            self._volts = self._kept * self._volts + abs(voltage)
            if self._same_rows >= LEAST_ROWS and abs(drop) > self._most + self._doubt * self._volts:
                way = (abs(drop) - self._doubt * self._volts) * self._period / self.volts_per_speed
                speed = abs(drop) / (self.volts_per_speed * (self._same_rows - 1))  # mean of the rows summed
                if way > self._unseen_still(speed, self._step):
                    self._refuse(drop * self._period / self.volts_per_speed, 0.0)

    def _unseen_still(self, speed, step):
        """Way [m] of the motor at ``speed`` [m/s] that an encoder need not show which stands since a ``step`` [m] of
        one period."""
        if step > self.standing.last_step(speed, self._period):
            return self.unseen[1]
        return self.unseen[1] + self.standing.way(speed) - UNSEEN_STILL

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
        blind, speed = BLIND_ROWS * self._period * slowing, 0.0
        for _ in range(ROUNDS):
            left = SAFE_WAY - self._unseen_still(speed, speed * self._period)
            speed = math.sqrt(blind**2 + 2.0 * slowing * left) - blind
        return speed

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
