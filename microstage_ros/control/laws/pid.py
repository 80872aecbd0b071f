"""Discrete PID controller of Eqs. 11 and 12 of the paper.

    U(n) = K_P e(n) + K_I sum_k e(k) - K_D [x(n) - x(n-1)],   K_I = K_P T / T_I,   K_D = K_P T_D / T

with e = reference - x. The printed Eq. 11 has + K_D, which with this e would be positive velocity
feedback; the damping sign is -. Beyond the printed form:

* the difference of positions passes a first-order filter of time constant `filter_time`, because one
  encoder count per period is 0.25 mm/s at 25 nm and 100 us;
* a share `derivative_on_reference` of the reference's velocity is taken off the measured one
  (0: the paper's damping of the position; 1: derivative of the error);
* the integral stops while the output is at its limit and the error would drive it further;
* the integral is kept in volts, so that a change of gains never makes the output jump.

Example: ``make_controller("pid", axis, proportional=6e5, integral_time=0.01, derivative_time=0.004)``.
"""

from microstage_ros.control.gains import Gain, record_type
from microstage_ros.numerics.compiled import compiled
from microstage_ros.solver.vectors import fused

GAINS = (
    Gain("proportional", "V/m", 0.0, 1e9, 3.6e5, "proportional gain K_P"),
    Gain("integral_time", "s", 1e-5, 1e6, 0.0065, "integral time T_I; K_I = K_P T / T_I"),
    Gain("derivative_time", "s", 0.0, 10.0, 0.0039, "derivative time T_D; K_D = K_P T_D / T"),
    Gain("filter_time", "s", 0.0, 1.0, 1.64e-3, "time constant of the filter of the derivative"),
    Gain("derivative_on_reference", "1", 0.0, 1.0, 1.0, "share of the reference velocity in the derivative"),
)
PARAMETERS = record_type(GAINS)
STATE_FIELDS = [
    ("kp", "f8"),  # V/m, the gain in use: parameters at reset, then the adaptation's
    ("ki", "f8"),  # V/(m s)
    ("kd", "f8"),  # V s/m
    ("filter_time", "f8"),  # s
    ("integral", "f8"),  # V
    ("velocity", "f8"),  # m/s, filtered
    ("reference_velocity", "f8"),  # m/s
    ("previous_encoder", "f8"),  # m
    ("previous_reference", "f8"),  # m
    ("proportional_term", "f8"),  # V
    ("derivative_term", "f8"),  # V
    ("error", "f8"),  # m
    ("saturated", "i8"),
]


@compiled
def pid_reset(p, s, voltage):
    """Start with the output at ``voltage`` [V] and the parameters' gains."""
    s.kp = p.proportional
    s.ki = p.proportional / p.integral_time if p.integral_time > 0.0 else 0.0
    s.kd = p.proportional * p.derivative_time
    s.filter_time = p.filter_time
    s.integral = voltage
    s.velocity = 0.0
    s.reference_velocity = 0.0
    s.proportional_term = 0.0
    s.derivative_term = 0.0
    s.error = 0.0
    s.saturated = 0


@compiled
def pid_change(p, s, kp, ki, kd):
    """Other gains from now on [V/m, V/(m s), V s/m]; the output does not jump."""
    damped = s.velocity - p.derivative_on_reference * s.reference_velocity
    s.integral += (s.kp - kp) * s.error - (s.kd - kd) * damped
    s.kp = kp
    s.ki = ki
    s.kd = kd


@compiled
def pid_motion(p, s, period, reference, encoder):
    """Error and filtered velocities of this period, from the new reference and encoder value [m]."""
    s.error = reference - encoder
    rate = 1.0 / period
    s.reference_velocity = (reference - s.previous_reference) * rate
    share = period / (period + s.filter_time)  # backward Euler: a filter time of 0 is the raw difference
    s.velocity = fused(share * rate, encoder - s.previous_encoder, (1.0 - share) * s.velocity)
    s.previous_reference = reference
    s.previous_encoder = encoder


@compiled
def pid_output(p, s, period, limit, feed_forward):
    """Output [V] within +-limit, from the motion of `pid_motion` and a feed-forward voltage."""
    wanted_velocity = p.derivative_on_reference * s.reference_velocity
    s.proportional_term = s.kp * s.error
    s.derivative_term = -s.kd * (s.velocity - wanted_velocity)
    gain = s.ki * period
    step = gain * s.error
    # before the encoder is read, which a quick loop waits for
    known = s.integral + feed_forward + s.kd * wanted_velocity
    wanted = fused(-s.kd, s.velocity, fused(s.kp + gain, s.error, known))
    output = min(max(wanted, -limit), limit)
    s.saturated = 0 if wanted == output else 1
    if s.saturated == 0 or (wanted - output) * step <= 0.0:
        s.integral = min(max(s.integral + step, -limit), limit)
    return output
