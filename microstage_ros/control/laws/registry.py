"""The registry of control laws and the one compiled dispatch that node and simulator share.

A law is added by writing one file with its gains, its state fields and its compiled step, one line in
`LAWS` and one branch in `controller_reset` and `controller_step` (compiled code cannot look up a table).
"""

import math
from typing import NamedTuple

import numpy as np

from microstage_ros.control.feedforward import axis as feedforward
from microstage_ros.control.laws import adaptation, cascade, nctf, pid, supervision
from microstage_ros.control.gains import record_type
from microstage_ros.control.observer import flexible_mode as swing
from microstage_ros.control.observer import gap_crossing
from microstage_ros.control.observer import law as observer_law
from microstage_ros.control.observer.drive_learning import drive_voltage
from microstage_ros.control.observer.lost_motion import TOUCHING
from microstage_ros.numerics.compiled import compiled, not_inlined, always_inlined
from microstage_ros.quantities.errors import InputError

NONE, PID, SELF_TUNING, CASCADE, PID_FEEDFORWARD, SELF_TUNING_FEEDFORWARD, NCTF, SELF_TUNING_OBSERVER = range(8)


class Law(NamedTuple):
    """Number in the dispatch, and the parts (record name -> gains) that the law is made of."""

    kind: int
    parts: dict


LAWS = {
    "none": Law(NONE, {}),
    "pid": Law(PID, {"pid": pid.GAINS}),
    "self_tuning": Law(SELF_TUNING, {"pid": pid.GAINS, "adaptation": adaptation.GAINS}),
    "pid_feedforward": Law(PID_FEEDFORWARD, {"pid": pid.GAINS, "feedforward": feedforward.GAINS}),
    "self_tuning_feedforward": Law(
        SELF_TUNING_FEEDFORWARD,
        {"pid": pid.GAINS, "adaptation": adaptation.GAINS, "feedforward": feedforward.GAINS},
    ),
    "self_tuning_observer": Law(
        SELF_TUNING_OBSERVER,
        {
            "pid": pid.GAINS, "adaptation": adaptation.GAINS, "feedforward": feedforward.GAINS,
            "observer": observer_law.GAINS, "supervision": supervision.GAINS,
        },
    ),
    "nctf": Law(NCTF, {"nctf": nctf.GAINS}),
    "cascade": Law(CASCADE, {"cascade": cascade.GAINS}),
}

#: What a law is given: numbers that do not change while it runs.
PARAMETERS = np.dtype([
    ("kind", "i8"),
    ("period", "f8"),  # s
    ("voltage_limit", "f8"),  # V
    ("pid", pid.PARAMETERS),
    ("adaptation", adaptation.PARAMETERS),
    ("feedforward", feedforward.PARAMETERS),
    ("observer", observer_law.PARAMETERS),
    ("nctf", nctf.PARAMETERS),
    ("cascade", cascade.PARAMETERS),
    ("supervision", record_type(supervision.GAINS)),
    ("encoder_pid", pid.PARAMETERS),  # of the encoder-only law that the observer law hands over to
    ("encoder_adaptation", adaptation.PARAMETERS),
    ("encoder_filter", "f8"),  # factor on its filter time at the start, where the observer law is unstable
    ("unstable", "i8"),  # 1: the observer law is unstable on the axis file's own model
])

#: What a law remembers from one period to the next. `pid` holds error, terms and gains for every law.
STATE = np.dtype([
    ("voltage", "f8"),  # V, the last output
    ("reference", "f8"),  # m
    ("feed_forward", "f8"),  # V
    ("started", "i8"),
    ("pid", pid.STATE_FIELDS),
    ("adaptation", adaptation.STATE_FIELDS),
    ("feedforward", feedforward.STATE_FIELDS),
    ("observer", observer_law.STATE_FIELDS),
    ("cascade", cascade.STATE_FIELDS),
    ("crossing", gap_crossing.FIELDS),
    ("supervision", supervision.FIELDS),
    ("encoder_pid", pid.STATE_FIELDS),
    ("encoder_adaptation", adaptation.STATE_FIELDS),
])


