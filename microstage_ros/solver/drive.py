"""What the actuators put into the compiled step beside its linear part (`model.actuators.actuator`)."""

from microstage_ros.model.actuators import ACTUATORS
from microstage_ros.numerics.compiled import dispatch, internal, not_inlined

REBUILD = 2e-4                 # relative change of the force constant that remakes the matrices

_shape = dispatch("shape_of", [a.shape for a in ACTUATORS], "plant, state, u", "u")
_torque = dispatch("torque_of", [a.torque for a in ACTUATORS], "plant, state, theta, omega", "0.0")


@internal
def shape_command(plant, state, work, u):
    """The actuator's answer to this period's amplifier output ``u``; matrices of another force constant are dropped."""
    not_inlined()
    u = _shape(plant.drive, plant, state, u)
    if abs(state.constant_change - work.constant_change) > REBUILD:
        work.key[:] = -1
        work.slot = -1
        work.constant_change = state.constant_change
    return u


@internal
def drive_torque(plant, state, theta, omega):
    """Torque of the actuator that is not linear [N m], at motor angle ``theta`` and speed ``omega``."""
    not_inlined()
    return _torque(plant.drive, plant, state, theta, omega)
