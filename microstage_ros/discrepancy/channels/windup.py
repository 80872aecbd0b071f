"""Stage against motor: the motor's angle by integrating its back-EMF, the stage by its position reading.

    K_E Δθ = T (u − R i_s)                 (exact over a period: the winding's terms cancel)
    residual = x − H(s) (r/N) θ + G(s) F_g        [m]
    H = (D_c s + K_c)/(m s² + D_c s + K_c),  G = 1/(m s² + D_c s + K_c)

so it holds the amplifier and the winding (integrated), lost motion, wind-up, lead errors and the
resonance. Noise: the amplifier's noise makes θ a random walk of some 25 nm per √s; the reading is white.
"""

import numpy as np
from scipy.signal import lfilter

from microstage_ros.axis.compiled import compiled
from microstage_ros.discrepancy.preparation import reading_noise, stage_filter
from microstage_ros.discrepancy.whitening import whiten_walk

BLOCK = 5
SUBSTEPS = 3


class Windup:
    """Residual of one record; attributes as in `channels.mechanical.Mechanical`, and ``force`` (guideway, N)."""

    name, unit = "windup", "m"

    def __init__(self, prepared, drive):
        self.prepared, self.drive = prepared, drive
        p = prepared
        self.time, self.position, self.speed = (self.mean(v) for v in (p.time, p.position, p.speed))
        self.voltage, self.current = self.mean(p.answered), self.mean(p.settled)
        self.force = p.guideway + drive.guideway.viscous * p.stage_speed
        self.residual = self.mean(p.stage - p.stage[0] - self.predict())
        self.walk, self.noise = self._noise()

    def mean(self, values):
        """Block means of a signal of shape (n,) or (n, k)."""
        rows = len(values) // BLOCK * BLOCK
        return values[:rows].reshape(-1, BLOCK, *values.shape[1:]).mean(axis=1)

    def predict(self, stiffness=1.0, damping=1.0, mass=1.0, load=1.0):
        """Stage position from the motor's [m], shape (n,), with factors on K_c, D_c, m and the guideway force."""
        factors = {"stiffness": stiffness, "damping": damping, "mass": mass}
        b, a = stage_filter(self.drive, self.prepared.period, **factors)
        g, _ = stage_filter(self.drive, self.prepared.period, **factors, force=True)
        return lfilter(b, a, self.prepared.travel) - lfilter(g, a, load * self.force)

    def carry(self, gap):
        """Stage position [m] carried by the motor through a drive with a gap [m] at the stage, shape (n,).

        The guideway's force is that of the measured motion plus its pre-sliding stiffness times what the
        computed stage is off, so that a stage within the gap stays where friction holds it.
        """
        p, d = self.prepared, self.drive
        measured = p.stage_position - p.stage_position[0]
        return carry_stage(p.travel - p.travel[0], self.force, measured, gap, d.stiffness, d.damping, d.mass,
                           float(d.guideway.stiffness.sum()), p.period)

    def integral(self, voltage):
        """Stage position [m] that a voltage (n,) or (n, k) at the motor's terminals would add, in block means."""
        steps = self.mean(voltage)
        middle = np.cumsum(steps, axis=0) - 0.5 * steps
        return middle * (BLOCK * self.prepared.period * self.drive.lever / self.drive.back_emf)

    def _noise(self):
        """Walk per block and white noise of a block mean, from robust spreads of differences over two lags."""
        white = reading_noise(self.prepared.stage) / np.sqrt(BLOCK)
        lag = 100
        spread = np.subtract(*np.percentile(self.residual[lag:] - self.residual[:-lag], [75, 25])) / 1.349
        nominal = 1.0e-3 * self.prepared.period * np.sqrt(BLOCK) * self.drive.lever / self.drive.back_emf
        walk = np.sqrt(max(spread**2 - 2 * white**2, 0.0) / lag)
        return float(np.clip(walk, nominal, 2.0 * nominal)), white

    def nuisance(self):
        """A lateness of the readings of some tenths of a period is a matter of stamps, not of the axis."""
        return self.speed[:, None]

    def whiten(self, matrix):
        """Unit-variance innovations of (blocks, k), and 0."""
        return whiten_walk(matrix, self.walk, self.noise), 0.0


@compiled
def carry_stage(travel, force, measured, gap, stiffness, damping, mass, hold, period):
    """m dv/dt = F_c(d) − F_g − hold (x − measured), F_c = K (d − sgn(d) gap/2) + D ḋ where |d| > gap/2, d = travel − x."""
    x, v = measured[0], 0.0
    out = np.empty(travel.size)
    h = period / SUBSTEPS
    for n in range(travel.size):
        out[n] = x
        last = min(n + 1, travel.size - 1)
        rate = (travel[last] - travel[n]) / period
        for s in range(SUBSTEPS):
            d = travel[n] + rate * h * s - x
            carried = 0.0
            if abs(d) > 0.5 * gap:
                carried = stiffness * (d - np.sign(d) * 0.5 * gap) + damping * (rate - v)
            v += h / mass * (carried - force[n] - hold * (x - measured[n]))
            x += h * v
    return out
