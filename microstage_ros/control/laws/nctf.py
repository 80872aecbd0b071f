"""Nominal characteristic trajectory following (NCTF), the best published practical law for ball screws.

    u_p = de/dt + f(e),   U = K_p u_p + K_i integral of u_p

f is the nominal characteristic trajectory: the speed at which the axis, left without voltage, would just
come to rest after the way e. It is the measured deceleration in the original; here it is the same curve of
the nominal axis, dv/dt = -(v + v_f)/tau with v_f = friction voltage / back-EMF gain:

    e(v) = tau (v - v_f ln(1 + v / v_f))

Near the origin, where this curve is infinitely steep, it is replaced by the line f = beta e. The integral
is frozen while the output saturates. Source: G. J. Maeda, K. Sato, Practical control method for
ultra-precision positioning using a ballscrew mechanism, Precision Engineering 32 (2008) 309-318 (5 nm
resolution reported).
"""

import numpy as np

from microstage_ros.control.design import rules
from microstage_ros.control.gains import Gain, record_type
from microstage_ros.control.laws.filtered_motion import filtered_motion
from microstage_ros.control.laws.law import ControlLaw, Part
from microstage_ros.numerics.compiled import compiled

GAINS = (
    Gain("beta", "1/s", 1e-3, 1e5, 200.0, "slope of the trajectory at the origin"),
    Gain("velocity_proportional", "V s/m", 0.0, 1e7, 2.0e3, "gain K_p on the distance from the trajectory"),
    Gain("velocity_integral", "V/m", 0.0, 1e9, 2.0e5, "gain K_i on its integral"),
    Gain("filter_time", "s", 0.0, 1.0, 5.0e-4, "time constant of the filter of the measured velocity"),
)
POINTS = 64
PARAMETERS = record_type(GAINS, [("way", "f8", POINTS), ("speed", "f8", POINTS)])


def fill_trajectory(record, model):
    """Tabulate the trajectory of the nominal axis from its feed-forward model (way [m], speed [m/s])."""
    speed = np.concatenate([[0.0], np.geomspace(1e-6, 1.0, POINTS - 1)]) * float(model["top_speed"])
    emf = float(model["volts_per_velocity"])
    inertia = float(model["rotor"] + model["volts_per_force"] * model["mass"])
    friction = 0.0
    if model["has_actuator"]:
        friction += float(model["volts_per_torque"] * model["actuator"][1])
    if model["has_guideway"]:
        friction += float(model["volts_per_force"] * model["guideway"][1])
    if emf > 0.0:
        time, slow = inertia / emf, max(friction / emf, 1e-9)
        way = time * (speed - slow * np.log1p(speed / slow))
    else:  # no back-EMF: friction alone brakes
        way = 0.5 * inertia * speed**2 / max(friction, 1e-12)
    record["way"], record["speed"] = way, speed


@compiled
def trajectory_speed(p, error):
    """f(e) [m/s]: the line near the origin, the tabulated trajectory beyond, odd in the error [m]."""
    size = abs(error)
    speed = p.speed[POINTS - 1]
    if size < p.way[POINTS - 1]:
        low, high = 0, POINTS - 1
        while high - low > 1:
            middle = (low + high) // 2
            if p.way[middle] > size:
                high = middle
            else:
                low = middle
        share = (size - p.way[low]) / (p.way[high] - p.way[low])
        speed = p.speed[low] + share * (p.speed[high] - p.speed[low])
    speed = min(speed, p.beta * size)
    return speed if error > 0.0 else -speed


@compiled
def nctf_step(p, base, period, limit, reference, encoder):
    """Output [V] within +-limit; ``base`` keeps motion, integral and terms."""
    filtered_motion(base, period, p.filter_time, reference, encoder)
    distance = base.reference_velocity - base.velocity + trajectory_speed(p, base.error)
    base.kp = p.velocity_proportional * p.beta
    base.ki = p.velocity_integral * p.beta
    base.kd = p.velocity_proportional
    base.proportional_term = p.velocity_proportional * distance
    base.derivative_term = 0.0
    step = p.velocity_integral * distance * period
    wanted = base.proportional_term + base.integral + step
    output = min(max(wanted, -limit), limit)
    base.saturated = 0 if wanted == output else 1
    if base.saturated == 0 or (wanted - output) * step <= 0.0:
        base.integral = min(max(base.integral + step, -limit), limit)
    return output


@compiled
def law_step(parameters, state, reference, encoder, current):
    """`nctf_step` on the records of a controller."""
    return nctf_step(parameters.nctf, state.pid, parameters.period, parameters.voltage_limit, reference, encoder)


def complete(record):
    """Tabulate the trajectory of the nominal axis."""
    fill_trajectory(record["nctf"], record["feedforward"])


LAWS = (ControlLaw("nctf", {"nctf": Part(GAINS, PARAMETERS)}, law_step, rules=rules.nctf_gains, complete=complete),)
