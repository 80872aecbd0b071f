"""How far encoder and back-EMF are trusted as readings of one mass, learned from swings of the loop (compiled parts of
`observer_law`).

The motion filter takes the axis for one mass. Beyond the drive train's resonance the encoder reads the stage, which
swings on its own, and with a heavy stage or a soft drive the loop that believes it swings too. The back-EMF lies on
this side of the resonance, but leans on a voltage that may come late. Where the loop swings, one of the two is
believed too much:

    swing: a half wave of the position's innovation (without its slow part) beyond `WAVE` doubts, shorter than
    `HALF_WAVE`

Every swing after the second in a row that is no smaller than the one before (`DECAY`) raises a doubt by `STEP`: that of
the encoder where the mean square innovation of the position, over what the filter expects, is more than `MECHANICAL`
times that of the speed, that of the voltage where it is less than `ELECTRICAL` times that, both in between. Where the
encoder is doubted already and the stage rings more slowly than the file's (`slower_than_file`: a heavy stage or a soft
drive), the voltage's is raised only where it comes late: a law that doubts both follows neither. A swing that began
below `BEGINS`, grows by more than `STEP` and hardly shows in the back-EMF (`SOFT`), a soft drive's in a fast move,
raises the doubt in the encoder by as much as it grows, from the second half wave on: it doubles with every one, and
`STEP` would not follow; a heavy stage's (`grew_from_small`) from the third on. A doubt falls back at `FADE`, slowly, so
that a machine whose doubt was found stays near it. The doubts at the start are those that hold the axis file's own
model (`design.start_check`).

A loop whose axis is lighter than it counts with has too high a gain, and swings by that alone, in both sources. So
while the inertia is as uncertain as at the start, and the axis slides, the doubts fall back at `RELAX`, if the
voltage's is no smaller than the encoder's (a heavy stage and a soft drive raise that of the encoder); and where the
inertia is found to be less than `LIGHTER` times that of the last swing, both go back to those of the start.

A swing of a few counts makes no half wave beyond `WAVE`, and may still grow at rest as soon as friction no longer
damps it (three times the mass with a voltage that comes 0.3 ms late). At rest an error of the model shows in no
innovation: so while the reference has stood for `REST_TIME` and the innovation of the position is beyond `RINGS` of the
expected, which noise does not explain, and beyond that of the speed as in a mechanical swing, the doubt in the encoder
rises e-fold in `RING_TIME` (`rings_quietly`), until innovations are as large as expected.

A voltage that acts late needs no swing to be seen: where its steps are large, the current does not follow them. An
amplifier with a lag, a dead band or a slow filter of the current leave less than `FOLLOWS` of their mean square
(`long_delay` keeps the current's; a resistance or gain that is off by a factor of two leaves more). The voltage is then
doubted at once, by `UNFOLLOWED`. Of the steps what the back-EMF takes is left out: in a strong constant acceleration of
a light rotor the voltage rises and the current stands. Where the current does not follow the voltage of the found
delay, by `FOLLOWED`, a motor that seems to lead says nothing of a gap either (`current_follows`), before any doubt has
been raised. Steps of the current beyond all that the voltage's could make are noise, and say nothing of a lag.

A motor that rattles in a gap of the drive makes such swings too, but they begin at the size of the gap, where a loop
that is no longer stable swings up from the noise and the wind-up of the drive bounds its swings. So mechanical ones
beyond `RATTLE` that smaller ones did not announce (the row is a soft drive's or grew from small ones, or the encoder is
doubted), of an axis that does not slide too fast for a gap to open (`glides`), say that lost motion is suspected, and
any such swing does where a gap is known: the doubt in the voltage goes back to that of the start, the friction's level
to nominal, and for `SUSPECTED_TIME` no mechanical swing raises a doubt, the inertia is not learned and the gains do not
fade at rest in swings beyond `IN_A_GAP`. (A fast move that a soft drive threw may look like a rattle; the small swing
that it leaves at rest ends where the gains fade.) Behind a gap the encoder is no reading of the screw either: it is
doubted by `MOST_ENCODER` meanwhile, and by `AT_REST` once the reference has stood for `SETTLES`, so that a move ends at
its target (`doubt_in_lost_motion`).

Once the drive train is known (`wind_up.stage_swings_low`) nothing has to be guessed: a stage that swings low does so
in a loop that believes the encoder. Its swings raise no doubt in a voltage that the current follows, what they have
raised goes within `RESTORED` once the drive train explains all that is seen, and the doubt in the encoder fades to what
its mass asks for (`held_doubt`), no further.

A half wave is over where the innovation is beyond `CLEAR` on the other side. Without that the noise at the change of
sign began the row anew, which then seemed to begin large: in 4 of 140 records six times the mass on a third of the
stiffness was taken for a rattle, and thrown by 84 um.
"""

