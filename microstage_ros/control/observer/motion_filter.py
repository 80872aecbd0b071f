"""Covariance and gain of the observer's motion (x, v, d): an extended Kalman filter on the friction in use.

With stiffness k of the blocks that stick and slope c of the sliding curve for those that slip, a small error of
the motion obeys

    dx/dt = v,    dv/dt = -(k/M) x - (c/M) v - d + white acceleration,    dd/dt = white.

Sliding below the Stribeck velocity c < 0: errors grow e-fold in 3 ms, and the gain has to catch them. Where blocks
stick they hold the axis. But a block lets go within a doubt of the place, which no slope of a curve says, and the stage
swings beyond the drive train: `STIFFNESS_SHARE` of the stiffness is counted on. Simon, "Optimal State Estimation",
Wiley 2006, ch. 13.2; the two readings are taken in one after the other (ch. 6.1), which needs no inverse of a matrix.
"""

import math

import numpy as np

from microstage_ros.control.observer.inertia_doubt import drift_variance
from microstage_ros.model.friction.curve import (
    COULOMB,
    DIRECTION_WIDTH,
    STATIC,
    STRIBECK_EXPONENT,
    STRIBECK_VELOCITY,
    VISCOUS,
)
from microstage_ros.numerics.compiled import compiled

FIELDS = [
    ("covariance", "f8", (3, 3)),  # of x, v, d; the upper triangle is kept
    ("gain", "f8", (3, 2)),  # change of x, v, d per innovation of position and of speed
    ("stiffness", "f8"),  # 1/s^2, k/M over this period
    ("slope", "f8"),  # 1/s, c/M
]
PART = 2.0e-4  # s, longest step of the prediction within a period
MOST_DOUBLINGS = 64  # of the periods in `riccati`: more than any mode takes to settle
# see above; with more of it an axis with three times the payload swings, or one with half the friction lags
STIFFNESS_SHARE = 0.05
SLOWEST = 1e-2  # of the Stribeck velocity: below, the curve is taken to fall as it does there
# m, m/s, m/s^2: standard deviations of x, v, d at the start, of an axis at rest whose delay is not yet known
UNKNOWN = (1e-8, 1e-6, 1e-3)


@compiled
def forget_motion(s):
    """All that is known of the motion is `UNKNOWN`."""
    s.covariance[:] = 0.0
    for j in range(3):
        s.covariance[j, j] = UNKNOWN[j] * UNKNOWN[j]


@compiled
def parts_of(period):
    """Steps of the prediction within a period."""
    return int(math.ceil(period / PART - 1e-9))


@compiled
def curve_slope(law, velocity, share):
    """dF/dw of a packed law's sliding curve at ``velocity`` [q/s], ``share`` [1] of its blocks slipping."""
    head = 0 if velocity >= 0.0 else DIRECTION_WIDTH
    drop = share * (law[head + STATIC] - law[head + COULOMB])
    if drop <= 0.0:
        return law[head + VISCOUS]
    ratio = max(abs(velocity) / law[head + STRIBECK_VELOCITY], SLOWEST)
    power = ratio ** law[head + STRIBECK_EXPONENT]
    fall = drop * law[head + STRIBECK_EXPONENT] / law[head + STRIBECK_VELOCITY] * power / ratio * math.exp(-power)
    return law[head + VISCOUS] - fall


@compiled
def linearise(model, s):
    """Slopes of the actuator's friction at the present motion, into ``stiffness`` and ``slope``."""
    s.stiffness, s.slope = 0.0, 0.0
    if model.has_actuator == 0:
        return
    law, blocks = model.actuator, s.actuator
    count = int(law[10])
    stiffness, share = 0.0, 0.0
    for j in range(count):
        if blocks[count + j] == 0.0:
            stiffness += law[11 + j]
        else:
            share += law[11 + count + j]
    scale = model.force_per_torque / (model.screw_ratio * model.moving_mass * s.inertia)
    s.stiffness = STIFFNESS_SHARE * scale * stiffness
    s.slope = scale * curve_slope(law, s.v / model.screw_ratio, share * s.level)


@compiled
def along_motion(s, error, period):
    """Move an ``error`` of (x, v, d) by a period: x += h v', v' = v - h (k/M x + c/M v + d)."""
    parts = parts_of(period)
    h = period / parts
    for _ in range(parts):
        error[1] -= h * (s.stiffness * error[0] + s.slope * error[1] + error[2])
        error[0] += h * error[1]


@compiled
def widen(p, s, period):
    """Covariance after a period, by the same steps as `along_motion`, and what moves the axis unmodelled."""
    parts = parts_of(period)
    h = period / parts
    c = s.covariance
    xx, xv, xd, vv, vd, dd = c[0, 0], c[0, 1], c[0, 2], c[1, 1], c[1, 2], c[2, 2]
    a, b = -h * s.stiffness, 1.0 - h * s.slope
    push = p.acceleration_noise * p.acceleration_noise * h
    drift = (p.friction_drift * p.friction_drift + drift_variance(s) + s.turning_drift) * h
    for _ in range(parts):
        old_x_new_v = a * xx + b * xv - h * xd
        old_v_new_v = a * xv + b * vv - h * vd
        vd = a * xd + b * vd - h * dd
        vv = a * old_x_new_v + b * old_v_new_v - h * vd + push
        xx += h * (2.0 * old_x_new_v + h * vv)
        xv = old_x_new_v + h * vv
        xd += h * vd
        dd += drift
    c[0, 0], c[0, 1], c[0, 2], c[1, 1], c[1, 2], c[2, 2] = xx, xv, xd, vv, vd, dd


