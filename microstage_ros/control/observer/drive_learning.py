"""What the observer learns about the drive while it runs: delay, resistance, zero, motor constant.

The back-EMF speed leans on the voltage that was applied and on three numbers that change: the resistance
warms up, the amplifier has a gain and a zero, the motor constant spreads. Encoder and back-EMF see the same
motion, so what they disagree on tells (compiled parts of `observer_law`).
"""

import math

from microstage_ros.control.observer.long_delay import LEAST, far_voltage, keep_far_voltage
from microstage_ros.control.observer.motion_filter import along_motion
from microstage_ros.control.observer.wind_up import wind_up_step
from microstage_ros.numerics.compiled import compiled
from microstage_ros.signals.current import settled

PEAK_TIME = 1e-2  # s, memory of the largest innovation of the position
PEAK_LIMIT = 5.0  # doubts in the encoder beyond which something goes on that is not the drive (backlash, an impact)
LAGS = 4  # periods, longest delay of the voltage that a glance tells; `long_delay` finds longer ones
EXCITED = 1e-6  # V^2, mean square of voltage steps that tells the delay: 1 mV rms
LAG_LIMIT = 2.0  # doubts in the voltage that its rms steps are beyond when they tell of another delay
LAG_LEAST = 0.3  # share of the current's steps that follow the voltage of another delay at least
# correlation of the two that another delay must have beyond the present one: four standard deviations of the difference
LAG_CLEAR = 0.4
LAG_CONFIRMED = 0.8  # share of the current's steps that follow the voltage of one delay, once that is sure
CHANGE_LIMIT = 4.0  # doubts in the voltage that a step of it is beyond when the drive has changed
RARE = 6.0  # and rms steps of late
WINDING = 0.1  # share of a change of voltage that the current may follow in another way
RESTLESS_TIME = 0.1  # s, memory of these
STEADY_TIME = 2e-2  # s, for which all has been explained before: a first move with a drive not yet known has no steps
APPLY_TIME = 0.1  # s, in which the controller follows what is learned
SLACK, ZERO_SLACK = 0.05, 1e-2  # 1, V, up to which it does not
STRAY_TIME, LONG_TIME = 5e-3, 0.1  # s, memory of a position that stays beside the encoder, at rest and in motion
ASTRAY, LONG_ASTRAY = 0.8, 1.5  # doubts in the encoder by which it may
REST_TIME = 0.3  # s, for which the reference stands when the axis is surely at rest
NOISE_TIME = 0.3  # s, memory of the noise in the voltage behind the back-EMF
FIRST_TIME = 1e-2  # s, shortest memory of it, at the start
OUTLIER = 9.0  # variances, at which a square is cut: a change of the drive is no noise
# doubt in that voltage over its noise, as in the shipped figures: the filter's own model is not exact either
NOISE_DOUBT = 1.95
LOUD = 3.0  # times the shipped doubt, beyond which the found one also says what a sudden change is
WORTH = 3e-3  # A, noise of the current at which the voltage tells the force as well
BIASED = 2e-3  # A, noise of the current beyond which R is no longer learned from the measured one
FARTHEST = 2.0  # standard deviations from nominal to which R is learned from a noisy current
KNOWN = 0.03  # standard deviation of R by the bins of `dead_band` with which it counts
BINNED = 0.05  # of nominal, by which the learned R may then differ from it
GAIN_SPREAD = 1.0  # standard deviation of gain over former gain after a change
ZERO_SPREAD = 0.03  # V, of the amplifier's zero after a change


@compiled
def forget_drive(p, s):
    """Nominal R and zero, the back-EMF of the motor constant that was found, with all their doubt."""
    s.learned[0] = 1.0
    s.learned[1] = 0.0
    s.learned[2] = s.emf_centre
    s.learned_covariance[:] = 0.0
    s.learned_covariance[0, 0] = p.resistance_spread * p.resistance_spread
    s.learned_covariance[1, 1] = p.zero_spread * p.zero_spread
    s.learned_covariance[2, 2] = p.emf_spread * p.emf_spread
    s.shift[:] = 0.0
    s.innovation_peak_m = 0.0
    s.strayed = 0.0


