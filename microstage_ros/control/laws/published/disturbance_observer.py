"""Cascade of position and velocity loop with a disturbance observer (K. Ohnishi's form), from the encoder alone.

    v* = r' + w_p (r - x),   U = E v + M [r'' + b (v* - v)] + d,   d = g/(s + g) [U - E v + g M v] - g M v

with M [V s^2/m] and E [V s/m] of the axis file: d is the voltage that friction and every other load take, filtered at
g (U - E v - M v' without its derivative). Source: K. Ohnishi, M. Shibata, T. Murakami, Motion control for advanced
mechatronics, IEEE/ASME Transactions on Mechatronics 1 (1996) 56-67.
"""

import math

from microstage_ros.control.design.rules import volts_per_acceleration
from microstage_ros.control.gains import Gain, record_type
from microstage_ros.control.laws.filtered_motion import filtered_motion
from microstage_ros.control.laws.law import ControlLaw, Part
from microstage_ros.numerics.compiled import compiled

GAINS = (
    Gain("position_rate", "1/s", 1e-3, 1e5, 150.0, "w_p of the position loop"),
    Gain("velocity_rate", "1/s", 1e-3, 1e5, 300.0, "b of the velocity loop"),
    Gain("disturbance_rate", "1/s", 1e-3, 1e5, 100.0, "g of the disturbance observer"),
    Gain("inertia_share", "1", 1e-3, 10.0, 1.0, "share of the file's inertia that is counted with"),
    Gain("filter_time", "s", 0.0, 1.0, 5.0e-4, "time constant of the filter of the measured velocity"),
)
PARAMETERS = record_type(GAINS, [("inertia", "f8"), ("emf", "f8"), ("keep", "f8")])
STATE_FIELDS = [("filtered", "f8"), ("wanted_velocity", "f8"), ("output", "f8")]


@compiled
def law_start(parameters, state, reference, encoder):
    """At rest, with no disturbance yet."""
    own = state.disturbance
    own.filtered, own.wanted_velocity, own.output = state.voltage, 0.0, state.voltage


@compiled
def law_step(parameters, state, reference, encoder, current):
    """One period: command within its limit; the error, the terms and the disturbance [V] stand in ``state.pid``."""
    p, s, base, period = parameters.disturbance, state.disturbance, state.pid, parameters.period
    limit = parameters.voltage_limit
    filtered_motion(base, period, p.filter_time, reference, encoder)
    shifted = p.disturbance_rate * p.inertia * base.velocity
    s.filtered = p.keep * s.filtered + (1.0 - p.keep) * (s.output - p.emf * base.velocity + shifted)
    base.integral = s.filtered - shifted
    acceleration = (base.reference_velocity - s.wanted_velocity) / period
    s.wanted_velocity = base.reference_velocity
    base.kd = p.inertia * p.velocity_rate
    base.kp = base.kd * p.position_rate
    base.proportional_term = base.kp * base.error
    base.derivative_term = base.kd * (base.reference_velocity - base.velocity)
    state.feed_forward = p.inertia * acceleration + p.emf * base.velocity
    wanted = state.feed_forward + base.proportional_term + base.derivative_term + base.integral
    s.output = min(max(wanted, -limit), limit)
    base.saturated = 0 if wanted == s.output else 1
    return s.output


def complete(record):
    """Inertia [V s^2/m] and back-EMF [V s/m] of the file, and what the observer's filter keeps in a period."""
    own, model = record["disturbance"], record["feedforward"]
    own["inertia"] = float(own["inertia_share"]) * volts_per_acceleration(model)
    own["emf"] = model["volts_per_velocity"]
    own["keep"] = math.exp(-float(own["disturbance_rate"]) * float(record["period"]))


LAWS = (
    ControlLaw(
        "cascade_disturbance",
        {"disturbance": Part(GAINS, PARAMETERS, STATE_FIELDS)},
        law_step,
        start=law_start,
        complete=complete,
    ),
)
