"""The PID, and the PID with the voltage that the axis's own model needs along the reference.

U = PID(e) + U_ff(reference), where U_ff holds inertia, back-EMF and a share of the friction
(`control.feedforward.axis`).

Sources: paper, section 5.2 (friction fed forward beside the PID); the rest of U_ff is derived: the inverse of the
machine's own equations, as `control.feedforward.axis` has them.
"""

from microstage_ros.control.design import rules
from microstage_ros.control.feedforward import axis as feedforward
from microstage_ros.control.laws import pid
from microstage_ros.control.laws.law import ControlLaw, Part
from microstage_ros.numerics.compiled import compiled

PID = Part(pid.GAINS, pid.PARAMETERS, pid.STATE_FIELDS)
FEEDFORWARD = Part(feedforward.GAINS, feedforward.PARAMETERS, feedforward.STATE_FIELDS)


@compiled
def pid_step(parameters, state, reference, encoder, current):
    """One period of the PID: command within its limit."""
    pid.pid_motion(parameters.pid, state.pid, parameters.period, reference, encoder)
    return pid.pid_output(parameters.pid, state.pid, parameters.period, parameters.voltage_limit, 0.0)


@compiled
def feedforward_start(parameters, state, reference, encoder):
    """The reference has stood at its first value [m] until now."""
    feedforward.feedforward_reset(state.feedforward, reference)


@compiled
def fed_forward_step(parameters, state, reference, encoder, current):
    """One period of the PID with feed-forward: command within its limit."""
    period = parameters.period
    state.feed_forward = feedforward.feedforward_step(
        parameters.feedforward, state.feedforward, period, reference, 1.0, 1.0, 0.0, 1.0
    )
    pid.pid_motion(parameters.pid, state.pid, period, reference, encoder)
    return pid.pid_output(parameters.pid, state.pid, period, parameters.voltage_limit, state.feed_forward)


LAWS = (
    ControlLaw("pid", {"pid": PID}, pid_step, rules=rules.encoder_gains, loop="pid"),
    ControlLaw("pid_feedforward", {"pid": PID, "feedforward": FEEDFORWARD}, fed_forward_step, start=feedforward_start,
        rules=rules.fed_forward_gains, loop="pid"),
)
