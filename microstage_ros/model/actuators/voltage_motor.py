"""A DC motor on a voltage amplifier.

    L di/dt = u_a − R i − K_E ω,     torque = k_M i

Commanded with the voltage at the amplifier's output, clipped to ± ``voltage_limit``, rounded by the converter.

Derived: Kirchhoff's voltage law of the winding; with di/dt = 0 it is Eq. 9 of the paper.
"""

from microstage_ros.model.actuators.actuator import UNKNOWN_TOP_SPEED, Actuator, lever
from microstage_ros.quantities.spec import Spec, not_negative, positive


class VoltageMotor(Actuator):
    """Voltage-driven DC motor: command [V]."""

    name = "voltage_motor"
    estimation = "motor"
    emf_key = "drive.back_emf"
    tells_turning = True
    parameters = {
        "voltage_limit": positive("V", "amplifier output is clipped to ± this"),
        "dac_range": positive("V", "converter spans ± this"),
        "dac_bits": Spec("1", 0, 32, "converter width; 0 means not quantised"),
        "noise": not_negative("V", "standard deviation of the amplifier's output, held over a period", default=1.0e-3),
        "resistance": positive("ohm", "terminal resistance R"),
        "inductance": positive("H", "terminal inductance L"),
        "back_emf": not_negative("V s/rad", "back-EMF constant K_E of the motor"),
        "torque_constant": positive("N m/A", "torque constant k_M of the motor"),
        "rotor_inertia": positive("kg m^2", "all rotating parts, at the motor shaft"),
    }

    @classmethod
    def fill(cls, plant, axis):
        """L, R, K_E, k_M and J as the file has them; b = 1."""
        for key in ("resistance", "inductance", "back_emf", "torque_constant"):
            plant[key] = axis.value(f"drive.{key}")
        plant["inertia"] = axis.value("drive.rotor_inertia")
        plant["electrical_input"], plant["winding"] = 1.0, 1

    @classmethod
    def feed_forward(cls, axis):
        """Volts for a force, a torque, a speed, the rotor's acceleration."""
        ratio, gear, _ = lever(axis)
        per_torque = axis.value("drive.resistance") / axis.value("drive.torque_constant")
        per_velocity = axis.value("drive.back_emf") * gear / ratio
        inertia = axis.value("drive.rotor_inertia")
        return {
            "volts_per_torque": per_torque,
            "volts_per_force": per_torque * ratio / gear,
            "volts_per_velocity": per_velocity,
            "rotor": per_torque * inertia * gear / ratio,
            "top_speed": cls.command_limit(axis) / per_velocity if per_velocity > 0.0 else UNKNOWN_TOP_SPEED,
            "resistance": axis.value("drive.resistance"),
            "settling": axis.value("drive.inductance") / axis.value("drive.resistance"),
            "current_bandwidth": axis.value("sensors.current.bandwidth"),
            "current_skew": axis.value("sensors.current.skew"),
            "force_per_torque": gear / ratio,
            "force_per_ampere": axis.value("drive.torque_constant") * gear / ratio,
            "moving_mass": axis.value("stage.mass") + inertia * (gear / ratio) ** 2,
        }

    @classmethod
    def amperes_per_command(cls, axis):
        """1/R [A/V]."""
        return 1.0 / axis.value("drive.resistance")

    @classmethod
    def emf_per_speed(cls, axis):
        """K_E N/r [V s/m]."""
        return axis.value("drive.back_emf") / lever(axis)[2]

    @classmethod
    def force_per_command(cls, axis):
        """k_M N / (R r): the stalled motor's force [N/V]."""
        ratio, gear, _ = lever(axis)
        return axis.value("drive.torque_constant") / axis.value("drive.resistance") * gear / ratio