@compiled
def keep_voltage(s, voltage):
    """Remember the ``voltage`` [V] of the newest period."""
    for j in range(LAGS, 0, -1):
        s.voltages[j] = s.voltages[j - 1]
    s.voltages[0] = voltage
    keep_far_voltage(s, voltage)
    s.answered = voltage if s.lag == 0 else far_voltage(s, s.lag)


@compiled
def speed_innovation(model, s, drop):
    """Speed [m/s] by the voltage of the found delay less R i = ``drop`` [V], less the predicted one."""
    motor = s.v + s.wind_up_speed
    return (s.answered - s.learned[0] * drop - s.learned[1]) / model.volts_per_velocity - s.learned[2] * motor


@compiled
def compare_voltage(model, s, drop):
    """Keep what R i = ``drop`` [V] and speed call for beyond the applied voltage [V]."""
    s.unexplained = -model.volts_per_velocity * speed_innovation(model, s, drop)
    s.drop = drop
    s.speed = s.v


@compiled
def drive_changed(p, model, s, period, drop, repeats):
    """Whether current and speed call for another voltage than the applied one all of a sudden.

    Readings that ``repeats`` those of the period before to the last bit are lost ones, and say nothing.

    Nothing but the drive itself can do that: a force on the motor takes many periods, since it has to turn the rotor
    first. Only the planned wind-up may change at once (`wind_up`); masses follow it later.
    """
    low, high = min(s.voltages), max(s.voltages)
    if s.lag > LAGS:
        for j in range(LAGS):
            low, high = min(low, far_voltage(s, s.lag - j)), max(high, far_voltage(s, s.lag - j))
    power = s.far_voltage_power
    confirmed = s.far_answers[s.lag] * model.resistance * s.learned[0] > LAG_CONFIRMED * power and power > EXCITED
    unsettled = (WINDING if confirmed else 1.0) * (high - low)
    unsettled += wind_up_step(model, s)
    before = s.unexplained
    expected = voltage_variance(model, s, drop - s.drop, s.v - s.speed, 0.0)
    compare_voltage(model, s, drop)
    now, step = s.unexplained, s.unexplained - before
    shipped = s.voltage_factor * p.voltage_noise
    noise = s.voltage_noise if s.voltage_noise > LOUD * shipped else shipped
    doubt = max(CHANGE_LIMIT * CHANGE_LIMIT * noise * noise, RARE * RARE * s.restless) + unsettled * unsettled
    sudden = step * step > doubt + CHANGE_LIMIT * CHANGE_LIMIT * expected
    beyond = now * now > doubt + CHANGE_LIMIT * CHANGE_LIMIT * voltage_variance(model, s, drop, s.v, 1.0)
    s.since += period
    if sudden and beyond and not repeats and (s.steady > STEADY_TIME or s.changes > 0 and s.since < 3.5 * period):
        s.steady = 0.0
        return True
    learn_noise(p, s, step, period)
    steady = now * now < doubt and s.innovation_peak_m < PEAK_LIMIT * s.encoder_noise
    s.steady = s.steady + period if steady else 0.0
    memory = RESTLESS_TIME if s.changes > 0 else min(RESTLESS_TIME, s.since)
    s.restless += period / max(memory, period) * (step * step - s.restless)
    return False


@compiled
def learn_noise(p, s, step, period):
    """Noise of the voltage behind the back-EMF, from a ``step`` [V] of what is unexplained.

    Two steps in a row, e_n - e_(n-1) and e_(n-1) - e_(n-2), have the mean product -sigma^2 if e is white; a model's
    error, which changes slowly, or once, adds nothing to it.
    """
    s.running += period
    most, least = OUTLIER * s.noise_variance, (p.voltage_noise / NOISE_DOUBT) ** 2
    square = min(max(-step * s.last_step, -most), most)
    s.last_step = step
    s.noise_variance += period / min(max(s.running, FIRST_TIME), NOISE_TIME) * (square - s.noise_variance)
    s.noise_variance = max(s.noise_variance, least)
    s.voltage_noise = s.voltage_factor * max(p.voltage_noise, NOISE_DOUBT * math.sqrt(s.noise_variance))


