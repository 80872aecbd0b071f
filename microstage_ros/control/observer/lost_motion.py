"""Lost motion of the drive as the observer sees it (compiled parts of `observer_law`).

With lost motion b between drive and stage the stage follows the motor only while the drive touches one side.
Within the gap the encoder tells where the stage is and the back-EMF how far the motor goes. What the motor is
ahead of the stage,

    dr/dt = w - dy/dt - r / LEAD_TIME,        w motor speed from the back-EMF, y encoder,

stays near its mean in contact. The contact opens when r leaves its noise while the force through the drive is
near zero; if the stage then comes along, it had not. The drive has arrived when the stage moves on: a first sign of
that stops the drive, since the push goes on until the drive train has bounced, and what more comes of it decides. An
unknown gap shows as a motor that goes on while the stage stands; b is what the motor travels from one sure contact to
the next, corrected by every later crossing (a scalar Kalman filter, opened again where it is far off). A crossing whose
opening was noticed late, when the motor had led by some way, is doubted by half that way. The way is counted in the
nominal back-EMF: a constant error of that is learned with the gap.

After an acceleration drive and stage swing, and one leads the other without a crossing: a known gap opens, and an
unknown one is looked for, only where the reference has been steady for `OPENS` and `SEARCHED`.
"""

from microstage_ros.control.feedforward.axis import friction_along
from microstage_ros.numerics.compiled import compiled

TOUCHING, IN_GAP = range(2)
LEAD_TIME = 15e-3  # s, memory of the lead
SMOOTH_TIME = 2.5e-3  # s, of its filter
MEAN_TIME = 0.1  # s, of its mean
TOTAL_TIME = 0.25  # s, memory of the way that an unknown gap takes before it is noticed
STAGE_TIME = 1.5e-3  # s, of the stage's filter
PUSHED = 2.5e-8  # m, by which a pushed stage shows
NOTICED = 1.4e-7  # m, by which a motor goes on alone in a gap that is not known
KNOWN = 2e-6  # m/s, doubt in the motor's speed up to which it tells of a gap
SURPRISE = 1.5e-5  # m/s, of the speed, that tells of another drive instead
SETTLED_TIME = 2e-2  # s
SLOW = 8e-5  # m/s; a faster motor is not watched, its crossings take no time
UNLOADED = 0.35  # share of the guideways' limit below which the contact may open
CHANGE = 2e-8  # m, standard deviation of the gap from one crossing to the next
PUSH_SHARE = 0.3  # of the filter that a push is seen by
TOUCHED, DOUBTED = 1.5e-8, 2e-3  # m, s; a push that stops the drive, and for how long if no more comes of it
PUSH_TIME = 7e-4  # s, that it takes to show
LANDING, GIVEN_UP = 8e-3, 16e-3  # s, that a contact takes to count at least and at most
NEAR = 5e-8  # m, by which the drive may be off the stage before the latter
GAP_GAIN = 0.3  # of the speed while apart, where the encoder says nothing of the motor and friction changes fast
# s, for which the reference has not accelerated where the contact of a known gap may open, and an unknown gap is looked
# for: after a fast move drive and stage swing, and what they lead each other by is no crossing. Calibrated with
# `robustness --only "backlash 0.25 deg" "backlash 0.5 deg" "backlash 1 deg" --seeds 24 --seed 91000` and `--moves 1003`
OPENS, SEARCHED = 0.05, 0.1
# of the way that the drive has gone where the opening is noticed, as a standard deviation of that way: it may be any
# from nothing to twice as much, which a uniform distribution gives 0.58
LATE = 0.5
UNSEEN = 4e-8  # m, doubt in where a contact opened that was noticed late
FIELDS = [
    ("contact", "i8"),  # TOUCHING or IN_GAP
    ("side", "f8"),  # that the drive touches or touched last: +1 pushes forward, -1 backward, 0 not known
    ("toward", "f8"),  # direction of a crossing
    ("arrived", "i8"),  # 1 once the drive is taken to be on the other side
    ("gap", "f8"),  # m, b; 0: none known
    ("gap_variance", "f8"),  # m^2
    ("travel", "f8"),  # m, of the motor since it left its last contact, along `toward`
    ("opening_doubt", "f8"),  # m, standard deviation of the travel at which the contact opened
    ("arrival", "f8"),  # m, travel at which the drive arrived
    ("age", "f8"),  # s, since then, or since a touch was suspected
    ("raw_lead", "f8"),  # m, r
    ("lead", "f8"),  # m, r smoothed
    ("mean_lead", "f8"),  # m
    ("followed", "f8"),  # m, of the encoder within the same memory
    ("stage", "f8"),  # m, encoder smoothed
    ("arrival_stage", "f8"),  # m
    ("before", "f8"),  # m, encoder of the period before
    ("push", "f8"),  # m, by which the stage is ahead of where it stood
    ("settled_time_s", "f8"),  # s, in which the motor was not ahead
    ("confirmed", "i8"),  # 1 once this contact has been at rest under load
    ("landed", "i8"),  # 1 from the end of a search until the contact is confirmed
    ("calm", "f8"),  # s, without surprise in the speed
    ("ever", "i8"),  # 1 once any contact was confirmed
    ("total", "f8"),  # m, lead with a long memory
]


