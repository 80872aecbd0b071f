"""The wind-up of the drive train: planned, and what it tells of stiffness and damping (compiled parts of
`observer_law`).

The motor runs ahead of the stage by w. With mass m, stiffness K, damping D and guideway friction F_g

    K w + D dw/dt = m dv/dt + F_g,      so that      motor speed = v + dw/dt.

Planned: w = (F_g + m dv/dt) / K of the axis file along the reference (`feedforward`). Where the reference or its
acceleration steps, so does the plan: one count of the encoder in one period makes millimetres per second of it. No
drive train follows that, and a resistance would be learned from it. So a plan whose back-EMF jumps by more than the
voltage's doubt is not believed until the step has passed.

Learned: differentiated once the balance is linear in three numbers, each over the file's (`drive_train`),

    dw/dt = (m/K) d^3x/dt^3 + (1/K) dF_g/dt - (D/K) d^2w/dt^2,      dw/dt = v_m - dx/dt,

with x of the encoder, F_g of the friction law along the estimated motion, and v_m of the back-EMF, which is that of L/R
ago: the winding's current lags behind what the speed changes. All pass the same state-variable filter, four times
`RATE` and once a high pass at `SLOW`, which also takes off what R, the amplifier's zero and the motor constant make of
v_m; its stages give the derivatives (Garnier and Wang, eds., "Identification of Continuous-time Models from Sampled
Data", Springer 2008, ch. 1 and 4). A Kalman filter learns the three with their covariance while the jerk is `LOUD`
times what the encoder's noise makes of it: in fast moves, and where the stage swings. The first is the square of the
file's resonance over that of the axis; the second is as right as the guideway's friction in the file; the third holds
L/R too, as v_m is moved by L/R times the stage's acceleration, not the motor's (`laws.learned` takes it off). A voltage
or current that comes late by t looks like t (M R / (k_T K_E)) more of the first, 0.3 of the shipped axis's for 10 us;
so nothing is learned where the current does not follow the voltage, nor beside lost motion.

What is learned is used in three places. Where both m/K and 1/K are known (`plan_known`) and the first is off by more
than `SLACK`, the plan follows them within `APPLY_TIME`. Where the stage is known to swing low (`stage_swings_low`) its
swings say nothing of the voltage, of a dead band or of a gap (`source_doubt`, `law`). And the doubt in the encoder that
swings have raised falls no lower than the mass, at its upper bound (`heaviest`), asks for: `held_doubts` are the least
doubts with which the loop holds such a stage (`design.start_check`).
"""

import math

from microstage_ros.control.observer.lost_motion import TOUCHING
from microstage_ros.numerics.compiled import compiled

