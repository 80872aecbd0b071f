"""Friction observer: motion and friction of both contacts from encoder, current and voltage.

The measured current i gives the driving force F = (k_M N/r) i, and with the voltage the speed of the motor,
free of the encoder's counts and of the drive train's resonance. The axis is one mass M = m + J (N/r)^2:

    M dv/dt = F - (N/r) M_f(z; l) - F_g(x) - M d,      dx/dt = v,      z = x + F_g / K_c
    encoder = x + e + n_x,      (u - R i_end - o) / (K_E N/r) = v + dw/dt + n_v

with the friction laws of the axis file run along the estimated motion, l the level of the actuator's limits, d what is
left (a random walk), w = (F_g + m dv/dt) / K_c the wind-up of the drive train, planned along the reference, e the
encoder's error of `interpolation`. x, v and d follow a Kalman filter (`motion_filter`), the stage's swing is `swing`'s.
The back-EMF matters: below the Stribeck
velocity friction falls by 34 uNm per rad/s at the motor, so speed errors of a model driven by the current alone grow
e-fold in 3 ms. Its R, zero o and constant are learned (`learn_drive`) from what encoder and back-EMF disagree on, and
the delay of the voltage, in whole periods, from which past voltage the current answers to.
"""

import math

from microstage_ros.control.feedforward import axis as feedforward
from microstage_ros.control.feedforward.axis import friction_along
from microstage_ros.control.gains import Gain, record_type
from microstage_ros.control.observer import flexible_mode as swing
from microstage_ros.control.observer import (
    dead_band,
    friction_level,
    inertia,
    inertia_doubt,
    interpolation,
    long_delay,
    lost_motion,
    motion_filter,
    motor_constant,
    source_doubt,
    wind_up,
)
from microstage_ros.control.observer.drive_learning import (
    LAGS,
    NOISE_DOUBT,
    apply_learned,
    compare_voltage,
    drive_changed,
    drop_to_learn,
    find_lag,
    forget_drive,
    keep_voltage,
    learn_drive,
    relearn,
    settled_drop,
    speed_innovation,
    speed_variance,
    trust_in_speed,
    voltage_variance,
    weighed_current,
)
from microstage_ros.control.observer.lost_motion import TOUCHING
from microstage_ros.model.friction.curve import COULOMB
from microstage_ros.model.sensors.current import sensed_transient
from microstage_ros.numerics.compiled import compiled

