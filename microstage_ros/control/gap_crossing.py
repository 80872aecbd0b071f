"""The way of the motor through lost motion, from one contact to the other (compiled part of the laws).

The motor leaves with the speed v_0 that it has and ends just short (e) of the other contact with that of the
reference, v, so that it does not throw the stage; the rest it goes slowly:

    p(t) = p_0 + q(t) + [b - e - p_0 - q(t) - v (T - t)] S(t/T) + (v_0 - v) T H(t/T),        dq/dt = v
    S = s^3 (10 - 15 s + 6 s^2),      H = s (1 - s)^3 (1 + 3 s)

T follows from the highest acceleration of S. Through a gap of unknown width it goes at a constant speed. Once
there, it leads the stage to the reference at a gentle rate until the contact counts. All the while the regulator
holds the motor to p by dead reckoning; its integral and its tuning wait.
"""

import math

from microstage_ros.axis.compiled import compiled
from microstage_ros.control.lost_motion import TOUCHING, reckoned

CATCH_UP = 120.0  # 1/s, rate at which the stage is led to the reference
GENTLE = 2e-5  # m/s, most that this may take
BUMPLESS_TIME = 4e-3  # s
SHORT = 5e-8  # m, by which the path of least jerk ends before the contact, so that no error along it throws the stage
APPROACH = 1e-5  # m/s, over the rest
FIELDS = [
    ("mode", "i8"),  # contact of the period before
    ("time", "f8"),  # s, since the crossing began
    ("start", "f8"),  # m, p_0
    ("led", "f8"),  # m, q
    ("start_speed", "f8"),  # m/s, v_0
    ("duration", "f8"),  # s, T
    ("path", "f8"),  # m, p
    ("path_speed", "f8"),  # m/s
    ("offset", "f8"),  # m, left of the error on the path
    ("offset_speed", "f8"),  # m/s, added to the reference's
]


@compiled
def crossing_reset(c):
    """In contact, nothing to catch up."""
    c.mode = TOUCHING
    c.offset = 0.0
    c.offset_speed = 0.0


@compiled
def begin(c, s, speed, acceleration, period):
    """Plan a crossing from the observer's state ``s``, at the reference's ``speed`` [m/s] along the crossing."""
    c.time = 0.0
    c.led = 0.0
    c.start = s.travel
    c.start_speed = s.toward * s.v
    c.path = c.start
    c.path_speed = c.start_speed
    length = max(s.gap - SHORT - c.start, 1e-9)
    c.duration = max(math.sqrt(5.77 * length / acceleration), 5.0 * period)


@compiled
def advance(c, p, s, speed, error, period):
    """One period along the path; ``speed``, ``error``: of the reference and to it, along the crossing."""
    c.time += period
    c.led += speed * period
    if s.arrived != 0:
        c.path_speed = speed + min(max(CATCH_UP * error, -GENTLE), GENTLE)
    elif not reckoned(s):
        c.path_speed += (p.search_speed - c.path_speed) * min(period / BUMPLESS_TIME, 1.0)
    elif c.time >= c.duration:
        c.path_speed = speed + APPROACH
    else:
        t = c.time / c.duration
        rest = 1.0 - t
        length = s.gap - SHORT - c.start - c.led - speed * (c.duration - c.time)
        slower = c.start_speed - speed
        before = c.path
        c.path = c.start + c.led + length * t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
        c.path += slower * c.duration * t * rest * rest * rest * (1.0 + 3.0 * t)
        c.path_speed = (c.path - before) / period
        return
    c.path += c.path_speed * period


@compiled
def cross_step(c, p, s, period, error, speed):
    """The regulator's error [m] for this period from the ``error`` to the reference at ``speed`` [m/s]; sets the offset."""
    if s.contact == TOUCHING:
        if c.mode != TOUCHING:
            c.offset = s.toward * (c.path - s.travel) - error
            c.mode = TOUCHING
        c.offset_speed = -c.offset / BUMPLESS_TIME
        c.offset += c.offset_speed * period
        return error + c.offset
    if c.mode == TOUCHING:
        c.mode = s.contact
        begin(c, s, s.toward * speed, p.crossing_acceleration, period)
    advance(c, p, s, s.toward * speed, s.toward * error, period)
    c.offset_speed = s.toward * c.path_speed - speed
    return s.toward * (c.path - s.travel)