JUMP = 4.0  # doubts in the voltage, as of a drive that has changed (`drive_learning.CHANGE_LIMIT`)
JUMP_PERIODS = 3  # for which a step of the reference lasts in its second difference, of which the acceleration is
# Where nothing else is named the constants of what is learned were chosen on simulated records of 32 conditions (seed
# 700) and kept as `robustness` judged them: all conditions (seeds 900 to 902), 200 random machines (8200 to 8399, seed
# 12400), the tilted stage of six times the mass (seeds 12600 to 12639). The tables use other seeds of the first.
RATE, SLOW = 900.0, 100.0  # 1/s, of the filters: below the resonance, above what R and friction's level change by
LARGEST_SHARE = 0.2  # of a period over the filter's time: beyond, the stages are no derivatives
LOUD = 6.0  # standard deviations of the jerk
NOISE = 1.2e-8 / 1.8e-8  # of an encoder value, noise and rounding, over the doubt in it
EVERY = 5  # periods between two steps of the Kalman filter
CORRELATED = 8.0  # such steps, over which noise behind the filters is correlated: four of their times of 1/`RATE`
SHARE = 0.15  # of dw/dt, standard deviation of what the model leaves out
OWN_LAW = 0.5  # of the part by friction, likewise: when a block begins to slip the law knows only roughly
SPREADS = (3.0, 3.0, 3.0)  # standard deviations of the three over the file's, before anything is learned
CHANGE_TIME = 300.0  # s of loud motion, in which they may change by as much
UNDISTURBED = 0.05  # s, for which the filters have seen one drive train only
SOFTNESS_KNOWN = 0.2  # standard deviation of the second over itself, with which both are planned with
SLACK = 0.5  # of the first, within which it is taken as the file says: a floor that shakes makes 0.36 of it
APPLY_TIME = 0.1  # s, in which the plan follows
EXCITED = 2.5e-3  # V, rms of the voltage's steps that tell whether the current follows them
# s, and least share of them then: a filter of 1 kHz and an amplifier that is 0.1 ms slow leave 0.32, the shipped axis
# has 0.67, six times the mass 0.57, half the resistance 0.40
FOLLOWED_TIME, AT_ONCE = 1.0, 0.45
# 1, of the first, beyond which it may be a motor's that rattles in a gap, where lost motion is suspected: those begin
# with 15 to 26, as well explained as a swing, and fall to 5 to 10, less well. Of 1003 moves through 1 degree 267 miss
# with 20, 156 with 8, 133 with 7 and half of `EXPLAINED`, as without all this (`robustness --moves`, seed 9000); a
# tilted stage of six times the mass has 5 to 6
RATTLE_LIKE = 7.0
TESTED = 0.02  # of a step, in the mean square of the innovations
EXPLAINED = 5.0  # 1, mean square of the innovations up to which the model holds: swings of heavy stages reach 3 to 5
KNOWN = 0.1  # standard deviation of the first over itself
LOW = 0.65  # of the file's resonance: twice the mass, which the loop holds, does not count
HEAVIER = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0)  # times the file's mass, for which the regulator is designed
VARIES = 0.15  # 1, standard deviation of the guideway's friction about the file's (the paper's scatter)
UPPER = 2.0  # standard deviations above the mass that is learned
RESONANCE, FRICTION, DAMPING = 0, 1, 2  # m/K, F_g/K and D/K over the file's
FIELDS = [
    ("wind_up_speed", "f8"),  # m/s, of the motor beyond the stage's as the drive train is wound up
    ("wind_up_before", "f8"),  # m/s, in the period before
    ("wind_up_plan", "f8"),  # m/s, as the feed-forward plans it, jumps and all
    ("wind_up_wait", "i8"),  # periods for which a jump of the plan is not believed yet
    ("drive_train", "f8", 3),  # 1, what is learned, over the file's
    ("drive_train_covariance", "f8", (3, 3)),  # of its errors
    ("encoder_stages", "f8", 5),  # m, encoder, filtered not at all to four times
    ("motor_stages", "f8", 5),  # m/s, speed of the motor by the back-EMF, likewise
    ("friction_stages", "f8", 5),  # N, of the guideway, likewise
    ("slow_parts", "f8", 4),  # of the filtered dw/dt, d^3x/dt^3, dF_g/dt, d^2w/dt^2, which the high pass takes off
    ("undisturbed_s", "f8"),  # s, for which nothing has spoiled the filters
    ("drive_train_wait", "i8"),  # periods since the last step
    ("drive_train_swing", "f8"),  # 1, m/K over the file's, as it is planned with
    ("drive_train_softness", "f8"),  # 1, 1/K likewise
    ("followed_share", "f8"),  # 1, share of the voltage's steps that the current follows at once, of late
    ("held_doubt", "f8"),  # 1, doubt in the encoder over the shipped one that the mass as it is known asks for
    ("drive_train_test", "f8"),  # 1, mean square of its innovations over the expected
]
PARAMETERS = [
    ("filter_rate", "f8"),  # 1/s
    ("loud_jerk", "f8"),  # m/s^3
    ("filtered_variance", "f8", 3),  # m^2/s^2, of `design_filters`
    ("held_doubts", "f8", len(HEAVIER)),  # 1, doubt in the encoder with which the loop holds a stage of these masses
]


@compiled
def forget_drive_train(s):
    """The drive train is the file's, with all its doubt."""
    s.drive_train[:] = 1.0
    s.drive_train_covariance[:] = 0.0
    for j in range(3):
        s.drive_train_covariance[j, j] = SPREADS[j] * SPREADS[j]
    s.drive_train_test = 1.0
    s.held_doubt = 1.0


@compiled
def wind_up_reset(s):
    """Nothing is planned; the drive train is the file's, with all its doubt."""
    forget_drive_train(s)
    s.wind_up_speed = 0.0
    s.wind_up_before = 0.0
    s.wind_up_plan = 0.0
    s.wind_up_wait = 0
    s.encoder_stages[:] = 0.0
    s.motor_stages[:] = 0.0
    s.friction_stages[:] = 0.0
    s.slow_parts[:] = 0.0
    s.undisturbed_s = 0.0
    s.drive_train_wait = 0
    s.drive_train_swing = s.drive_train_softness = 1.0
    s.followed_share = 1.0


@compiled
def drive_train_known(s):
    """Whether the resonance is known, to `KNOWN` of its square, and the model explains what is seen."""
    spread = KNOWN * max(s.drive_train[RESONANCE], 1.0)
    return s.drive_train_covariance[RESONANCE, RESONANCE] < spread * spread and s.drive_train_test < EXPLAINED