GAINS = (
    Gain("encoder_noise", "m", 1e-12, 1e-3, 1.8e-8, "doubt in one encoder value: noise, rounding and more"),
    Gain("voltage_noise", "V", 1e-6, 10.0, 2.3e-3, "doubt in the voltage behind the back-EMF: noise of it and more"),
    Gain(
        "encoder_doubt",
        "1",
        1.0,
        100.0,
        1.0,
        "doubt in the encoder at the start, over `encoder_noise`: a stage that swings is no reading of the screw",
    ),
    Gain("voltage_doubt", "1", 1.0, 100.0, 1.0, "the same of the voltage"),
    Gain(
        "interpolation_spread", "m", 0.0, 1e-3, 1e-8,
        "standard deviation of the encoder's error of interpolation before anything is learned; 0: none is looked for",
    ),
    Gain("acceleration_noise", "m/s^2/rtHz", 1e-12, 1e3, 6.0e-5, "density of what moves the axis unmodelled"),
    Gain("friction_drift", "m/s^3/rtHz", 1e-12, 1e6, 4.0e-3, "density of the random walk of d"),
    Gain("resistance_spread", "1", 0.0, 1.0, 0.1, "standard deviation of R over nominal before anything is learned"),
    Gain("zero_spread", "V", 0.0, 10.0, 5.0e-3, "standard deviation of the amplifier's zero before that"),
    Gain("emf_spread", "1", 0.0, 1.0, 0.02, "standard deviation of the back-EMF over nominal before that"),
    Gain("forgetting_time", "s", 1e-2, 1e9, 3000.0, "time in which R and back-EMF may change by as much"),
    Gain(
        "zero_time", "s", 1e-2, 1e9, 3.0e4,
        "time in which the zero may: sliding one way cannot tell it from R, and would let both go astray",
    ),
    Gain("level_variability", "1", 0.0, 1.0, 0.06, "standard deviation of the friction level"),
    Gain("level_length", "m", 1e-9, 1.0, 1.0e-4, "travel over which the level varies"),
    Gain("level_time", "s", 1e-3, 1e6, 20.0, "time over which the level varies"),
    Gain("presliding_stiffness", "1", 0.1, 10.0, 1.0, "of the actuator's friction in the law, over the file's"),
    Gain("force_noise", "N", 1e-9, 1e6, 0.25, "noise of the force balance within one observer time"),
    Gain("known_gap", "m", 0.0, 1e-3, 0.0, "lost motion of the drive, if known"),
    Gain("widest_gap", "m", 0.0, 1e-3, 6.0e-6, "widest lost motion that is looked for; 0: none"),
    Gain("least_lead", "m", 1e-10, 1e-3, 1.5e-8, "lead of the motor that opens a contact"),
    Gain("crossing_acceleration", "m/s^2", 1e-3, 1e6, 0.9, "highest acceleration through a gap"),
    Gain("search_speed", "m/s", 1e-9, 1.0, 3.5e-5, "lowest speed through a gap of unknown width"),
    Gain("search_rate", "1/s", 0.0, 1e6, 250.0, "speed through it over what the stage has fallen behind, 2 / k"),
    *swing.GAINS,
)
REPEATED = 0.2  # doubts in the encoder that the axis moves within a period when readings cannot repeat
TEST_TIME = 2e-2  # s, over which innovations are averaged
# of the actuator's Coulomb friction, that the current overcomes where the motor moves at all: else it is a dead band
PULL = 0.2
PARAMETERS = record_type(
    GAINS, [("motion_gain", "f8", (3, 2)), ("transient", "f8"), *swing.PARAMETERS, *wind_up.PARAMETERS]
)
BLOCK_STATE = feedforward.BLOCK_STATE
STATE_FIELDS = [
    ("x", "f8"),  # m, stage position
    ("v", "f8"),  # m/s
    ("d", "f8"),  # m/s^2, unexplained deceleration
    ("screw", "f8"),  # m, stage position plus wind-up
    ("current", "f8"),  # A, of the period before
    ("read", "f8"),  # m, encoder of the period before
    ("lost_time_s", "f8"),  # s, for which samples have been lost since
    ("acceleration", "f8"),  # m/s^2, of the period before
    ("learned", "f8", 3),  # R over nominal [1], zero of the amplifier [V], back-EMF over nominal [1]
    ("learned_covariance", "f8", (3, 3)),  # of their errors; the upper triangle is kept
    ("unexplained", "f8"),  # V, of what current and speed call for
    ("applied", "f8", 3),  # what is learned, as the controller counts with it
    ("drop", "f8"),  # V, nominal R i
    ("speed", "f8"),  # m/s, that these belong to
    ("steady", "f8"),  # s, for which the voltage has been what they call for
    ("since", "f8"),  # s, since the start or the last change of the drive
    ("restless", "f8"),  # V^2, mean square of its steps
    ("changes", "i8"),  # of the drive
    ("noise_variance", "f8"),  # V^2, found in the voltage behind the back-EMF
    ("voltage_noise", "f8"),  # V, doubt in it that is counted with
    ("last_step", "f8"),  # V, of what is unexplained, a period before
    ("running", "f8"),  # s, since the start
    ("force_current", "f8"),  # A, that the force of the period before was taken from
    ("innovation_peak_m", "f8"),  # m, largest innovation of the position of late
    ("rest_time_s", "f8"),  # s, for which the reference has stood, if that is known
    ("strayed", "f8"),  # m, mean innovation of the position
    ("of_position", "f8", 3),  # change of the position's innovation per unit error of what is learned
    ("of_speed", "f8", 3),
    ("shift", "f8", (3, 3)),  # how far x, v, d are off per unit error of what is learned
    ("voltages", "f8", LAGS + 1),  # V, newest first
    ("answered", "f8"),  # V, that the newest current answers
    ("lag", "i8"),  # periods between a voltage and its current, beyond the hold
    ("actuator", "f8", BLOCK_STATE),
    ("guideway", "f8", BLOCK_STATE),
    ("actuator_friction", "f8"),  # N m at the motor shaft, by the law
    ("guideway_friction", "f8"),  # N
    ("noise", "f8"),  # m^2, running variance of the innovation
    ("position_test", "f8"),  # 1, mean square of the position's innovation over the expected
    ("speed_test", "f8"),  # 1, the same of the speed's
    *friction_level.FIELDS,
    *source_doubt.FIELDS,
    *inertia.FIELDS,
    *motor_constant.FIELDS,
    *dead_band.FIELDS,
    *long_delay.FIELDS,
    *wind_up.FIELDS,
    *inertia_doubt.FIELDS,
    *interpolation.FIELDS,
    ("net_force", "f8"),  # N, that accelerated the axis in the newest period, sum over its parts
    *motion_filter.FIELDS,
    *swing.FIELDS,
    *lost_motion.FIELDS,
]


