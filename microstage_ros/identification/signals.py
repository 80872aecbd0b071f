"""What a record says of the motor: angle of the gearhead's output, its speed, the torque, the windows of steady motion.

Everything is referred to the shaft and the output as the axis file's actuator contact is: torque k_M i at
the motor [N m], angle φ and speed ω_r of the gearhead's output [rad, rad/s].
"""

from dataclasses import dataclass

import numpy as np

from microstage_ros.model.transmission import screw_ratio
from microstage_ros.numerics.filters import low_pass
from microstage_ros.quantities.errors import InputError
from microstage_ros.signals.current import centred_current

SLOPE_SPAN = 2e-3  # slopes of the reference are taken over this time [s]: files write it with few digits
CURRENT_EXPERIMENT = "record the motor current: without it friction and back EMF are one"


@dataclass(frozen=True)
class MotorSignals:
    """One record at the motor; arrays of shape (n,).

    `angle` φ [rad], `voltage` [V] and `current` [A] as recorded (the current answers the voltage of the row
    before), `torque` k_M i about the instant of each reading [N m], `reference` φ asked for [rad]; `resolution` of φ
    [rad]; `period` [s]; `at_motor`: φ was measured at the motor, not at the stage.
    """

    source: str
    period: float
    angle: np.ndarray
    reference: np.ndarray
    voltage: np.ndarray
    current: np.ndarray
    torque: np.ndarray
    resolution: float
    at_motor: bool = False

    def smooth_speed(self, edge):
        """ω_r [rad/s], shape (n,), behind a zero-phase low-pass of ``edge`` [Hz]."""
        return np.gradient(low_pass(self.angle, edge, self.period), self.period)


def motor_signals(record, axis):
    """`MotorSignals` of a record of a voltage-driven motor. Raises InputError without a current column."""
    if "current_A" not in record:
        raise InputError(f"{record.source}: column current_A", "missing", CURRENT_EXPERIMENT)
    ratio, gear = screw_ratio(axis), axis.value("transmission.gear_ratio")
    if "motor_angle_rad" in record:
        angle, resolution = record["motor_angle_rad"] / gear, 1e-7
    else:
        angle, resolution = record["encoder_m"] / ratio, axis.value("sensors.encoder.resolution") / ratio
    current = record["current_A"]
    lag = min(axis.value("drive.inductance") / axis.value("drive.resistance") / record.period_s, 1.0)
    torque = axis.value("drive.torque_constant") * centred_current(current, lag)
    return MotorSignals(record.source, record.period_s, angle, record["reference_m"] / ratio, record["voltage_V"],
                        current, torque, resolution, "motor_angle_rad" in record)


@dataclass(frozen=True)
class Window:
    """Rows ``start <= n < stop`` in which the reference moves at one speed [rad/s]."""

    start: int
    stop: int
    speed: float


def steady_windows(signals, shortest=0.02, settle=0.25, least_travel=0.0):
    """Windows of constant, non-zero slope of the reference.

    Parameters
    ----------
    shortest : least duration of what is kept [s].
    settle : leading share [1] of each window that is left out, while the loop settles.
    least_travel : travel [rad] that is left out at the start at least: until the contact slides.

    Returns
    -------
    list of `Window`.
    """
    lag = max(int(SLOPE_SPAN / signals.period), 1)
    if len(signals.reference) < 4 * lag:
        return []
    slope = (signals.reference[lag:] - signals.reference[:-lag]) / (lag * signals.period)
    moving = np.abs(slope) > 1e-6 * np.abs(slope).max()
    # one slope: it changes by less than a thousandth from one span to the next, and by less than 1 % in all
    change = np.abs(slope[lag:] - slope[:-lag])
    steady = (change <= 1e-3 * np.abs(slope[lag:])) & moving[lag:]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], steady, [False]]).astype(int)))
    windows = []
    for start, stop in edges.reshape(-1, 2):
        start, stop = int(start), int(stop + 2 * lag)  # rows that the spans cover
        part = slope[start : stop - lag]
        speed = float(np.mean(part))
        if np.ptp(part) > 0.01 * abs(speed):
            continue
        left_out = max(settle * (stop - start), least_travel / abs(speed) / signals.period)
        start = int(start + left_out)
        if (stop - start) * signals.period >= shortest:
            windows.append(Window(start, stop, speed))
    return windows


def window_means(signals, window, inertia=0.0):
    """Mean speed [rad/s] and mean torque without inertia [N m] of a window; ``inertia`` at the motor per output
    acceleration [kg m²] (gear ratio times all inertia at the shaft)."""
    rows = slice(window.start, window.stop)
    angle = signals.angle[rows]
    centred = np.arange(len(angle)) - 0.5 * (len(angle) - 1)
    speed = float(centred @ angle / (centred @ centred)) / signals.period
    third = max(len(angle) // 3, 1)
    gain = (angle[-1] - angle[-third] - angle[third - 1] + angle[0]) / ((third - 1) * signals.period or 1.0)
    acceleration = gain / ((len(angle) - third) * signals.period or 1.0)
    return speed, float(np.mean(signals.torque[rows])) - inertia * acceleration


def reversals(signals, fastest, least_travel):
    """Slow branches that begin at a reversal out of sliding.

    Parameters
    ----------
    fastest : highest speed of the reference on the branch [rad/s]: beyond it friction is not that of rest.
    least_travel : way before the reversal [rad], so that the contact slid: twice the slip displacement.

    Returns
    -------
    list of (start, stop, direction): rows of each branch.
    """
    windows = [w for w in steady_windows(signals, shortest=0.0, settle=0.0) if abs(w.speed) <= fastest]
    found = []
    for before, after in zip(windows, windows[1:]):
        gap = (after.start - before.stop) * signals.period
        travelled = abs(before.speed) * (before.stop - before.start) * signals.period
        if before.speed * after.speed < 0.0 and gap < 0.5 and travelled >= least_travel:
            found.append((before.stop, after.stop, int(np.sign(after.speed))))
    return found