@compiled
def lost_motion_reset(p, s):
    """No side is known; the gap is what the parameters say."""
    s.contact = TOUCHING
    s.side = 0.0
    s.toward = 0.0
    s.gap = p.known_gap
    s.gap_variance = 1e-16 + (p.emf_spread * p.known_gap) ** 2
    s.travel = 0.0
    s.opening_doubt = 0.0
    s.raw_lead = 0.0
    s.lead = 0.0
    s.mean_lead = 0.0
    s.followed = 0.0
    s.settled_time_s = 0.0
    s.confirmed = 0
    s.ever = 0
    s.landed = 0
    s.calm = 0.0
    s.total = 0.0


@compiled
def watch_lead(s, period, encoder, motor_speed, surprise):
    """Follow how far the motor is ahead of the encoder [m] at ``motor_speed`` [m/s].

    A large ``surprise`` [m/s], speed against prediction, says that the drive is not what it was: then nothing is
    searched.
    """
    s.calm = 0.0 if abs(surprise) > SURPRISE else s.calm + period
    step = encoder - s.before
    s.before = encoder
    fade = period / LEAD_TIME
    s.raw_lead += motor_speed * period - step - fade * s.raw_lead
    s.total += motor_speed * period - step - period / TOTAL_TIME * s.total
    s.followed += step - fade * s.followed
    s.settled_time_s = s.settled_time_s + period if abs(s.lead - s.mean_lead) < 3e-8 else 0.0
    s.lead += min(period / SMOOTH_TIME, 1.0) * (s.raw_lead - s.lead)
    s.stage += min(period / STAGE_TIME, 1.0) * (encoder - s.stage)
    if s.contact == TOUCHING and abs(s.lead - s.mean_lead) < 5e-8:
        s.mean_lead += min(period / MEAN_TIME, 1.0) * (s.lead - s.mean_lead)


@compiled
def watch_contact(p, s, force, scale, doubt, pulls):
    """Open the contact where it opens: ``force`` [N] through the drive, its ``scale`` [N], ``doubt`` [m/s] in the
    speed.

    ``pulls``: the current moves the motor against its friction.

    True if what was learned of the drive is void, since its motor moved and the stage did not.
    """
    if s.settled_time_s > SETTLED_TIME and abs(force) > UNLOADED * scale:
        s.side = 1.0 if force > 0.0 else -1.0
        s.confirmed = 1
        s.ever = 1
        if s.landed == 1:
            s.landed = 0
            return True
    if abs(s.v) > SLOW or s.steady_time_s < OPENS:
        return False
    if s.gap > 0.0 and s.side != 0.0:
        # a contact opens while the stage is led back, not when it was thrown ahead
        lead = -(s.lead - s.mean_lead) * s.side
        led = s.followed * s.side < 0.0 and s.v * s.side < 0.0
        if s.confirmed == 1 and led and lead > p.least_lead and force * s.side < UNLOADED * scale:
            s.gap_variance += CHANGE * CHANGE
            travel = lead + abs(s.v) * SMOOTH_TIME
            open_contact(s, -s.side, travel, LATE * travel)
        return False
    if s.steady_time_s < SEARCHED:
        return False
    size = abs(s.lead)
    calm = s.calm > SETTLED_TIME or s.ever == 0
    stands = abs(s.followed) < 0.2 * size and s.lead * s.side <= 0.0
    if p.widest_gap > 0.0 and calm and stands and pulls and doubt < KNOWN and size > NOTICED + 5.0 * doubt * LEAD_TIME:
        open_contact(s, 1.0 if s.lead > 0.0 else -1.0, max(size, abs(s.total)), UNSEEN)
        return s.ever == 0
    return False


