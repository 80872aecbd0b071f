"""No control: command zero, whatever the error; for runs in open loop."""

from microstage_ros.control.laws.law import ControlLaw
from microstage_ros.numerics.compiled import compiled


@compiled
def none_step(parameters, state, reference, encoder, current):
    """Zero; the error [m] is kept for those who publish it."""
    state.pid.error = reference - encoder
    return 0.0


LAWS = (ControlLaw("none", {}, none_step),)