import math

from microstage_ros.control.half_waves import half_wave
from microstage_ros.control.observer.inertia import inertia_unread
from microstage_ros.control.observer.long_delay import MEMORY, far_voltage
from microstage_ros.control.observer.wind_up import stage_swings_low
from microstage_ros.numerics.compiled import compiled

SMOOTH_TIME, SLOW_TIME = 5e-4, 2e-2  # s, of the innovation's fast part
WAVE = 3.5  # shipped doubts in the encoder
CLEAR = 0.875  # of them, on the other side of zero before a half wave is over: 1.5 times the noise and rounding
HALF_WAVE = 2e-2  # s; slower ones are friction's or a gap's
SWINGS = 2  # in a row, that noise or a jolt may make
DECAY = 0.95  # of the half wave before: a swing that dies away is left alone
LATE_STEP = 2.0  # of the doubt in a voltage that comes late
STEP = 1.4  # of a doubt with every further one
# times the shipped doubts: beyond, friction that falls with speed is seen too late
MOST_ENCODER, MOST_VOLTAGE = 8.0, 12.0
# heavy stages and soft drives show 5 to 20, late voltages 0.03 to 0.7, a slow amplifier 1 to 2
MECHANICAL, ELECTRICAL = 3.0, 0.7
# m; a gap of 0.5 degrees at the motor makes 1.1 to 2.7 um, ten times the mass 0.3, a payload on a soft drive 0.7
RATTLE = 1e-6
GROWN = 2.0  # times the doubt of the start, to which smaller swings have brought it: these grow, where a rattle begins
# m, first half wave of a row; gaps of 0.25 to 1 degree begin with 0.49 to 0.88 um, a soft drive in a fast move with
# 0.07 to 0.19, and doubles with every half wave: beyond `RATTLE` before the doubt has been raised to `GROWN`
BEGINS = 2.5e-7
# as `MECHANICAL`: the second half wave of a soft drive in a fast move has 17 to 54, that of heavy stages 15 at most;
# the largest factor on a doubt of one half wave
SOFT, LARGEST_STEP = 16.0, 3.0
SLOWER = 1.2  # of that half period: twice the mass has 1.4, a loop with four times the gain 0.6
# m, second half wave of a row, and how much more the encoder shows of it than the back-EMF (as `SOFT`): six times the
# mass on a third of the stiffness has 0.34 to 0.63 um and 7 to 20 (24 records). After more than SLOWLY half waves the
# latter does not count: three times the mass with a late voltage needs nine to pass 1 um. Calibrated on those and on
# the ends of moves through gaps of 0.1 to 1 degree (seeds 9400 to 9458), which a first half wave up to 0.45 um spoils
SECOND, HELD, SLOWLY = 7e-7, 5.0, 5
# m, half wave of the error at rest: smaller ones cross no gap. With it the ends of 2006 moves through a gap of 1 degree
# (`robustness --moves`, seeds 58000 to 58058 and 59000 to 59058) are the same to the last digit; with 0.6 µm 165 of
# 1003 end more than 100 nm off in place of 151
IN_A_GAP = 3e-7
SUSPECTED_TIME = 10.0  # s, since the last rattle
LEAST_STEP = 2e-3  # V, rms of steps beyond which noise of amplifier and current, which only adds to R di, is small
# 1, mean square of R di over du: 0.002 to 0.07 with a lag of 0.3 and 1 ms, a dead band of 50 mV, a filter of 300 Hz;
# 0.16 and more with twice the resistance, half the gain, a lag of 0.1 ms
FOLLOWS = 0.08
UNFOLLOWED = 5.0
FOLLOWED = 0.3  # share of the steps of the voltage, in R times the current's; a lag of 1 ms leaves 0.1 of a step
PERIODS = 20  # in a row: a current that answers late has answered by then
# 1, mean square of the position's innovation over the expected, where the reference stands: noise and rounding give
# (8^2 + 25^2/12)/18^2 = 0.36 of the doubt alone, below 0.43 in 99 of 100 periods where the loop does not ring; a stage
# that rings 1 to 3 (`robustness --only "delay 0.3 ms, mass x 3" --seeds 40 --seed 76000`)
RINGS = 0.8
RING_TIME = 0.1  # s, of an e-fold of the doubt: within two or three rests of 0.25 s; calibrated with the same
# s, for which the reference has stood: calibrated with `robustness --random 200 --first 8200 --seeds 2 --seed 12400`.
# After 0.05 s stages still ring after their moves: 87 of 400 runs changed, and 14 went more than 1.2 times as far
# astray (15 and 3 with 0.2 s)
REST_TIME = 0.2
# 1, doubt in the encoder that is left at rest where lost motion is suspected, and s, in which it comes down to that:
# with 8 what a move ends beside its target takes 0.3 s to be seen; with 2 motors rattle on at rest (`robustness --moves
# 1003 --only "backlash 0.5 deg"`: 16 moves missed, 18 with 8 and 35 with 2)
AT_REST, SETTLES = 4.0, 0.05
FADE = 1e-2  # 1/s, of the logarithm
# s, in which a voltage is believed again that swings of a heavy stage raised a doubt in: some of its periods (10 ms).
# Calibrated with the tilted stage of six times the mass and random machine 4059, as `wind_up` tells
RESTORED = 0.05
# calibrated with `robustness`, all conditions: used on the doubts of heavy stages and soft drives too, their first fast
# moves fail
RELAX = 1.0  # 1/s, of the logarithm
LIGHTER = 0.6  # of the inertia counted with: a gain 4.4 dB too high
FIELDS = [
    ("encoder_factor", "f8"),  # doubt in the encoder over the shipped one
    ("voltage_factor", "f8"),  # doubt in the voltage behind the back-EMF, over what its noise asks for
    ("swung_inertia", "f8"),  # 1, moving mass over the file's, counted with at the last swing
    ("encoder_noise", "f8"),  # m, doubt in the encoder that is counted with
    ("wave_smooth", "f8"),  # m, innovation without noise
    ("wave_slow", "f8"),  # m, its slow part
    ("wave_peak", "f8"),  # m, largest fast innovation since its sign changed
    ("wave_before", "f8"),  # m, size of the half wave before
    ("wave_first", "f8"),  # m, size of the first in the row
    ("wave_second", "f8"),  # m, of the second
    ("wave_time", "f8"),  # s, since then
    ("waves", "i8"),  # in a row
    ("push_power", "f8"),  # V^2, mean square of the steps of what the current answers, less the back-EMF
    ("unfollowed", "i8"),  # periods in a row in which the current has not followed the voltage
    ("suspected", "f8"),  # s, for which lost motion stays suspected
    ("drives", "i8"),  # 1: the law that regulates leans on this observer; swings under another one say nothing
]


