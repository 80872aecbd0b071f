"""The registry of control laws and the one compiled dispatch that node and simulator share.

A law is added by writing one file with its gains, its state fields and its compiled step (see `law.ControlLaw`), and
by naming that file in `FILES`: parameter record, memory and dispatch are made from what the files say.
"""

import math

import numpy as np

from microstage_ros.control.laws import cascade, nctf, none, pid, pid_feedforward, self_tuning, self_tuning_observer
from microstage_ros.control.laws.law import ControlLaw
from microstage_ros.control.laws.published import (
    disturbance_observer,
    disturbance_rejection,
    linear_quadratic,
    sliding_mode,
)
from microstage_ros.numerics.compiled import always_inlined, compiled, dispatch, not_inlined
from microstage_ros.quantities.errors import InputError

FILES = (none, pid_feedforward, self_tuning, self_tuning_observer, disturbance_observer, disturbance_rejection,
         sliding_mode, linear_quadratic, nctf, cascade)

LAWS = {law.name: law for file in FILES for law in file.LAWS}
KINDS = {name: kind for kind, name in enumerate(LAWS)}
"""Name of a law to its number in the dispatch."""
NAMES = tuple(LAWS)
PARTS = {name: part for law in LAWS.values() for name, part in law.parts.items()}
PID = KINDS["pid"]

#: What a law is given: numbers that do not change while it runs. Every law finds the feed-forward model of its axis
#: there.
PARAMETERS = np.dtype([
    ("kind", "i8"),
    ("period", "f8"),  # s
    ("voltage_limit", "f8"),  # V
    *((name, part.parameters) for name, part in PARTS.items() if part.parameters is not None),
])

#: What a law remembers from one period to the next. `pid` holds error, terms and gains for every law.
STATE = np.dtype([
    ("voltage", "f8"),  # V, the last output
    ("reference", "f8"),  # m
    ("feed_forward", "f8"),  # V
    ("started", "i8"),
    *((name, part.state) for name, part in PARTS.items() if part.state is not None),
])

law_reset = dispatch("law_reset", [law.reset for law in LAWS.values()], "parameters, state, voltage", "None")
law_start = dispatch("law_start", [law.start for law in LAWS.values()], "parameters, state, reference, encoder", "None")
law_step = dispatch(
    "law_step", [law.step for law in LAWS.values()], "parameters, state, reference, encoder, current", "0.0"
)


def law(type_name: str, place: str = "controller.type") -> ControlLaw:
    """The `ControlLaw` of that name; `InputError` with the known names otherwise."""
    if not isinstance(type_name, str) or type_name not in LAWS:
        raise InputError(place, type_name, "one of " + ", ".join(LAWS))
    return LAWS[type_name]


@compiled
def controller_reset(parameters, state, voltage):
    """Forget everything; the first output continues from ``voltage`` [V]."""
    state.voltage = voltage
    state.feed_forward = 0.0
    state.started = 0
    pid.pid_reset(parameters.pid, state.pid, voltage)
    law_reset(parameters.kind, parameters, state, voltage)


@compiled
def controller_start(parameters, state, reference, encoder):
    """First period after a reset: the axis is taken to rest where the encoder [m] says."""
    not_inlined()
    state.started = 1
    state.pid.previous_encoder = encoder
    state.pid.previous_reference = reference
    law_start(parameters.kind, parameters, state, reference, encoder)


@always_inlined
def controller_step(parameters, state, reference, encoder, current):
    """One control period of the law ``parameters.kind``.

    ``reference``, ``encoder`` [m] and ``current`` [A] are those of the start of the period; returns the
    voltage [V] to hold during it, within the voltage limit. An encoder value that is not a number (a
    lost sample) repeats the voltage before.
    """
    if not (math.isfinite(encoder) and math.isfinite(reference)):
        return state.voltage
    if state.started == 0:
        controller_start(parameters, state, reference, encoder)
    state.reference = reference
    if parameters.kind == PID:         # beside the others, so that it is written into a loop that calls it
        pid.pid_motion(parameters.pid, state.pid, parameters.period, reference, encoder)
        state.voltage = pid.pid_output(parameters.pid, state.pid, parameters.period, parameters.voltage_limit, 0.0)
    else:
        state.voltage = law_step(parameters.kind, parameters, state, reference, encoder, current)
    return state.voltage
