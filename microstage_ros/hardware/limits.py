"""Limits that the driver holds the machine to, one look per control period at constant cost, and what a breach is
called.

| fault                   | when |
|-------------------------|------|
| ``encoder_absent``      | the reading is no number |
| ``travel``              | the encoder is beyond the travel and its margin |
| ``encoder_jump``        | it moves further in one period than three times the highest speed allows |
| ``velocity``            | its speed, smoothed over `SMOOTHING_S`, is above the limit |
| ``current``             | the current is above the limit, smoothed likewise |
| ``following_error``     | the controller's reference and the encoder are too far apart |
| ``encoder_frozen``      | the encoder does not change by a single count although the voltage should turn the motor |
| ``encoder_motor``       | encoder and motor angle have moved apart since activation |
| ``voltage_rate``        | the voltage changes by more in one period than the limit |

A limit of infinity is none.
"""

import math

import numpy as np

from microstage_ros.hardware.command_gate import FAULTS
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.top_speed import top_speed
from microstage_ros.numerics.compiled import in_place

SMOOTHING_S = 5e-3
JUMP = 3.0
"""Times the velocity limit."""

CURRENT_MARGIN = 1.3
"""Above what the voltage limit can bring about, where no limit is given."""

FROZEN_SHARE, FROZEN_S = 0.25, 0.1
"""Of the voltage limit; with that much voltage for so long [s] the encoder has to move."""

LIMITS = np.dtype([(name, "f8") for name in (
    "low", "high", "jump", "velocity", "current", "following", "frozen_voltage", "frozen_periods", "motor_travel",
    "motor_gap", "voltage_step", "period", "blend")])
MEMORY = np.dtype([(name, "f8") for name in (
    "begun", "position", "velocity", "current", "still", "offset", "voltage", "reference")])

_ABSENT, _TRAVEL, _JUMP, _VELOCITY, _CURRENT, _FOLLOWING, _FROZEN, _MOTOR, _RATE = (
    FAULTS.index(name)
    for name in (
        "encoder_absent",
        "travel",
        "encoder_jump",
        "velocity",
        "current",
        "following_error",
        "encoder_frozen",
        "encoder_motor",
        "voltage_rate",
    )
)
BOUNDS = {"travel": ("", "m"), "encoder_jump": ("jump", "m in one period"), "velocity": ("velocity", "m/s"),
          "current": ("current", "A"), "following_error": ("following", "m"), "encoder_motor": ("motor_gap", "m"),
          "voltage_rate": ("voltage_step", "{} in one period")}
"""Fault to the limit that was breached, and its unit; ``{}``: that of the command."""


@in_place
def breach(limits, memory, encoder, current, motor_angle, voltage):
    """Look at one period; the code of the fault, 0 for none.

    Parameters
    ----------
    limits, memory : records `LIMITS` and `MEMORY`. encoder [m], current [A], motor_angle [rad] : as read; NaN for no
        sensor, apart from the encoder. voltage : that was held during the period before [V].
    """
    if not math.isfinite(encoder):
        return _ABSENT
    if not limits.low <= encoder <= limits.high:
        memory.position = encoder
        return _TRAVEL
    if memory.begun == 0.0:
        memory.begun, memory.position, memory.velocity, memory.current, memory.still = 1.0, encoder, 0.0, 0.0, 0.0
        memory.offset = encoder - limits.motor_travel * motor_angle
        memory.voltage = voltage
        return 0
    step = encoder - memory.position
    turned = voltage - memory.voltage
    memory.position, memory.voltage = encoder, voltage
    if abs(step) > limits.jump:
        memory.velocity = step
        return _JUMP
    memory.velocity += (step / limits.period - memory.velocity) * limits.blend
    if abs(memory.velocity) > limits.velocity:
        return _VELOCITY
    if current == current:
        memory.current += (current - memory.current) * limits.blend
        if abs(memory.current) > limits.current:
            return _CURRENT
    if abs(memory.reference - encoder) > limits.following:  # false without a reference
        return _FOLLOWING
    memory.still = memory.still + 1.0 if step == 0.0 and abs(voltage) > limits.frozen_voltage else 0.0
    if memory.still > limits.frozen_periods:
        return _FROZEN
    if abs(encoder - limits.motor_travel * motor_angle - memory.offset) > limits.motor_gap:  # false without motor angle
        return _MOTOR
    return _RATE if abs(turned) > limits.voltage_step else 0


