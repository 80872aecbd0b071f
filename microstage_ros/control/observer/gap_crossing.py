"""The way of the motor through lost motion, from one contact to the other (compiled part of the laws).

The motor leaves with the speed v_0 that it has and ends just short (e) of the other contact with that of the
reference, v, so that it does not throw the stage; the rest it goes slowly:

    p(t) = p_0 + q(t) + [b - e - p_0 - q(t) - v (T - t)] S(t/T) + (v_0 - v) T H(t/T),        dq/dt = v
    S = s^3 (10 - 15 s + 6 s^2),      H = s (1 - s)^3 (1 + 3 s)

T follows from the highest acceleration of S. From there on, and through a gap of unknown width from the start, it
looks for the contact. A drive that meets the stage at v_m throws it by about k v_m, while before it the stage falls
behind by the way of the reference, l. With

    v_m = v + 2 l / k

it is thrown as far ahead as it was behind, whatever the width. For a constant v and a drive from rest on the stage's
side v_m >> v, so b = v t^2 / k and both are sqrt(k v b): no other speed does better in the worse of the two. Once
there, the drive waits beside the stage until the contact counts, and then for the reference if the stage is ahead of
it. All the while the regulator holds the motor to p by dead reckoning; its integral and its tuning wait.

A motor that rattles in a gap at the end of a move, or in slow motion, is too fast for its contacts to be seen. There it
is left without voltage until friction has stopped motor and stage, and goes on from there at the speed of a search.
"""

import math

from microstage_ros.control.observer.lost_motion import TOUCHING, reckoned, settle, touching
from microstage_ros.control.observer.source_doubt import lost_motion_suspected
from microstage_ros.numerics.compiled import compiled

CATCH_UP = 120.0  # 1/s, rate at which the stage is led to the reference
GENTLE = 2e-5  # m/s, most that this may take
# 1/s and at most m/s, at which the drive follows a stage that was thrown ahead, and looks for one faster than the
# reference
CHASE, FAST = 300.0, 1e-4
BUMPLESS_TIME = 4e-3  # s
# m, and standard deviations of the gap, by which the path ends before the contact: no error along it throws the stage
SHORT, GAP_MARGIN = 4e-8, 1.5
APPROACH = 4e-6  # m/s, over the rest
WAIT_TIME = 0.05  # s, in which a stage that is ahead is led back if the reference does not come
RATTLES = 5  # swings of the error in a row, the reference at rest, that a landing does not make
STOPPED_AT = 2e-5  # m/s, of the reference: it goes on by no more than a gap's width in a stop
STOP_TIME = 0.1  # s, at most, without voltage: motor and stage are stopped by friction
STANDS, STANDS_TIME, PLACE_TIME = 3e-8, 8e-3, 4e-3  # m, s: a stage within this of where it was of late has been stopped
LEAD_BACK_TIME, SEEN = 0.05, 7e-5  # s; m/s, up to which an opening contact is seen
MOST_STOPS, MOST_MOVING = 4, 1  # at one rest, in one slow motion
FIELDS = [
    ("mode", "i8"),  # contact of the period before
    ("arrived", "i8"),  # 1 once the drive has been beside the stage
    ("time", "f8"),  # s, since the crossing began
    ("short", "f8"),  # m, e
    ("start", "f8"),  # m, p_0
    ("led", "f8"),  # m, q
    ("start_speed", "f8"),  # m/s, v_0
    ("duration", "f8"),  # s, T
    ("path", "f8"),  # m, p
    ("path_speed", "f8"),  # m/s
    ("offset", "f8"),  # m, left of the error on the path
    ("offset_speed", "f8"),  # m/s, added to the reference's
    ("stop", "f8"),  # s, left of a stop
    ("stands", "f8"),  # s, for which the stage has stood in it
    ("place", "f8"),  # m, where the stage was of late
    ("stops", "i8"),  # since the reference stands
    ("led_back", "i8"),  # after a stop, to the reference at the speed of a search: 1 from this period on, 2 under way
    ("held_speed", "f8"),  # m/s, that of the period before: what the motor answers to is a period old
]


@compiled
def crossing_reset(c):
    """In contact, nothing to catch up."""
    c.mode = TOUCHING
    c.offset = 0.0
    c.offset_speed = 0.0
    c.held_speed = 0.0
    c.stop = 0.0
    c.stops = 0
    c.led_back = 0


