"""The moving inertia as the observer learns it (compiled parts of `observer_law`).

What drives the axis beyond its friction, over the file's moving mass M, is known from the current and the friction
laws, and the acceleration that follows from the encoder (not from the back-EMF, which a voltage that comes late leads
astray). Through the same filter of second order,

    a = rho n,      n = (F - friction) / M,      rho = M / M_true

and a scalar Kalman filter learns rho with its variance, while nothing swings. Only strong accelerations tell: at n
below `LEAST` the friction's level, which varies by some percent, is as large as what is sought. Noise is counted as
`CORRELATED` samples long. The regulator, the feed-forward and the observer's own prediction follow beyond `SLACK`,
within `APPLY_TIME`, so that nothing jumps.
"""

import math

from microstage_ros.numerics.compiled import compiled

FILTER_TIME = 3e-3  # s, of both sides, twice: slower than the drive train's resonance
LEAST = 0.03  # m/s^2
NOISE = 1e-2  # m/s^2, of a: friction's level, counts of the encoder
RELATIVE = 0.1  # of n: the drive's wind-up, a current that is off by its gain
CORRELATED = 6e-3  # s, over which these hang together
SPREAD = 0.5  # standard deviation of rho at the start
WEIGHED = 0.3  # of it, when the motor's constant was found elsewhere
SLACK = 0.15  # of the logarithm of the inertia, within which it is taken as the file says
APPLY_TIME = 0.02  # s
LOWEST, HIGHEST = 0.15, 7.0  # times the file's
FIELDS = [
    ("rho", "f8"),  # 1, file's moving mass over the true one
    ("rho_variance", "f8"),
    ("inertia", "f8"),  # 1, moving mass over the file's, as it is counted with
    ("net", "f8", 2),  # m/s^2, n filtered once and twice
    ("stage_speed", "f8", 2),  # m/s, of the encoder, filtered once and twice
    ("net_before", "f8"),  # N, mean over the period before
    ("filtered_s", "f8"),  # s, for which both have been observed undisturbed
]


@compiled
def weigh_anew(s, factor):
    """The motor's constant is ``factor`` times what it was taken for: in SI units that of its torque too, so every
    ampere accelerates by so much more. Lower gains follow at once; higher ones wait for what accelerations say."""
    if factor <= 1.0:
        return
    s.rho = min(max(s.rho * factor, 1.0 / HIGHEST), 1.0 / LOWEST)
    s.rho_variance = max(s.rho_variance, WEIGHED * WEIGHED * s.rho * s.rho)
    s.inertia = max(s.inertia / factor, LOWEST)


@compiled
def inertia_reset(s):
    """The file's number for the motor constant that was found, with all its doubt."""
    s.rho = 1.0
    s.rho_variance = SPREAD * SPREAD
    s.inertia = 1.0
    weigh_anew(s, s.emf_centre)
    s.net[:] = 0.0
    s.stage_speed[:] = 0.0
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
def learn_inertia(s, period, net, speed, lost):
    """One period: ``net`` [m/s^2], n; ``speed`` [m/s] of the encoder; ``lost``: the axis is not one mass now, or
    swings."""
    share = min(period / FILTER_TIME, 1.0)
    s.net[1] += share * (s.net[0] - s.net[1])
    s.net[0] += share * (net - s.net[0])
    slope = (s.stage_speed[0] - s.stage_speed[1]) / FILTER_TIME
    s.stage_speed[1] += share * (s.stage_speed[0] - s.stage_speed[1])
    s.stage_speed[0] += share * (speed - s.stage_speed[0])
    driven = s.net[1]
    s.filtered_s = 0.0 if lost else s.filtered_s + period
    if s.filtered_s > 5.0 * FILTER_TIME and abs(driven) > LEAST:
        noise = (NOISE * NOISE + RELATIVE * RELATIVE * driven * driven) * max(CORRELATED / period, 1.0)
        gain = s.rho_variance * driven / (driven * driven * s.rho_variance + noise)
        s.rho = min(max(s.rho + gain * (slope - s.rho * driven), 1.0 / HIGHEST), 1.0 / LOWEST)
        s.rho_variance *= 1.0 - gain * driven
    if abs(s.rho * s.inertia - 1.0) < 0.25 * SLACK:   # then its logarithm is below 0.3 SLACK, too
        return
    off = -math.log(s.rho) - math.log(s.inertia)
    beyond = -math.log(s.rho)
    target = (
        beyond if abs(beyond) > SLACK and abs(beyond) > 3.0 * math.sqrt(s.rho_variance) / s.rho else math.log(s.inertia)
    )
    if abs(off) > 0.3 * SLACK:
        s.inertia *= math.exp(min(period / APPLY_TIME, 1.0) * (target - math.log(s.inertia)))