@compiled
def current_variance(p, model, s):
    """Variance [A^2] of the measured current: what was found beyond the amplifier's noise, over R; 0 or less: none."""
    found = s.voltage_noise / s.voltage_factor
    excess = found * found - p.voltage_noise * p.voltage_noise
    return excess / (NOISE_DOUBT * NOISE_DOUBT * model.resistance * model.resistance)


@compiled
def drop_to_learn(p, model, s, drop, used):
    """R i [V] from which R is learned: ``drop`` of the measured current, or of the weighed one, ``used`` [A], if noisy.

    The noise of a measured current, times itself, teaches too small an R (errors in variables); the weighed one leans
    on the model that is to be learned. Lost samples and dead bands look like up to 1.4 mA of noise.
    """
    return model.resistance * used if current_variance(p, model, s) > BIASED * BIASED else drop


@compiled
def weighed_current(p, model, s, current):
    """Current [A] for the driving force: the measured one as far as it is worth more than what voltage and speed say.

    Both are weighed by their variances.
    """
    noise = current_variance(p, model, s)
    if noise <= 0.0:
        return current
    motion = s.learned[1] + s.learned[2] * model.volts_per_velocity * s.v
    expected = (s.answered - motion) / (model.resistance * s.learned[0])
    return expected + WORTH * WORTH / (WORTH * WORTH + noise) * (current - expected)


@compiled
def relearn(p, model, s, drop):
    """After a change of the drive: any gain or zero is possible again, and the newest speed tells which.

    The motion was not led astray by it so far: the voltage is wrong since this period only.
    """
    for k in range(0, 3, 2):
        for j in range(k, 3, 2):
            s.learned_covariance[k, j] += GAIN_SPREAD * GAIN_SPREAD * s.learned[k] * s.learned[j]
    s.learned_covariance[1, 1] += ZERO_SPREAD * ZERO_SPREAD
    s.shift[:] = 0.0
    s.innovation_peak_m = 0.0
    s.strayed = 0.0
    for k in range(3):
        s.of_speed[k] = direct_effect(model, s, drop, k)
    noise = p.voltage_noise / model.volts_per_velocity
    take_in(s, s.of_speed, s.of_position, speed_innovation(model, s, drop), noise * noise)
    bound_learned(p, s)


@compiled
def direct_effect(model, s, drop, k):
    """Change of the speed's innovation per unit error of what is learned, ``k``-th of R, zero, back-EMF."""
    return drop / model.volts_per_velocity if k == 0 else (1.0 / model.volts_per_velocity if k == 1 else s.v)


@compiled
def apply_learned(p, s, period):
    """Let the drive that the controller counts with follow the learned one.

    At once after a change; else, while all is steady, to within what sliding one way for long leads the learned one
    astray.
    """
    fresh = s.changes > 0 and s.since < STEADY_TIME
    share = min(period / APPLY_TIME, 1.0) * trust_in_speed(s, s.restless) if s.steady > STEADY_TIME else 0.0
    for k in range(3):
        off = s.learned[k] - s.applied[k]
        slack = ZERO_SLACK if k == 1 else SLACK
        s.applied[k] += off if fresh else share * (off - min(max(off, -slack), slack))


@compiled
def drive_voltage(s, drop, motion):
    """Voltage [V] that gives the axis what R i = ``drop`` [V] and E v = ``motion`` [V] would give it by the nominal
    drive."""
    return s.applied[0] * drop + s.applied[1] + s.applied[2] * motion


