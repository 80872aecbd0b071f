"""What an actuator is: its command, its parameters, how it enters the compiled step, its limits, its feed-forward.

The linear part of every actuator has one form, with the amplifier's output u_a [command's unit × ``gain``]:

    L di/dt  = b u_a − R i − K_E ω          i: current, or whatever first-order state the actuator has
    torque   = k_M i + g u_a − D ω          at the motor shaft (with a ``rigid`` transmission of unit ratio: a force)

`Actuator.fill` writes L, R, b, K_E, k_M, g, D into the plant record. What is not linear goes into two compiled
functions of the class, both optional: ``shape`` (once per period: command → u_a) and ``torque`` (in every chunk).

Derived: Kirchhoff's voltage law of the winding and the torque of its current; the stationary form is Eq. 9 of the
paper.
"""

from collections.abc import Callable

from microstage_ros.model.transmission import screw_ratio
from microstage_ros.quantities.command import VOLTAGE
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec

UNKNOWN_TOP_SPEED = 10.0
"""Of an axis whose data do not limit its speed [m/s]."""

LINEAR = ("inductance", "resistance", "electrical_input", "back_emf", "torque_constant", "direct", "motor_damping")
"""Fields of a plant that hold L, R, b, K_E, k_M, g, D."""


class Actuator:
    """Base of all actuators; a subclass is one file of `model.actuators` and one line of its registry.

    Attributes
    ----------
    name : word in axis files (``drive.type``). number : its place in the registry, set there.
    command : `quantities.command.Command`, what it is commanded with.
    parameters : {key below ``drive``: `Spec`}. transmissions : the types that it can be joined to.
    measures_current : whether the drive has a current sensor. holds_position : whether the command sets a position
        (stepper, piezo) and not a force.
    holds_on_fault : the safe command is the last one obeyed, since zero would be a move. disables_on_fault : the
        drive's enable output goes off with a fault. laws : control laws that can drive it, None: all.
    estimation : what its records are identified and diagnosed by: ``motor`` (voltage and current), ``force`` (the
    command
        is a force at the stage), ``position`` (the command sets a position), None: nothing yet.
    identified : keys that `identify` scales where ``estimation`` is ``position``.
    limit_key : leaf of the axis file that bounds the command.
    emf_key : leaf of the back-EMF constant of a winding that is fed with a voltage; "" for other drives. In SI it is
        the torque (force) constant too.
    tells_turning : whether back-EMF and current tell that the motor turns beside a dead encoder. Of a coil straight at
        the stage they do not: L i / K_E alone is some 100 µm there.
    shape : compiled function (plant, state, u) -> u, or None. torque : compiled (plant, state, theta, omega) -> N m, or
    None.
    """

    name = ""
    number = 0
    command = VOLTAGE
    parameters: dict[str, Spec] = {}
    transmissions: tuple[str, ...] = ("screw", "rigid")
    measures_current = True
    holds_position = False
    holds_on_fault = False
    disables_on_fault = True
    laws: tuple[str, ...] | None = None
    estimation: str | None = None
    identified: tuple[str, ...] = ()
    limit_key = "drive.voltage_limit"
    emf_key = ""
    tells_turning = False
    shape: Callable | None = None
    torque: Callable | None = None

    @classmethod
    def command_limit(cls, axis):
        """Largest command [unit of the command]."""
        return axis.value(cls.limit_key)

    @classmethod
    def limited(cls, axis, limit):
        """The `Axis` with ``limit`` [unit of the command] as its largest command."""
        return axis.with_values({cls.limit_key: axis.value(cls.limit_key) * limit / cls.command_limit(axis)},
                                source="estimate")

    @classmethod
    def amperes_per_command(cls, axis):
        """Current at rest per unit of the command [A per unit]; 0 for a drive without one."""
        return 0.0

    @classmethod
    def emf_per_speed(cls, axis):
        """Volts per speed of the stage of a winding that is fed with a voltage [V s/m]; 0 for other drives."""
        return 0.0

    @classmethod
    def converter(cls, axis):
        """(range of the converter [unit of the command], its bits; 0: not quantised)."""
        return axis.value("drive.dac_range"), axis.value("drive.dac_bits")

    @classmethod
    def command_step(cls, axis):
        """Smallest step of the command that the drive obeys [unit of the command]; 0: any."""
        span, bits = cls.converter(axis)
        return 2.0 * span / 2.0**bits if bits else 0.0

    @classmethod
    def fill(cls, plant, axis):
        """Write what is the actuator's own into a plant record, whose transmission is filled already."""
        raise NotImplementedError

    @classmethod
    def given_noise(cls, volts):
        """Noise of the command that a run asks for [unit of the command], None: the axis file's ``drive.noise``.

        ``volts``: the run's ``noise.voltage_V`` [V]; InputError where it is not zero and the command is not a voltage.
        """
        if volts and cls.command is not VOLTAGE:
            raise InputError(
                "noise.voltage_V",
                volts,
                f"0 or nothing: {cls.name} is commanded in {cls.command.units}; "
                f"its noise is drive.noise [{cls.command.unit}] of the axis file",
            )
        return volts

    @classmethod
    def linearised(cls, plant):
        """(gain, stiffness, damping) at small commands and motion: ``torque`` = gain u − stiffness θ − damping ω.

        In [N m] per unit of the command, [N m/rad], [N m s/rad].
        """
        return 0.0, 0.0, 0.0

    @classmethod
    def start(cls, plant, state):
        """Write the actuator's part of a ``state`` record (SI) at rest at ``state['theta']`` [rad]; most have none."""

    @classmethod
    def feed_forward(cls, axis):
        """Fields of `control.feedforward.axis.MODEL_FIELDS` that are the actuator's, as a dict."""
        raise NotImplementedError

    @classmethod
    def derived_columns(cls, axis, columns):
        """Columns of a simulated record that follow from its ``columns`` {name: values (n,), SI}; most have none."""
        return {}

    @classmethod
    def force_per_command(cls, axis):
        """Force on the stage per unit of the command, at rest [N per unit]; InputError where it sets none."""
        raise InputError(f"{axis.place}: drive.type", cls.name, "a drive whose command is a force at the stage")

    @classmethod
    def judged(cls, axis):
        """(factor, unit, quantity) in which re-simulated and recorded commands are compared.

        A force, or the command itself.
        """
        if cls.holds_position:
            return 1.0, cls.command.unit, cls.command.quantity
        return cls.force_per_command(axis), "N", "force"

    @classmethod
    def reflected_mass(cls, axis):
        """What the rotor adds to the moving mass [kg]."""
        return 0.0

    @classmethod
    def estimated(cls, axis, task):
        """``estimation``, or InputError where ``task`` (identify, diagnose) has nothing for this drive."""
        if cls.estimation is None:
            raise InputError(
                f"{axis.place}: drive.type",
                cls.name,
                f"a drive that {task} has a model of: a voltage-driven motor, or one "
                "whose command is a force at the stage",
            )
        return cls.estimation

    @classmethod
    def command_as_force(cls, axis, record):
        """Force on the stage that a record's command asks for [N], shape (n,)."""
        if cls.command.column in record:
            return cls.force_per_command(axis) * record[cls.command.column]
        return record["force_N"]

    @classmethod
    def check(cls, axis):
        """InputError for parameters that contradict each other or the transmission."""
        kind = axis.choices["transmission.type"]
        if kind not in cls.transmissions:
            raise InputError(
                f"{axis.place}: transmission.type",
                kind,
                f"{' or '.join(cls.transmissions)}, with a drive of type {cls.name}",
            )

    @classmethod
    def check_law(cls, law, place):
        """InputError if the control law ``law`` cannot drive this actuator."""
        if cls.laws is not None and law not in cls.laws:
            raise InputError(
                place,
                law,
                f"one of {', '.join(cls.laws)}: {cls.name} is commanded with {cls.command.quantity}"
                f" [{cls.command.unit}], which sets a position and not a force",
            )


def lever(axis):
    """(r, N, r/N): travel per angle of the screw [m/rad], gear ratio [1], travel per angle of the motor [m/rad]."""
    ratio, gear = screw_ratio(axis), axis.value("transmission.gear_ratio")
    return ratio, gear, ratio / gear