def law(type_name, place="controller.type"):
    """The `Law` of that name; `InputError` with the known names otherwise."""
    if type_name not in LAWS:
        raise InputError(place, type_name, "one of " + ", ".join(LAWS))
    return LAWS[type_name]


@compiled
def controller_reset(parameters, state, voltage):
    """Forget everything; the first output continues from ``voltage`` [V]."""
    state.voltage = voltage
    state.feed_forward = 0.0
    state.started = 0
    pid.pid_reset(parameters.pid, state.pid, voltage)
    if parameters.kind in (SELF_TUNING, SELF_TUNING_FEEDFORWARD, SELF_TUNING_OBSERVER):
        adaptation.adaptation_reset(parameters.adaptation, state.adaptation, state.pid)
    if parameters.kind == SELF_TUNING_OBSERVER:
        pid.pid_reset(parameters.encoder_pid, state.encoder_pid, voltage)
        adaptation.adaptation_reset(parameters.encoder_adaptation, state.encoder_adaptation, state.encoder_pid)
        if parameters.unstable != 0:
            own = state.encoder_adaptation
            own.log_filter = math.log(parameters.encoder_filter)
            own.ceiling = own.damping_ceiling = math.log(parameters.encoder_adaptation.start) + 0.1
            state.encoder_pid.filter_time *= parameters.encoder_filter
        supervision.supervision_reset(parameters.supervision, state.supervision, parameters.unstable)
    observer_law.observer_reset(parameters.observer, state.observer)
    gap_crossing.crossing_reset(state.crossing)


@compiled
def controller_start(state, reference, encoder):
    """First period after a reset: the axis is taken to rest where the encoder [m] says."""
    not_inlined()
    state.started = 1
    state.pid.previous_encoder = encoder
    state.pid.previous_reference = reference
    cascade.cascade_reset(state.cascade, encoder)
    state.encoder_pid.previous_encoder = encoder
    state.encoder_pid.previous_reference = reference
    feedforward.feedforward_reset(state.feedforward, reference)
    observer_law.observer_start(state.observer, encoder)


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
        controller_start(state, reference, encoder)
    state.reference = reference
    if parameters.kind == PID:         # beside the others, so that it is written into a loop that calls it
        pid.pid_motion(parameters.pid, state.pid, parameters.period, reference, encoder)
        state.voltage = pid.pid_output(parameters.pid, state.pid, parameters.period, parameters.voltage_limit, 0.0)
    else:
        state.voltage = dispatch(parameters, state, reference, encoder, current)
    return state.voltage


@compiled
def dispatch(parameters, state, reference, encoder, current):
    """The branch of `controller_step` for each kind of law."""
    not_inlined()
    kind = parameters.kind
    period = parameters.period
    limit = parameters.voltage_limit
    if kind == NONE:
        state.pid.error = reference - encoder
        return 0.0
    if kind == CASCADE:
        return cascade.cascade_step(parameters.cascade, state.cascade, state.pid, period, limit, reference, encoder)
    if kind == NCTF:
        return nctf.nctf_step(parameters.nctf, state.pid, period, limit, reference, encoder)
    if kind == SELF_TUNING_OBSERVER:
        return observed_step(parameters, state, reference, encoder, current)
    if kind == PID_FEEDFORWARD or kind == SELF_TUNING_FEEDFORWARD:
        state.feed_forward = feedforward.feedforward_step(
            parameters.feedforward, state.feedforward, period, reference, 1.0, 1.0, 0.0
        )
    pid.pid_motion(parameters.pid, state.pid, period, reference, encoder)
    if kind != PID_FEEDFORWARD:
        adaptation.adaptation_step(parameters.adaptation, state.adaptation, parameters.pid, state.pid, period)
        if kind == SELF_TUNING_FEEDFORWARD:
            state.feed_forward += adaptation.take_over(
                parameters.adaptation, state.adaptation, state.pid, state.feedforward.friction, parameters.feedforward.friction_share
            )
        state.feed_forward *= adaptation.fed_forward(parameters.adaptation, state.adaptation)
    return pid.pid_output(parameters.pid, state.pid, period, limit, state.feed_forward)