@compiled
def open_contact(s, toward, travel, doubt):
    """The drive leaves the stage, which stands; it has gone ``travel`` [m], standard deviation ``doubt`` [m]."""
    if s.confirmed == 0:
        s.side = 0.0
    s.contact = IN_GAP
    s.toward = toward
    s.travel = travel
    s.opening_doubt = doubt
    s.arrived = 0
    s.age = DOUBTED
    s.push = 0.0
    s.x = s.stage


@compiled
def cross(p, s, period, position):
    """One period apart: whether the drive arrives, and whether the stage follows it (innovation ``position`` [m]).

    True if the stage was not found.
    """
    from_contact = s.side == -s.toward
    s.push += PUSH_SHARE * (s.toward * position - s.push)
    s.age += period
    if s.arrived == 0:
        if s.push > PUSHED and reckoned(s) and s.travel < 0.5 * s.gap:
            settle(s, s.side)  # it had never left: the stage comes along
        elif s.push > PUSHED:
            arrive(p, s, from_contact)
        elif s.push > TOUCHED and s.age > DOUBTED and abs(s.v) < SLOW:
            s.age = 0.0
        elif s.travel > p.widest_gap or -s.travel > s.gap:
            settle(s, 0.0)
            return True
        return False
    moved = s.toward * (s.stage - s.arrival_stage)
    late = s.travel - s.arrival - moved
    if s.age > LANDING and (abs(late) < NEAR or s.age > GIVEN_UP):
        settle(s, s.toward)
    return False


@compiled
def arrive(p, s, from_contact):
    """The drive has pushed the stage: it reached it where the stage stood, the push's own time ago."""
    speed = abs(s.v)
    s.arrived = 1
    s.arrival = s.travel - s.push - speed * PUSH_TIME
    s.arrival_stage = s.x
    s.age = 0.0
    if from_contact:
        learn_gap(p, s, s.arrival, 1e-8 + speed * PUSH_TIME + s.opening_doubt)


@compiled
def touching(s):
    """Whether the stage may just have been touched: the drive waits for it to show."""
    return s.arrived == 0 and s.age < DOUBTED


@compiled
def reckoned(s):
    """Whether a crossing goes by dead reckoning."""
    return s.gap > 0.0 and s.side == -s.toward


@compiled
def settle(s, side):
    """The drive touches ``side`` for good."""
    s.landed = 0 if reckoned(s) else 1
    s.contact = TOUCHING
    s.side = side
    s.raw_lead = s.mean_lead
    s.lead = s.mean_lead
    s.settled_time_s = 0.0
    s.confirmed = 0
    s.total = 0.0
    s.screw += s.stage - s.x
    s.x = s.stage


@compiled
def learn_gap(p, s, found, doubt):
    """Take in that the gap was ``found`` [m] with the standard deviation ``doubt`` [m]."""
    if found > p.widest_gap:
        return
    change, noise = found - s.gap, doubt * doubt
    if change * change > 9.0 * (s.gap_variance + noise):  # it was not what it was taken for
        s.gap_variance = change * change
    gain = s.gap_variance / (s.gap_variance + noise) if s.gap > 0.0 else 1.0
    s.gap_variance = (1.0 - gain) * s.gap_variance if s.gap > 0.0 else noise
    s.gap = min(max(s.gap + gain * change, 0.0), p.widest_gap)


@compiled
def steady_measure(p, s):
    """What to add to the learned back-EMF [1] so that the way through a gap is always counted in the same measure.

    That is the nominal one, unless the amplifier's gain has changed the measure of all.
    """
    beyond = s.learned[2] - s.emf_centre
    return beyond if abs(beyond) < 2.0 * p.emf_spread else 0.0


@compiled
def correct_in_gap(p, model, s, period, position, speed, trust):
    """The observer's corrections while drive and stage are apart, by the innovations of ``position`` [m] and ``speed``
    [m/s] (with its ``trust``): the speed tells of the motor, the position of the stage."""
    speed += steady_measure(p, s) * s.v
    trust /= s.voltage_factor * s.voltage_factor  # a voltage that comes late says little of the speed here too
    s.v += trust * max(p.motion_gain[1, 1], GAP_GAIN) * speed
    s.d += trust * p.motion_gain[2, 1] * speed
    step = 0.05 * position
    s.x += step
    if model.has_guideway != 0:
        s.guideway_friction = friction_along(model.guideway, s.guideway, step / period, period, 1.0)
    s.screw = s.x + s.guideway_friction * model.compliance
