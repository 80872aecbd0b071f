"""What moved: position, speed and load of the motor from position readings and current.

The current is used as an inertial sensor. Constant-gain Kalman filter and Rauch–Tung–Striebel
smoother (no phase lag) for the state ``z = (x, v, d)`` at the stage, over one period T::

    x' = x + T v + T²/2 (g i − d)        x  stage position [m]
    v' = v + T (g i − d)                 v  stage speed [m/s]
    d' = d + T^½ w                       d  load, as the acceleration it takes away [m/s²]
    y  = x + noise                       g = k_M r / (N J)   [m/s² per A]

so that ``J N/r · d`` is the torque at the motor shaft that friction and loads took.
Source: Rauch, Tung, Striebel, AIAA Journal 3 (1965) 1445.
"""

import dataclasses
import functools

import numpy as np
import scipy.linalg

from microstage_ros.numerics.compiled import compiled

# N m per root of a second: friction turns round in some milliseconds; calibrated by: validation.variation --group
# motion (half and double: the same answers)
LOAD_WALK = 1.0e-3
REACH = 60        # periods to either side of a reading over which a load shows; calibrated by: the same


@dataclasses.dataclass(frozen=True)
class Motion:
    """Smoothed motion, arrays of shape (n,): ``position`` [m], ``speed`` [m/s], ``load`` [N m at the motor shaft]."""

    position: np.ndarray
    speed: np.ndarray
    load: np.ndarray


def smooth_motion(reading, current, drive, period, noise):
    """Motion of the axis from position readings [m] and current [A].

    Parameters
    ----------
    reading : shape (n,), position at the start of each period [m].
    current : shape (n,), mean current of each period [A].
    drive : `Drive` of the axis.
    period : control period [s].
    noise : standard deviation of one reading [m].
    """
    lever = drive.lever
    gain = drive.torque_constant * lever / drive.inertia
    # derived: the noise of a reading is about one
    scale = 1.0e-8  # metres per unit of the filter's state, for conditioning
    walk = LOAD_WALK * lever / drive.inertia / scale
    f = np.array([[1.0, period, -period**2 / 2], [0.0, 1.0, -period], [0.0, 0.0, 1.0]])
    b = np.array([period**2 / 2, period, 0.0]) * gain / scale
    q = np.diag([0.0, 0.0, walk**2 * period])
    # derived: a variance of (10⁻¹⁴ m)², for the Riccati equation to be regular
    q[0, 0], q[1, 1] = 1e-12, (walk * period) ** 2 * period
    h = np.array([[1.0, 0.0, 0.0]])
    r = np.array([[(noise / scale) ** 2]])
    s = np.diag([1.0, 1.0 / period, 1.0 / period**2])  # balances the Riccati equation
    si = np.linalg.inv(s)
    predicted = s @ scipy.linalg.solve_discrete_are((si @ f @ s).T, (h @ s).T, si @ q @ si, r) @ s
    k = (predicted @ h.T / (predicted[0, 0] + r[0, 0]))[:, 0]
    filtered = predicted - np.outer(k, predicted[0])
    back = filtered @ f.T @ np.linalg.inv(predicted)
    origin = reading[0]
    z = _smooth((reading - origin) / scale, current, f, b, k, back)
    return Motion(z[:, 0] * scale + origin, z[:, 1] * scale, z[:, 2] * scale * drive.inertia / lever)


# derived: memory alone, no result depends on it
@functools.lru_cache(maxsize=64)
def load_kernel(drive, period, noise):
    """What `smooth_motion` makes of a load that stands for one period: shape (2 `REACH` + 1,), sum 1.

    ``noise``: of the readings [m]. Entry `REACH` + k is the share that it gives to the reading k periods later.
    """
    # derived: from the middle to either end four times as far as is looked at
    rows = 8 * REACH
    load = np.zeros(rows)
    load[rows // 2] = drive.inertia / drive.lever
    steps = -load * drive.lever / drive.inertia * period
    speed = np.concatenate([[0.0], np.cumsum(steps)[:-1]])
    position = np.concatenate([[0.0], np.cumsum(period * (speed + 0.5 * steps))[:-1]])
    seen = smooth_motion(position, np.zeros(rows), drive, period, noise).load / load[rows // 2]
    kernel = seen[rows // 2 - REACH: rows // 2 + REACH + 1]
    return kernel / kernel.sum()


@compiled
def _smooth(y, current, f, b, k, back):
    """Filter forward with gain k, smooth backward with gain ``back``; returns states of shape (n, 3)."""
    n = y.size
    z = np.zeros((n, 3))
    p = np.zeros(3)
    p[0] = y[0]
    for i in range(n):
        if i > 0:
            for a in range(3):
                p[a] = f[a, 0] * z[i - 1, 0] + f[a, 1] * z[i - 1, 1] + f[a, 2] * z[i - 1, 2] + b[a] * current[i]
        error = y[i] - p[0]
        for a in range(3):
            z[i, a] = p[a] + k[a] * error
    d = np.zeros(3)
    for i in range(n - 2, -1, -1):
        for a in range(3):
            d[a] = z[i + 1, a] - (
                f[a, 0] * z[i, 0] + f[a, 1] * z[i, 1] + f[a, 2] * z[i, 2] + b[a] * current[i + 1]
            )
        for a in range(3):
            z[i, a] += back[a, 0] * d[0] + back[a, 1] * d[1] + back[a, 2] * d[2]
    return z


@compiled
def through_play(position, half):
    """Position (n,) [m] of what is dragged by a play of ``half`` a width [m], as ``position`` (n,) [m] moves."""
    dragged = np.empty(position.size)
    now = position[0]
    for i in range(position.size):
        now = min(max(now, position[i] - half), position[i] + half)
        dragged[i] = now
    return dragged
