"""Shapes without a name: any smooth function of one coordinate. They compete with the named causes.

What only one of these explains is a finding on that coordinate, not a cause.
"""

import numpy as np

from microstage_ros.diagnosis.catalogue.form import Form, splines


def of_position(channel, frame):
    """Any force along the stroke, the same in both directions."""
    return splines(channel.position, frame.low, frame.high, max(int((frame.high - frame.low) / 0.5e-3), 2))


def of_time(channel, frame):
    """Any force in time, the same for all records."""
    return splines(channel.time, 0.0, frame.duration, 10)


def friction_in_time(channel, frame):
    """Any course of the friction's size in time: torques [N m]."""
    return channel.friction[:, None] * splines(channel.time, 0.0, frame.duration, 8)


def viscous_in_time(channel, frame):
    """Any course of the viscosity in time: torques [N m]."""
    return channel.viscous[:, None] * splines(channel.time, 0.0, frame.duration, 5)


SPEEDS = np.array([0.0, 5e-6, 2e-5, 1e-4, 3e-4, 1e-3, 2e-3, 4e-3])  # m/s


# m/s; derived: four standard deviations of a mean over 2 ms of a motion known to 2 nm, 2 nm √2 / 2 ms
DIRECTION_SPEED = 5.6e-6


def _hats(values):
    """Piecewise-linear functions of |values| on SPEEDS in the logarithm, shape (rows, len(SPEEDS))."""
    scale = np.log1p(np.abs(values) / 1e-5)
    return np.stack([np.interp(scale, np.log1p(SPEEDS / 1e-5), row) for row in np.eye(len(SPEEDS))], axis=1)


def odd_in_speed(channel, frame):
    """Any resistance that turns round with the speed: shape (rows, len(SPEEDS)), each up to 1.

    None at rest: the speed is noise there, which has turned the replayed friction, too, and so is in the residual.
    """
    direction = np.clip(channel.speed / DIRECTION_SPEED, -1.0, 1.0) * (np.abs(channel.speed) > 0.5 * DIRECTION_SPEED)
    return (direction * (1.0 - channel.stuck))[:, None] * _hats(channel.speed)


def even_in_speed(channel, frame):
    """Any force that depends on the size of the speed alone."""
    return _hats(channel.speed)



def of_acceleration(channel, frame):
    """Inertia other than the nominal."""
    p = channel.prepared
    return channel.mean(np.gradient(p.speed, p.period))[:, None]


FORMS = (
    Form("generic:position", "torque", "", of_position, prior=1.0e-4),
    Form("generic:time", "torque", "", of_time, prior=1.0e-4),
    Form("generic:friction in time", "torque", "", friction_in_time, prior=0.3),
    Form("generic:viscous in time", "torque", "", viscous_in_time, prior=2.0),
    Form("generic:velocity", "torque", "", odd_in_speed),
    Form("generic:speed", "torque", "", even_in_speed),
    Form("generic:acceleration", "torque", "", of_acceleration),
)
