"""What someone who extends the project writes: for each kind of part one new file, and the edits of ours that it needs.

``new``: {path: text}. ``edits``: {path: [(old, new), ...]}; the paths of both are below the package.
"""

LAW = {
    "new": {"model/friction/exponential.py": '''
"""Exponential approach: friction nears the limit by the same share over every stretch of the way.

    dF/dx = k (1 − sgn(w) F / F_s),     F(x) = F_s (1 − exp(−k x / F_s)) from rest
"""

import math

from microstage_ros.model.friction.curve import COULOMB, DIRECTION_WIDTH, LIMIT, OWN
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.spec import positive

TITLE = "exponential"
PARAMETERS = {"stiffness": positive("N m/rad", "k, slope dF/dx at F = 0")}
CURVE = LIMIT
FAMILY = "own"
SAYS = {"pre-sliding hysteresis": True}


def pack(values):
    """Own entries of the packed law, from a mapping of `PARAMETERS`."""
    return [values["stiffness"]]


def state_size(packed):
    """Entries of the state: the force F."""
    return 1


@compiled
def stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor):
    """Force without its viscous part at the end of a stretch of motion in one direction."""
    limit = direction * limit_factor * parameters[COULOMB if direction > 0.0 else DIRECTION_WIDTH + COULOMB]
    if direction != 0.0:
        way = 0.5 * (speed_start + speed_end) * duration
        state[0] = limit + (state[0] - limit) * math.exp(-parameters[OWN] * way / abs(limit))
    return state[0]


def stored_energy(parameters, state):
    """Elastic energy F² / 2k [F q]."""
    return float(state[0] ** 2 / (2.0 * parameters[OWN]))
'''},
    "edits": {"model/friction/registry.py": [
        ("    elasto_plastic,\n    generalised", "    elasto_plastic,\n    exponential,\n    generalised"),
        ("maxwell_slip,\n         generalised_maxwell_slip)", "maxwell_slip,\n         generalised_maxwell_slip, exponential)"),
    ]},
}

EFFECT = {
    "new": {"model/effects/magnet.py": '''
"""A magnet beside the axis."""

import math

import numpy as np

from microstage_ros.model.effects.drawing import either_sign
from microstage_ros.model.effects.effect import Effect, Parameter
from microstage_ros.model.effects.signature import Form, one
from microstage_ros.numerics.compiled import internal

WIDTH = 4.0e-4
PLACES = (0.0, 1.0e-3, 2.0e-3)


@internal
def pull(parameters, x, v, t):
    """−size u exp(½ − u²/2), u = (x − place) / width: towards the magnet, largest (± size) one width beside it."""
    u = (x - parameters[1]) / parameters[2]
    return -parameters[0] * u * math.exp(0.5 - 0.5 * u * u)


def shape(channel, place):
    """Force of a magnet of 1 N, turned round."""
    u = (channel.position - place) / WIDTH
    return (u * np.exp(0.5 - 0.5 * u * u))[:, None]


def forms(place):
    """Torque that the pull asks of the motor, and the way by which it makes the stage hang back."""
    sizes = one("size_N", "N", extra={"place_m": place, "width_m": WIDTH})
    return (Form("magnet_pull", "torque", f"{place:g}", lambda channel, frame: frame.drive.lever * shape(channel, place), sizes),
            Form("magnet_pull", "windup", f"{place:g}", lambda channel, frame: -shape(channel, place) / frame.drive.stiffness, sizes))


class MagnetPull(Effect):
    """A magnet pulls the stage towards one place: −size_N u exp(½ − u²/2), u = (x − place_m) / width_m."""

    id = "magnet_pull"
    label = "A magnet pulls at the stage"
    remedy = "Take the magnet away, or shield it."
    separated_by = "stroke"
    shows_against = "position"
    within = ("generic:position",)
    parameters = {
        "size_N": Parameter("N", "largest pull", None, -100.0, 100.0),
        "place_m": Parameter("m", "where it pulls to", 0.0, -1.0, 1.0),
        "width_m": Parameter("m", "distance of the largest pull", WIDTH, 1e-6, 1.0),
    }
    force = pull
    forms = tuple(form for place in PLACES for form in forms(place))

    @classmethod
    def draw(cls, generator, strength):
        return {"size_N": either_sign(generator, 1.0 * strength, 2.0 * strength), "place_m": 1.0e-3}


EFFECTS = (MagnetPull,)
'''},
    "edits": {"model/effects/__init__.py": [
        ("    friction,\n    piezo,", "    friction,\n    magnet,\n    piezo,"),
        ("piezo, position_sensors)\n", "piezo, position_sensors, magnet)\n"),
    ]},
}

