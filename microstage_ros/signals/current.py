"""The motor current referred to what a balance needs: an instant, a period, or the voltage that it answers.

The winding, R i + L di/dt = u − K_E ω, settles with τ = L/R. A current read at the end of a period T in which u was
held keeps the share a = exp(−T/τ) of the current before.
"""

import numpy as np

from microstage_ros.numerics.compiled import compiled
from microstage_ros.signals.drive import DriveConstants
from microstage_ros.signals.rows import of_row_after, of_row_before


@compiled
def settled(current: float, before: float, share: float) -> float:
    """Current [A] after the winding's time constant, (i_n − a i_{n−1}) / (1 − a): what (u − K_E ω)/R would drive.

    ``current`` and ``before``: of this reading and the one before [A]; ``share``: a = exp(−T R/L).
    """
    return (current - share * before) / (1.0 - share)


def settled_current(current: np.ndarray, share: float) -> np.ndarray:
    """`settled` of every row of ``current`` (n,) for ``share`` a [1]; (n,) [A], the first row counts as settled."""
    return settled.py_func(current, of_row_before(current), share)


def centred_current(current: np.ndarray, lag: float) -> np.ndarray:
    """Current about the instant of each reading [A], shape (n,), from ``current`` as read [A], shape (n,).

    The current read at the end of a period is the one that flowed through it, but for its settling in
    ``lag`` = L / (R T) periods [1]; the mean of the periods before and after a reading is
    ½ [(1 − ε) i(n+1) + i(n) + ε i(n−1)]. Without this the torque would be 28 µs early against the motion.
    """
    return 0.5 * ((1.0 - lag) * of_row_after(current) + current + lag * of_row_before(current))


def between_readings(settled: np.ndarray, current: np.ndarray, speed: np.ndarray, drive: DriveConstants,
                     period: float) -> np.ndarray:
    """Torque of the motor in the mean over each period beyond k_M i_s, shape (n,) [N m].

    ``settled`` i_s and ``current`` i [A], ``speed`` of the stage [m/s], each of shape (n,); ``period`` [s].

    A controller's voltage stands still for a period T while the motor's speed does not, so the current is a saw-tooth
    and is read at its tips. With τ = L/R, a = exp(−T/τ), angular acceleration ω', and the voltage held::

        mean i − i_s = (i_0 − i_s) (1 − a) τ/T + (K_E/R) T ω' (1/(1 − a) − 1/2 − τ/T)

    (R i + L di/dt = u − K_E ω solved over one period; i_0 is the reading before). It is 0.4 % of the
    torque that turns the shipped axis's rotor, nearly half of what the stage's inertia takes.
    """
    share = drive.inductance / drive.resistance / period
    keep = np.exp(-1.0 / share)
    turning = np.gradient(speed, period) / drive.lever
    ramp = drive.back_emf / drive.resistance * period * (1.0 / (1.0 - keep) - 0.5 - share) * turning
    return drive.torque_constant * ((of_row_before(current) - settled) * (1.0 - keep) * share + ramp)
