"""The self-tuning PID on the encoder, alone and with feed-forward: `adaptation` moves the gains of `pid`.

Source: F. Lin, R. D. Brandt, G. Saikalis 2000; paper, section 5.3. What is added to it is told in `adaptation`.
"""

from microstage_ros.control.design import rules
from microstage_ros.control.feedforward import axis as feedforward
from microstage_ros.control.laws import adaptation, pid
from microstage_ros.control.laws.law import ControlLaw, Part
from microstage_ros.control.laws.pid_feedforward import FEEDFORWARD, PID, feedforward_start
from microstage_ros.numerics.compiled import compiled

ADAPTATION = Part(adaptation.GAINS, adaptation.PARAMETERS, adaptation.STATE_FIELDS)


@compiled
def self_tuning_reset(parameters, state, command):
    """Forget what was learned."""
    adaptation.adaptation_reset(parameters.adaptation, state.adaptation, state.pid)


@compiled
def self_tuning_step(parameters, state, reference, encoder, current):
    """One period of the self-tuning PID: command within its limit."""
    period = parameters.period
    pid.pid_motion(parameters.pid, state.pid, period, reference, encoder)
    adaptation.adaptation_step(parameters.adaptation, state.adaptation, parameters.pid, state.pid, period, 1.0, True)
    return pid.pid_output(parameters.pid, state.pid, period, parameters.voltage_limit, 0.0)


@compiled
def fed_forward_self_tuning_step(parameters, state, reference, encoder, current):
    """One period of the self-tuning PID with feed-forward, which falls with a lowered ceiling of the gains."""
    period, model, tuned, learned = parameters.period, parameters.feedforward, parameters.adaptation, state.adaptation
    state.feed_forward = feedforward.feedforward_step(model, state.feedforward, period, reference, 1.0, 1.0, 0.0, 1.0)
    pid.pid_motion(parameters.pid, state.pid, period, reference, encoder)
    adaptation.adaptation_step(tuned, learned, parameters.pid, state.pid, period, 1.0, True)
    state.feed_forward += adaptation.take_over(
        tuned, learned, state.pid, state.feedforward.friction, model.friction_share
    )
    state.feed_forward *= adaptation.fed_forward(tuned, learned)
    return pid.pid_output(parameters.pid, state.pid, period, parameters.voltage_limit, state.feed_forward)


def complete(record):
    """Fill the logarithms of the adaptation's gains."""
    adaptation.take_logarithms(record["adaptation"])


LAWS = (
    ControlLaw("self_tuning", {"pid": PID, "adaptation": ADAPTATION}, self_tuning_step, self_tuning_reset,
        rules=rules.self_tuning_encoder_gains, complete=complete, loop="pid"),
    ControlLaw("self_tuning_feedforward", {"pid": PID, "adaptation": ADAPTATION, "feedforward": FEEDFORWARD},
        fed_forward_self_tuning_step, self_tuning_reset, feedforward_start,
        rules=rules.fed_forward_self_tuning_gains, complete=complete, loop="pid"),
)
