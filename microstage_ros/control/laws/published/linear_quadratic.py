"""Linear quadratic Gaussian law (LQG), given encoder, current and voltage as the observer law is.

The axis is one free mass under an unknown deceleration d that walks at random; friction is all in d:

    x' = v,   v' = (k i) / M - d + noise,   encoder = x + noise,   (U - R i) / E = v + noise
    U = M_v [r'' + w^2 (r - x) + sqrt(2) w (r' - v) + d] + E v

x, v, d by the stationary Kalman filter (`observer.motion_filter.steady_gain`), the regulator is the stationary one of
the double integrator with the weight w^4 on the error and 1 on the acceleration (M_v: volts per acceleration). Nothing
is learned. Source: D. Simon, Optimal State Estimation, Wiley 2006, chapter 7.3; B. Anderson, J. Moore, Optimal Control,
Prentice Hall 1990, chapters 3 and 8.
"""

import math

from microstage_ros.control.design.rules import volts_per_acceleration
from microstage_ros.control.gains import Gain, record_type
from microstage_ros.control.laws.law import ControlLaw, Part
from microstage_ros.control.observer import motion_filter
from microstage_ros.model.sensors.current import sensed_transient
from microstage_ros.numerics.compiled import compiled
from microstage_ros.signals.current import settled

GAINS = (
    Gain("regulator_rate", "1/s", 1e-3, 1e5, 200.0, "w: fourth root of the weight on the error"),
    Gain("encoder_noise", "m", 1e-12, 1e-3, 1.8e-8, "doubt in one encoder value"),
    Gain("voltage_noise", "V", 1e-6, 10.0, 4.0e-3, "doubt in the voltage behind the back-EMF"),
    Gain("acceleration_noise", "m/s^2/rtHz", 1e-12, 1e3, 1.0e-3, "density of what moves the axis unmodelled"),
    Gain("friction_drift", "m/s^3/rtHz", 1e-12, 1e6, 1.0, "density of the random walk of d"),
)
PARAMETERS = record_type(GAINS, [("inertia", "f8"), ("emf", "f8"), ("transient", "f8"), ("gain", "f8", (3, 2))])
STATE_FIELDS = [("x", "f8"), ("v", "f8"), ("d", "f8"), ("current", "f8"), ("wanted_velocity", "f8"), ("output", "f8")]


@compiled
def law_start(parameters, state, reference, encoder):
    """At rest where the encoder [m] says."""
    own = state.quadratic
    own.x, own.v, own.current, own.wanted_velocity = encoder, 0.0, 0.0, 0.0
    own.d = state.voltage / parameters.quadratic.inertia
    own.output = state.voltage


@compiled
def law_step(parameters, state, reference, encoder, current):
    """One period: command within its limit; error and terms stand in ``state.pid``, d as integral [V]."""
    p, s, model, base, period = (
        parameters.quadratic,
        state.quadratic,
        parameters.feedforward,
        state.pid,
        parameters.period,
    )
    senses, limit = model.force_per_ampere > 0.0 and math.isfinite(current), parameters.voltage_limit
    push = (s.output - p.emf * s.v) / p.inertia
    if senses:
        push = model.force_per_ampere / model.moving_mass * 0.5 * (current + s.current)
    s.v += period * (push - s.d)
    s.x += period * s.v
    position, speed = encoder - s.x, 0.0
    if senses:
        drop = model.resistance * settled(current, s.current, p.transient)
        speed = (s.output - drop) / p.emf - s.v
        s.current = current
    s.x += p.gain[0, 0] * position + p.gain[0, 1] * speed
    s.v += p.gain[1, 0] * position + p.gain[1, 1] * speed
    s.d += p.gain[2, 0] * position + p.gain[2, 1] * speed
    base.reference_velocity = (reference - base.previous_reference) / period
    base.previous_reference = reference
    base.previous_encoder = encoder
    acceleration = (base.reference_velocity - s.wanted_velocity) / period
    s.wanted_velocity = base.reference_velocity
    base.error, base.velocity = reference - s.x, s.v
    base.kp = p.inertia * p.regulator_rate * p.regulator_rate
    base.kd = math.sqrt(2.0) * p.inertia * p.regulator_rate
    base.proportional_term = base.kp * base.error
    base.derivative_term = base.kd * (base.reference_velocity - s.v)
    base.integral = p.inertia * s.d
    state.feed_forward = p.inertia * acceleration + p.emf * s.v
    wanted = state.feed_forward + base.proportional_term + base.derivative_term + base.integral
    s.output = min(max(wanted, -limit), limit)
    base.saturated = 0 if wanted == s.output else 1
    return s.output


def complete(record):
    """Inertia [V s^2/m], back-EMF [V s/m] and the filter's gain; without a current the speed's part of it is zero."""
    own, model, period = record["quadratic"], record["feedforward"], float(record["period"])
    own["inertia"], own["emf"] = volts_per_acceleration(model), model["volts_per_velocity"]
    noise = {
        name: float(own[name]) for name in ("encoder_noise", "voltage_noise", "acceleration_noise", "friction_drift")
    }
    senses = float(model["force_per_ampere"]) > 0.0
    if not senses:
        noise["voltage_noise"] = 1e6  # V: a speed that is worth nothing
    own["gain"] = motion_filter.steady_gain({**noise, "encoder_doubt": 1.0, "voltage_doubt": 1.0}, model, period)
    if senses and float(model["settling"]) > 0.0:
        own["transient"] = sensed_transient(
            period, float(model["settling"]), float(model["current_bandwidth"]), float(model["current_skew"])
        )


LAWS = (
    ControlLaw(
        "linear_quadratic",
        {"quadratic": Part(GAINS, PARAMETERS, STATE_FIELDS)},
        law_step,
        start=law_start,
        complete=complete,
    ),
)
