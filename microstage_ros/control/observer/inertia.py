"""The moving inertia as the observer learns it (compiled parts of `observer_law`).

What the current gives beyond nominal friction, over the file's moving mass M, accelerates the axis, overcomes friction
of another level, and balances forces that do not turn with the motion:

    (F - F_f) / M = J a + l S / M + c + k (x - x_0),        S = dF_f/dl

with the inertia J over the file's, the level l beyond nominal, a constant c and a spring k. The acceleration a is that
of the encoder (not of the back-EMF, which a late voltage leads astray); a, F - F_f and S pass the same filter of
second order. While blocks slip and nothing swings a Kalman filter learns the four together. J alone is used; the
other three are what J would be taken for without them: a spring, in slow motion, for three times the inertia, friction
that falls with the speed for half of it. So l walks with the travel and with the logarithm of the speed, as the file's
curve is not quite the axis's. Simon, "Optimal State Estimation", Wiley 2006, ch. 5.

J moves in strong accelerations only, beyond `TELLS`: below, blocks that let go look like one; and where the motor
shares it, by the back-EMF: a stage that is struck in a gap accelerates without a force. Till then its doubt is kept
as it is, and counted with (Schmidt's consider filter; Simon, ch. 9.4). Noise is counted as `CORRELATED` long. The
regulator, the feed-forward and the observer's own prediction follow beyond `SLACK` and `CLEAR` standard deviations,
within `APPLY_TIME`, so that nothing jumps.
"""

import math

from microstage_ros.numerics.compiled import compiled

FILTER_TIME = 3e-3  # s, of all sides, twice: slower than the drive train's resonance
TELLS = 0.02  # m/s^2
TOGETHER = 0.5  # of a, by which the motor's may differ: a motor constant that has not been read yet
STEP_TIME = 1e-3  # s, between two steps of the filter: a third of what it looks through
NOISE = 3e-3  # m/s^2, of the balance: friction beyond its law, counts of the encoder
RELATIVE = 0.1  # of a: the drive's wind-up, a current that is off by its gain
CORRELATED = 6e-3  # s, over which these hang together
SPREADS = (0.5, 0.5, 1e-2, 50.0)  # standard deviations of J, l, c [m/s^2], k/M [1/s^2] at the start
LEVEL_WALK, CONSTANT_WALK, WALK_LENGTH = 0.06, 1e-3, 1e-4  # 1, m/s^2, of l and c within so many m of travel
SPEED_WALK, SLOWEST = 0.3, 1e-5  # 1, of l while the speed grows e-fold; m/s, slower is at rest
UNREAD = 0.8  # of the relative variance of J at the start
WEIGHED = 0.3  # least standard deviation over J, when the motor's constant was found elsewhere
SLACK = 0.15  # of the logarithm of the inertia, within which it is taken as the file says
CLEAR = 2.0  # standard deviations of the inertia, likewise
APPLY_TIME = 0.02  # s
LOWEST, HIGHEST = 0.15, 7.0  # times the file's
FIELDS = [
    ("rho", "f8"),  # 1, file's moving mass over the true one, 1/J
    ("rho_variance", "f8"),
    ("inertia", "f8"),  # 1, moving mass over the file's, as it is counted with
    ("balance", "f8", 4),  # J [1], l [1], c [m/s^2], k/M [1/s^2]
    ("balance_covariance", "f8", (4, 4)),  # of their errors; the upper triangle is kept
    ("balance_wait_s", "f8"),  # s, since the filter's last step
    ("balance_place", "f8"),  # m, where that was
    ("balance_speed", "f8"),  # 1, logarithm of the speed there
    ("balance_centre", "f8"),  # m, x_0
    ("net", "f8", 2),  # m/s^2, (F - F_f) / M filtered once and twice
    ("sliding", "f8", 2),  # m/s^2, S / M likewise
    ("stage_speed", "f8", 2),  # m/s, of the encoder, likewise
    ("motor_speed", "f8"),  # m/s, of the back-EMF (`motor_constant`), filtered twice
    ("net_before", "f8"),  # N, mean over the period before
    ("filtered_s", "f8"),  # s, for which all have been observed undisturbed
]


@compiled
def keep_inertia(s, inertia, variance):
    """J and its variance [1], within what a machine can be."""
    s.balance[0] = min(max(inertia, LOWEST), HIGHEST)
    s.balance_covariance[0, 0] = variance
    s.rho = 1.0 / s.balance[0]
    s.rho_variance = variance * s.rho ** 4


@compiled
def weigh_anew(s, factor):
    """The motor's constant is ``factor`` times what it was taken for: in SI units that of its torque too, so every
    ampere accelerates by so much more. Lower gains follow at once; higher ones wait for what accelerations say."""
    if factor <= 1.0:
        return
    c, found = s.balance_covariance, s.balance[0] / factor
    c[0, 1] = c[0, 2] = c[0, 3] = 0.0
    keep_inertia(s, found, max(c[0, 0] / (factor * factor), WEIGHED * WEIGHED * found * found))
    s.inertia = max(s.inertia / factor, LOWEST)


@compiled
def inertia_unread(s):
    """Whether the inertia is about as uncertain, over itself, as at the start."""
    return s.rho_variance > UNREAD * SPREADS[0] * SPREADS[0] * s.rho * s.rho