@compiled
def bound_learned(p, s):
    """Keep what is learned within what a drive can be."""
    s.learned[0] = min(max(s.learned[0], 0.3), 3.0)
    s.learned[1] = min(max(s.learned[1], -1.0), 1.0)
    # a gain of the amplifier looks like both R and back-EMF, a warm winding like R alone; the motor itself hardly
    # changes
    low, high = min(s.learned[0], 1.0), max(s.learned[0], 1.0)
    s.learned[2] = min(
        max(s.learned[2], s.emf_centre * low * (1.0 - p.emf_spread)), s.emf_centre * high * (1.0 + p.emf_spread)
    )


@compiled
def find_lag(p, model, s):
    """Which past voltage the current follows. True if it is another one than before.

    At rest the loop's steps of voltage are no larger than the amplifier's noise, and any delay may seem to fit for a
    while. A long delay has been clearer than every short one for a time, and needs no further proof against those.
    """
    best = s.lag
    if s.delayed == 1:
        best = s.delay
    else:
        for j in range(LAGS + 1):
            if s.far_answers[j] > 1.5 * s.far_answers[best]:
                best = j
    if best == s.lag:
        return False
    restored = s.changes == 0 or s.since > STEADY_TIME  # what a change of the drive shakes says nothing of the delay
    excited = s.far_voltage_power > LAG_LIMIT * LAG_LIMIT * p.voltage_noise * p.voltage_noise
    proven = s.delayed == 1 and s.lag < LEAST
    clear = 0.0 if proven else LAG_CLEAR * math.sqrt(s.far_voltage_power * s.far_current_power)
    if (
        not excited
        or s.far_answers[best] - s.far_answers[s.lag] < clear
        or not restored
        or s.far_answers[best] * model.resistance * s.learned[0] < LAG_LEAST * s.far_voltage_power
    ):
        return False
    s.lag = best
    s.answered = far_voltage(s, best)
    return True


@compiled
def settled_drop(p, model, s, current):
    """R i [V] by the nominal R, of the current at the end of the period without its last transient."""
    return model.resistance * settled(current, s.current, p.transient)


@compiled
def learn_drive(p, model, s, period, drop, position, speed, unread):
    """Learn R, the amplifier's zero and the back-EMF from the innovations of position [m] and speed [m/s].

    Friedland's two-stage filter: ``shift`` is how far a wrong R (or zero) has led x, v and d astray, so both
    innovations are known multiples of that error. Takes the learned part out of x, v, d. ``unread`` [V^2]:
    `motor_constant.unread_variance`.
    """
    noise_x = s.encoder_noise * s.encoder_noise
    noise_v = speed_variance(s, model, unread)
    # while the encoder is far beyond its noise, something else is going on (backlash, an impact): learn less
    s.innovation_peak_m = max(abs(position), s.innovation_peak_m * (1.0 - min(period / PEAK_TIME, 1.0)))
    doubt = max(1.0, s.innovation_peak_m / (PEAK_LIMIT * s.encoder_noise))
    noise_x *= doubt * doubt
    noise_v *= doubt * doubt
    doubt_drive(p, s, period, position)
    follow_shift(model, s, period, drop)
    for k in range(3):
        spread = p.resistance_spread if k == 0 else (p.zero_spread if k == 1 else p.emf_spread)
        s.learned_covariance[k, k] += spread * spread * period / (p.zero_time if k == 1 else p.forgetting_time)
    before = s.learned[0]
    speed -= take_in(s, s.of_position, s.of_speed, position, noise_x)
    take_in(s, s.of_speed, s.of_position, speed, noise_v)
    bound_learned(p, s)
    if current_variance(p, model, s) > BIASED * BIASED:  # the weighed current follows R: nothing holds it any more
        known = s.binned_spread < KNOWN
        centre, far = (s.binned_resistance, BINNED) if known else (1.0, FARTHEST * p.resistance_spread)
        s.learned[0] = min(max(s.learned[0], min(centre - far, before)), max(centre + far, before))


