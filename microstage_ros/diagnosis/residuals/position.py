"""Encoder against interferometer: residual = interferometer − encoder [m], in means over half a millisecond.

Neither friction nor drive can enter. Noise: white, and the rounding of the encoder, which repeats
while the stage rests (a slow process that some tens of nanometres of travel renew).
"""

import numpy as np

from microstage_ros.diagnosis.catalogue.form import splines
from microstage_ros.diagnosis.preprocessing.preparation import reading_noise
from microstage_ros.diagnosis.preprocessing.whitening import whiten_states

BLOCK = 5
ROUNDING = 1.5e-9   # m, standard deviation of what rounding leaves in a mean at rest
RENEWAL = 2.0e-8    # m of travel
PIECE = 2.5         # s between the knots of a record's own course of drift


def course_columns(time):
    """Splines in time that make a course of drift, shape (rows, k)."""
    return splines(time, 0.0, float(time[-1]), max(round(float(time[-1]) / PIECE), 2))


class Position:
    """Residual of one record; attributes as in `residuals.mechanical.Mechanical`."""

    name, unit = "position", "m"

    def __init__(self, prepared, drive):
        self.prepared, self.drive = prepared, drive
        self.drifts = False     # set where the record takes a course of its own, see `slow_drift`
        self.time, self.position, self.speed = (self.mean(v) for v in (
            prepared.time, prepared.stage_position, prepared.stage_speed))
        difference = prepared.interferometer - prepared.encoder
        self.residual = self.mean(difference)
        self.residual -= np.median(self.residual)
        self.scatter = max(reading_noise(difference), 1e-10) / np.sqrt(BLOCK)

    def mean(self, values):
        """Block means of a signal of shape (n,) or (n, k)."""
        rows = len(values) // BLOCK * BLOCK
        return values[:rows].reshape(-1, BLOCK, *values.shape[1:]).mean(axis=1)

    def nuisance(self):
        """Homing offset, one constant per record, or the record's own course, which holds it."""
        return course_columns(self.time) if self.drifts else np.ones((len(self.residual), 1))

    def whiten(self, matrix):
        """Unit-variance innovations of (blocks, k), and Σ ln S."""
        step = np.abs(self.speed) * BLOCK * self.prepared.period
        keeps = np.exp(-step / RENEWAL - BLOCK * self.prepared.period / 10.0)[:, None]
        white = np.full(len(self.residual), self.scatter**2)
        return whiten_states(matrix, np.ones((len(step), 1)), keeps, (ROUNDING,), white)