@compiled
def doubt_reset(p, s):
    """The doubts of the start."""
    s.encoder_factor = p.encoder_doubt
    s.voltage_factor = p.voltage_doubt
    s.swung_inertia = 0.0
    s.encoder_noise = p.encoder_doubt * p.encoder_noise
    s.wave_smooth = 0.0
    s.wave_slow = 0.0
    s.wave_peak = 0.0
    s.wave_before = s.wave_first = s.wave_second = 0.0
    s.wave_time = 0.0
    s.waves = 0
    s.push_power = 0.0
    s.unfollowed = 0
    s.suspected = 0.0


@compiled
def trust_voltage(p, s):
    """The doubt in the voltage of the start: swings and steps that were not followed belong to another delay."""
    s.voltage_factor = p.voltage_doubt
    s.push_power = 0.0
    s.unfollowed = 0
    s.waves = 0


@compiled
def trust_lighter(p, s):
    """The doubts of the start where the axis is found to be far lighter than at the last swing."""
    if s.inertia < LIGHTER * s.swung_inertia:
        s.encoder_factor, s.voltage_factor = p.encoder_doubt, p.voltage_doubt
        s.swung_inertia = s.inertia
        s.waves = 0


@compiled
def lost_motion_suspected(s):
    """Whether drive and stage rattle in a gap, known or not: then swings and accelerations say nothing of one mass."""
    return s.gap > 0.0 or s.suspected > 0.0


