"""What noise alone leaves of the tracking error: the linear-quadratic-Gaussian regulator of the sliding axis.

Sliding slowly, all blocks slip and friction falls with speed: the axis is linear and unstable, dv/dt = -(c/M) v + ...
with c < 0, and its swing w beyond the drive train is that of `swing`. Per period are known the encoder (its noise and
its rounding, as one white noise), the current exactly, and so the force; and the voltage up to the amplifier's noise n,
hence the speed up to n / (K_E N/r). The same n acts on the axis. No regulator of the linear axis has a smaller mean
square of x + w than the linear-quadratic one on the Kalman filter's estimate (separation theorem: Astrom and
Wittenmark, "Computer-Controlled Systems", 3rd ed., ch. 11), given everything but the noise, whatever it costs in
voltage. Friction does not vary here, and no block sticks or lets go.
"""

import numpy as np
from scipy.linalg import solve_discrete_are

from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.observer.flexible_mode import held_axis

EFFORT = 1e-6  # weight of a volt against the largest voltage that an error of 1 m would call for: next to nothing
COUNTS = 12.0  # a rounded value is uniform over a count: its variance is count^2 / 12


def sliding_loop(axis, period, amplifier_noise=1e-3, encoder_noise=8e-9):
    """The loop at ``period`` [s]: ``closed`` (8, 8) and ``push`` (8, 2) of state (w, w', x, v) [SI] and its estimate.

    Driven by the amplifier's noise and the encoder's, white, of the standard deviations in ``noise`` (2,):
    ``amplifier_noise`` [V], and ``encoder_noise`` [m] with the rounding.
    """
    axis = axis.with_values({"period": period}, source="derived")
    model = controller_parameters("self_tuning_observer", axis, {})["feedforward"]
    a, b, _ = held_axis(model, period)
    emf, count = float(model["volts_per_velocity"]), axis.value("sensors.encoder.resolution")
    noise = np.array([amplifier_noise, np.hypot(encoder_noise, count / np.sqrt(COUNTS))])
    c = np.array([[1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])  # encoder, speed of the motor
    spread = np.diag([noise[1], noise[0] / emf])
    gain = _filter_gain(a, c, spread)
    feedback = _regulator_gain(a, b, c[0])
    estimate = np.eye(4) - gain @ c
    # the force is known: n moves axis and estimate alike; it is also what the speed is wrong by, from the period that
    # it acted in
    known, applied = a - b @ feedback, -b @ feedback
    closed = np.block([[a, applied], [gain @ c @ a, estimate @ known + gain @ c @ applied]])
    push = np.vstack([np.hstack([b, np.zeros((4, 1))]), np.hstack([b - gain[:, 1:] / emf, gain[:, :1]])])
    return closed, push, noise


def least_error(axis, period, seeds=20, duration=10.0):
    """(rms, worst peak over ``seeds`` [1] runs of ``duration`` [s]) [m] of x + w at the instants of ``period`` [s]."""
    closed, push, noise = sliding_loop(axis, period)
    random = np.random.default_rng(0)
    state, square, peak, rows = np.zeros((8, seeds)), 0.0, 0.0, round(duration / period)
    for n in range(rows + rows // 10):
        state = closed @ state + push @ (noise[:, None] * random.standard_normal((2, seeds)))
        if n >= rows // 10:
            error = state[0] + state[2]
            square += np.mean(error**2)
            peak = max(peak, np.abs(error).max())
    return float(np.sqrt(square / rows)), float(peak)


def _filter_gain(a, c, spread):
    """Gain of the filtered estimate; nothing but the readings is uncertain."""
    scale = np.diag([1e-8, 1e-5, 1e-8, 1e-6])
    inverse = np.linalg.inv(scale)
    seen = np.linalg.inv(spread) @ c @ scale
    p = solve_discrete_are((inverse @ a @ scale).T, seen.T, 1e-14 * np.eye(4), np.eye(2))
    return scale @ p @ seen.T @ np.linalg.inv(seen @ p @ seen.T + np.eye(2)) @ np.linalg.inv(spread)


def _regulator_gain(a, b, output):
    """Feedback (1, 4) that makes the mean square of ``output`` least."""
    effort = (EFFORT * np.abs(output @ a @ b).item()) ** 2
    cost = solve_discrete_are(a, b, np.outer(output, output), np.array([[effort]]))
    return b.T @ cost @ a / (effort + b.T @ cost @ b)
