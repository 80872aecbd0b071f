"""What the doubt in the inertia leaves of an acceleration (compiled parts of `observer_law`).

Until the inertia is known, the prediction moves a wrong mass: the acceleration of the axis is off by

    b = q |a|,      q^2 = var(J) / J^2 + (1 - J / J_c)^2,      q at most 1,

with the reference's acceleration a, the inertia J that is learned and J_c that is counted with (`inertia`). The walk of
d is far slower than a profile, the estimated speed lags, and with it the stage. So while the reference accelerates, d
walks by b within `DRIFT_TIME`, as a Gauss-Markov disturbance of that size does from its start,

    dP_dd/dt = 2 b^2 / `DRIFT_TIME`

(Gelb, "Applied Optimal Estimation", MIT Press 1974, ch. 3), and the level, which would take the force of the inertia
for friction, doubts M b more of d (`friction_level`).

A filter that wide takes a wrong back-EMF for motion. So this is done only where the back-EMF's speed is that of the
encoder, both through two filters of `DIFFER_TIME`, within `AGREE` + `SHARE` of the speed; and where the motor constant
has not been read yet, only at a speed of which `AGREE` is less than the share `SIGNIFICANT`, so that agreement says
something. The back-EMF is doubted by no more than they differ meanwhile (`motor_constant.unread_variance`). Where they
part by more than noise does now and then, `DISAGREE` + `SHARE` of the speed, what d has taken in since goes: d and its
variance are those of before, and nothing is doubted until the next acceleration.

A voltage that is doubted (`source_doubt`) leaves such a filter to the encoder, and the loop swings: b is divided by
that doubt.
"""

import math

from microstage_ros.numerics.compiled import compiled

# calibrated with `robustness --only NAME`, rotor inertias, motor and torque constants (docs/evidence/control.md)
PLAN_TIME = 1e-3  # s, filter of the reference's acceleration
STANDING = 5e-3  # m/s^2, of it that does not count
STEADY = 1e-3  # m/s^2, of it: a sine of 10 um and 0.1 Hz has 4 um/s^2, the profile of a move 10 mm/s^2 and more
DRIFT_TIME = 2e-2  # s
DIFFER_TIME = 1.5e-3  # s, of each of two filters
AGREE, SHARE = 4e-6, 0.03  # m/s; 1, as a motor constant that has not been read is doubted (`motor_constant`)
DISAGREE = 6e-6  # m/s; beyond `AGREE` by chance in 3 of 40 first accelerations of half the rotor's inertia
SIGNIFICANT = 0.1  # 1, of the speed
FIELDS = [
    ("planned_acceleration", "f8"),  # m/s^2, of the reference, filtered
    ("steady_time_s", "f8"),  # s, for which the reference has hardly accelerated
    ("inertial_doubt", "f8"),  # m/s^2, b; 0 where it is not counted with
    ("speed_difference", "f8", 2),  # m/s, speed by the back-EMF beyond the encoder's, filtered once and twice
    ("turning", "f8"),  # m/s, speed by the back-EMF, a period before
    ("refused", "i8"),  # 1: these two have differed in this acceleration
    ("d_before", "f8"),  # m/s^2, d as the doubt began
    ("d_variance_before", "f8"),  # m^2/s^4
]


@compiled
def inertia_doubt_reset(s):
    """Nothing is planned; the reference has stood for a second."""
    s.steady_time_s = 1.0
    s.planned_acceleration = s.inertial_doubt = s.turning = 0.0
    s.speed_difference[:] = 0.0
    s.refused = 0
    s.d_before = s.d_variance_before = 0.0


@compiled
def plan_acceleration(s, period, gained):
    """Take in what the reference's speed has ``gained`` [m/s] in this period."""
    s.planned_acceleration += min(period / PLAN_TIME, 1.0) * (gained / period - s.planned_acceleration)
    s.steady_time_s = s.steady_time_s + period if abs(s.planned_acceleration) < STEADY else 0.0


@compiled
def compare_speeds(s, period, read_speed):
    """Take in the encoder's mean speed of this period, ``read_speed`` [m/s], beside that of the back-EMF."""
    share, turning = min(period / DIFFER_TIME, 1.0), s.emf_before / s.emf_centre - s.wind_up_speed
    s.speed_difference[1] += share * (s.speed_difference[0] - s.speed_difference[1])
    s.speed_difference[0] += share * (0.5 * (turning + s.turning) - read_speed - s.speed_difference[0])
    s.turning = turning


@compiled
def doubt_inertia(s, period, read_speed, doubtful):
    """One period of b. ``read_speed`` [m/s] of the encoder; ``doubtful``: drive and stage may be apart, or the
    loop swings."""
    compare_speeds(s, period, read_speed)
    strong = max(abs(s.planned_acceleration) - STANDING, 0.0)
    slowest = max(abs(s.v) - 2.0 * DIFFER_TIME * abs(s.planned_acceleration), 0.0)  # that the filters have still seen
    difference = abs(s.speed_difference[1]) - SHARE * slowest
    differ = doubtful or difference > AGREE
    significant = s.emf_doubt == 0.0 or AGREE < SIGNIFICANT * slowest
    before = s.inertial_doubt
    if strong == 0.0:
        s.refused = 0
    elif (doubtful or difference > DISAGREE) and significant:
        s.refused = 1
    counted_off = 1.0 - 1.0 / (s.rho * s.inertia)
    share = min(math.sqrt(s.rho_variance / (s.rho * s.rho) + counted_off * counted_off), 1.0)
    s.inertial_doubt = share * strong / s.voltage_factor if s.refused == 0 and significant and not differ else 0.0
    c = s.covariance
    if before == 0.0 and s.inertial_doubt > 0.0:
        s.d_before, s.d_variance_before = s.d, c[2, 2]
    if before > 0.0 and s.refused == 1:
        s.d, c[2, 2] = s.d_before, s.d_variance_before
        c[0, 2] = c[1, 2] = 0.0


@compiled
def drift_variance(s):
    """Density [m^2/s^5] of the walk of d that b makes."""
    return 2.0 * s.inertial_doubt * s.inertial_doubt / DRIFT_TIME
