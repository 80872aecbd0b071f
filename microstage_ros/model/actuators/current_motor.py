"""A motor on a current amplifier, commanded with a torque.

    (1/2πB) di/dt = τ_c / k_M − i,     torque = k_M i,     |τ_c| ≤ k_M I_max

B: bandwidth of the current loop. Where ``supply_voltage`` is given the amplifier cannot hold more current than
(± U − K_E ω) / R: the torque falls with speed (the limit is taken at the start of each period).

Derived: a closed current loop as a first-order lag; the supply's limit is U = R i + K_E ω solved for i.
"""

import math

from microstage_ros.model.actuators.actuator import UNKNOWN_TOP_SPEED, Actuator, lever
from microstage_ros.numerics.compiled import internal
from microstage_ros.quantities.command import TORQUE
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec, not_negative, positive


@internal
def _within_supply(plant, state, u):
    """Torque command within what the supply can push through the winding at the present speed."""
    p = plant.drive_parameters
    if p[0] > 0.0:
        low, high = p[3] * (-p[0] - p[1] * state.omega) / p[2], p[3] * (p[0] - p[1] * state.omega) / p[2]
        u = min(max(u, low), high)
    return u


class CurrentMotor(Actuator):
    """Current-driven motor: command [N m] at the motor shaft."""

    name = "current_motor"
    command = TORQUE
    estimation = "force"
    limit_key = "drive.current_limit"
    parameters = {
        "torque_constant": positive("N m/A", "torque constant k_M of the motor"),
        "current_limit": positive("A", "amplifier clips the current to ± this"),
        "bandwidth": positive("Hz", "bandwidth B of the current loop"),
        "rotor_inertia": positive("kg m^2", "all rotating parts, at the motor shaft"),
        "noise": not_negative("N m", "standard deviation of the torque, held over a period", default=0.0),
        "command_bits": Spec("1", 0, 32, "width of the command over ± its limit; 0 means not quantised", default=0),
        "supply_voltage": not_negative("V", "voltage U behind the current loop; 0: never short of it", default=0.0),
        "resistance": not_negative("ohm", "terminal resistance R, needed with supply_voltage", default=0.0),
        "back_emf": not_negative("V s/rad", "back-EMF constant K_E, needed with supply_voltage", default=0.0),
    }
    shape = _within_supply

    @classmethod
    def command_limit(cls, axis):
        """k_M I_max [N m]."""
        return axis.value("drive.torque_constant") * axis.value("drive.current_limit")

    @classmethod
    def converter(cls, axis):
        """The limit as range, and ``command_bits``."""
        return cls.command_limit(axis), axis.value("drive.command_bits")

    @classmethod
    def check(cls, axis):
        """A supply needs a winding.

        Raises InputError: a supply voltage without the winding's resistance.
        """
        super().check(axis)
        if axis.value("drive.supply_voltage") > 0.0 and not axis.value("drive.resistance") > 0.0:
            raise InputError(f"{axis.place}: drive.resistance", axis.value("drive.resistance"),
                             "the winding's ohms, where supply_voltage is given")

    @classmethod
    def fill(cls, plant, axis):
        """The current loop as a first-order lag: L = 1/2πB, R = 1, b = 1/k_M, no back-EMF of its own."""
        constant = axis.value("drive.torque_constant")
        plant["inductance"], plant["resistance"] = 1.0 / (2 * math.pi * axis.value("drive.bandwidth")), 1.0
        plant["electrical_input"], plant["torque_constant"] = 1.0 / constant, constant
        plant["inertia"] = axis.value("drive.rotor_inertia")
        supply = axis.value("drive.supply_voltage")
        plant["shaped"] = int(supply > 0.0)
        plant["drive_parameters"][:4] = supply, axis.value("drive.back_emf"), axis.value("drive.resistance"), constant

    @classmethod
    def feed_forward(cls, axis):
        """Torques for a force, a torque, the rotor's acceleration; no back-EMF."""
        _, _, ratio = lever(axis)
        inertia, supply, emf = (axis.value(f"drive.{key}") for key in ("rotor_inertia", "supply_voltage", "back_emf"))
        return {
            "volts_per_torque": 1.0, "volts_per_force": ratio, "rotor": inertia / ratio,
            "force_per_torque": 1.0 / ratio,
            "moving_mass": axis.value("stage.mass") + inertia / ratio**2,
            "top_speed": supply / emf * ratio if supply > 0.0 and emf > 0.0 else UNKNOWN_TOP_SPEED,
        }

    @classmethod
    def amperes_per_command(cls, axis):
        """1/k_M [A/(N m)]."""
        return 1.0 / axis.value("drive.torque_constant")

    @classmethod
    def force_per_command(cls, axis):
        """N/r: newtons at the stage per newton metre at the shaft [1/m]."""
        return 1.0 / lever(axis)[2]

    @classmethod
    def command_as_force(cls, axis, record):
        """k_M i N/r at the start of each period [N].

        i is measured, or else the loop's answer to the torques commanded before.
        """
        constant = axis.value("drive.torque_constant")
        if "current_A" in record:
            return constant * record["current_A"] / lever(axis)[2]
        from scipy.signal import lfilter  # most of a second that a node need not wait

        fade = math.exp(-2 * math.pi * axis.value("drive.bandwidth") * axis.value("period"))
        return lfilter([0.0, 1.0 - fade], [1.0, -fade], record[cls.command.column]) / lever(axis)[2]

    @classmethod
    def reflected_mass(cls, axis):
        """J (N/r)² [kg]."""
        return axis.value("drive.rotor_inertia") / lever(axis)[2] ** 2