@compiled
def encoder_doubted(p, s):
    """Whether swings have raised the doubt in the encoder as those of a heavy stage or a soft drive do."""
    return s.encoder_factor >= GROWN * p.encoder_doubt


@compiled
def rattles_at_rest(s, wave):
    """Whether swings at rest, of a half wave ``wave`` [m], are a motor's in a gap: all in one that is known, the larger
    ones where lost motion is suspected."""
    return s.gap > 0.0 or (s.suspected > 0.0 and wave > IN_A_GAP)


@compiled
def current_follows(model, s):
    """Whether the current's steps are those of the voltage that it is taken to answer, or too large to tell: noise."""
    drop = model.resistance * s.learned[0]
    noisy = drop * drop * s.far_current_power > s.far_voltage_power
    return noisy or drop * s.far_answers[s.lag] >= FOLLOWED * s.far_voltage_power


@compiled
def weigh_sources(p, model, s, period, position):
    """One period of the innovation ``position`` [m]."""
    drop = model.resistance * s.learned[0]
    turned = s.learned[2] * model.volts_per_velocity * s.acceleration * period
    step = far_voltage(s, s.lag) - far_voltage(s, s.lag + 1) - turned
    s.push_power += MEMORY * (step * step - s.push_power)
    excited = s.drives == 1 and s.push_power > LEAST_STEP * LEAST_STEP
    unfollowed = drop * drop * s.far_current_power < FOLLOWS * s.push_power
    s.unfollowed = s.unfollowed + 1 if excited and unfollowed else 0
    if s.unfollowed > PERIODS:
        s.voltage_factor = max(s.voltage_factor, UNFOLLOWED)
    s.wave_smooth += min(period / SMOOTH_TIME, 1.0) * (position - s.wave_smooth)
    s.wave_slow += min(period / SLOW_TIME, 1.0) * (s.wave_smooth - s.wave_slow)
    fast = s.wave_smooth - s.wave_slow
    s.wave_time += period
    s.suspected = max(s.suspected - period, 0.0)
    least, clear = WAVE * p.encoder_noise, CLEAR * p.encoder_noise
    s.waves, turned = half_wave(fast, s.wave_peak, s.waves, s.wave_time, HALF_WAVE, least, clear)
    if turned:
        swings = s.waves > SWINGS or s.waves == SWINGS and swings_up(s)
        grows = abs(s.wave_peak) > DECAY * s.wave_before
        if s.drives == 1 and swings and grows:
            doubt_more(p, model, s)
        s.wave_before = abs(s.wave_peak)
        if s.waves <= 1:
            s.wave_first = s.wave_before
        if s.waves == 2:
            s.wave_second = s.wave_before
        s.wave_peak = fast
        s.wave_time = 0.0
    elif abs(fast) > abs(s.wave_peak):
        s.wave_peak = fast
    if s.gap > 0.0:
        s.voltage_factor = p.voltage_doubt
    if s.suspected > 0.0:
        s.encoder_factor = doubt_in_lost_motion(p, s, period)
    if s.drives == 1 and rings_quietly(s):
        s.encoder_factor = min(s.encoder_factor * (1.0 + period / RING_TIME), max(MOST_ENCODER, p.encoder_doubt))
    both = s.encoder_factor > p.encoder_doubt
    both = both and s.voltage_factor * p.encoder_doubt >= s.encoder_factor * p.voltage_doubt
    slides = s.slipping > 0.9 and s.waves == 0 and s.rest_time_s == 0.0
    kept = 1.0 - (RELAX if both and slides and inertia_unread(s) else FADE) * period
    s.encoder_factor = max(s.encoder_factor * kept, p.encoder_doubt, min(s.encoder_factor, s.held_doubt))
    if stage_swings_low(p, s) and s.unfollowed == 0 and s.drive_train_test < 1.0:
        kept = 1.0 - period / RESTORED
    s.voltage_factor = max(s.voltage_factor * kept, p.voltage_doubt)
    s.encoder_noise = s.encoder_factor * p.encoder_noise


