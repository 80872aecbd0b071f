"""The self-tuning PID on the friction observer's motion, supervised, with the encoder-only self-tuning PID in
reserve.

Sources: those of its parts, `adaptation` (Lin, Brandt, Saikalis 2000; paper, section 5.3) and `supervision`; the
observer's equations are derived in `control.observer.law` from the axis's own.
"""

import math

from microstage_ros.control.design import rules
from microstage_ros.control.feedforward import axis as feedforward
from microstage_ros.control.gains import record_type
from microstage_ros.control.laws import adaptation, pid, supervision
from microstage_ros.control.laws.law import ControlLaw, Part
from microstage_ros.control.laws.pid_feedforward import FEEDFORWARD, PID
from microstage_ros.control.laws.self_tuning import ADAPTATION, self_tuning_reset
from microstage_ros.control.observer import flexible_mode as swing
from microstage_ros.control.observer import gap_crossing, inertia_doubt, lost_motion, source_doubt, wind_up
from microstage_ros.control.observer import law as observer_law
from microstage_ros.control.observer.dead_band import over_band
from microstage_ros.control.observer.drive_learning import drive_voltage
from microstage_ros.control.observer.lost_motion import TOUCHING
from microstage_ros.model.friction.blocks import COUNT, STIFFNESS
from microstage_ros.numerics.compiled import compiled, not_inlined

PARTS = {
    "pid": PID,
    "adaptation": ADAPTATION,
    "feedforward": FEEDFORWARD,
    "observer": Part(observer_law.GAINS, observer_law.PARAMETERS, observer_law.STATE_FIELDS),
    "supervision": Part(supervision.GAINS, record_type(supervision.GAINS), supervision.FIELDS),
    "crossing": Part(state=gap_crossing.FIELDS),
    # of the encoder-only law that the observer law hands over to
    "encoder_pid": Part((), pid.PARAMETERS, pid.STATE_FIELDS),
    "encoder_adaptation": Part((), adaptation.PARAMETERS, adaptation.STATE_FIELDS),
    "encoder_filter": Part((), "f8"),  # factor on its filter time at the start, where the observer law is unstable
    "lagged": Part(state="f8"),  # m/s, speed of the reference through the filter of the encoder-only law
    "fed_forward": Part(state="i8"),  # 1: the encoder-only law is fed forward, since the model of the axis holds
    "unstable": Part((), "i8"),  # 1: the observer law is unstable on the axis file's own model
}

# rad, that a delay of the voltage may take off the loop's phase at its bandwidth: up to 0.3 ms no gain is lowered
PHASE = 0.8
# s, for which a stage that a move has thrown across a gap may swing after the move; calibrated with `robustness --moves
# 1003 --only "backlash 0.5 deg" "backlash 1 deg"`: 18 and 104 moves missed, 27 and 182 with 0
THROWN = 0.1


@compiled
def observed_reset(parameters, state, voltage):
    """Forget everything; the encoder-only law continues from ``voltage`` [V] as well."""
    self_tuning_reset(parameters, state, voltage)
    pid.pid_reset(parameters.encoder_pid, state.encoder_pid, voltage)
    state.lagged = 0.0
    state.fed_forward = 0
    adaptation.adaptation_reset(parameters.encoder_adaptation, state.encoder_adaptation, state.encoder_pid)
    if parameters.unstable != 0:
        own = state.encoder_adaptation
        own.log_filter = math.log(parameters.encoder_filter)
        own.ceiling = own.damping_ceiling = math.log(parameters.encoder_adaptation.start) + 0.1
        state.encoder_pid.filter_time *= parameters.encoder_filter
    supervision.supervision_reset(parameters.supervision, state.supervision, parameters.unstable, voltage)
    observer_law.observer_reset(parameters.observer, state.observer)
    gap_crossing.crossing_reset(state.crossing)


@compiled
def observed_start(parameters, state, reference, encoder):
    """The axis is taken to rest where the encoder [m] says, for both laws."""
    state.encoder_pid.previous_encoder = encoder
    state.encoder_pid.previous_reference = reference
    feedforward.feedforward_reset(state.feedforward, reference)
    observer_law.observer_start(state.observer, encoder)


