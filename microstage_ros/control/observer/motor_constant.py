"""The motor constant where it is far from the file's (compiled parts of `observer_law`).

R, zero and back-EMF are learned from innovations within the spreads that a motor's data sheet allows
(`drive_learning`). A constant that is 1.3 times the file's lies beyond them, and the filter then takes its back-EMF
for motion. But at speed it can be read off without any model of the motion: through the same filter of first order,

    E = (u − R i − o) / (K_E (N/r) v),        u voltage, i current, v speed of the encoder, o zero of the amplifier

Where v has been beyond `FAST` and E within `STEADY` of its mean for `FOUND_TIME`, and the mean is further from what is
learned than `LEAST`, `DEVIATIONS` standard deviations (R and o are not known either) and `UNTOLD`, it becomes the
centre of what is allowed. R, o and the level of the friction are those of the last motion below `SLOW`, which a wrong
constant does not lead astray; the motion begins anew from encoder and back-EMF. The slow motion through a gap, where
the motor turns alone, is never that fast so long. A voltage that changes may come late: `LATE` times its rate is added
to what R and o leave.

Where the constant has not been read, or where E differs from what is learned for `SHORTEST` but says too little to be
taken over, the variance of the back-EMF's speed grows by `UNREAD_DOUBT` or that difference (`unread_variance`), and the
encoder leads meanwhile.
"""

import math

from microstage_ros.control.observer.drive_learning import BIASED, current_variance, voltage_variance
from microstage_ros.control.observer.inertia import weigh_anew
from microstage_ros.model.friction.curve import COULOMB
from microstage_ros.numerics.compiled import compiled

FILTER_TIME = 3e-3  # s, of both sides: slower than the drive train's resonance and the winding
MEAN_TIME = 1e-2  # s, of the ratio
FAST, SLOW = 2e-4, 2e-5  # m/s
STEADY = 0.04  # 1
FOUND_TIME = 1.2e-2  # s
PLAIN_SHARE = 0.08  # from what is learned, beyond which it is found the sooner: its loop begins to swing meanwhile
SHORTEST = 5e-3  # s: longer than half a swing of a stage of thrice the mass on a third of the stiffness
LEAST, DEVIATIONS = 0.04, 4.0  # 1, standard deviations of what R and o leave
UNTOLD = 0.06  # V, that a dead band or a zero that has moved may take: of the back-EMF less than this says nothing
LATE = 1e-3  # s, by which a voltage may come late under this law: what it changes by meanwhile is no back-EMF
UNREAD, LEAST_DOUBT = 0.05, 1e-5  # of the speed that was astray, m/s: what the reading leaves
# 1, standard deviation of the constant before it is read, by `robustness` and moves of 1 to 100 um with 1.2 times the
# constant (docs/evidence/control.md): 0.17 um astray with 0.03, 0.28 with 0.015; with 0.1 light rotors hand over
UNREAD_DOUBT = 0.03
LOWEST, HIGHEST = 0.3, 3.0  # of the constant over the file's
FIELDS = [
    ("emf_centre", "f8"),  # 1, motor constant over the file's, about which it is learned
    ("emf_speed", "f8"),  # m/s, of the motor by its back-EMF, filtered
    ("encoder_speed", "f8"),  # m/s, filtered in the same way
    ("emf_before", "f8"),  # m/s, of the motor at the end of the period before
    ("emf_voltage", "f8"),  # V, filtered in the same way
    ("emf_ratio", "f8"),  # 1, mean of the one over the other
    ("emf_doubt", "f8"),  # 1, standard deviation of the constant, beside what its covariance says
    ("emf_ratio_time_s", "f8"),  # s, for which the ratio has been near its mean
    ("slow_resistance", "f8"),  # 1, R over the file's as it was learned in slow motion
    ("slow_zero_V", "f8"),  # zero of the amplifier, likewise
    ("slow_variance_V2", "f8"),  # of both together
    ("slow_level", "f8"),  # 1, level of the friction, likewise
]


@compiled
def motor_constant_reset(s):
    """The file's number."""
    s.emf_centre = 1.0
    s.emf_speed = 0.0
    s.encoder_speed = 0.0
    s.emf_before = 0.0
    s.emf_voltage = 0.0
    s.emf_ratio = 1.0
    s.emf_doubt = UNREAD_DOUBT
    s.emf_ratio_time_s = 0.0
    s.slow_resistance = 1.0
    s.slow_zero_V = 0.0
    s.slow_variance_V2 = 0.0
    s.slow_level = 1.0


