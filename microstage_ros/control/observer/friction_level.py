"""The level of friction as the observer sees it (compiled parts of `observer_law`).

While blocks slip, d is an error of the level. The level follows a random walk in travel and time (the
Ornstein-Uhlenbeck variability of the model, without its pull to 1, so that wear is seen too), estimated by
a scalar Kalman filter with the sensitivity S = dF/dl of the slipping blocks; the same filter gives the
standard deviation. What the filter adds to the level it takes off d.

A force that does not turn with the motion, a tilt or a zero of the current's sensor, is no friction. It shows in what
the level would have to be in the two directions, l_f and l_b, means over `level_length` of travel:

    F_0 = S (l_f - l_b) / 2,        as far as the half difference is beyond `ALIKE`

A spring, as of a cable, is a force that grows with the position. Friction of whatever curve is odd in the direction of
motion, a spring is the same in both. So the unexplained force is regressed on the position in each direction alone, and
a spring is what both slopes have in common:

    k = the smaller of the two slopes, 0 where their signs differ, times 1 - q^2, 0 where q > 1,

q the force that `ALIKE` stands for, of the mean |S| (it grows towards a reversal, and k would fall), over that which
k makes over the narrower of the two ranges, which says nothing within `NARROW`. F_0 is then what is left.

Until both directions have told them apart, such a force is in the level, which turns at a reversal as the force does
not. Where the level would have to be another one in the two directions, by a beyond `ALIKE`, what is counted with is
off by up to 2 a S when the friction F_f has turned. So while it turns, d walks (`doubt_turning`):

    dP_dd/dt = min(TURNED (a / M)^2 S |dF_f/dt|, MOST_WALK),        in all (2 a S / M)^2 at most, from S to -S.

In strong accelerations a wrong inertia looks like friction: nothing is read of either, and d is doubted by what the
inertia's doubt leaves of them (`inertia_doubt`). Both forces stay in d, at
rest too, and the level and the inertia are learned from what is left.
"""

import math

from microstage_ros.numerics.compiled import compiled

FORCE_TIME = 5e-3  # s, over which errors of d hang together
ABSORB_TIME = 5e-3  # s, in which sticking blocks take over what is unexplained
# 1, by which friction itself may: its level varies, and may be 0.2 higher one way. Read in strong accelerations too, it
# cost two of 60 random machines a factor of 2 and 3.5
ALIKE = 0.4
LEAST = 0.03  # m/s^2, a strong acceleration
SPRING_LENGTH = 1.5e-3  # m of travel, memory of the regressions: there and back through what is now seen of the axis
TURNED = 2.0  # 1: over a reversal the variance of d grows by (2 a S / M)^2
# m^2/s^5. A cable's first reversal is the same to 3 nm with 0.01 and 0.05. Without it, a machine whose winding is 2.8
# times as slow as the file's (random machine 2492) swung at 5 kHz from 0.4 on
MOST_WALK = 0.02
NARROW = 1e-4  # m, half a range that says nothing of a spring: a heavy axis swings by 30 um and more
FIELDS = [
    ("level", "f8"),  # 1, limits of the actuator over nominal
    ("variance", "f8"),  # of the level
    ("sensitivity", "f8"),  # N, dF/dl of the slipping blocks
    ("level_forward", "f8"),  # 1, slow mean of the level while moving forward
    ("level_backward", "f8"),
    ("slipping", "f8"),  # share of the actuator's limit that slips
    ("constant", "f8"),  # N, F_0
    ("spring", "f8"),  # N/m, k
    ("spring_centre", "f8"),  # m, where it is taken to make no force
    # of forward and backward: weight [1], mean place [m], mean force [N], variance [m^2], covariance [m N]
    ("seen", "f8", (2, 5)),
    ("slide_force", "f8"),  # N, mean of |S| over half a `level_length` of sliding
    ("loaded", "f8"),  # N, a force that does not turn with the motion, of constant and spring
    ("turned_friction", "f8"),  # N, F_f as far as it has turned
    ("turning_drift", "f8"),  # m^2/s^5, dP_dd/dt while friction turns
]


@compiled
def level_reset(p, s):
    """The nominal level, with all its doubt."""
    s.level = 1.0
    s.variance = p.level_variability * p.level_variability
    s.sensitivity = 0.0
    s.level_forward = 1.0
    s.level_backward = 1.0
    s.slipping = 0.0
    s.constant = s.spring = s.spring_centre = s.loaded = 0.0
    s.slide_force = 0.0
    s.turned_friction = s.turning_drift = 0.0
    s.seen[:] = 0.0


@compiled
def slipping_force(law, blocks, level):
    """(dF/dl, slipping share): force of the slipping blocks over the level, and the sum of their weights."""
    count = int(law[10])
    force = 0.0
    share = 0.0
    for j in range(count):
        if blocks[count + j] != 0.0:
            force += blocks[j]
            share += law[11 + count + j]
    return force / level, share