@compiled
def observed_step(parameters, state, reference, encoder, current):
    """Self-tuning PID on the observer's motion, fed forward at its level, through lost motion where there is any.

    While `supervision` says that the model does not hold, the encoder-only self-tuning PID in its place.
    """
    not_inlined()
    period, rule, watched, observer = parameters.period, parameters.supervision, state.supervision, state.observer
    pid.pid_motion(parameters.pid, state.pid, period, reference, encoder)
    observer.drives = 1 if watched.law == supervision.OBSERVER and rule.supervised != 0.0 else 0
    observer_law.observer_step(
        parameters.observer, parameters.feedforward, observer, period, encoder, state.voltage, current
    )
    if rule.supervised == 0.0:
        return regulate(parameters, state, reference)
    corrected = encoder - observer.interpolated
    pid.pid_motion(parameters.encoder_pid, state.encoder_pid, period, reference, corrected)
    supervision.watch_error(
        rule,
        watched,
        state.encoder_pid.error,
        state.encoder_pid.reference_velocity,
        observer.contact != TOUCHING,
        state.voltage,
        period,
    )
    found = observer.voltage_noise / observer.voltage_factor  # without the doubt that is added to it
    if watched.law == supervision.OBSERVER:
        # a gap explains innovations that one mass does not
        rattles = source_doubt.lost_motion_suspected(observer)
        position_test, speed_test = (1.0, 1.0) if rattles else (observer.position_test, observer.speed_test)
        heavy = source_doubt.encoder_doubted(parameters.observer, observer)
        reason = supervision.sign_of_trouble(rule, watched, position_test, speed_test, found, heavy, period)
        if reason == supervision.NOTHING:
            return regulate(parameters, state, reference)
        supervision.hand_over(rule, watched, reason)
        # noise of the current and a gap of the drive leave the model of the axis as it is
        state.fed_forward = 1 if reason == supervision.NOISE or rattles else 0
        known = without_level(state, state.feed_forward) if state.fed_forward == 1 else 0.0
        if reason == supervision.SWINGS:  # what error and speed ask for belongs to the swing, and damps it
            state.encoder_pid.integral = watched.mean_voltage_V - known
        else:
            go_on_from(parameters.encoder_pid, state.encoder_pid, state.voltage - known)
        state.lagged = state.encoder_pid.reference_velocity
        if observer.lag > 0:  # a loop's bandwidth goes as one over its whole delay
            lag = parameters.encoder_pid.filter_time + rules.SAMPLING_LAG * period
            adaptation.allow_for_delay(state.encoder_adaptation, lag / (lag + observer.lag * period))
        if observer.contact != TOUCHING:
            lost_motion.settle(observer, 0.0)
    elif supervision.may_return(
        rule, watched, observer.position_test, observer.speed_test, found, period
    ):
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
def without_level(state, planned):
    """Of the ``planned`` feed-forward [V] what is given where nothing tells the friction's level."""
    return planned - (1.0 - rules.FRICTION_SHARE) * state.feedforward.friction


@compiled
def encoder_only_step(parameters, state, reference):
    """The encoder-only law, and what the observer law needs to take over again: its model along the reference, no
    crossing."""
    not_inlined()
    period, model, own, shown = parameters.period, parameters.feedforward, state.encoder_pid, state.pid
    planned = feedforward.feedforward_step(
        model, state.feedforward, period, reference, state.observer.level, 1.0, 0.0, state.observer.inertia
    )
    state.lagged += period / (period + own.filter_time) * (own.reference_velocity - state.lagged)
    if state.fed_forward == 1:
        # the measured speed comes through a filter: so has the wanted one to
        planned = without_level(state, planned) - own.kd * (own.reference_velocity - state.lagged)
    else:
        planned = 0.0
    gap_crossing.crossing_reset(state.crossing)
    state.observer.planned_acceleration = 0.0
    adaptation.adaptation_step(
        parameters.encoder_adaptation, state.encoder_adaptation, parameters.encoder_pid, own, period, 1.0, True
    )
    adaptation.fade_damping(parameters.encoder_adaptation, state.encoder_adaptation, own.reference_velocity, period)
    voltage = pid.pid_output(parameters.encoder_pid, own, period, parameters.voltage_limit, planned)
    state.feed_forward = planned
    state.observer.rest_time_s = state.supervision.rest_time_s
    shown.kp, shown.ki, shown.kd, shown.integral, shown.error = own.kp, own.ki, own.kd, own.integral, own.error
    shown.proportional_term, shown.derivative_term, shown.saturated = (
        own.proportional_term,
        own.derivative_term,
        own.saturated,
    )
    return voltage


@compiled
def slow_for_delay(parameters, learned, delay):
    """Bandwidth for a voltage that acts ``delay`` [s] late: the phase that it takes off stays below `PHASE`."""
    p, model = parameters.pid, parameters.feedforward
    bandwidth = p.proportional * p.derivative_time / (model.rotor + model.volts_per_force * model.mass)
    adaptation.allow_for_delay(learned, PHASE / (bandwidth * delay))


@compiled
def without_voltage(state):
    """No force on the motor; what the regulator has integrated belongs to another place."""
    state.pid.integral = 0.0
    state.feed_forward = 0.0
    return drive_voltage(state.observer, 0.0, 0.0)