@compiled
def observer_reset(p, s):
    """Forget everything but the nominal level."""
    s.v = s.d = 0.0
    s.swing = s.swing_rate = 0.0
    s.current = 0.0
    s.read = math.nan
    s.lost_time_s = s.acceleration = 0.0
    motor_constant.motor_constant_reset(s)
    forget_drive(p, s)
    s.applied[:] = s.learned
    s.rest_time_s = 0.0
    s.lag = 0
    s.unexplained = s.drop = s.speed = 0.0
    s.steady = s.since = s.restless = 0.0
    s.changes = 0
    source_doubt.doubt_reset(p, s)
    inertia.inertia_reset(s)
    dead_band.dead_band_reset(s)
    long_delay.long_delay_reset(s)
    s.drives = 1
    s.net_force = s.force_current = 0.0
    wind_up.wind_up_reset(s)
    inertia_doubt.inertia_doubt_reset(s)
    interpolation.interpolation_reset(p, s)
    s.voltage_noise = p.voltage_doubt * p.voltage_noise
    s.noise_variance = (p.voltage_noise / NOISE_DOUBT) ** 2
    s.running = s.last_step = 0.0
    s.voltages[:] = 0.0
    s.answered = 0.0
    s.actuator_friction = s.guideway_friction = 0.0
    s.noise = 0.0
    s.position_test = 1.0
    s.speed_test = 1.0
    friction_level.level_reset(p, s)
    lost_motion.lost_motion_reset(p, s)
    motion_filter.forget_motion(s)
    for j in range(BLOCK_STATE):
        s.actuator[j] = 0.0
        s.guideway[j] = 0.0


@compiled
def observer_start(s, encoder):
    """The axis rests where the encoder [m] says."""
    s.x = encoder
    s.screw = encoder
    s.stage = encoder
    s.before = encoder


@compiled
def predict(model, s, period, force):
    """Move the model by ``period`` [s] under the driving ``force`` [N] at the stage (velocity Verlet)."""
    touching = s.contact == TOUCHING
    load = s.guideway_friction + model.offset_force if touching else 0.0
    friction = model.force_per_torque * s.actuator_friction + load
    mass = model.moving_mass * s.inertia
    pull = ((force - friction) / mass - s.d) * period
    s.net_force += force - friction
    mean = s.v + 0.5 * pull
    s.v += pull
    velocity = mean
    if touching:
        s.x += mean * period
        if model.has_guideway != 0:
            s.guideway_friction = friction_along(model.guideway, s.guideway, mean, period, 1.0)
        screw = s.x + s.guideway_friction * model.compliance
        velocity = (screw - s.screw) / period
        s.screw = screw
        load = s.guideway_friction + model.offset_force
    else:
        s.travel += s.toward * mean * period
    if model.has_actuator != 0:
        s.actuator_friction = friction_along(
            model.actuator, s.actuator, velocity / model.screw_ratio, period, s.level
        )
    after = model.force_per_torque * s.actuator_friction + load
    s.v -= 0.5 * (after - friction) / mass * period


