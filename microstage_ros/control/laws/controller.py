"""The Python face of the control laws: build one by name, step it, look into it.

Example
-------
>>> from microstage_ros.model.axis_file import load_axis
>>> from microstage_ros.control.laws.controller import make_controller
>>> controller = make_controller("pid", load_axis("config/axis.yaml"), proportional=4e5)
>>> voltage = controller.step(reference=1e-6, encoder=0.0, current=0.0)
"""

from typing import NamedTuple

import numpy as np

from microstage_ros.control.design import rules, start_check
from microstage_ros.control.feedforward import axis as feedforward
from microstage_ros.control.gains import check_gain, fill
from microstage_ros.control.laws import adaptation
from microstage_ros.control.laws import registry as laws
from microstage_ros.control.laws.learned import learned_numbers
from microstage_ros.control.laws.pid import pid_change
from microstage_ros.model.actuators import actuator_of
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec
from microstage_ros.solver.period import as_array


class ControllerState(NamedTuple):
    """What a controller did in its last period (SI: m, V, V/m, V/(m s), V s/m).

    The observer law's terms are those of the nominal drive; its voltage is what the learned one needs for their sum.
    """

    reference: float
    error: float
    voltage: float
    proportional_gain: float
    integral_gain: float
    derivative_gain: float
    proportional_term: float
    integral_term: float
    derivative_term: float
    feed_forward_term: float
    saturated: bool
    mode: str
    law: int = 0  # `supervision.OBSERVER` (the law itself) or `supervision.ENCODER_ONLY`
    law_reason: int = 0  # of the last hand-over, place in `supervision.REASONS`
    handovers: int = 0

TUNED = Spec("s", 1e-6, 1.0, "control period for which the gains were tuned")


def gain_list(type_name):
    """The `Gain` entries (name, unit, range, default, meaning) that a type of controller accepts."""
    return [gain for part in laws.law(type_name).parts.values() for gain in part.gains]


def controller_parameters(type_name, axis, gains, period=None, place="controller"):
    """The parameter record (numpy structured scalar `laws.PARAMETERS`) of one controller.

    ``gains``: {name: number in the unit of its `Gain`}; ``period`` [s], None: the axis's.
    Gains not given come from the axis file's ``controller:`` section where it was tuned for this period,
    else from the rules of `control.design.rules`, else from the law's defaults. Raises `InputError` with name,
    value and range.
    """
    law = laws.law(type_name, f"{place}.type")
    actuator_of(axis).check_law(type_name, f"{place}.type")
    _known_gains(type_name, gains, place)
    period = float(axis.value("period") if period is None else period)
    record = np.zeros(1, laws.PARAMETERS)[0]
    record["kind"] = laws.KINDS[type_name]
    record["period"] = period
    record["voltage_limit"] = actuator_of(axis).command_limit(axis)
    feedforward.fill_model(record["feedforward"], axis)
    values = {
        **designed_gains(type_name, record["feedforward"], period),
        **shipped_gains(type_name, axis, period),
        **gains,
    }
    _fill_parts(record, law, values, place)
    if "supervision" in law.parts:
        own = {
            **designed_gains("self_tuning", record["feedforward"], period),
            **shipped_gains("self_tuning", axis, period),
        }
        for part, entry in laws.LAWS["self_tuning"].parts.items():
            fill(record[f"encoder_{part}"], entry.gains, own, place)
        adaptation.take_logarithms(record["encoder_adaptation"])
        _check_start(axis, record, period, gains)
    return record


def designed_gains(type_name, model, period):
    """Gains by rule for a type of controller at a ``period`` [s]; {} for those that have no rule."""
    law = laws.law(type_name)
    if float(model["volts_per_position"]) > 0.0 and law.parts:
        return rules.position_gains(model, period)
    return law.rules(model, period) if law.rules else {}


def _fill_parts(record, law, values, place):
    for part, entry in law.parts.items():
        if entry.gains:
            fill(record[part], entry.gains, values, place)
    if law.complete:
        law.complete(record)


def _check_start(axis, record, period, gains):
    """Doubts with which the observer law holds its own model; where none does, the encoder-only law starts, from gains
    that hold it."""
    if not record["supervision"]["supervised"] or not float(record["feedforward"]["force_per_ampere"]) > 0.0:
        return
    axis = axis if axis.value("period") == period else axis.with_values({"period": period}, source="derived")
    if {"encoder_doubt", "voltage_doubt"} & set(gains):
        record["unstable"] = int(not start_check.observer_is_stable(axis, record))
    else:
        doubts = start_check.stable_doubts(axis, record)
        record["unstable"] = int(doubts is None)
        record["observer"]["encoder_doubt"], record["observer"]["voltage_doubt"] = doubts or start_check.START_DOUBTS[0]
    record["observer"]["held_doubts"] = start_check.held_doubts(axis, record)
    if record["unstable"]:
        gains = {name: float(record["encoder_pid"][name]) for name in record["encoder_pid"].dtype.names}
        record["encoder_adaptation"]["start"], record["encoder_filter"] = start_check.held_start(axis, gains, period)


