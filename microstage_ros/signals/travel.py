"""What the motor and the screw travel: the back-EMF integrated."""

import numpy as np

from microstage_ros.signals.drive import DriveConstants


def motor_travel(answered: np.ndarray, settled: np.ndarray, drive: DriveConstants, period: float) -> np.ndarray:
    """Motor angle by integrating the back-EMF, in metres of stage, shape (n,).

    ``answered``: voltage that each current answers [V], ``settled``: settled current [A] (`current.settled_current`),
    each of shape (n,); ``period`` [s].

    K_E Δθ = T (u − R i_s). The settled current belongs to the speed of L/R before the reading, not of half
    a period before it, so the sum leads by T/2 − L/R; that is taken back by interpolation.
    """
    travel = drive.lever * np.cumsum(period * (answered - drive.resistance * settled) / drive.back_emf)
    lead = 0.5 - drive.inductance / drive.resistance / period
    return travel - lead * np.diff(travel, prepend=travel[0])
