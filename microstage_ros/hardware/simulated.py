"""The simulated axis: the compiled step of `solver.step` behind the calls of a real one."""

import re
from dataclasses import fields

from microstage_ros.hardware.protocol import Reading, Truth
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.axis_file import load_axis
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec
from microstage_ros.solver.period import advance_and_read, as_array, read
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work, usual_start

OPTIONS = ("position", "noise", "friction", "machine", "effects")
STARTS = ("random", "relaxed", "virgin")


def made_plant(machine, noise=None, effects=None, place="effects of the run"):
    """`make_plant` of the machine, which names the file of an effect that it cannot have.

    Parameters
    ----------
    machine : `Axis`. noise : `NoiseSpec`; None: the machine's own figures.
    effects : {id: parameters} beside those of its file. place : what gives those: a file, an option.

    Returns
    -------
    The plant record. Raises InputError: the file, the effect and what the machine lacks.
    """
    try:
        return make_plant(machine, noise, effects)
    except InputError as error:
        named = re.match(r"effects(?:: (\w+))?", error.place)
        if not named:
            raise
        file = place if named[1] is None or named[1] in (effects or {}) else machine.place
        raise InputError(f"{file}: {error.place}", error.value, error.expected) from None
    except (TypeError, ValueError):
        for file, given in ((place, effects or {}), (machine.place, machine.effects)):
            _refuse_lists(machine.with_effects({}), file, given)
        raise


def _refuse_lists(machine, file, effects):
    """InputError for the first of ``effects`` {id: parameters}, which come from ``file``, that has lists of numbers
    where the `Axis` ``machine`` can take one number only."""
    for effect, parameters in effects.items():
        lists = {name: value for name, value in parameters.items() if isinstance(value, list)}
        try:
            make_plant(machine, None, {effect: parameters})
        except (TypeError, ValueError):
            if lists:
                raise InputError(f"{file}: effects: {effect}", lists, "a single number for each of these") from None


def machine_for(axis, path):
    """`Axis` of the machine to simulate: that of the axis file ``path``, or ``axis`` itself without one.

    Raises `InputError` for a file that cannot be read, or whose control period is another one.
    """
    if not path:
        return axis
    machine = load_axis(path)
    if abs(machine.value("period") / axis.value("period") - 1.0) > 1e-9:
        raise InputError(f"{path}: period", machine.value("period"), f"{axis.value('period'):g} s, as in {axis.place}")
    if machine.choices["drive.type"] != axis.choices["drive.type"]:
        raise InputError(
            f"{path}: drive.type", machine.choices["drive.type"], f"{axis.choices['drive.type']}, as in {axis.place}"
        )
    return machine


def _checked(given):
    """Options of the simulated axis, checked. Raises `InputError`."""
    place = "simulated axis: option"
    for name in given:
        if name not in OPTIONS:
            raise InputError(f"{place} {name}", given[name], "one of " + ", ".join(OPTIONS))
    options = {name: value for name, value in given.items() if value is not None}
    if not isinstance(options.get("noise", {}), dict):
        raise InputError(f"{place} noise", options["noise"], "a mapping, as in run files")
    noises = [field.name for field in fields(NoiseSpec)]
    for name, value in options.get("noise", {}).items():
        if name not in noises:
            raise InputError(f"{place} noise: {name}", value, "one of " + ", ".join(noises))
        if value is not None:
            Spec(name.rpartition("_")[2], 0.0, 1e3, "standard deviation").check(value, f"{place} noise: {name}")
    if "position" in options:
        options["position"] = Spec("m", -1e3, 1e3, "of the stage at the start").check(options["position"],
                                                                                     f"{place} position")
    if options.get("friction", STARTS[0]) not in STARTS:
        raise InputError(f"{place} friction", options["friction"], "one of " + ", ".join(STARTS))
    if not isinstance(options.get("machine", ""), str):
        raise InputError(f"{place} machine", options["machine"], "the name of an axis file")
    return options


class SimulatedAxis:
    """One axis of MODEL equations; `read` moves it by one control period.

    Parameters
    ----------
    setup : `protocol.Setup`; options: ``position`` [m] at the start, ``noise`` ({name: standard deviation},
        names as in run files), ``friction`` (``relaxed`` or ``random``, the load of the contacts at the start; default
        random where the friction is), ``machine`` (axis file of the machine that is simulated, where it is not the one
        that the controller is given), ``effects`` ({id: parameters} beside those of its file, as in run files).

    Attributes
    ----------
    standing : command under which it stands where it is at the start [unit of the command]; 0 where that is a force.

    Example
    -------
    >>> axis = SimulatedAxis(Setup(load_axis("config/axis.yaml"), seed=1))
    >>> axis.open(); axis.read(); axis.write(0.5)
    """

    simulated = True

    def __init__(self, setup):
        options = _checked(setup.options or {})
        machine = machine_for(setup.axis, options.get("machine"))
        self._plant = made_plant(machine, NoiseSpec(**options.get("noise", {})), options.get("effects"),
                                 "simulated axis: option effects")
        self._state = new_state(self._plant, seed=setup.seed, position=options.get("position", 0.0),
                                friction=options.get("friction", usual_start(self._plant)))
        self._readings = new_readings()
        self._arrays = [
            as_array(record) for record in (self._plant, self._state, new_work(self._plant), self._readings)
        ]
        self.own_arrays = self._arrays
        self._voltage = None
        self._holds = actuator_of(machine).holds_on_fault
        self.standing = float(self._state["voltage"]) if self._holds else 0.0
        self._compile()

    def _compile(self):
        """Load or make the compiled step now, on a copy, and not in the first control period."""
        plant, state, work, readings = self._arrays
        read(plant, state.copy(), readings)
        advance_and_read(plant, state.copy(), work.copy(), readings, 0.0)

    def open(self):
        """At rest with no voltage; the first `read` does not move it."""
        self._voltage = None

    def read(self):
        """Move by one control period under the voltage written, then read the sensors."""
        if self._voltage is None:
            plant, state, _, readings = self._arrays
            read(plant, state, readings)
            self._voltage = self.standing
        else:
            advance_and_read(*self._arrays, self._voltage)
        return self.last_reading

    @property
    def last_reading(self):
        """`Reading` of the present period."""
        return Reading(*self._readings.item()[:3])  # the first three fields of `records.READINGS`

    @property
    def arrays(self):
        """Plant, state, work space and readings for a loop in compiled code that takes over from `read` and hands
        back with `write`; None before the first reading.
        """
        return None if self._voltage is None else self.own_arrays

    @property
    def held(self):
        """Command that moves it when it is read next [its unit]; None before the first reading."""
        return self._voltage

    def write(self, voltage):
        """Hold ``voltage`` [V] during the period that the last `read` began."""
        self._voltage = float(voltage)

    def close(self):
        """No voltage; a drive that holds a position stands."""
        if not self._holds:
            self._voltage = 0.0

    @property
    def truth(self):
        """`Truth` at the last reading."""
        s, r = self._state, self._readings
        return Truth(float(s["x"]), float(s["v"]), float(s["torque_friction"]), float(s["guide_friction"]),
                     float(r["interferometer"]), float(r["air_temperature"]), float(r["air_pressure"]),
                     float(r["air_humidity"]), float(r["stage_temperature"]))