@compiled
def plan_known(s):
    """Whether mass and stiffness are known apart, beside no lost motion and no current that comes late."""
    spread = SOFTNESS_KNOWN * max(s.drive_train[FRICTION], 1.0)
    known = s.drive_train_covariance[FRICTION, FRICTION] < spread * spread and drive_train_known(s)
    return known and s.suspected == 0.0 and s.followed_share > AT_ONCE


@compiled
def stage_swings_low(p, s):
    """Whether the stage is known to swing on its drive at less than `LOW` of the file's resonance, or at about that of
    a file whose own stage the law holds by a doubt in the encoder only."""
    least = LOW * LOW if p.encoder_doubt > 1.0 else 1.0 / (LOW * LOW)
    if s.suspected > 0.0 and (s.drive_train[RESONANCE] > RATTLE_LIKE or s.drive_train_test > 0.5 * EXPLAINED):
        return False
    return s.drive_train[RESONANCE] > least and drive_train_known(s) and s.followed_share > AT_ONCE


@compiled
def plan_wind_up(model, s, speed):
    """Take over the planned ``speed`` dw/dt [m/s] of this period."""
    jump = model.volts_per_velocity * abs(speed - s.wind_up_plan)
    s.wind_up_plan = speed
    s.wind_up_wait = JUMP_PERIODS if jump > JUMP * s.voltage_noise else max(s.wind_up_wait - 1, 0)
    s.wind_up_speed = 0.0 if s.wind_up_wait > 0 else speed


@compiled
def wind_up_step(model, s):
    """Back-EMF [V] of what the speed taken over has changed by since the period before."""
    change = model.volts_per_velocity * abs(s.wind_up_speed - s.wind_up_before)
    s.wind_up_before = s.wind_up_speed
    return change


@compiled
def pass_stages(stages, value, share):
    """``value`` into the first of five ``stages``; each further one follows the one before, trapezoidal, by ``share``
    [1]."""
    before = stages[0]
    stages[0] = value
    for k in range(1, 5):
        own = stages[k]
        stages[k] += share * (stages[k - 1] + before - 2.0 * own)
        before = own


@compiled
def learn_drive_train(p, model, s, period, encoder, motor_speed, follows):
    """One period: ``encoder`` [m] and ``motor_speed`` [m/s] by the back-EMF; ``follows``: the current follows the
    voltage."""
    if model.compliance == 0.0:
        return
    if s.contact != TOUCHING or s.gap > 0.0:
        forget_drive_train(s)  # the motor moved without its stage
        s.undisturbed_s = 0.0
    s.undisturbed_s = s.undisturbed_s + period if follows and s.since > UNDISTURBED else 0.0
    follow_drive_train(model, s, period)
    rate, half = p.filter_rate, 0.5 * period * p.filter_rate
    share = half / (1.0 + half)
    pass_stages(s.encoder_stages, encoder, share)
    pass_stages(s.motor_stages, motor_speed, share)
    pass_stages(s.friction_stages, s.guideway_friction, share)
    x, v, f = s.encoder_stages, s.motor_stages, s.friction_stages
    acceleration = rate * rate * (x[2] - 2.0 * x[3] + x[4])
    jerk = rate * rate * rate * (x[1] - 3.0 * (x[2] - x[3]) - x[4])
    speed = v[4] + model.settling * acceleration - rate * (x[3] - x[4])
    turning = rate * (v[3] - v[4]) + model.settling * jerk - acceleration
    speed = without_slow_part(s, 0, speed, period)
    jerk = without_slow_part(s, 1, jerk, period)
    friction = without_slow_part(s, 2, rate * (f[3] - f[4]), period)
    turning = without_slow_part(s, 3, turning, period)
    s.drive_train_wait += 1
    if s.drive_train_wait >= EVERY and s.undisturbed_s > UNDISTURBED and abs(jerk) > p.loud_jerk:
        s.drive_train_wait = 0
        weigh_drive_train(
            p, model, s, speed, model.mass * model.compliance * jerk, model.compliance * friction,
            -model.drive_damping * model.compliance * turning, EVERY * period,
        )


@compiled
def follow_drive_train(model, s, period):
    """Let the plan follow what is learned, where it differs clearly from the file and the current is not late."""
    if s.far_voltage_power > EXCITED * EXCITED:
        share = model.resistance * s.learned[0] * s.far_answers[s.lag] / s.far_voltage_power
        s.followed_share += period / FOLLOWED_TIME * (share - s.followed_share)
    c, found = s.drive_train_covariance, s.drive_train
    part = period / APPLY_TIME
    if plan_known(s) and abs(found[RESONANCE] - 1.0) > SLACK:
        s.drive_train_swing += part * (found[RESONANCE] - s.drive_train_swing)
        s.drive_train_softness += part * (max(found[FRICTION], 0.0) - s.drive_train_softness)
    elif c[RESONANCE, RESONANCE] >= SPREADS[RESONANCE] * SPREADS[RESONANCE]:
        s.drive_train_swing += part * (1.0 - s.drive_train_swing)
        s.drive_train_softness += part * (1.0 - s.drive_train_softness)