@compiled
def correct(s, position, speed):
    """Correct x, v, d by the innovations of position [m] and speed [m/s]."""
    change = s.gain[0, 0] * position + s.gain[0, 1] * speed
    s.x += change
    s.screw += change
    s.v += s.gain[1, 0] * position + s.gain[1, 1] * speed
    s.d += s.gain[2, 0] * position + s.gain[2, 1] * speed
    s.noise += 0.01 * (position * position - s.noise)


@compiled
def observer_step(p, model, s, period, encoder, voltage, current):
    """One control period: ``encoder`` [m] and ``current`` [A] of now, ``voltage`` [V] held until now."""
    senses, fall, used = model.force_per_ampere > 0.0 and math.isfinite(current), 0.0, current
    if senses:
        keep_voltage(s, dead_band.beyond_band(voltage, s.dead_band))
        rest = p.transient
        part = model.settling / period - rest / (1.0 - rest)
        used = weighed_current(p, model, s, current)
        force = model.force_per_ampere * (used + part * (s.force_current - used))
        s.force_current = used
        # within the period the current falls as the back-EMF rises: before its end it is above the newest value
        fall = model.force_per_ampere * model.volts_per_velocity / model.resistance
    elif model.force_per_ampere > 0.0:
        force = model.force_per_ampere * (voltage - model.volts_per_velocity * s.v) / model.resistance
    else:
        force = voltage / model.volts_per_force
    # a lost sample stands as the one before; a moving axis does not repeat both readings
    repeats = encoder == s.read and current == s.current
    lost = repeats and abs(s.v) * period > REPEATED * p.encoder_noise
    moved = 0.0 if math.isnan(s.read) else encoder - s.read
    s.read = encoder
    encoder -= interpolation.interpolation_error(p, model, s, encoder)
    before = s.v
    motion_filter.linearise(model, s)
    parts = motion_filter.parts_of(period)
    s.net_force = 0.0
    for k in range(parts):
        start = s.v
        predict(model, s, period / parts, force + fall * s.acceleration * period * (parts - k - 0.5) / parts)
        s.acceleration = (s.v - start) * parts / period
    s.acceleration = (s.v - before) / period
    swing.follow_swing(p, s)
    if lost and s.contact == TOUCHING:
        motion_filter.widen(p, s, period)
        s.lost_time_s += period
        s.undisturbed_s = 0.0
        return
    read_speed = moved / (period + s.lost_time_s)
    s.lost_time_s = 0.0
    encoder -= s.swing
    speed, drop, doubt = 0.0, 0.0, 0.0
    if senses:
        drop = settled_drop(p, model, s, current)
        changed = drive_changed(p, model, s, period, drop, repeats)
        long_delay.watch_long_delay(s, period, current - s.current)
        if changed:
            relearn(p, model, s, drop)
            dead_band.forget_bins(s)
            s.calm = 0.0
            s.since = 0.0 if s.since > 1e-3 else s.since
            s.changes += 1
        elif find_lag(p, model, s):
            forget_drive(p, s)  # learned from voltages of another period
            source_doubt.trust_voltage(p, s)
        apply_learned(p, s, period)
        speed = speed_innovation(model, s, drop)
        doubt = voltage_variance(model, s, drop, s.v, 1.0)
        doubtful = s.contact != TOUCHING or source_doubt.lost_motion_suspected(s) or s.waves > source_doubt.SWINGS
        inertia.learn_inertia(model, s, period, inertia.mean_net(s, parts), read_speed, doubtful)
        source_doubt.trust_lighter(p, s)
        s.current = current
        constant = s.emf_centre * model.volts_per_velocity
        swings_low = s.waves > 0 and wind_up.stage_swings_low(p, s)
        if swings_low:
            dead_band.forget_bins(s)  # its motor is faster than the mean of the encoder says
        if s.contact == TOUCHING and dead_band.watch_dead_band(s, period, voltage, drop, constant, read_speed):
            forget_drive(p, s)
            if source_doubt.lost_motion_suspected(s):
                source_doubt.doubt_reset(p, s)  # the band had been taken for lost motion
            lost_motion.lost_motion_reset(p, s)
        if not doubtful:
            motor_constant.watch_motor_constant(p, model, s, period, drop, read_speed)
        inertia_doubt.doubt_inertia(s, period, read_speed, doubtful)
    position = encoder - s.x
    if senses:
        motor_speed = s.v + s.wind_up_speed + speed / s.learned[2]
        lost_motion.watch_lead(s, period, encoder, motor_speed, speed)
        follows = source_doubt.current_follows(model, s)
        wind_up.learn_drive_train(p, model, s, period, encoder + s.swing, motor_speed, follows)
        if s.contact == TOUCHING:
            force = s.guideway_friction + model.offset_force + model.mass * s.acceleration
            # a voltage that comes late looks like a motor that leads
            pulls = abs(drop) > PULL * model.volts_per_torque * model.actuator[COULOMB]
            pulls = pulls and s.voltage_factor < source_doubt.GROWN * p.voltage_doubt
            pulls = pulls and follows and not swings_low  # it leads a heavy stage's swing too
            if lost_motion.watch_contact(
                p, s, force, model.guideway[0], math.sqrt(doubt) / model.volts_per_velocity, pulls
            ):
                forget_drive(p, s)
        elif lost_motion.cross(p, s, period, position):
            forget_drive(p, s)
        position = encoder - s.x
    if s.contact != TOUCHING:
        lost_motion.correct_in_gap(p, model, s, period, position, speed, trust_in_speed(s, doubt))
        compare_voltage(model, s, drop)
        motion_filter.forget_motion(s)
        s.swing, s.swing_rate = 0.0, 0.0
        return
    motion_filter.widen(p, s, period)
    unread = 0.0 if source_doubt.lost_motion_suspected(s) else motor_constant.unread_variance(model, s)
    variance = speed_variance(s, model, doubt + unread) if senses else math.inf
    share = min(period / TEST_TIME, 1.0)
    expected = s.covariance[0, 0] + s.encoder_noise * s.encoder_noise
    beyond = position * position / expected if s.gap == 0.0 else 1.0  # a gap explains more than the filter knows
    s.position_test += share * (beyond - s.position_test)
    if senses:
        beyond = speed * speed / (s.covariance[1, 1] + variance) if s.gap == 0.0 else 1.0
        s.speed_test += share * (beyond - s.speed_test)
        source_doubt.weigh_sources(p, model, s, period, position)
    if source_doubt.lost_motion_suspected(s):
        inertia.inertia_reset(s)  # what a rattle taught of it before it was seen to be one
        if s.suspected == source_doubt.SUSPECTED_TIME:
            friction_level.level_reset(p, s)
    if source_doubt.lost_motion_suspected(s) or s.waves > source_doubt.SWINGS:
        s.fast_turns = 0.0
    else:
        interpolation.learn_interpolation(p, model, s, period, position, expected)
    motion_filter.take_readings(s, variance)
    correct(s, position, speed)
    if senses:
        learn_drive(p, model, s, period, drop_to_learn(p, model, s, drop, used), position, speed, unread)
        compare_voltage(model, s, drop)
    friction_level.learn_level(p, model, s, period)
    if senses:
        friction_level.doubt_turning(p, model, s, period)
    if model.has_actuator != 0:
        friction_level.absorb(model, s, period)


def design_motion(record, model, period):
    """What follows from an observer's gains, its axis and the ``period`` [s].

    ``motion_gain`` of a free mass; ``transient``, what is left after a period of a transient of the current; the
    swing's matrix.
    """
    settling = float(model["settling"])
    record["transient"] = 0.0
    if settling > 0.0:
        record["transient"] = sensed_transient(
            period, settling, float(model["current_bandwidth"]), float(model["current_skew"])
        )
    record["motion_gain"] = motion_filter.steady_gain(record, model, period)
    record["swing_matrix"] = swing.swing_matrix(record, model, period)
    wind_up.design_filters(record, model, period)