@compiled
def absorb(model, s, period):
    """While hardly a block slips, d is an error of the stuck blocks' forces: move it over to them.

    Each sticking block takes its share of the stiffness, within its limit; what is left stays in d.
    """
    law, blocks = model.actuator, s.actuator
    if s.slipping > 0.5:
        return
    count = int(law[10])
    stiffness = 0.0
    for j in range(count):
        if blocks[count + j] == 0.0:
            stiffness += law[11 + j]
    if stiffness == 0.0:
        return
    unexplained = model.moving_mass * s.inertia * s.d - s.loaded
    torque = unexplained / model.force_per_torque * min(period / ABSORB_TIME, 1.0)
    taken = 0.0
    for j in range(count):
        if blocks[count + j] == 0.0:
            limit = law[11 + count + j] * law[0] * s.level
            before = blocks[j]
            blocks[j] = min(max(before + torque * law[11 + j] / stiffness, -limit), limit)
            taken += blocks[j] - before
    s.actuator_friction += taken
    s.d -= taken * model.force_per_torque / (model.moving_mass * s.inertia)


@compiled
def learn_level(p, model, s, period):
    """One period of the scalar Kalman filter of the level."""
    s.sensitivity, s.slipping = 0.0, 0.0
    if model.has_actuator != 0:
        force, s.slipping = slipping_force(model.actuator, s.actuator, s.level)
        s.sensitivity = model.force_per_torque * force
    spread = p.level_variability * p.level_variability
    travel = abs(s.v) * period / p.level_length
    s.variance = min(s.variance + 2.0 * spread * (travel + period / p.level_time), 1.0)
    # while few blocks slip, d is rather an error of the place of the reversal than one of the level
    doubt = p.force_noise / max(s.slipping, 0.1) ** 6
    inertial = model.moving_mass * s.inertia * s.inertial_doubt
    noise = (doubt * doubt + inertial * inertial) * FORCE_TIME / period
    gain = s.variance * s.sensitivity / (s.sensitivity * s.sensitivity * s.variance + noise)
    residual = model.moving_mass * s.inertia * s.d - s.loaded
    change = gain * residual
    level = min(max(s.level + change, 0.1), 10.0)
    s.d -= (level - s.level) * s.sensitivity / (model.moving_mass * s.inertia)
    s.level = level
    s.variance *= 1.0 - gain * s.sensitivity
    if s.slipping > 0.9 and abs(s.acceleration) < LEAST:
        share = min(2.0 * travel, 1.0)
        found = s.level + s.constant / s.sensitivity
        if s.v > 0.0:
            s.level_forward += share * (found - s.level_forward)
        else:
            s.level_backward += share * (found - s.level_backward)
        half = 0.5 * (s.level_forward - s.level_backward)
        s.constant = abs(s.sensitivity) * (half - min(max(half, -ALIKE), ALIKE))
        force = s.sensitivity * (s.level - 1.0) + model.moving_mass * s.inertia * s.d
        before = s.slide_force if s.slide_force > 0.0 else abs(s.sensitivity)
        s.slide_force = before + share * (abs(s.sensitivity) - before)
        learn_spring(s, abs(s.v) * period, force, ALIKE * s.slide_force)
    s.d += s.spring * s.v * period / (model.moving_mass * s.inertia)
    s.loaded = s.constant + s.spring * (s.x - s.spring_centre)


@compiled
def doubt_turning(p, model, s, period):
    """One period of the walk of d while the friction turns, as far as it has not turned before.

    Only where every source is believed as at the start and the motor constant has been read: a filter that wide takes
    a wrong back-EMF for motion. At rest a reversal is none of the motion that is asked for.
    """
    friction = model.force_per_torque * s.actuator_friction
    s.turning_drift = 0.0
    believed = s.emf_doubt == 0.0 and s.voltage_factor <= p.voltage_doubt and s.encoder_factor <= p.encoder_doubt
    if not believed or s.slipping > 0.9 or s.rest_time_s > 0.0:
        s.turned_friction = friction
        return
    further = friction - s.turned_friction
    if further * s.planned_acceleration > 0.0:
        beyond = max(abs(s.level_forward - s.level_backward) - ALIKE, 0.0) / (model.moving_mass * s.inertia)
        s.turning_drift = min(TURNED * beyond * beyond * s.slide_force * abs(further) / period, MOST_WALK)
        s.turned_friction = friction


@compiled
def learn_spring(s, travel, force, alike):
    """Take in the ``force`` [N] beyond nominal friction over this period's ``travel`` [m]; ``alike`` [N]: what the two
    directions may differ by without a spring."""
    if travel == 0.0:
        return
    row = s.seen[0] if s.v > 0.0 else s.seen[1]
    share = min(travel / SPRING_LENGTH, 1.0)
    row[0] += share * (1.0 - row[0])
    share /= row[0]
    place, beyond = s.x - row[1], force - row[2]
    row[1] += share * place
    row[2] += share * beyond
    row[3] += share * ((1.0 - share) * place * place - row[3])
    row[4] += share * ((1.0 - share) * place * beyond - row[4])
    one, other = s.seen[0], s.seen[1]
    s.spring = 0.0
    narrower = min(one[3], other[3])
    if 3.0 * narrower < NARROW * NARROW or one[4] * other[4] <= 0.0:
        return
    s.spring_centre = 0.5 * (one[1] + other[1])
    ahead, back = one[4] / one[3], other[4] / other[3]
    common = ahead if abs(ahead) < abs(back) else back
    doubt = alike / (abs(common) * math.sqrt(3.0 * narrower))  # half of an even range is 1.7 standard deviations
    s.spring = common * max(1.0 - doubt * doubt, 0.0)