@compiled
def doubt_in_lost_motion(p, s, period):
    """Doubt in the encoder, over the shipped one [1], where drive and stage may be apart."""
    if s.rest_time_s < SETTLES or s.waves > 0:
        return max(MOST_ENCODER, p.encoder_doubt)
    return max(s.encoder_factor * (1.0 - period / SETTLES), AT_REST, p.encoder_doubt)


@compiled
def rings_quietly(s):
    """Whether the encoder shows more at rest than noise, the back-EMF does not, and no half wave counts as a swing."""
    at_rest = s.rest_time_s > REST_TIME and s.waves == 0 and not lost_motion_suspected(s)
    return at_rest and s.position_test > max(RINGS, MECHANICAL * s.speed_test)


@compiled
def glides(s):
    """Whether the axis slides faster than this half wave swings, by v > ω A: then friction holds the drive to one flank
    of a gap."""
    return abs(s.v) * s.wave_time > math.pi * abs(s.wave_peak)


@compiled
def swings_up(s):
    """Whether this half wave is one of a row that began as no gap makes it and grows, and hardly shows in the
    back-EMF."""
    steps = began_small(s, SOFT) or s.waves > SWINGS and grew_from_small(s)
    return steps and abs(s.wave_peak) > STEP * s.wave_before


@compiled
def grew_from_small(s):
    """Whether the first two half waves of the row were smaller than those of a rattle."""
    return s.wave_second < SECOND and began_small(s, HELD if s.waves <= SLOWLY else 0.0)


@compiled
def began_small(s, ratio):
    """Whether the row began as no gap makes it and shows in the encoder by ``ratio`` [1] more than in the back-EMF."""
    return s.wave_first < BEGINS and s.position_test > ratio * s.speed_test


@compiled
def slower_than_file(model, s):
    """Whether this half wave is longer than half a period of the file's stage on its drive, π √(m/K), by `SLOWER`."""
    return s.wave_time > SLOWER * math.pi * math.sqrt(model.mass * model.compliance)


@compiled
def doubt_more(p, model, s):
    """Answer one swing."""
    low = stage_swings_low(p, s) and s.unfollowed == 0
    late = s.position_test < ELECTRICAL * s.speed_test and not low
    announced = grew_from_small(s) or began_small(s, SOFT) or encoder_doubted(p, s)
    rattle = s.gap > 0.0 or abs(s.wave_peak) > RATTLE and not announced
    if not late and rattle and not glides(s):
        s.voltage_factor = p.voltage_doubt
        s.suspected = SUSPECTED_TIME
    if s.gap > 0.0 or not late and s.suspected > 0.0:
        return
    s.swung_inertia = s.inertia
    if not late:
        step = min(abs(s.wave_peak) / s.wave_before, LARGEST_STEP) if swings_up(s) else STEP
        s.encoder_factor = min(step * s.encoder_factor, max(MOST_ENCODER, p.encoder_doubt))
    rings = encoder_doubted(p, s) and slower_than_file(model, s) or low
    if late or s.position_test < MECHANICAL * s.speed_test and not rings:
        s.voltage_factor = min((LATE_STEP if late else STEP) * s.voltage_factor, max(MOST_VOLTAGE, p.voltage_doubt))
