"""A hybrid stepper on a microstepping driver of constant current, commanded with the angle of its field.

    torque = −T_H sin(p (θ − θ_f)) − T_D sin(4 p θ) − D ω

p: pole pairs, 50 for 200 steps per turn; T_H: holding torque; T_D: detent torque, four periods per electrical turn
(P. Acarnley, Stepping Motors, IET 2002). The field θ_f follows the command in whole microsteps of 2π / (4 p n), no
faster than the driver can pulse. A load beyond T_H, or a field that runs away, makes the rotor slip by whole
electrical turns: 4 full steps each are lost, and nothing tells the driver.
"""

import math

from microstage_ros.model.actuators.actuator import Actuator, lever
from microstage_ros.numerics.compiled import internal
from microstage_ros.quantities.command import ANGLE
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec, not_negative, positive

FINE = 0.05             # largest angle of the rotor's own oscillation per chunk of the compiled step [rad]
SPARE = 1.2             # the field may be commanded beyond the travel by this factor
SHARE = 0.25            # of the damping rate D/J that integral control may use
HOLDING, POLES, DETENT, MICROSTEP, STEPS, LOST, LOST_AT, LOST_WITHIN = range(8)


@internal
def _field(plant, state, u):
    """Angle of the field in this period [rad]: the command in whole microsteps, as fast as the driver pulses."""
    p = plant.drive_parameters
    steps = round(u / p[MICROSTEP]) - state.drive[0]
    state.drive[0] += min(max(steps, -p[STEPS]), p[STEPS])
    behind = 0.0
    if p[LOST] != 0.0 and state.time > p[LOST_AT]:       # an effect: pulses that the driver has lost
        behind = round(p[LOST] * min((state.time - p[LOST_AT]) / p[LOST_WITHIN], 1.0))
    return (state.drive[0] - behind) * p[MICROSTEP]


@internal
def _torque(plant, state, theta, omega):
    """Torque of field and magnets [N m]; the field stands in ``state.voltage``."""
    p = plant.drive_parameters
    return -p[HOLDING] * math.sin(p[POLES] * (theta - state.voltage)) - p[DETENT] * math.sin(4.0 * p[POLES] * theta)


class Stepper(Actuator):
    """Stepper motor: command [rad], the angle of the field at the motor shaft."""

    name = "stepper"
    command = ANGLE
    measures_current = False
    holds_position = True
    # zero would be a run to angle zero. No more pulses, then no current: without it nothing drives the rotor, and screw
    # and detent torque hold it as they hold a motor without voltage
    holds_on_fault = True
    estimation = "position"
    laws = ("none", "pid", "pid_feedforward")
    parameters = {
        "full_steps": Spec("1", 4, 4000, "full steps per turn"),
        "microsteps": Spec("1", 1, 4096, "microsteps per full step"),
        "holding_torque": positive("N m", "torque T_H at which the rotor slips"),
        "detent_torque": not_negative("N m", "torque T_D of the magnets without current", default=0.0),
        "rotor_inertia": positive("kg m^2", "all rotating parts, at the motor shaft"),
        "damping": not_negative("N m s/rad", "viscous damping D at the rotor", default=0.0),
        "pulse_rate": positive("Hz", "most microsteps per second; at most one full step per control period",
                               default=2.0e4),
        "noise": not_negative("rad", "standard deviation of the command, held over a period", default=0.0),
    }
    shape = _field
    torque = _torque

    @classmethod
    def command_limit(cls, axis):
        """The angle of the farther end of the travel, and a fifth more [rad]."""
        ends = abs(axis.value("travel.minimum")), abs(axis.value("travel.maximum"))
        return SPARE * max(ends) / lever(axis)[2]

    @classmethod
    def converter(cls, axis):
        """Not quantised: the microsteps do that."""
        return cls.command_limit(axis), 0

    @classmethod
    def command_step(cls, axis):
        """A microstep [rad]."""
        return cls.microstep(axis)

    @classmethod
    def microstep(cls, axis):
        """Angle of one microstep at the shaft [rad]."""
        return 2 * math.pi / (axis.value("drive.full_steps") * axis.value("drive.microsteps"))

    @classmethod
    def check(cls, axis):
        """The field is held over a period, so it may not move on by more than a full step in one.

        Raises InputError: a pulse rate of more than one full step per control period.
        """
        super().check(axis)
        most = axis.value("drive.microsteps") / axis.value("period")
        if axis.value("drive.pulse_rate") > most * (1 + 1e-9):
            raise InputError(f"{axis.place}: drive.pulse_rate", axis.value("drive.pulse_rate"),
                             f"at most {most:g} Hz, one full step per control period")

    @classmethod
    def fill(cls, plant, axis):
        """Rotor, damping, the numbers of `_torque`; chunks short against the rotor's own oscillation."""
        holding, detent, poles = (
            axis.value("drive.holding_torque"),
            axis.value("drive.detent_torque"),
            axis.value("drive.full_steps") / 4,
        )
        plant["inertia"], plant["motor_damping"] = axis.value("drive.rotor_inertia"), axis.value("drive.damping")
        plant["inductance"] = 1.0
        rate = max(round(axis.value("drive.pulse_rate") * float(plant["period"])), 1)
        plant["drive_parameters"][:5] = holding, poles, detent, cls.microstep(axis), rate
        frequency = math.sqrt(poles * (holding + 4.0 * detent) / float(plant["inertia"]))
        plant["base_level"] = min(max(math.ceil(math.log2(frequency * float(plant["period"]) / FINE)), 2), 6)

    @classmethod
    def start(cls, plant, state):
        """The field at the microstep nearest to the rotor [rad]."""
        p = plant["drive_parameters"]
        state["drive"][0] = round(float(state["theta"] / p[MICROSTEP]))
        state["voltage"] = state["drive"][0] * p[MICROSTEP]

    @classmethod
    def linearised(cls, plant):
        """Gain p T_H of the field, stiffness p (T_H + 4 T_D) against the angle, both [N m/rad]."""
        holding, poles, detent = (float(plant["drive_parameters"][k]) for k in (HOLDING, POLES, DETENT))
        return poles * holding, poles * (holding + 4.0 * detent), 0.0

    @classmethod
    def feed_forward(cls, axis):
        """Radians for a position."""
        _, _, ratio = lever(axis)
        inertia = axis.value("drive.rotor_inertia")
        return {
            "volts_per_position": 1.0 / ratio, "force_per_torque": 1.0 / ratio,
            "integral_rate": SHARE * axis.value("drive.damping") / inertia,
            "moving_mass": axis.value("stage.mass") + inertia / ratio**2,
            "top_speed": axis.value("drive.pulse_rate") * cls.microstep(axis) * ratio,
        }