@in_place
def look(limits, memory, encoder, current, motor_angle, voltage):
    """`breach` for arrays of one."""
    return breach(limits[0], memory[0], encoder, current, motor_angle, voltage)


def new_limits(axis, travel, given):
    """Records `LIMITS` of one axis, and an empty `MEMORY`.

    Parameters
    ----------
    axis : `model.axis_file.Axis`. travel : lowest and highest encoder reading [m].
    given : ``velocity`` [m/s], ``current`` [A], ``following_error`` [m], ``encoder_motor`` [m], ``voltage_rate`` [V/s,
        or the command's unit]; 0 or left out: derived from the voltage limit for the first two, none for the last.

    Returns
    -------
    limits, memory : arrays of one.
    """
    period, limits, memory = axis.value("period"), np.zeros(1, LIMITS), np.zeros(1, MEMORY)
    limits.view("f8")[:] = math.inf
    actuator = actuator_of(axis)
    turning = (
        math.nan if actuator.holds_position else actuator.command_limit(axis)
    )  # what holds a position may stand still under command
    gear, pitch = _known(axis, "transmission.gear_ratio"), _known(axis, "transmission.pitch")
    travel_per_radian = pitch / (2.0 * math.pi * gear)
    highest = _known(
        axis, "drive.current_limit", _known(axis, "drive.voltage_limit") / _known(axis, "drive.resistance")
    )
    values = {
        "low": travel[0], "high": travel[1], "velocity": given.get("velocity") or top_speed(axis),
        "current": given.get("current") or _or_none(CURRENT_MARGIN * highest),
        "following": given.get("following_error") or math.inf,
        "frozen_voltage": _or_none(FROZEN_SHARE * turning), "frozen_periods": max(FROZEN_S / period, 10.0),
        "motor_travel": travel_per_radian, "motor_gap": given.get("encoder_motor") or math.inf,
        "voltage_step": (given.get("voltage_rate") or math.inf) * period, "period": period,
        "blend": min(period / SMOOTHING_S, 1.0)}
    values["jump"] = JUMP * values["velocity"] * period + 100.0 * _known(axis, "sensors.encoder.resolution", 0.0)
    for name, value in values.items():
        limits[name] = value
    memory["reference"] = math.nan
    return limits, memory


def begin_anew(memory):
    """Before the first period after an activation or a reset; ``memory``: the record of the check."""
    memory["begun"], memory["reference"] = 0.0, math.nan


def in_words(code, limits, memory, command_unit="V"):
    """The fault's name, and what was read against which bound.

    ``code``: its place in `FAULTS` [1]; ``limits``, ``memory``: the records of the check, shape (1,), SI.
    """
    name, found, limit = FAULTS[code], memory[0], limits[0]
    if name == "travel":
        return (
            name,
            f"the encoder reads {found['position']!r} m, the travel is {float(limit['low'])!r} to "
            f"{float(limit['high'])!r} m",
        )
    if name == "encoder_absent":
        return name, "the encoder gives no number"
    if name == "encoder_frozen":
        return name, (
            f"the encoder has not changed by one count for {found['still'] * limit['period']:.3g} s at "
            f"{found['voltage']:.3g} {command_unit} "
            f"(bound: {limit['frozen_periods'] * limit['period']:.3g} s above {limit['frozen_voltage']:.3g} "
            f"{command_unit})"
        )
    field, unit = BOUNDS[name]
    unit = unit.format(command_unit)
    value = {"encoder_jump": found["velocity"], "velocity": found["velocity"], "current": found["current"],
             "following_error": found["reference"] - found["position"]}.get(name)
    says = "" if value is None else f"{value:.6g} {unit}, "
    return name, f"{says}the bound is {limit[field]:.6g} {unit}"


def _known(axis, path, otherwise=math.nan):
    """A number of the axis file, ``otherwise`` where this kind of axis has none."""
    return float(axis.value(path)) if axis.has(path) else otherwise


def _or_none(value):
    """A derived limit; infinity where what it derives from is not known."""
    return value if math.isfinite(value) else math.inf