@compiled
def take_readings(s, speed_variance):
    """Gain of both readings, and the covariance after them; ``speed_variance`` [m^2/s^2], infinite: no speed is
    known."""
    c = s.covariance
    part = 1.0 / (c[0, 0] + s.encoder_noise * s.encoder_noise)
    g0, g1, g2 = part * c[0, 0], part * c[0, 1], part * c[0, 2]
    c[2, 2] -= g2 * c[0, 2]
    c[1, 2] -= g1 * c[0, 2]
    c[1, 1] -= g1 * c[0, 1]
    c[0, 2] *= 1.0 - g0
    c[0, 1] *= 1.0 - g0
    c[0, 0] *= 1.0 - g0
    part = 1.0 / (c[1, 1] + speed_variance)
    k0, k1, k2 = part * c[0, 1], part * c[1, 1], part * c[1, 2]
    c[0, 0] -= k0 * c[0, 1]
    c[0, 2] -= k0 * c[1, 2]
    c[2, 2] -= k2 * c[1, 2]
    c[0, 1] *= 1.0 - k1
    c[1, 2] *= 1.0 - k1
    c[1, 1] *= 1.0 - k1
    # the position's innovation has moved v before the speed's is looked at
    s.gain[0, 0], s.gain[1, 0], s.gain[2, 0] = g0 - k0 * g1, g1 - k1 * g1, g2 - k2 * g1
    s.gain[0, 1], s.gain[1, 1], s.gain[2, 1] = k0, k1, k2


def motion_matrices(record, period, stiffness=0.0, slope=0.0):
    """(A, Q), each (3, 3), of a period of (x, v, d) at k/M ``stiffness`` [1/s^2] and c/M ``slope`` [1/s]."""
    parts = parts_of(period)
    h = period / parts
    kick = np.array([[1.0, 0.0, 0.0], [-h * stiffness, 1.0 - h * slope, -h], [0.0, 0.0, 1.0]])
    step = np.array([[1.0, h, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    push, drift = float(record["acceleration_noise"]) ** 2 * h, float(record["friction_drift"]) ** 2 * h
    noise = step @ np.diag([0.0, push, 0.0]) @ step.T + np.diag([0.0, 0.0, drift])
    a, q = np.eye(3), np.zeros((3, 3))
    for _ in range(parts):
        a, q = step @ kick @ a, step @ kick @ q @ (step @ kick).T + noise
    return a, q


def steady_gain(record, model, period, stiffness=0.0, slope=0.0):
    """Gain of (x, v, d) that the filter settles at under constant slopes, (3, 2): encoder and back-EMF, nothing to
    learn. ``period`` [s]; k/M ``stiffness`` [1/s^2], c/M ``slope`` [1/s].

    P C' (C P C' + R)^-1 of the filtered estimate, by the discrete Riccati equation in scaled units.
    """
    a, q = motion_matrices(record, period, stiffness, slope)
    speed = (
        float(record["voltage_doubt"]) * float(record["voltage_noise"]) / max(float(model["volts_per_velocity"]), 1e-9)
    )
    noise = np.array([float(record["encoder_doubt"]) * float(record["encoder_noise"]), speed])
    scale = np.array([noise[0], noise[0] * 1e2, noise[0] * 1e4])
    s, inverse, n = np.diag(scale), np.diag(1 / scale), np.diag(1 / noise)
    cs = n @ np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]) @ s
    p = riccati((inverse @ a @ s).T, inverse @ (q + 1e-40 * np.eye(3)) @ inverse, cs.T @ cs)
    gain = p @ cs.T @ np.linalg.inv(cs @ p @ cs.T + np.eye(2))
    return s @ gain @ n


def riccati(a, q, information):
    """P of P = A' P (1 + G P)^-1 A + Q, with ``a``, ``q`` and G = ``information``, each (n, n).

    Each step doubles the periods that have passed (Anderson 1978). P and G are symmetric; where rounding may part them
    from that, a slow mode never settles on some processors.

    SciPy's solver takes half a second to load and leaves residuals ten times as large.
    """
    p = q
    for _ in range(MOST_DOUBLINGS):
        shrink = np.linalg.inv(np.eye(len(a)) + information @ p)
        more = a.T @ p @ shrink @ a
        p, information, a = p + more, information + a @ shrink @ information @ a.T, a @ shrink @ a
        p, information = 0.5 * (p + p.T), 0.5 * (information + information.T)
        if not np.abs(more).max() > 1e-17 * np.abs(p).max():
            break
    return p