def shipped_gains(type_name, axis, period):
    """Gains of this type in the axis file's ``controller:`` section, {} if tuned for another ``period`` [s].

    The section is {type, tuned_period, GAIN: value ..., TYPE: {GAIN: value ...}}: gains beside ``type`` belong to
    that type, gains under a type's name to it.
    """
    place = f"{axis.place}: controller"
    section = dict(axis.controller)
    tuned = TUNED.check(section.pop("tuned_period", axis.value("period")), f"{place}.tuned_period")
    own_type = section.pop("type", None)
    nested = {name: value for name, value in section.items() if isinstance(value, dict)}
    for name in nested:
        laws.law(name, f"{place}.{name}")
    gains = dict(nested.get(type_name, {}))
    if own_type == type_name:
        gains |= {name: value for name, value in section.items() if name not in nested}
    _known_gains(type_name, gains, place)
    return gains if abs(period / tuned - 1) < 0.01 else {}


def _known_gains(type_name, gains, place):
    known = {gain.name for gain in gain_list(type_name)}
    for name in gains:
        if name not in known:
            raise InputError(f"{place}.{name}", gains[name], "one of " + ", ".join(sorted(known)))


@compiled
def _step(parameters, memories, reference, encoder, current):
    """`controller_step` of the only record of each array (see `solver.period`)."""
    return laws.controller_step(parameters[0], memories[0], reference, encoder, current)


class Controller:
    """One control law with its memory.

    Parameters
    ----------
    type_name : name in `laws.LAWS`.
    parameters : record made by `controller_parameters`.

    Notes
    -----
    The fields ``parameters`` and ``memory`` are the records that the compiled loop takes.
    """

    def __init__(self, type_name, parameters):
        self.type = type_name
        self.parameters = parameters
        self.memory = np.zeros(1, laws.STATE)[0]
        self._parameters, self._memory = as_array(parameters), as_array(self.memory)
        self.reset()

    @property
    def arrays(self):
        """Parameters and memory as arrays of one, for a loop in compiled code (`laws.controller_step`)."""
        return self._parameters, self._memory

    @property
    def start_remark(self):
        """What the check before the start found, one sentence; empty if the law starts as asked for."""
        if not self.parameters["unstable"]:
            return ""
        return (f"{self.type} is unstable on the axis file's own model: started with the encoder-only self-tuning law, "
                f"at {float(self.parameters['encoder_adaptation']['start']):.2g} of its gains")

    def reset(self, voltage=0.0):
        """Forget everything; the first output continues from ``voltage`` [V] (a bumpless start)."""
        laws.controller_reset(self.parameters, self.memory, float(voltage))

    def step(self, reference, encoder, current=0.0):
        """Voltage [V] for this period from reference and encoder [m] and current [A] at its start."""
        return _step(self._parameters, self._memory, float(reference), float(encoder), float(current))

    def change(self, **gains):
        """Change gains while it runs, without a jump of the output; `InputError` for a bad one."""
        parts = laws.law(self.type).parts
        known = {gain.name: (part, gain) for part, entry in parts.items() for gain in entry.gains}
        checked = {}
        for name, value in gains.items():
            if name not in known:
                raise InputError(f"controller.{name}", value, "one of " + ", ".join(sorted(known)))
            checked[name] = check_gain("controller", known[name][1], value)
        for name, value in checked.items():
            self.parameters[known[name][0]][name] = value
        if "adaptation" in parts:
            adaptation.take_logarithms(self.parameters["adaptation"])
        tuned = self.parameters["pid"]
        if {"proportional", "integral_time", "derivative_time"} & set(gains):
            kp = float(tuned["proportional"])
            ki, kd = kp / float(tuned["integral_time"]), kp * float(tuned["derivative_time"])
            pid_change(tuned, self.memory["pid"], kp, ki, kd)

    @property
    def state(self):
        """`ControllerState` of the last period."""
        pid = self.memory["pid"]
        return ControllerState(
            float(self.memory["reference"]), float(pid["error"]), float(self.memory["voltage"]),
            float(pid["kp"]), float(pid["ki"]), float(pid["kd"]),
            float(pid["proportional_term"]), float(pid["integral"]), float(pid["derivative_term"]),
            float(self.memory["feed_forward"]), bool(pid["saturated"]), self.type,
            *(int(self.memory["supervision"][name]) for name in ("law", "reason", "handovers")),
        )

    @property
    def learned(self):
        """{name: `learned.Learned`}: what the law has learned of the axis, SI, {} if it learns nothing of it."""
        if "observer" not in laws.law(self.type).parts:
            return {}
        return learned_numbers(self.parameters, self.memory)


def make_controller(type_name, axis, period=None, **gains):
    """Build a `Controller` by name for an axis; ``period`` [s], and what is refused, as for `controller_parameters`."""
    return Controller(type_name, controller_parameters(type_name, axis, gains, period))