ACTUATOR = {
    "new": {"model/actuators/cylinder.py": '''
"""A pneumatic cylinder behind a force loop.

    time · df/dt = f_c − f,     |f_c| ≤ force_limit
"""

from microstage_ros.model.actuators.actuator import Actuator, lever
from microstage_ros.quantities.command import FORCE
from microstage_ros.quantities.spec import not_negative, positive


class Cylinder(Actuator):
    """Pneumatic cylinder: command [N]."""

    name = "cylinder"
    command = FORCE
    measures_current = False
    estimation = "force"
    transmissions = ("rigid",)
    parameters = {
        "force_limit": positive("N", "largest force"),
        "time": positive("s", "time constant of the force loop"),
        "noise": not_negative("N", "standard deviation of the force, held over a period", default=0.0),
    }

    @classmethod
    def command_limit(cls, axis):
        """The largest force [N]."""
        return axis.value("drive.force_limit")

    @classmethod
    def converter(cls, axis):
        """The limit as range, not quantised."""
        return cls.command_limit(axis), 0

    @classmethod
    def fill(cls, plant, axis):
        """L = time, R = b = 1, k_M = r/N: the first-order state is the force."""
        plant["inductance"], plant["resistance"], plant["electrical_input"] = axis.value("drive.time"), 1.0, 1.0
        plant["torque_constant"] = plant["ratio"]

    @classmethod
    def feed_forward(cls, axis):
        """Newtons for a force."""
        ratio, gear, _ = lever(axis)
        return {"force_per_torque": gear / ratio, "moving_mass": axis.value("stage.mass"), "volts_per_force": 1.0,
                "volts_per_torque": gear / ratio, "top_speed": 10.0}

    @classmethod
    def force_per_command(cls, axis):
        """One newton per newton."""
        return 1.0
'''},
    "edits": {"model/actuators/__init__.py": [
        ("from microstage_ros.model.actuators.force import Force\n",
         "from microstage_ros.model.actuators.cylinder import Cylinder\nfrom microstage_ros.model.actuators.force import Force\n"),
        ("    VoltageMotor,\n    Force,\n", "    VoltageMotor,\n    Cylinder,\n    Force,\n"),
    ]},
}

SENSOR = {
    "new": {"model/sensors/potentiometer.py": '''
"""A wire-wound potentiometer: the slider jumps from turn to turn, reading = turn · round(x / turn)."""

import numpy as np

from microstage_ros.model.sensors.position import PositionSensor
from microstage_ros.numerics.compiled import internal
from microstage_ros.quantities.spec import positive


@internal
def _read(plant, state, y):
    """Reading [m] at position ``y`` [m]."""
    return plant.sensor_parameters[0] * np.rint(y / plant.sensor_parameters[0])


class Potentiometer(PositionSensor):
    """Potentiometer: width of a turn."""

    name = "potentiometer"
    parameters = {"turn": positive("m", "travel from one turn of the wire to the next")}
    read = _read

    @classmethod
    def fill(cls, plant, axis):
        """The turn."""
        plant["sensor_parameters"][0] = axis.value("sensors.encoder.turn")
'''},
    "edits": {"model/sensors/__init__.py": [
        ("from microstage_ros.model.sensors.position import PositionSensor\n",
         "from microstage_ros.model.sensors.position import PositionSensor\nfrom microstage_ros.model.sensors.potentiometer import Potentiometer\n"),
        ("    Lvdt,\n    Capacitive,\n", "    Lvdt,\n    Capacitive,\n    Potentiometer,\n"),
    ]},
}

CONTROLLER = {
    "new": {"control/laws/pd.py": '''
"""Proportional-derivative law: U = K_P (reference − x) − K_D v, v a backward difference."""

from microstage_ros.control.gains import Gain, record_type
from microstage_ros.control.laws.law import ControlLaw, Part
from microstage_ros.numerics.compiled import compiled

GAINS = (
    Gain("proportional", "V/m", 0.0, 1e9, 1.0e5, "K_P"),
    Gain("derivative", "V s/m", 0.0, 1e7, 30.0, "K_D"),
)


@compiled
def pd_step(parameters, state, reference, encoder, current):
    """Output [V] within the limit; ``state.pid`` keeps the terms for those who publish them."""
    p, base, limit = parameters.pd, state.pid, parameters.voltage_limit
    base.error = reference - encoder
    base.velocity = (encoder - base.previous_encoder) / parameters.period
    base.previous_encoder = encoder
    base.proportional_term = p.proportional * base.error
    base.derivative_term = -p.derivative * base.velocity
    return min(max(base.proportional_term + base.derivative_term, -limit), limit)


LAWS = (ControlLaw("pd", {"pd": Part(GAINS, record_type(GAINS))}, pd_step),)
'''},
    "edits": {"control/laws/registry.py": [
        ("import cascade, nctf, none, pid,", "import cascade, nctf, none, pd, pid,"),
        ("nctf, cascade)\n", "nctf, cascade, pd)\n"),
    ]},
}

BACKEND = {
    "new": {"../laboratory/card.py": '''
"""A card of a laboratory: a mass of 2 kg on a spring, 5 N per volt."""


class Card:
    """See `microstage_ros.hardware.protocol.Hardware`."""

    simulated = True

    def __init__(self, setup):
        self.period, self.voltage, self.x, self.v = setup.axis.value("period"), 0.0, 0.0, 0.0

    def open(self):
        """Nothing to open."""

    def read(self):
        """Position [m], one period later."""
        self.v += self.period * (5.0 * self.voltage - 1.0e4 * self.x - 100.0 * self.v) / 2.0
        self.x += self.period * self.v
        return self.x

    def write(self, voltage):
        """Hold the voltage [V]."""
        self.voltage = voltage

    def close(self):
        """Nothing to close."""
'''},
    "edits": {},
}

TASKS = {
    "friction law": LAW, "effect": EFFECT, "actuator": ACTUATOR, "sensor": SENSOR, "controller": CONTROLLER,
    "hardware backend": BACKEND,
}
