"""A force on the stage, proportional to the command: an amplifier of the force or of the current, infinitely fast.

    force = gain · u_a

Commanded with the voltage at the amplifier's input [V], as the published data of such axes are.

Derived: by definition of the gain. Such axes: the EMPS data set (Janot, Gautier, Brunot 2019).
"""

from microstage_ros.model.actuators.actuator import UNKNOWN_TOP_SPEED, Actuator, lever
from microstage_ros.quantities.spec import Spec, not_negative, positive


class Force(Actuator):
    """Force drive: command [V], ``gain`` [N/V]."""

    name = "force"
    measures_current = False
    estimation = "force"
    parameters = {
        "voltage_limit": positive("V", "command is clipped to ± this"),
        "dac_range": positive("V", "converter spans ± this", default=10.0),
        "dac_bits": Spec("1", 0, 32, "converter width; 0 means not quantised", default=0),
        "noise": not_negative("V", "standard deviation of the command that the amplifier adds, held over a period",
                              default=1.0e-3),
        "gain": positive("N/V", "force on the stage per volt of command"),
    }

    @classmethod
    def fill(cls, plant, axis):
        """Direct torque r/N per unit, so that u_a is the force at the stage; no current, no rotor."""
        plant["gain"] = axis.value("drive.gain")
        plant["limit"] = cls.command_limit(axis) * plant["gain"]
        plant["inductance"] = 1.0
        plant["direct"] = plant["ratio"]

    @classmethod
    def feed_forward(cls, axis):
        """Volts for a force or a torque; no back-EMF, no rotor."""
        ratio, gear, _ = lever(axis)
        per_force = 1.0 / axis.value("drive.gain")
        return {
            "force_per_torque": gear / ratio,
            "moving_mass": axis.value("stage.mass"),
            "volts_per_force": per_force,
            "volts_per_torque": per_force * gear / ratio,
            "top_speed": UNKNOWN_TOP_SPEED,
        }

    @classmethod
    def derived_columns(cls, axis, columns):
        """The force, gain × voltage [N]."""
        return {"force_N": axis.value("drive.gain") * columns["voltage_V"]}

    @classmethod
    def force_per_command(cls, axis):
        """The gain [N/V]."""
        return axis.value("drive.gain")