@compiled
def stop_rattle(c, p, s, period, swings, speed, size):
    """Whether the motor is to be without voltage: it rattles in a gap while the reference, ``speed`` [m/s], stands or
    is slow.

    ``swings`` in a row, ``size`` [m] of the last one or of the error, that of a gap at most, or it is no rattle, or a
    load that friction does not hold. Afterwards the stage is led to the reference from where it came to stand.
    """
    if abs(speed) > STOPPED_AT:
        c.stop, c.stops, c.led_back = 0.0, 0, 0
    elif c.stop > 0.0:
        c.stop -= period
        c.place += min(period / PLACE_TIME, 1.0) * (s.stage - c.place)
        c.stands = c.stands + period if abs(s.stage - c.place) < STANDS else 0.0
        if size > p.widest_gap:
            c.stops = MOST_STOPS
        elif c.stop > 0.0 and c.stands < STANDS_TIME:
            return True
        c.stop = 0.0
        settle(s, 0.0)
        s.v, s.d = 0.0, 0.0
        c.mode, c.led_back = TOUCHING, 1
    elif (
        swings >= RATTLES
        and c.stops < (MOST_STOPS if speed == 0.0 else MOST_MOVING)
        and size < p.widest_gap
        and lost_motion_suspected(s)
    ):
        c.stop, c.stands, c.place = STOP_TIME, 0.0, s.stage
        c.stops += 1
        return True
    return False


@compiled
def begin(c, s, speed, acceleration, period):
    """Plan a crossing from the observer's state ``s``, at the reference's ``speed`` [m/s] along the crossing."""
    c.time = 0.0
    c.led = 0.0
    c.start = s.travel
    c.start_speed = s.toward * s.v
    c.path = c.start
    c.path_speed = c.start_speed
    c.arrived = 0
    c.short = SHORT + GAP_MARGIN * math.sqrt(s.gap_variance)
    length = max(s.gap - c.short - c.start, 1e-9)
    c.duration = max(math.sqrt(5.77 * length / acceleration), 5.0 * period)


@compiled
def advance(c, p, s, speed, error, period):
    """One period along the path; ``speed``, ``error``: of the reference and to it, along the crossing."""
    c.time += period
    c.led += speed * period
    if s.arrived != 0:
        if c.arrived == 0:
            c.arrived, c.path = 1, s.travel
        beside = s.arrival + s.toward * (s.stage - s.arrival_stage)
        c.path_speed = min(max(CHASE * (beside - c.path), -FAST), FAST)
        if error > 0.0:
            c.path_speed += speed + min(CATCH_UP * error, GENTLE)
    elif touching(s):
        c.path_speed = 0.0
    elif not reckoned(s):
        c.path_speed = max(p.search_speed, speed + min(p.search_rate * error, FAST))
    elif c.time >= c.duration:
        c.path_speed = speed + min(max(APPROACH, p.search_rate * error), FAST)
    else:
        t = c.time / c.duration
        rest = 1.0 - t
        length = max(s.gap - c.short - c.start, 0.0) - c.led - speed * (c.duration - c.time)
        slower = c.start_speed - speed
        before = c.path
        c.path = c.start + c.led + length * t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
        c.path += slower * c.duration * t * rest * rest * rest * (1.0 + 3.0 * t)
        c.path_speed = (c.path - before) / period
        return
    c.path += c.path_speed * period


@compiled
def cross_step(c, p, s, period, error, speed):
    """The regulator's error [m] for this period from the ``error`` to the reference at ``speed`` [m/s]; sets the
    offsets."""
    if s.contact == TOUCHING:
        if c.mode != TOUCHING:
            c.offset = s.toward * (c.path - s.travel) - error
            c.mode = TOUCHING
        c.offset_speed = -c.offset / BUMPLESS_TIME
        if c.led_back != 0:
            fastest = min(max(abs(c.offset) / LEAD_BACK_TIME, p.search_speed), SEEN)
            c.offset_speed = min(max(c.offset_speed, -fastest), fastest)
        elif s.toward * c.offset > 0.0:  # the stage is ahead: the drive waits for the reference instead of leaving it
            c.offset_speed = -s.toward * min(abs(c.offset_speed), max(s.toward * speed, abs(c.offset) / WAIT_TIME))
        c.offset += c.offset_speed * period
        c.held_speed = c.offset_speed
        return error + c.offset
    if c.mode == TOUCHING:
        c.mode = s.contact
        begin(c, s, s.toward * speed, p.crossing_acceleration, period)
    before, c.held_speed = c.path, s.toward * c.path_speed - speed
    advance(c, p, s, s.toward * speed, s.toward * error, period)
    c.offset_speed = s.toward * c.path_speed - speed
    return s.toward * (before - s.travel)
