"""Whether the encoder lives and which way it counts, for drives of which nothing else tells motion.

A pulse of the command u for the time t, and half of it the other way for twice as long, move a free mass by 1.5 u t²/I
and leave it at rest; I is the command per acceleration. A stage with friction f (in units of the command) goes forward
by (u − f) t²/(2 I) · (1 + (u − f)/(f + u/2)) and, where u/2 is more than f, some of it back; `ShortPulses.way` is the
difference. Through a drive train a rotor with the momentum u t winds it up to the force u t ω, ω its angular frequency
against a stage that stands; that has to be more than the friction.

Gain and mass together are within a factor Γ of the sketch's. The heaviest and weakest machine, with the largest
friction, has to show itself before an encoder is called dead: d, at least. The lightest and strongest one goes Γ² · 1.5
u t²/(I d) times as far then, without friction: 3.6 Γ² d at u = 3 f, 2.3 Γ² d at 6 f. Friction that is not the same
both ways leaves a part of each pulse. (Newton's law with Coulomb friction.)

What moves while the pulse lasts tells the sign, and so does what moves under its counterpart until a rotor that its
drive train has stopped comes back: with the momentum of the counterpart it may draw a stage farther back than it went.
What moves later tells only that the encoder lives.
"""

import math
from dataclasses import dataclass

import numpy as np

from microstage_ros.commissioning.estimation.known import FRICTION
from microstage_ros.control.design.rules import volts_per_acceleration
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.model.actuators import actuator_of

RISE, LEVELS = 3.0, 4  # from one level to the next, and how many below the highest: friction that is not the same both
# ways leaves a part of each; a machine lighter than the sketch allows is seen before it goes three times as far
HARD = 6.0  # times the largest friction, the level for which the length of the pulses is made
PROVEN = 1.15  # times what is seen as motion, that the heaviest and weakest machine goes: friction varies by as much
COUNTS, SIGMAS = 3.0, 6.0  # that are seen as motion: either reading may be one count off; standard deviations
BRAKE, LONGER = 0.5, 2  # of the level, times the length, of the second part: the momentum of the first
GAIN = {
    "force": ("drive.gain",),
    "current_motor": ("drive.torque_constant",),
    "voice_coil": ("drive.force_constant", "drive.resistance"),
}
STIFFNESS, WOUND = "transmission.stiffness", 1.5  # times the friction, that a rotor which is stopped winds up
MASS = "stage.mass", "drive.rotor_inertia"


@dataclass(frozen=True)
class ShortPulses:
    """How long and how strong.

    Attributes
    ----------
    inertia : I of the sketch [command s²/m]. spread : Γ [1]. friction : largest one that the sketch allows, as the
        weakest drive feels it [unit of the command]. threshold : way that is seen as motion [m].
    rate : ω of the heaviest rotor on the softest train [rad/s], infinite without one. returns : time in which the
        lightest rotor comes back from the stiffest one [s].
    limit : largest command [its unit]. period : of control [s].
    """

    inertia: float
    spread: float
    friction: float
    threshold: float
    rate: float
    returns: float
    limit: float
    period: float

    @classmethod
    def of(cls, sketch, expected, noise, limit):
        """From a sketch.

        ``expected``: breakaway command of the sketch [unit of the command]. ``noise``: of the encoder, standard
        deviation [m]. ``limit``: largest command [unit of the command].
        """
        axis = sketch.axis

        def factor(keys):
            return max((1.0 + sketch.tolerance[key] for key in keys if axis.has(key)), default=1.0)

        gain = math.prod(1.0 + sketch.tolerance[key] for key in GAIN[axis.choices["drive.type"]])
        inertia = volts_per_acceleration(controller_parameters("pid_feedforward", axis, {})["feedforward"])
        friction = gain * factor(FRICTION) * expected
        threshold = max(COUNTS * axis.value("sensors.encoder.resolution"), SIGMAS * noise)
        rate, doubt = math.inf, 1.0
        if axis.choices["transmission.type"] != "rigid":
            rate = math.sqrt(axis.value(STIFFNESS) / actuator_of(axis).reflected_mass(axis))
            doubt = math.sqrt(factor((STIFFNESS,)) * factor(MASS))
        back = math.pi / (rate * doubt) if math.isfinite(rate) else math.inf
        return cls(inertia, gain * factor(MASS), friction, threshold, rate / doubt, back, limit, axis.value("period"))

    def way(self, level, length):
        """Way [m] of the heaviest and weakest machine under ``level`` [unit of the command] for ``length`` [s]."""
        left, back = level - self.friction, max(BRAKE * level - self.friction, 0.0)
        stops = left / (self.friction + BRAKE * level)  # in lengths of the pulse, under the counterpart
        there = 0.5 * left * (1.0 + stops)
        again = 0.5 * back * (LONGER - stops) ** 2 * (1.0 + back / self.friction)
        return (there - again) * length**2 / (self.spread * self.inertia)

    @property
    def rows(self):
        """Periods of a pulse."""
        level = min(HARD * self.friction, self.limit)
        if level <= 1.0001 * self.friction:  # the limit does not move the heaviest one: as long as if it did
            level = HARD * self.friction
        far, wound = PROVEN * self.threshold / self.way(level, 1.0), WOUND * self.friction / level / self.rate
        return max(math.ceil(max(math.sqrt(far), wound) / self.period), 1)

    @property
    def highest(self):
        """Level [unit of the command] at which the heaviest and weakest machine shows itself, or the limit."""
        length = self.rows * self.period
        low, high = max(1.0, WOUND / length / self.rate) * self.friction, max(HARD * self.friction, self.limit)
        for _ in range(50):
            level = 0.5 * (low + high)
            low, high = (low, level) if self.way(level, length) >= PROVEN * self.threshold else (level, high)
        return min(high, self.limit)


@dataclass(frozen=True)
class Felt:
    """A pulse that moved the stage: its level [unit of the command], the way [m], whether that tells the sign."""

    level: float
    way: float
    tells_sign: bool


def felt(pulses, short, highest):
    """(level, [`Felt`, ...]) of the first pulses that move the stage; an empty list: none does.

    Parameters
    ----------
    pulses : `first_motion.Pulses`. short : `ShortPulses`. highest : level at which to give up [unit of the command].
    """
    for number in range(-LEVELS, 1):
        level = highest * RISE**number
        for sign in (1.0, -1.0):
            found = _one(pulses, short, sign * level)
            if found:
                again = [_one(pulses, short, each * level) for each in (-sign, sign, -sign)]
                return level, [found, *(each for each in again if each)]
    return highest, []


def _one(pulses, short, level):
    """`Felt` where the stage moves, None where it does not; ``level``: with its sign."""
    machine = pulses.machine
    start, rows = machine.position, short.rows
    pushed = rows + LONGER * rows
    total = pushed + machine.periods(pulses.rest, 20)

    def command(n, x, i):
        return level if n < rows else -BRAKE * level if n < pushed else 0.0

    record = machine.run(np.full(total, start), command)
    pulses.records.append(record)
    way = record["encoder_m"] - start
    far = np.abs(way) > short.threshold
    seen = np.flatnonzero(far[:-2] & far[1:-1] & far[2:])
    if not len(seen):
        return None
    certain = max(rows, min(pushed, short.returns / short.period))
    return Felt(level, float(way[seen[0]]), bool(seen[0] <= certain))