@compiled
def doubt_drive(p, s, period, position):
    """While the estimated position stays beside the encoder, R or zero have changed by too little to be noticed at
    once.

    Noise has no mean: the innovation ``position`` [m], averaged, lies within a count of zero as long as the drive is
    known. In motion it takes longer to say, since a gap that opens looks the same until it is noticed.
    """
    rests = s.rest_time_s > REST_TIME
    memory, bound = (STRAY_TIME, ASTRAY) if rests else (LONG_TIME, LONG_ASTRAY)
    s.strayed += min(period / memory, 1.0) * (position - s.strayed)
    beyond = abs(s.strayed) / s.encoder_noise - bound
    if beyond > 0.0:
        part = min(beyond, 1.0) * period / memory
        s.learned_covariance[0, 0] += part * p.resistance_spread * p.resistance_spread
        s.learned_covariance[1, 1] += part * ZERO_SPREAD * ZERO_SPREAD


@compiled
def follow_shift(model, s, period, drop):
    """One period of ``shift``, and by how much each innovation changes per unit error of what is learned."""
    for k in range(3):
        shift = s.shift[k]
        along_motion(s, shift, period)
        s.of_position[k] = -shift[0]
        s.of_speed[k] = direct_effect(model, s, drop, k) - shift[1]
        for j in range(3):
            shift[j] += s.gain[j, 0] * s.of_position[k] + s.gain[j, 1] * s.of_speed[k]


@compiled
def take_in(s, along, other, innovation, noise):
    """Scalar Kalman step of what is learned: ``innovation`` = along . error + noise of that variance.

    Returns by how much the innovation that goes with ``other`` becomes smaller.
    """
    c = s.learned_covariance
    g0 = c[0, 0] * along[0] + c[0, 1] * along[1] + c[0, 2] * along[2]
    g1 = c[0, 1] * along[0] + c[1, 1] * along[1] + c[1, 2] * along[2]
    g2 = c[0, 2] * along[0] + c[1, 2] * along[1] + c[2, 2] * along[2]
    part = 1.0 / (along[0] * g0 + along[1] * g1 + along[2] * g2 + noise)
    c[0, 0] -= part * g0 * g0
    c[0, 1] -= part * g0 * g1
    c[0, 2] -= part * g0 * g2
    c[1, 1] -= part * g1 * g1
    c[1, 2] -= part * g1 * g2
    c[2, 2] -= part * g2 * g2
    part *= innovation
    s.learned[0] += part * g0
    s.learned[1] += part * g1
    s.learned[2] += part * g2
    s.x -= part * (g0 * s.shift[0, 0] + g1 * s.shift[1, 0] + g2 * s.shift[2, 0])
    s.v -= part * (g0 * s.shift[0, 1] + g1 * s.shift[1, 1] + g2 * s.shift[2, 1])
    s.d -= part * (g0 * s.shift[0, 2] + g1 * s.shift[1, 2] + g2 * s.shift[2, 2])
    return part * (g0 * other[0] + g1 * other[1] + g2 * other[2])


@compiled
def trust_in_speed(s, variance):
    """1 if the back-EMF is as good as the amplifier's noise, towards 0 while R and zero are not known:
    `voltage_variance`."""
    noise = s.voltage_noise * s.voltage_noise
    return noise / (noise + variance)


@compiled
def speed_variance(s, model, variance):
    """Variance [m^2/s^2] of the back-EMF's speed: the noise that was found and ``variance`` [V^2] of
    `voltage_variance`."""
    return (s.voltage_noise * s.voltage_noise + variance) / (model.volts_per_velocity * model.volts_per_velocity)


@compiled
def voltage_variance(model, s, drop, speed, zero):
    """Variance [V^2] that R, zero and back-EMF leave in R i + zero o + E v, R i = ``drop`` [V], v = ``speed`` [m/s]."""
    c, emf = s.learned_covariance, model.volts_per_velocity * speed
    found = c[0, 0] * drop * drop + c[1, 1] * zero * zero + c[2, 2] * emf * emf
    return max(found + 2.0 * (c[0, 1] * drop * zero + c[0, 2] * drop * emf + c[1, 2] * emf * zero), 0.0)