@compiled
def watch_motor_constant(p, model, s, period, drop, speed):
    """One period in contact: R i = ``drop`` [V], ``speed`` [m/s] of the encoder.

    Returns True if the constant was found elsewhere.
    """
    share = min(period / FILTER_TIME, 1.0)
    turning = (s.answered - s.slow_resistance * drop - s.slow_zero_V) / model.volts_per_velocity
    s.emf_speed += share * (0.5 * (turning + s.emf_before) - s.emf_speed)      # the encoder's speed is a period's mean
    s.emf_before = turning
    s.emf_voltage += share * (s.answered - s.emf_voltage)
    s.encoder_speed += share * (speed - s.encoder_speed)
    size = abs(s.encoder_speed)
    if size < SLOW:
        s.slow_resistance, s.slow_zero_V, s.slow_level = s.learned[0], s.learned[1], s.level
        s.slow_variance_V2 = voltage_variance(model, s, model.volts_per_torque * model.actuator[COULOMB], 0.0, 1.0)
    if size < FAST:
        s.emf_ratio_time_s = 0.0
        return False
    ratio = s.emf_speed / s.encoder_speed
    if s.emf_ratio_time_s == 0.0 or abs(ratio - s.emf_ratio) > STEADY * max(1.0, abs(ratio)):
        s.emf_ratio, s.emf_ratio_time_s = ratio, 0.0
    s.emf_ratio += min(period / MEAN_TIME, 1.0) * (ratio - s.emf_ratio)
    s.emf_ratio_time_s += period
    off, emf = s.emf_ratio - s.learned[2], model.volts_per_velocity * size
    doubt = DEVIATIONS * math.sqrt(s.slow_variance_V2)
    late = LATE * abs(s.answered - s.emf_voltage) / FILTER_TIME
    if s.emf_ratio_time_s >= SHORTEST:
        if abs(off) < LEAST:
            s.emf_doubt = 0.0
        elif abs(off) * emf > doubt + late:
            s.emf_doubt = abs(off)
    clear = current_variance(p, model, s) < BIASED * BIASED
    plain = PLAIN_SHARE / max(abs(off), PLAIN_SHARE) if clear else 1.0
    if s.emf_ratio_time_s < max(FOUND_TIME * plain, SHORTEST):
        return False
    if abs(off) < max(LEAST, (max(doubt, UNTOLD) + late) / emf):
        return False
    s.emf_doubt = 0.0
    s.emf_ratio_time_s = 0.0
    centre_on(p, s, min(max(s.emf_ratio, LOWEST), HIGHEST))
    # the motion was led astray meanwhile: it begins anew from both readings
    s.v = (s.answered - s.learned[0] * drop - s.learned[1]) / (s.learned[2] * model.volts_per_velocity)
    change = s.read - s.swing - s.x
    s.x += change
    s.screw += change
    c = s.covariance
    c[0, 0] = p.encoder_noise * p.encoder_noise
    c[0, 1] = c[0, 2] = c[1, 2] = 0.0
    c[1, 1] = (UNREAD * off * size) ** 2 + LEAST_DOUBT * LEAST_DOUBT
    c[2, 2] += s.d * s.d
    return True


@compiled
def unread_variance(model, s):
    """Variance [V^2] of the back-EMF while the constant has not been read off, or differs from what is counted with.

    Where both speeds agree while the inertia is doubted (`inertia_doubt`), no more than they differ by.
    """
    doubt = abs(s.emf_doubt * s.v)
    if s.inertial_doubt > 0.0:
        doubt = min(doubt, abs(s.speed_difference[1]))
    return (doubt * model.volts_per_velocity) ** 2


@compiled
def centre_on(p, s, centre):
    """Learn about another ``centre`` [1] from now on."""
    weigh_anew(s, centre / s.emf_centre)
    s.emf_centre = centre
    s.learned[0], s.learned[1], s.learned[2] = s.slow_resistance, s.slow_zero_V, centre
    s.level = s.slow_level
    c = s.learned_covariance
    c[0, 2] = c[1, 2] = 0.0
    c[2, 2] = p.emf_spread * p.emf_spread
    s.shift[:] = 0.0
    s.innovation_peak_m = 0.0
    s.strayed = 0.0
    s.variance = max(s.variance, p.level_variability * p.level_variability)
