"""Linear active disturbance rejection (ADRC) with an extended-state observer, from the encoder alone.

    x'' = f + b U,   U = [w_c^2 (r - z_1) + 2 w_c (r' - z_2) + r'' - z_3] / b

z_1, z_2, z_3 are the observer's position, speed and f: all that is not b U, back-EMF and friction included. The
observer is the discrete current one with a triple pole B = exp(-w_o T):

    l_1 = 1 - B^3,   l_2 = 3/2 (1 - B)^2 (1 + B) / T,   l_3 = (1 - B)^3 / T^2

Sources: Z. Gao, Scaling and bandwidth-parameterization based controller tuning, American Control Conference 2003;
R. Miklosovic, A. Radke, Z. Gao, Discrete implementation and generalization of the extended state observer, ibid. 2006.
"""

import math

from microstage_ros.control.design.rules import volts_per_acceleration
from microstage_ros.control.gains import Gain, record_type
from microstage_ros.control.laws.law import ControlLaw, Part
from microstage_ros.numerics.compiled import compiled

GAINS = (
    Gain("controller_rate", "1/s", 1e-3, 1e5, 200.0, "bandwidth w_c of the controller"),
    Gain("observer_rate", "1/s", 1e-3, 1e5, 900.0, "bandwidth w_o of the extended-state observer"),
    Gain("inertia_share", "1", 1e-3, 10.0, 1.0, "1/b over the file's inertia in volts"),
)
PARAMETERS = record_type(GAINS, [("inertia", "f8"), ("gain", "f8", 3)])
STATE_FIELDS = [("position", "f8"), ("speed", "f8"), ("rest", "f8"), ("wanted_velocity", "f8"), ("output", "f8")]


@compiled
def law_start(parameters, state, reference, encoder):
    """At rest where the encoder [m] says; what is not b U holds against the voltage from which the law goes on."""
    own = state.rejection
    own.position, own.speed, own.wanted_velocity = encoder, 0.0, 0.0
    own.rest = -state.voltage / parameters.rejection.inertia
    own.output = state.voltage


@compiled
def law_step(parameters, state, reference, encoder, current):
    """One period: command within its limit; error and terms stand in ``state.pid``, z_3 as integral [V]."""
    p, s, base, period = parameters.rejection, state.rejection, state.pid, parameters.period
    limit = parameters.voltage_limit
    base.reference_velocity = (reference - base.previous_reference) / period
    base.previous_reference = reference
    base.previous_encoder = encoder
    push = s.rest + s.output / p.inertia
    innovation = encoder - (s.position + period * (s.speed + 0.5 * period * push))
    s.position = encoder - (1.0 - p.gain[0]) * innovation
    s.speed += period * push + p.gain[1] * innovation
    s.rest += p.gain[2] * innovation
    acceleration = (base.reference_velocity - s.wanted_velocity) / period
    s.wanted_velocity = base.reference_velocity
    base.error = reference - s.position
    base.velocity = s.speed
    base.kp = p.inertia * p.controller_rate * p.controller_rate
    base.kd = 2.0 * p.inertia * p.controller_rate
    base.proportional_term = base.kp * base.error
    base.derivative_term = base.kd * (base.reference_velocity - s.speed)
    base.integral = -p.inertia * s.rest
    state.feed_forward = p.inertia * acceleration
    wanted = state.feed_forward + base.proportional_term + base.derivative_term + base.integral
    s.output = min(max(wanted, -limit), limit)
    base.saturated = 0 if wanted == s.output else 1
    return s.output


def complete(record):
    """1/b [V s^2/m] and the observer's gains for the period."""
    own, period = record["rejection"], float(record["period"])
    own["inertia"] = float(own["inertia_share"]) * volts_per_acceleration(record["feedforward"])
    pole = math.exp(-float(own["observer_rate"]) * period)
    own["gain"] = (1.0 - pole**3, 1.5 * (1.0 - pole) ** 2 * (1.0 + pole) / period, (1.0 - pole) ** 3 / period**2)


LAWS = (
    ControlLaw(
        "disturbance_rejection",
        {"rejection": Part(GAINS, PARAMETERS, STATE_FIELDS)},
        law_step,
        start=law_start,
        complete=complete,
    ),
)
