"""Cascade of a position P loop and a velocity P loop, as the EMPS benchmark's controller.

    U(n) = K_pos K_vel (reference - x(n)) - K_vel v(n),   v: backward difference of the mean of two positions

Source of the form: EMPS data set (Janot, Gautier, Brunot 2019): position gain 160.18 1/s, velocity gain
243.45 V/(m/s), output within +-10 V.
"""

from microstage_ros.control.gains import Gain, record_type
from microstage_ros.control.laws.law import ControlLaw, Part
from microstage_ros.numerics.compiled import compiled

GAINS = (
    Gain("position_gain", "1/s", 0.0, 1e6, 160.18, "gain of the position loop"),
    Gain("velocity_gain", "V s/m", 0.0, 1e7, 243.45, "gain of the velocity loop"),
)
PARAMETERS = record_type(GAINS)
STATE_FIELDS = [("mean", "f8"), ("previous_encoder", "f8")]


@compiled
def cascade_reset(s, encoder):
    """Start at rest at ``encoder`` [m]."""
    s.mean = encoder
    s.previous_encoder = encoder


@compiled
def cascade_step(p, s, base, period, limit, reference, encoder):
    """Output [V] within +-limit; ``base`` keeps the terms for those who publish them."""
    mean = 0.5 * (encoder + s.previous_encoder)
    velocity = (mean - s.mean) / period
    s.mean = mean
    s.previous_encoder = encoder
    base.error = reference - encoder
    base.velocity = velocity
    base.kp = p.position_gain * p.velocity_gain
    base.kd = p.velocity_gain
    base.proportional_term = base.kp * base.error
    base.derivative_term = -p.velocity_gain * velocity
    wanted = base.proportional_term + base.derivative_term
    output = min(max(wanted, -limit), limit)
    base.saturated = 0 if wanted == output else 1
    return output


@compiled
def law_start(parameters, state, reference, encoder):
    """`cascade_reset` on the records of a controller."""
    cascade_reset(state.cascade, encoder)


@compiled
def law_step(parameters, state, reference, encoder, current):
    """`cascade_step` on the records of a controller."""
    return cascade_step(
        parameters.cascade, state.cascade, state.pid, parameters.period, parameters.voltage_limit, reference, encoder
    )


LAWS = (ControlLaw("cascade", {"cascade": Part(GAINS, PARAMETERS, STATE_FIELDS)}, law_step, start=law_start),)