@compiled
def regulate(parameters, state, reference):
    """What `observed_step` does with the motion, level and contact that stand in ``state.observer``."""
    period, model, observer, crossing = parameters.period, parameters.feedforward, state.observer, state.crossing
    speed = state.pid.reference_velocity
    observer.rest_time_s = observer.rest_time_s + period if speed == 0.0 else 0.0
    watched = state.supervision
    # a machine that has been seen to swing as no gap makes it is not stopped, but handed over
    rattles = watched.swings if watched.reason != supervision.SWINGS else 0
    size = max(abs(state.encoder_pid.error), watched.last_half_wave_m if rattles > 0 else 0.0)
    if gap_crossing.stop_rattle(crossing, parameters.observer, observer, period, rattles, speed, size):
        watched.swings, watched.beside = 0, 0.0
        return without_voltage(state)
    state.pid.velocity = observer.v
    if crossing.led_back == 1:
        crossing.led_back = 2
        crossing.offset = observer.x - reference
    state.pid.error = gap_crossing.cross_step(
        crossing,
        parameters.observer,
        observer,
        period,
        reference - observer.x - swing.read_swing(parameters.observer, observer),
        speed,
    )
    gained = speed - state.feedforward.velocity
    # the observer's speed is that of now, the difference of the reference is the mean of the period before
    state.pid.reference_velocity = speed + 0.5 * gained + crossing.held_speed
    inertia_doubt.plan_acceleration(observer, period, gained)
    state.feed_forward = feedforward.feedforward_step(
        model, state.feedforward, period, reference, observer.level, 1.0, crossing.offset_speed, observer.inertia,
        observer.drive_train_swing, observer.drive_train_softness,
    )
    state.feed_forward += model.volts_per_velocity * gained  # and the voltage is held over the period that comes
    integral = state.pid.integral
    in_gap = observer.contact != TOUCHING
    planned = state.feedforward
    loose = in_gap or source_doubt.lost_motion_suspected(observer)
    wound_up = 0.0 if loose else planned.screw_velocity - planned.offset_speed - planned.velocity
    wind_up.plan_wind_up(model, observer, wound_up)
    if observer.lag > 0:
        slow_for_delay(parameters, state.adaptation, observer.lag * period)
    if watched.rest_swing > parameters.supervision.rest_swing:
        wave = 0.5 * math.pi * watched.rest_swing  # of a sine of that mean size
        adaptation.fade_at_rest(parameters.adaptation, state.adaptation, wave, period)
    if no_gain_ends_swings(parameters, observer, watched.swings):
        state.adaptation.swings = 0
    if not in_gap:
        adaptation.adaptation_step(
            parameters.adaptation,
            state.adaptation,
            parameters.pid,
            state.pid,
            period,
            observer.inertia,
            not source_doubt.rattles_at_rest(observer, state.adaptation.wave),
        )
        adaptation.fade_damping(parameters.adaptation, state.adaptation, state.pid.reference_velocity, period)
    limit, applied = parameters.voltage_limit, observer.applied
    motion = model.volts_per_velocity * state.pid.reference_velocity
    # in nominal volts, of which a drive that has learned another resistance makes ±limit
    centre, half = motion - (applied[1] + applied[2] * motion) / applied[0], limit / applied[0]
    voltage = centre + pid.pid_output(parameters.pid, state.pid, period, half, state.feed_forward - centre)
    if in_gap:
        state.pid.integral = integral
    wanted = over_band(drive_voltage(observer, voltage - motion, motion), observer.dead_band)
    return min(max(wanted, -limit), limit)


@compiled
def no_gain_ends_swings(parameters, s, swings):
    """Whether swings of the error, ``swings`` in a row, are such as no lower gain ends.

    Either friction's own, stick-slip: the reference moves, at a speed that hardly changes, and no swing of the loop,
    heavy stage, soft drive or lost motion has shown. Or a stage's that is thrown across a gap in a move: until the
    swings are so many that they are the loop's.
    """
    if source_doubt.lost_motion_suspected(s):
        return s.rest_time_s < THROWN and swings <= parameters.supervision.swings
    steady = s.rest_time_s == 0.0 and s.steady_time_s > 0.0
    return steady and s.waves == 0 and not source_doubt.encoder_doubted(parameters.observer, s)


def complete(record):
    """Fill the logarithms of the gains, the stiffness of the law's model, and the observer's own gains from model and
    noise."""
    adaptation.take_logarithms(record["adaptation"])
    law = record["feedforward"]["actuator"]
    law[STIFFNESS : STIFFNESS + int(law[COUNT])] *= record["observer"]["presliding_stiffness"]
    observer_law.design_motion(record["observer"], record["feedforward"], float(record["period"]))


LAWS = (
    ControlLaw(
        "self_tuning_observer",
        PARTS,
        observed_step,
        observed_reset,
        observed_start,
        rules=rules.observer_gains,
        complete=complete,
        loop="observer",
    ),
)
