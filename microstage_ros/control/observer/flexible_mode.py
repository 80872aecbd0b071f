"""The stage's swing beyond the drive train, and the regulator that allows for it at long control periods.

The rotor is a hundred times as heavy as the stage, reflected: it moves as if the stage were not there, and the
stage swings on the drive train about where the screw holds it, w'' = -w / (K m) - (D/m) w' - dv/dt, with compliance
K and damping D. Encoder and back-EMF hardly see w, but the motor's acceleration is known from its current: w is
dead-reckoned.

A voltage held for a millisecond throws the stage by nanometres, and what is done about the error of the one period
is felt in the next. The regulator that weighs both is the linear-quadratic one of (w, w', x, v), the voltage held,
sliding where the friction curve falls:

    sum of (x + w)^2 + (EFFORT^2 dv/dt)^2  least      (Franklin, Powell, Workman, "Digital Control", 3rd ed., ch. 9)

Its gains on x and v are the PID's K_P and K_D; those on w and w' over K_P are `swing_share` and `swing_time`.
"""

import numpy as np

from microstage_ros.control.gains import Gain
from microstage_ros.control.observer.motion_filter import curve_slope, riccati
from microstage_ros.model.friction.curve import STRIBECK_VELOCITY
from microstage_ros.numerics.compiled import compiled

GAINS = (
    Gain("swing_share", "1", -10.0, 10.0, 0.0, "share of the stage's swing that the regulator reads as error"),
    Gain("swing_time", "s", -1.0, 1.0, 0.0, "time over which it reads its rate; both 0: the swing is not followed"),
)
FIELDS = [
    ("swing", "f8"),  # m, stage over where the screw holds it
    ("swing_rate", "f8"),  # m/s
]
PARAMETERS = [("swing_matrix", "f8", (2, 3))]  # (w, w') after a period, of (w, w', acceleration)
EFFORT = 2.7e-4  # s: an acceleration a costs what an error of EFFORT^2 a costs
CREEP = 0.1  # of the Stribeck velocity, at which friction is taken to fall


@compiled
def follow_swing(p, s):
    """One period of the swing under the observer's mean acceleration."""
    m, swing, rate = p.swing_matrix, s.swing, s.swing_rate
    s.swing = m[0, 0] * swing + m[0, 1] * rate + m[0, 2] * s.acceleration
    s.swing_rate = m[1, 0] * swing + m[1, 1] * rate + m[1, 2] * s.acceleration


@compiled
def read_swing(p, s):
    """What the swing adds to the position [m] that is regulated."""
    return p.swing_share * s.swing + p.swing_time * s.swing_rate


def exponential(a):
    """e^a of a square matrix ``a`` (n, n), by squaring the series of a / 2^k; same shape."""
    halvings = max(int(np.ceil(np.log2(max(np.abs(a).sum(axis=1).max(), 1e-300)))) + 4, 0)
    small = a / 2.0**halvings
    term = result = np.eye(len(a))
    for k in range(1, 12):
        term = term @ small / k
        result = result + term
    for _ in range(halvings):
        result = result @ result
    return result


def held(a, b, period):
    """(A, B) over ``period`` [s] of dx/dt = a x + b u, the input held; ``a`` and A (n, n), ``b`` and B (n, k)."""
    n = len(a)
    both = exponential(np.block([[a, b], [np.zeros((b.shape[1], n + b.shape[1]))]]) * period)
    return both[:n, :n], both[:n, n:]


def swing_rates(model):
    """(1/(K m) [1/s^2], D/m [1/s]) of a feed-forward model record with a drive train."""
    mass = float(model["mass"])
    return 1.0 / (float(model["compliance"]) * mass), float(model["drive_damping"]) / mass


def swing_matrix(record, model, period):
    """`PARAMETERS` of an observer record: shape (2, 3), SI; zero where the regulator does not read the
    swing, or nothing swings. ``period`` [s]."""
    if not (record["swing_share"] or record["swing_time"]) or not float(model["compliance"]) > 0.0:
        return np.zeros((2, 3))
    spring, damping = swing_rates(model)
    return np.hstack(held(np.array([[0.0, 1.0], [-spring, -damping]]), np.array([[0.0], [-1.0]]), period))


def held_axis(model, period):
    """(A, B, acceleration per volt [m/(V s^2)]) of (w, w', x, v) over a ``period`` [s] of held voltage, friction
    falling at `CREEP`; A (4, 4), B (4, 1)."""
    resistance, mass = float(model["resistance"]), float(model["moving_mass"])
    push = float(model["force_per_ampere"]) / (resistance * mass)
    slope = push * float(model["volts_per_velocity"])
    if model["has_actuator"]:
        law = np.array(model["actuator"])
        scale = float(model["force_per_torque"]) / (float(model["screw_ratio"]) * mass)
        slope += scale * curve_slope(law, CREEP * law[STRIBECK_VELOCITY], 1.0)
    spring, damping = swing_rates(model)
    a = np.array([
        [0.0, 1.0, 0.0, 0.0], [-spring, -damping, 0.0, slope], [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, -slope],
    ])
    return *held(a, np.array([[0.0], [-push], [0.0], [push]]), period), push


def held_gains(model, period):
    """Volts per (w [m], w' [m/s], x [m], v [m/s]) of the linear-quadratic regulator at ``period`` [s], (4,)."""
    a, b, push = held_axis(model, period)
    weight = np.outer([1.0, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 0.0])
    effort = (EFFORT**2 * push) ** 2
    cost = riccati(a, weight, b @ b.T / effort)
    return (b.T @ cost @ a / (effort + b.T @ cost @ b))[0]
