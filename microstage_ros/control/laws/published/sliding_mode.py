"""Sliding mode with integral surface and boundary layer, from the encoder alone.

    s = (r' - v) + 2 w e + w^2 integral of e,   U = E v + M [r'' + 2 w (r' - v) + w^2 e] + k sat(s / h)

sat is linear within the boundary layer h and 1 beyond, so that the encoder's noise is not switched on; the integral in
the surface takes away what the layer would leave. It is frozen while the output saturates. Source: J.-J. Slotine,
W. Li, Applied nonlinear control, Prentice Hall 1991, sections 7.1 and 7.2.
"""

from microstage_ros.control.design.rules import volts_per_acceleration
from microstage_ros.control.gains import Gain, record_type
from microstage_ros.control.laws.filtered_motion import filtered_motion
from microstage_ros.control.laws.law import ControlLaw, Part
from microstage_ros.numerics.compiled import compiled

GAINS = (
    Gain("surface_rate", "1/s", 1e-3, 1e5, 100.0, "slope w of the surface"),
    Gain("switching", "V", 0.0, 100.0, 0.6, "voltage k on either side of the surface"),
    Gain("layer", "m/s", 1e-9, 10.0, 6.0e-4, "width h of the boundary layer"),
    Gain("filter_time", "s", 0.0, 1.0, 1.0e-3, "time constant of the filter of the measured velocity"),
)
PARAMETERS = record_type(GAINS, [("inertia", "f8"), ("emf", "f8")])
STATE_FIELDS = [("sum", "f8"), ("wanted_velocity", "f8")]


@compiled
def law_start(parameters, state, reference, encoder):
    """At rest; the integral of the error [m s] starts at zero."""
    state.sliding.sum, state.sliding.wanted_velocity = 0.0, 0.0


@compiled
def law_step(parameters, state, reference, encoder, current):
    """One period: command within its limit; error and terms stand in ``state.pid``."""
    p, s, base, period = parameters.sliding, state.sliding, state.pid, parameters.period
    limit = parameters.voltage_limit
    filtered_motion(base, period, p.filter_time, reference, encoder)
    acceleration = (base.reference_velocity - s.wanted_velocity) / period
    s.wanted_velocity = base.reference_velocity
    rate, behind = p.surface_rate, base.reference_velocity - base.velocity
    total = s.sum + period * base.error
    surface = behind + 2.0 * rate * base.error + rate * rate * total
    base.kp = p.inertia * rate * rate + 2.0 * rate * p.switching / p.layer
    base.kd = 2.0 * p.inertia * rate + p.switching / p.layer
    base.proportional_term = p.inertia * rate * rate * base.error
    base.derivative_term = 2.0 * p.inertia * rate * behind
    base.integral = p.switching * min(max(surface / p.layer, -1.0), 1.0)
    state.feed_forward = p.inertia * acceleration + p.emf * base.velocity
    wanted = state.feed_forward + base.proportional_term + base.derivative_term + base.integral
    output = min(max(wanted, -limit), limit)
    base.saturated = 0 if wanted == output else 1
    if abs(surface) < p.layer and base.saturated == 0 or surface * base.error < 0.0:
        s.sum = total
    return output


def complete(record):
    """Inertia [V s^2/m] and back-EMF [V s/m] of the file."""
    record["sliding"]["inertia"] = volts_per_acceleration(record["feedforward"])
    record["sliding"]["emf"] = record["feedforward"]["volts_per_velocity"]


LAWS = (
    ControlLaw(
        "sliding_mode", {"sliding": Part(GAINS, PARAMETERS, STATE_FIELDS)}, law_step, start=law_start, complete=complete
    ),
)
