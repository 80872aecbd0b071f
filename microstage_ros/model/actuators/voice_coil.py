"""A voice coil on a voltage amplifier, straight on the stage.

    L di/dt = u_a − R i − K(x) v,     force = K(x) i,     K(x) = K_0 (1 + a x + b x²)

The force constant falls towards the ends of the stroke (b < 0); the back-EMF follows it, so no energy is made. K is
taken at the middle of each period's travel; the linear solution is made anew when it has changed by 2·10⁻⁴.

Derived: Kirchhoff's voltage law of the coil, and the power K v i of the back-EMF equal to that of the force; K to
second order in x.
"""

from microstage_ros.model.actuators.actuator import Actuator, lever
from microstage_ros.numerics.compiled import internal
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec, any_number, not_negative, positive

LEAST = 0.05            # of K_0 that is left anywhere on the travel


@internal
def _follow_constant(plant, state, u):
    """Note the force constant of this period's middle."""
    x = state.x + 0.5 * plant.period * state.v
    state.constant_change = max((plant.drive_parameters[0] + plant.drive_parameters[1] * x) * x, LEAST - 1.0)
    return u


class VoiceCoil(Actuator):
    """Voice coil: command [V]."""

    name = "voice_coil"
    transmissions = ("rigid",)
    estimation = "force"
    emf_key = "drive.force_constant"
    parameters = {
        "voltage_limit": positive("V", "amplifier output is clipped to ± this"),
        "dac_range": positive("V", "converter spans ± this"),
        "dac_bits": Spec("1", 0, 32, "converter width; 0 means not quantised"),
        "noise": not_negative("V", "standard deviation of the amplifier's output, held over a period", default=1.0e-3),
        "resistance": positive("ohm", "coil resistance R"),
        "inductance": positive("H", "coil inductance L"),
        "force_constant": positive("N/A",
                                   "force constant K_0 at x = 0; the back-EMF constant in V s/m is the same number"),
        "force_constant_slope": any_number("1/m", "a of K(x)", default=0.0),
        "force_constant_curvature": any_number("1/m^2", "b of K(x)", default=0.0),
    }
    shape = _follow_constant

    @classmethod
    def constant(cls, axis, x):
        """K at the positions ``x`` [m]: N/A, same shape."""
        a, b = axis.value("drive.force_constant_slope"), axis.value("drive.force_constant_curvature")
        return axis.value("drive.force_constant") * (1.0 + a * x + b * x**2)

    @classmethod
    def check(cls, axis):
        """The force constant has to stay positive over the travel.

        Raises InputError: a force constant that vanishes within the travel.
        """
        super().check(axis)
        ends = [axis.value("travel.minimum"), axis.value("travel.maximum")]
        least = min(cls.constant(axis, x) for x in ends)
        if not least > LEAST * axis.value("drive.force_constant"):
            raise InputError(f"{axis.place}: drive.force_constant_curvature",
                             axis.value("drive.force_constant_curvature"),
                             f"a force constant above {LEAST:.0%} of force_constant at both ends of the travel")

    @classmethod
    def fill(cls, plant, axis):
        """L, R, K_0 as back-EMF and force constant (of the motor coordinate x N/r); b = 1."""
        constant = axis.value("drive.force_constant") * plant["ratio"]
        plant["inductance"], plant["resistance"] = axis.value("drive.inductance"), axis.value("drive.resistance")
        plant["torque_constant"] = plant["back_emf"] = constant
        plant["electrical_input"], plant["winding"] = 1.0, 1
        shape = axis.value("drive.force_constant_slope"), axis.value("drive.force_constant_curvature")
        plant["shaped"], plant["drive_parameters"][:2] = int(any(shape)), shape

    @classmethod
    def feed_forward(cls, axis):
        """Volts for a force and a speed, at x = 0."""
        constant, resistance = axis.value("drive.force_constant"), axis.value("drive.resistance")
        _, _, ratio = lever(axis)
        return {
            "volts_per_force": resistance / constant, "volts_per_torque": resistance / constant / ratio,
            "volts_per_velocity": constant, "resistance": resistance,
            "settling": axis.value("drive.inductance") / resistance,
            "current_bandwidth": axis.value("sensors.current.bandwidth"),
            "current_skew": axis.value("sensors.current.skew"),
            "force_per_torque": 1.0 / ratio, "force_per_ampere": constant, "moving_mass": axis.value("stage.mass"),
            "top_speed": cls.command_limit(axis) / constant,
        }

    @classmethod
    def amperes_per_command(cls, axis):
        """1/R [A/V]."""
        return 1.0 / axis.value("drive.resistance")

    @classmethod
    def emf_per_speed(cls, axis):
        """K_0 [V s/m]."""
        return axis.value("drive.force_constant")

    @classmethod
    def force_per_command(cls, axis):
        """K_0 / R: force at rest [N/V]."""
        return axis.value("drive.force_constant") / axis.value("drive.resistance")

    @classmethod
    def command_as_force(cls, axis, record):
        """K(x) i [N]: from the measured current, since the back-EMF takes its part of the voltage.

        Raises InputError: the record has no measured current.
        """
        if "current_A" not in record:
            raise InputError(f"{record.source}: column current_A", "missing",
                             f"current_A, since {axis.place} has a voice coil")
        return cls.constant(axis, record["encoder_m"]) * record["current_A"]
