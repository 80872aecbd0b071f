"""Stage against motor, slow part: the motor's angle by integrating its back-EMF, the stage by its reading.

    K_E Δθ = T (u − R i_s);   residual = x − (r/N) θ + (F_g + m a) / K_c        [m], means over 20 ms

so it holds the amplifier and the winding (integrated), lost motion, wind-up and lead errors. Noise: the
amplifier's noise makes θ a random walk (1 mV on the shipped axis: some 25 nm per √s); the reading is nearly exact in
the mean, except where the stage rattles; the guideway's random friction winds the drive up by some nanometres.
"""

import math

import numpy as np

from microstage_ros.diagnosis.preprocessing.smoothing import block_means, spread_of
from microstage_ros.diagnosis.preprocessing.whitening import whiten_states
from microstage_ros.diagnosis.residuals import mechanical

PARTS = 10      # of a block, whose scatter is its rattle; derived: nine differences tell it to a quarter, 1/√18
BLOCK = PARTS * mechanical.BLOCK    # periods; derived: a part is as long as a block of the torque's
# m: the walk as a first-order process so wide that it forgets nothing; derived: 10⁵ times a walk of 25 nm per √s in
# half a minute
SPREAD = 1.0e-2
WALKED = 4.0         # standard deviations; derived: a walk goes so far once in 16 000 blocks
EDGE = 0.5           # share of a sudden change that a block's mean may miss
# V of an amplifier whose axis file states no noise: derived: a thirtieth of a 16-bit converter's step over ±10 V
LEAST_NOISE = 1.0e-5
# times the stated walk that the records may show before it is no noise any more; derived: a noise of one significant
# digit is uncertain by a factor of two, as in `position.UNSURE`
WIDER = 2.0


class Windup:
    """Residual of one record; attributes as in `channels.mechanical.Mechanical`, ``force`` of the
    guideways and ``load``, the stage's inertia included, by which the drive train winds up (blocks,) [N]."""

    name, unit = "windup", "m"

    def __init__(self, prepared, drive):
        self.prepared, self.drive = prepared, drive
        p = prepared
        self.time, self.position, self.speed = (self.mean(v) for v in (p.time, p.position, p.speed))
        self.voltage, self.current = self.mean(p.answered), self.mean(p.settled)
        friction = p.guideway + drive.guideway.viscous * p.stage_speed
        self._load = friction + drive.mass * np.gradient(p.stage_speed, p.period)
        self.force, self.load = self.mean(friction), self.mean(self._load)
        residual = self.deflection()
        self.residual = self.mean(residual - residual[0])
        self.walk, self.white = self._noise(residual)
        self.noise = float(np.sqrt(np.median(self.white)))

    def deflection(self):
        """Stage against motor and wind-up [m] at the record's rate, shape (n,)."""
        p, drive = self.prepared, self.drive
        if p.behind is not None:
            return p.stage - p.angle - p.behind
        return p.stage - p.angle + self._load / drive.stiffness

    def mean(self, values):
        """Block means of a signal, ``values`` of shape (n,) or (n, k)."""
        return block_means(values, BLOCK)

    def integral(self, voltage):
        """Stage position [m] that a voltage (n,) or (n, k) at the motor's terminals would add, in block means."""
        steps = self.mean(voltage)
        middle = np.cumsum(steps, axis=0) - 0.5 * steps
        return middle * (BLOCK * self.prepared.period * self.drive.lever / self.drive.back_emf)

    def _noise(self, residual):
        """Walk per block [m], and the variance of each block's mean: what rattles within a block is not known
        better."""
        rows = len(residual) // BLOCK * BLOCK
        blocks = residual[:rows].reshape(-1, BLOCK)
        inner = blocks.reshape(len(blocks), PARTS, -1).mean(axis=2)
        rattle = np.std(np.diff(inner, axis=1), axis=1) / np.sqrt(2.0)
        usual = np.median(rattle)
        change = np.diff(self.residual)
        spread = spread_of(change)
        rounding = 0.5 * self.drive.converter_step / math.sqrt(3.0)
        noise = max(math.hypot(self.drive.amplifier_noise, rounding), LEAST_NOISE)
        per_volt = self.prepared.period * np.sqrt(BLOCK) * self.drive.lever / self.drive.back_emf
        self.amplifier_noise = float(spread / per_volt)    # as this record shows it, with all else that walks
        walk = float(np.clip(spread, noise * per_volt, WIDER * noise * per_volt))
        # where the load turns round within a block, its mean depends on the very moment
        edge = EDGE * np.maximum(np.abs(change) - WALKED * walk, 0.0)
        edge = np.maximum(np.append(edge, 0.0), np.insert(edge, 0, 0.0))
        resting = self.prepared.stage_noise ** 2 / BLOCK
        white = resting + np.maximum(rattle**2 - (2.0 * usual) ** 2, 0.0) + edge**2
        if self.prepared.closed is not None:    # what is bridged while no flank touches says nothing
            white += np.where(self.mean(self.prepared.closed) > 0.0, 0.0, np.ptp(self.prepared.behind) ** 2)
        return walk, white

    def nuisance(self):
        """Columns (blocks, k) that are free: readings late by some tenths of a period are a matter of stamps, not of
        the axis; the start; and by what the contacts held there the drive is wound up [m per metre], `first_state`."""
        first = mechanical.first_state(mechanical.span_of(self.position))
        return np.column_stack([self.speed, np.ones(len(self.speed)), first])

    def whiten(self, matrix):
        """Unit-variance innovations of ``matrix`` (blocks, k), and Σ ln S."""
        rows = len(self.residual)
        ahead = np.append(np.abs(np.diff(self.position)), 0.0)
        vary = mechanical.stated_spreads(self.drive)
        keeps = np.stack(
            [np.full(rows, np.sqrt(1.0 - (self.walk / SPREAD) ** 2)), np.exp(-ahead / vary.travel_length)], axis=1
        )
        gains = np.stack([np.ones(rows), self.force / self.drive.stiffness], axis=1)
        return whiten_states(matrix, gains, keeps, (SPREAD, vary.relative), self.white)
