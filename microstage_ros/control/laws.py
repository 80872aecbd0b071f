"""The registry of control laws and the one compiled dispatch that node and simulator share.

A law is added by writing one file with its gains, its state fields and its compiled step, one line in
`LAWS` and one branch in `controller_reset` and `controller_step` (compiled code cannot look up a table).
"""

from typing import NamedTuple

import numpy as np

from microstage_ros.axis.compiled import compiled
from microstage_ros.axis.errors import InputError
from microstage_ros.control import adaptation, cascade, none, pid

NONE, PID, SELF_TUNING, CASCADE = 0, 1, 2, 3


class Law(NamedTuple):
    """Number in the dispatch, and the parts (record name -> gains) that the law is made of."""

    kind: int
    parts: dict


LAWS = {
    "none": Law(NONE, {}),
    "pid": Law(PID, {"pid": pid.GAINS}),
    "self_tuning": Law(SELF_TUNING, {"pid": pid.GAINS, "adaptation": adaptation.GAINS}),
    "cascade": Law(CASCADE, {"cascade": cascade.GAINS}),
}

#: What a law is given: numbers that do not change while it runs.
PARAMETERS = np.dtype([
    ("kind", "i8"),
    ("period", "f8"),  # s
    ("voltage_limit", "f8"),  # V
    ("pid", pid.PARAMETERS),
    ("adaptation", adaptation.PARAMETERS),
    ("cascade", cascade.PARAMETERS),
])

#: What a law remembers from one period to the next. `pid` holds error, terms and gains for every law.
STATE = np.dtype([
    ("voltage", "f8"),  # V, the last output
    ("reference", "f8"),  # m
    ("feed_forward", "f8"),  # V
    ("pid", pid.STATE_FIELDS),
    ("adaptation", adaptation.STATE_FIELDS),
    ("cascade", cascade.STATE_FIELDS),
])


def law(type_name, place="controller.type"):
    """The `Law` of that name; `InputError` with the known names otherwise."""
    if type_name not in LAWS:
        raise InputError(place, type_name, "one of " + ", ".join(LAWS))
    return LAWS[type_name]


@compiled
def controller_reset(parameters, state, encoder, voltage):
    """Start at rest at ``encoder`` [m]; the first output continues from ``voltage`` [V]."""
    state.voltage = voltage
    state.reference = encoder
    state.feed_forward = 0.0
    pid.pid_reset(parameters.pid, state.pid, encoder, voltage)
    if parameters.kind == SELF_TUNING:
        adaptation.adaptation_reset(parameters.adaptation, state.adaptation, parameters.pid, state.pid)
    if parameters.kind == CASCADE:
        cascade.cascade_reset(parameters.cascade, state.cascade, encoder)


@compiled
def controller_step(parameters, state, reference, encoder, current):
    """One control period of the law ``parameters.kind``.

    ``reference``, ``encoder`` [m] and ``current`` [A] are those of the start of the period; returns the
    voltage [V] to hold during it, within the voltage limit.
    """
    kind = parameters.kind
    state.reference = reference
    if kind == NONE:
        state.pid.error = reference - encoder
        state.voltage = 0.0
        return 0.0
    period = parameters.period
    limit = parameters.voltage_limit
    if kind == CASCADE:
        state.voltage = cascade.cascade_step(
            parameters.cascade, state.cascade, state.pid, period, limit, reference, encoder
        )
        return state.voltage
    pid.pid_motion(parameters.pid, state.pid, period, reference, encoder)
    if kind == SELF_TUNING:
        adaptation.adaptation_step(
            parameters.adaptation, state.adaptation, parameters.pid, state.pid, period
        )
    state.voltage = pid.pid_output(parameters.pid, state.pid, period, limit, state.feed_forward)
    return state.voltage