@compiled
def without_slow_part(s, k, value, period):
    """``value`` behind the high pass, ``k``-th of `slow_parts`."""
    s.slow_parts[k] += period * SLOW * (value - s.slow_parts[k])
    return value - s.slow_parts[k]


@compiled
def weigh_drive_train(p, model, s, speed, inertial, frictional, damped, since):
    """One step of the Kalman filter: ``speed`` [m/s] by the three parts of it that the file's numbers make [m/s],
    ``since`` [s] after the one before."""
    c, found = s.drive_train_covariance, s.drive_train
    for j in range(3):
        c[j, j] += SPREADS[j] * SPREADS[j] * since / CHANGE_TIME
    g0 = c[0, 0] * inertial + c[0, 1] * frictional + c[0, 2] * damped
    g1 = c[0, 1] * inertial + c[1, 1] * frictional + c[1, 2] * damped
    g2 = c[0, 2] * inertial + c[1, 2] * frictional + c[2, 2] * damped
    volts, square = p.filtered_variance, s.voltage_noise / model.volts_per_velocity
    noise = CORRELATED * (volts[0] * square * square + volts[1] + volts[2] * found[0] * found[0])
    noise += SHARE * SHARE * speed * speed + OWN_LAW * OWN_LAW * frictional * frictional
    part = 1.0 / (inertial * g0 + frictional * g1 + damped * g2 + noise)
    innovation = speed - found[0] * inertial - found[1] * frictional - found[2] * damped
    s.drive_train_test += TESTED * (part * innovation * innovation - s.drive_train_test)
    beyond = part * innovation
    found[0] += beyond * g0
    found[1] += beyond * g1
    found[2] += beyond * g2
    c[0, 0] -= part * g0 * g0
    c[0, 1] -= part * g0 * g1
    c[0, 2] -= part * g0 * g2
    c[1, 1] -= part * g1 * g1
    c[1, 2] -= part * g1 * g2
    c[2, 2] -= part * g2 * g2
    if plan_known(s):
        s.held_doubt = doubt_for(p, heaviest(s))


@compiled
def heaviest(s):
    """Upper bound of the stage's mass over the file's, m/K over 1/K, by `UPPER` standard deviations."""
    c, found = s.drive_train_covariance, s.drive_train
    softness = max(found[FRICTION], 1.0)
    spread = c[RESONANCE, RESONANCE] / found[RESONANCE] ** 2 + c[FRICTION, FRICTION] / softness**2
    return found[RESONANCE] / softness * (1.0 + UPPER * math.sqrt(spread + VARIES * VARIES))


@compiled
def doubt_for(p, mass):
    """`held_doubts` between its masses, linear; ``mass`` over the file's [1]."""
    k = 1
    while k < len(HEAVIER) - 1 and mass > HEAVIER[k]:
        k += 1
    share = min(max((mass - HEAVIER[k - 1]) / (HEAVIER[k] - HEAVIER[k - 1]), 0.0), 1.0)
    return p.held_doubts[k - 1] + share * (p.held_doubts[k] - p.held_doubts[k - 1])


def design_filters(record, model, period):
    """Fill rate [1/s], least jerk [m/s^3] and variances (3,) of `PARAMETERS` into an observer ``record`` for the
    feed-forward ``model`` and the ``period`` [s].

    White noise of variance q per period behind four filters of the rate r has the variance (5/32) r h q; its first
    derivative r^2/32 r h q, its third (5/32) r^6 r h q (integrals of w^2k / (1 + w^2)^4). The variances are those of
    the voltage's noise, per (m/s)^2 of it, of the encoder's in dx/dt, and of the encoder's in (m/K) d^3x/dt^3
    [m^2/s^2].
    """
    rate = min(RATE, LARGEST_SHARE / period)
    square = (NOISE * float(record["encoder_noise"])) ** 2 * rate * period
    jerk = math.sqrt(5.0 / 32.0 * rate**6 * square)
    per_jerk = float(model["mass"]) * float(model["compliance"])
    record["filter_rate"], record["loud_jerk"] = rate, LOUD * jerk
    record["filtered_variance"] = 5.0 / 32.0 * rate * period, rate**2 / 32.0 * square, (per_jerk * jerk) ** 2