@compiled
def inertia_reset(s):
    """The file's number for the motor constant that was found, with all its doubt."""
    s.balance[:] = 0.0
    s.balance_covariance[:] = 0.0
    for j in range(1, 4):
        s.balance_covariance[j, j] = SPREADS[j] * SPREADS[j]
    keep_inertia(s, 1.0, SPREADS[0] * SPREADS[0])
    s.inertia = 1.0
    weigh_anew(s, s.emf_centre)
    s.balance_wait_s = 0.0
    s.balance_place = math.nan
    s.balance_speed = s.balance_centre = 0.0
    s.net[:] = 0.0
    s.sliding[:] = 0.0
    s.stage_speed[:] = 0.0
    s.motor_speed = 0.0
    s.filtered_s = 0.0
    s.net_before = 0.0


@compiled
def mean_net(s, parts):
    """Net force [N] that goes with the difference of the encoder's last two speeds: the mean over both periods.

    Where a period is one step of the prediction, ``parts`` = 1 [1], half of it is not worth the while.
    """
    if parts == 1:
        return s.net_force
    mean, before = s.net_force / parts, s.net_before
    s.net_before = mean
    return 0.5 * (mean + before)


@compiled
def walk_balance(s):
    """What level and constant may have become since the filter's last step."""
    speed = math.log(abs(s.stage_speed[1]) + SLOWEST)
    if math.isnan(s.balance_place):
        s.balance_place, s.balance_speed, s.balance_centre = s.x, speed, s.x
    travel = abs(s.x - s.balance_place) / WALK_LENGTH
    c = s.balance_covariance
    c[1, 1] += LEVEL_WALK * LEVEL_WALK * travel + SPEED_WALK * SPEED_WALK * abs(speed - s.balance_speed)
    c[2, 2] += CONSTANT_WALK * CONSTANT_WALK * travel
    s.balance_place, s.balance_speed = s.x, speed


@compiled
def weigh_balance(s, slope, motor, since):
    """One step of the filter, ``since`` [s] after the one before.

    ``slope``, ``motor``: accelerations of stage and motor [m/s^2].
    """
    walk_balance(s)
    b, c = s.balance, s.balance_covariance
    level, place = s.sliding[1], s.x - s.balance_centre
    g0 = c[0, 0] * slope + c[0, 1] * level + c[0, 2] + c[0, 3] * place
    g1 = c[0, 1] * slope + c[1, 1] * level + c[1, 2] + c[1, 3] * place
    g2 = c[0, 2] * slope + c[1, 2] * level + c[2, 2] + c[2, 3] * place
    g3 = c[0, 3] * slope + c[1, 3] * level + c[2, 3] + c[3, 3] * place
    noise = (NOISE * NOISE + RELATIVE * RELATIVE * slope * slope) * max(CORRELATED / since, 1.0)
    part = 1.0 / (slope * g0 + level * g1 + g2 + place * g3 + noise)
    beyond = part * (s.net[1] - b[0] * slope - b[1] * level - b[2] - b[3] * place)
    b[1] += g1 * beyond
    b[2] += g2 * beyond
    b[3] += g3 * beyond
    c[0, 1] -= part * g0 * g1
    c[0, 2] -= part * g0 * g2
    c[0, 3] -= part * g0 * g3
    c[1, 1] -= part * g1 * g1
    c[1, 2] -= part * g1 * g2
    c[1, 3] -= part * g1 * g3
    c[2, 2] -= part * g2 * g2
    c[2, 3] -= part * g2 * g3
    c[3, 3] -= part * g3 * g3
    if abs(slope) > TELLS and abs(motor - slope) < TOGETHER * abs(slope):
        keep_inertia(s, b[0] + g0 * beyond, c[0, 0] - part * g0 * g0)


@compiled
def learn_inertia(model, s, period, force, speed, lost):
    """One period: mean net ``force`` [N], beyond friction of the level that is known; ``speed`` [m/s] of the encoder;
    ``lost``: the axis is not one mass now, or swings."""
    share = min(period / FILTER_TIME, 1.0)
    s.net[1] += share * (s.net[0] - s.net[1])
    s.net[0] += share * ((force + (s.level - 1.0) * s.sensitivity) / model.moving_mass - s.net[0])
    s.sliding[1] += share * (s.sliding[0] - s.sliding[1])
    s.sliding[0] += share * (s.sensitivity / model.moving_mass - s.sliding[0])
    slope = (s.stage_speed[0] - s.stage_speed[1]) / FILTER_TIME
    s.stage_speed[1] += share * (s.stage_speed[0] - s.stage_speed[1])
    s.stage_speed[0] += share * (speed - s.stage_speed[0])
    motor = (s.emf_speed - s.motor_speed) / FILTER_TIME
    s.motor_speed += share * (s.emf_speed - s.motor_speed)
    s.filtered_s = 0.0 if lost else s.filtered_s + period
    s.balance_wait_s += period
    if s.balance_wait_s > STEP_TIME - 0.5 * period:
        slides = s.slipping > 0.9 or model.has_actuator == 0
        if slides and s.filtered_s > 5.0 * FILTER_TIME:
            weigh_balance(s, slope, motor, s.balance_wait_s)
        s.balance_wait_s = 0.0
    if abs(s.rho * s.inertia - 1.0) < 0.25 * SLACK:   # then its logarithm is below 0.3 SLACK, too
        return
    off = -math.log(s.rho) - math.log(s.inertia)
    beyond = -math.log(s.rho)
    clear = abs(beyond) > max(SLACK, CLEAR * math.sqrt(s.rho_variance) / s.rho)
    target = beyond if clear else math.log(s.inertia)
    if abs(off) > 0.3 * SLACK:
        s.inertia *= math.exp(min(period / APPLY_TIME, 1.0) * (target - math.log(s.inertia)))