@compiled
def observed_step(parameters, state, reference, encoder, current):
    """Self-tuning PID on the observer's motion, fed forward at its level, through lost motion where there is any.

    While `supervision` says that the model does not hold, the encoder-only self-tuning PID in its place.
    """
    period, rule, watched, observer = parameters.period, parameters.supervision, state.supervision, state.observer
    pid.pid_motion(parameters.pid, state.pid, period, reference, encoder)
    observer_law.observer_step(parameters.observer, parameters.feedforward, observer, period, encoder, state.voltage, current)
    if rule.supervised == 0.0:
        return regulate(parameters, state, reference)
    pid.pid_motion(parameters.encoder_pid, state.encoder_pid, period, reference, encoder)
    supervision.watch_error(rule, watched, state.encoder_pid.error, state.encoder_pid.reference_velocity, period)
    if watched.law == supervision.OBSERVER:
        reason = supervision.sign_of_trouble(rule, watched, observer.position_test, observer.speed_test, observer.voltage_noise, period)
        if reason == supervision.NOTHING:
            return regulate(parameters, state, reference)
        supervision.hand_over(rule, watched, reason)
        go_on_from(parameters.encoder_pid, state.encoder_pid, state.voltage)
    elif supervision.may_return(rule, watched, observer.position_test, observer.speed_test, observer.voltage_noise):
        supervision.hand_back(watched)
        voltage = regulate(parameters, state, reference)
        state.pid.integral += (state.voltage - voltage) / observer.applied[0]
        return state.voltage
    return encoder_only_step(parameters, state, reference)


@compiled
def go_on_from(p, s, voltage):
    """Set the integral of ``s`` so that its output continues from ``voltage`` [V]."""
    wanted = p.derivative_on_reference * s.reference_velocity
    s.integral = voltage - s.kp * s.error + s.kd * (s.velocity - wanted)


@compiled
def encoder_only_step(parameters, state, reference):
    """The encoder-only law, and what the observer law needs to take over again: its model along the reference, no crossing."""
    not_inlined()
    period, model, own, shown = parameters.period, parameters.feedforward, state.encoder_pid, state.pid
    feedforward.feedforward_step(model, state.feedforward, period, reference, state.observer.level, 1.0, 0.0)
    gap_crossing.crossing_reset(state.crossing)
    adaptation.adaptation_step(parameters.encoder_adaptation, state.encoder_adaptation, parameters.encoder_pid, own, period)
    voltage = pid.pid_output(parameters.encoder_pid, own, period, parameters.voltage_limit, 0.0)
    state.feed_forward = 0.0
    state.observer.rest_time_s = state.supervision.rest_time_s
    shown.kp, shown.ki, shown.kd, shown.integral, shown.error = own.kp, own.ki, own.kd, own.integral, own.error
    shown.proportional_term, shown.derivative_term, shown.saturated = own.proportional_term, own.derivative_term, own.saturated
    return voltage


@compiled
def regulate(parameters, state, reference):
    """What `observed_step` does with the motion, level and contact that stand in ``state.observer``."""
    period, model, observer, crossing = parameters.period, parameters.feedforward, state.observer, state.crossing
    speed = state.pid.reference_velocity
    observer.rest_time_s = observer.rest_time_s + period if speed == 0.0 else 0.0
    state.pid.velocity = observer.v
    state.pid.error = gap_crossing.cross_step(
        crossing, parameters.observer, observer, period,
        reference - observer.x - swing.read_swing(parameters.observer, observer), speed,
    )
    state.pid.reference_velocity = speed + crossing.held_speed
    state.feed_forward = feedforward.feedforward_step(
        model, state.feedforward, period, reference, observer.level, 1.0, crossing.offset_speed
    )
    integral = state.pid.integral
    in_gap = observer.contact != TOUCHING
    if not in_gap:
        adaptation.adaptation_step(parameters.adaptation, state.adaptation, parameters.pid, state.pid, period)
    limit = parameters.voltage_limit
    voltage = pid.pid_output(parameters.pid, state.pid, period, limit / max(observer.applied[0], 1.0), state.feed_forward)
    if in_gap:
        state.pid.integral = integral
    motion = model.volts_per_velocity * state.pid.reference_velocity
    return min(max(drive_voltage(observer, voltage - motion, motion), -limit), limit)
