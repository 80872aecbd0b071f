"""Self-tuning of the PID gains by adaptive interaction, raw and robust.

Raw law (Lin, Brandt, Saikalis 2000, plant-free form, one coefficient; section 5.3 of the paper), with the
time unit tau that gives the three gains K_P, K_I tau, K_D / tau one unit:

    dK_P/dt = g e^2,    dK_I/dt = g e S / tau^2,    dK_D/dt = g tau^2 e de/dt,    S = integral of e

The trapezoidal rule used here keeps the closed forms K_I = K_I0 + g S^2 / (2 tau^2) and
K_D = K_D0 + g tau^2 (e^2 - e0^2) / 2 exact. Left alone the law only accumulates, and its speed goes with
e^2, 10^6 between 1 um and 1 mm.

Robust law. The same three products drive the logarithms of the gains, after the cures below:

* error and its slope pass a filter; a dead band (the encoder's resolution) is taken off the error, so that
  noise at rest teaches nothing;
* e, S and tau de/dt are divided by dead_band^2 + e^2 + S^2 + (tau de/dt)^2: the speed does not depend on the
  size of the move;
* S forgets with 10 tau and only e S > 0 counts: an error that persists raises K_I, an overshoot does not
  make it collapse;
* the gains stay between `floor` and a ceiling times the tuned ones (`ceiling`, `integral_ceiling`, `damping_ceiling`),
  K_I at most `spread` times ahead of K_P, K_D not behind K_P, nor behind a raised K_I by more than `follow` allows; a
  raised K_D brings a longer filter. That is beyond the tuned margins, and stands only as long as nothing swings;
* the set shrinks where the axis says so. A swing is a half wave of the error's fast part beyond
  `alternation`, shorter than 10 tau; the fifth in a row and every later one is answered. Swings faster than
  tau / 2 are those of a resonance: a longer filter of the derivative first, up to `filter_ceiling`, and with it lower
  ceilings (`soft_...`): on a loaded or soft axis it is K_I that lets a creeping stage hunt, so where friction is fed
  forward, the feed-forward takes over from it (`soft_share`). Then less K_D (by `damping_share`). Every other answer
  lowers the ceilings of K_P and K_I by `back_off`; slow swings, of stick-slip or backlash, keep their damping. Below
  `prompt` it takes many more swings, so that one jolt of a lightly damped axis, which rings down by itself, does not
  cost more gain than it has to; a swing beyond `large` counts in full everywhere, for that is a gap being crossed,
  where a slow integral is what helps. Below `joint` the ceiling of K_I falls twice as far, and so does what is fed
  forward; K_I comes up again while reference and error stand still, so that a move ends at its target. None falls
  below its least, and all rise at `recovery`, slowly, so that an axis whose limit was found stays near it;
* where the reference stands and swings go on all the same, `LASTING` in a row, K_P and K_D fade with each further one,
  below every floor, until friction holds the axis: without them the loop is an axis that rests, led to within `HELD` of
  its target by K_I alone. An axis that slides is thrown by K_I alone, from side to side of a gap and ever further. So
  they are back as soon as the error's fast part is beyond `large` and `THROWN` half waves, or the reference moves;
* in the observer law and the encoder-only law that it hands over to, K_D alone fades where K_P is at its least, the
  reference moves and `LASTING` swings in a row have gone on all the same: it is what keeps a motor rattling in a gap.
  It is back within some `fade_time` once the swings have ended or the reference stands. (By themselves the encoder-only
  laws end more moves through a gap beside their target with it: 155 of 800 beyond 100 nm in place of 133.)
"""

import math

from microstage_ros.control.gains import Gain, record_type
from microstage_ros.control.half_waves import half_wave
from microstage_ros.control.laws.pid import pid_change
from microstage_ros.numerics.compiled import compiled

GAINS = (
    Gain("raw", "1", 0.0, 1.0, 0.0, "1: the raw law without its cures (for comparison only)"),
    Gain("raw_coefficient", "V/(m^3 s)", 0.0, 1e30, 1e17, "g of the raw law"),
    Gain("time_unit", "s", 1e-5, 10.0, 0.01, "tau, which gives K_P, K_I tau, K_D / tau one unit"),
    Gain("speed", "1/s", 0.0, 1e3, 60.0, "rate of the logarithm of a gain under a full-size error"),
    Gain("back_off", "1", 0.0, 10.0, 0.1, "fall of the logarithm of the ceiling with a swing"),
    Gain("damping_share", "1", 0.0, 1.0, 0.8, "share of the back-off that K_D takes part in"),
    Gain("prompt", "1", 1e-4, 1.0, 0.6, "ceiling over the tuned gains below which swings lower it slowly"),
    Gain("large", "m", 1e-9, 1.0, 6.0e-7, "swing that is answered in full below `prompt` too"),
    Gain("joint", "1", 1e-4, 1.0, 0.4, "ceiling of K_P below which that of K_I falls twice as far"),
    Gain("filter_ceiling", "1", 1.0, 100.0, 2.5, "longest filter time over the tuned one"),
    Gain("soft_proportional", "1", 1e-4, 100.0, 0.5, "ceiling of K_P under the longest filter"),
    Gain("soft_integral", "1", 1e-4, 100.0, 0.12, "ceiling of K_I under the longest filter"),
    Gain("soft_damping", "1", 1e-4, 100.0, 0.8, "ceiling of K_D under the longest filter"),
    Gain("soft_share", "1", 0.0, 2.0, 0.9, "share of the friction that is fed forward under the longest filter"),
    Gain("recovery", "1/s", 0.0, 100.0, 0.003, "rise of the logarithm of a lowered ceiling"),
    Gain("fade_time", "s", 1e-3, 1e6, 0.1, "in which K_D comes back e-fold after swings that went on"),
    Gain("dead_band", "m", 0.0, 1e-3, 2.5e-8, "error that teaches nothing"),
    Gain("alternation", "m", 1e-10, 1e-3, 4.0e-8, "smallest half wave of the error that is called a swing"),
    Gain("start", "1", 1e-4, 100.0, 1.0, "gains at reset over the tuned ones"),
    Gain("floor", "1", 1e-4, 1.0, 0.1, "lowest gains over the tuned ones"),
    Gain("least_ceiling", "1", 1e-4, 1.0, 0.12, "lowest that swings may bring the ceiling of K_P"),
    Gain("least_damping", "1", 1e-4, 1.0, 0.25, "lowest that swings may bring the ceiling of K_D"),
    Gain("least_integral", "1", 1e-4, 1.0, 0.03, "lowest that swings may bring the ceiling of K_I"),
    Gain("ceiling", "1", 1.0, 100.0, 1.2, "highest K_P over the tuned one"),
    Gain("integral_ceiling", "1", 1.0, 100.0, 2.0, "highest K_I over the tuned one"),
    Gain("damping_ceiling", "1", 1.0, 100.0, 2.0, "highest K_D over the tuned one"),
    Gain("follow", "1", 0.0, 1.0, 1.0, "share of the logarithm of a raised K_I that K_D takes part in at least"),
    Gain("spread", "1", 1.0, 10.0, 3.0, "how far K_I may be ahead of K_P"),
    Gain("calm_gain", "1", 0.05, 1.0, 1.0, "gains at rest over those in motion"),
    Gain("calm_damping", "1", 0.05, 1.0, 1.0, "K_D at rest over that, beside"),
    Gain("calm_band", "m", 0.0, 1e-3, 5.0e-8, "error up to which the axis is at rest"),
    Gain("calm_time", "s", 1e-3, 1e3, 0.1, "time in which it comes to rest"),
)
CORNER = math.log(0.55)  # of the bandwidth, below which w_p is bound to it (`design.rules`: b / 4.4 < 270 1/s)
SLOWLY = 0.04  # of `back_off`, below `prompt`
# of the logarithm of a raised K_D, by which the filter grows: what K_D passes on of noise and resonance hardly grows
FILTERED = 0.7
LASTING = 40  # swings in a row, beyond which what has been lowered does not end them
LEAST_HUSH = math.log(0.01)  # of K_P and K_D
# s, of one such step where no half waves are counted: `LEAST_HUSH` within 0.6 s, as long as a limit cycle is let go on
UNSEEN_TIME = 2e-2
# half waves, of the smallest since they began to fade; derived: friction does not hold a swing that has grown twofold
THROWN = 2.0
# m, error within which friction is left to hold it: K_I would only wind up until it lets go; chosen on ten times the
# mass behind gaps of 0.5 and 1 degree, seeds 31000 to 31039 (4 and 8 of 40 swing on)
HELD = 1e-7
BACK_TIME = 1e-3  # s, in which they grow e-fold once the reference moves, or the axis is thrown
STANDING = math.log(1.5)  # of K_I ahead of K_P on a lowered ceiling, where the axis stands
LOGGED = (
    "prompt", "joint", "filter_ceiling", "soft_proportional", "soft_integral", "soft_damping", "floor", "least_ceiling",
    "least_damping", "least_integral", "ceiling", "integral_ceiling", "damping_ceiling", "spread",
)
PARAMETERS = record_type(GAINS, [(f"log_{name}", "f8") for name in LOGGED])
STATE_FIELDS = [
    ("error", "f8"),  # m, of the previous period
    ("integral", "f8"),  # m s (raw)
    ("filtered", "f8"),  # m
    ("slope", "f8"),  # m, tau times the slope of the filtered error
    ("leaky", "f8"),  # m, forgetting integral of the error over tau
    ("slow", "f8"),  # m, slow part of the error
    ("smooth", "f8"),  # m, error without the encoder's noise
    ("peak", "f8"),  # m, largest fast error since its sign changed; it has the sign
    ("since", "f8"),  # s, time since its sign changed
    ("swings", "i8"),  # in a row
    ("ceiling", "f8"),  # logarithm of the present ceiling of K_P
    ("damping_ceiling", "f8"),  # logarithm of the present ceiling of K_D
    ("more_share", "f8"),  # of the friction, fed forward beyond the law's own share
    ("log_filter", "f8"),  # logarithm of the filter time over the tuned one
    ("log_kp", "f8"),  # natural logarithms of the gains over the tuned ones
    ("log_ki", "f8"),
    ("log_kd", "f8"),
    ("calm", "f8"),  # 0: in motion, 1: at rest
    ("wave", "f8"),  # m, size of the half wave before
    ("rest_swings", "i8"),  # in a row, since the reference stands
    ("rest_wave", "f8"),  # m, smallest half wave since K_P and K_D began to fade; 0: they do not
    ("damping_fade", "f8"),  # logarithm of what swings that go on leave of K_D
    ("hush", "f8"),  # logarithm of what they leave of K_P and K_D
]


def take_logarithms(record):
    """Fill the logarithms of a parameter record from its gains: every period asks for them."""
    for name in LOGGED:
        record[f"log_{name}"] = math.log(record[name])


@compiled
def adaptation_reset(p, s, pid_s):
    """Forget what was learned; gains at `start` times the tuned ones."""
    s.error = 0.0
    s.integral = 0.0
    s.filtered = 0.0
    s.slope = 0.0
    s.leaky = 0.0
    s.slow = 0.0
    s.smooth = 0.0
    s.peak = 0.0
    s.since = 0.0
    s.swings = 0
    s.ceiling = p.log_ceiling
    s.damping_ceiling = p.log_damping_ceiling
    s.log_filter = 0.0
    s.calm = 0.0
    s.more_share = 0.0
    s.wave = 0.0
    s.rest_swings = 0
    s.rest_wave = 0.0
    s.damping_fade = 0.0
    s.hush = 0.0
    s.log_kp = math.log(p.start)
    s.log_ki = s.log_kp
    s.log_kd = s.log_kp
    pid_s.kp *= p.start
    pid_s.ki *= p.start
    pid_s.kd *= p.start


@compiled
def adapt_raw(p, s, error, period):
    """Increments of K_P [V/m], K_I [V/(m s)], K_D [V s/m] in one period by the raw law."""
    mean = 0.5 * (error + s.error)
    step = mean * period
    up = p.raw_coefficient * 0.5 * (error * error + s.error * s.error) * period
    ui = p.raw_coefficient / (p.time_unit * p.time_unit) * step * (s.integral + 0.5 * step)
    ud = p.raw_coefficient * p.time_unit * p.time_unit * mean * (error - s.error)
    s.integral += step
    s.error = error
    return up, ui, ud


@compiled
def adapt_robust(p, s, error, speed, period, fades):
    """One period of the robust law on the logarithms of the gains in ``s``; ``speed`` [m/s] of the reference."""
    outside = max(abs(error) - p.dead_band, 0.0) * (1.0 if error > 0.0 else -1.0)
    share = min(period / (0.1 * p.time_unit), 1.0)
    before = s.filtered
    s.filtered += share * (outside - s.filtered)
    s.slope = (s.filtered - before) * p.time_unit / period
    forget = period / (10.0 * p.time_unit)
    s.leaky += (s.filtered * period / p.time_unit) - forget * s.leaky
    size = p.dead_band * p.dead_band + s.filtered * s.filtered + s.leaky * s.leaky + s.slope * s.slope
    rate = p.speed * period / size
    s.log_kp += rate * s.filtered * s.filtered
    s.log_ki += rate * max(s.filtered * s.leaky, 0.0)
    s.log_kd += rate * s.filtered * s.slope
    long = 10.0 * p.time_unit
    still = stands_still(p, speed)
    watch_swings(p, s, error, period)
    hush(p, s, still and fades, period)
    project(p, s, still, still and s.since > long)


@compiled
def watch_swings(p, s, error, period):
    """Count half waves of the fast part of the error; lower the ceiling while they go on."""
    s.smooth += min(period / (0.05 * p.time_unit), 1.0) * (error - s.smooth)
    s.slow += min(period / (2.0 * p.time_unit), 1.0) * (error - s.slow)
    fast = s.smooth - s.slow
    s.since += period
    s.ceiling = min(s.ceiling + p.recovery * period, p.log_ceiling)
    s.damping_ceiling = min(s.damping_ceiling + p.recovery * period, p.log_damping_ceiling)
    s.swings, turned = half_wave(fast, s.peak, s.swings, s.since, 10.0 * p.time_unit, p.alternation, 0.0)
    if turned:
        if s.swings > 4:
            lower_ceilings(p, s)
        s.wave = abs(s.peak)
        s.peak = fast
        s.since = 0.0
    elif abs(fast) > abs(s.peak):
        s.peak = fast


@compiled
def allow_for_delay(s, share):
    """Lower the ceilings for a voltage that acts late, to the ``share`` [1] of the bandwidth that is left.

    K_D goes as the bandwidth, K_P too, and as its square where the corner between them has to come down as well.
    """
    slower = math.log(share)
    s.ceiling = min(s.ceiling, slower + min(slower - CORNER, 0.0))
    s.damping_ceiling = min(s.damping_ceiling, slower)


@compiled
def stands_still(p, speed):
    """Whether the reference, at ``speed`` [m/s], moves by less than the dead band in ten time units."""
    return abs(speed) * 10.0 * p.time_unit < p.dead_band


@compiled
def fade_damping(p, s, speed, period):
    """Let K_D fade while swings go on at ``speed`` [m/s] and K_P has nothing left to give; after `adaptation_step`."""
    if s.swings == 0 or stands_still(p, speed):
        s.damping_fade = min(s.damping_fade + period / p.fade_time, 0.0)
    elif s.since == 0.0 and s.swings > LASTING and s.ceiling == p.log_least_ceiling:
        s.damping_fade = max(s.damping_fade - p.back_off, p.log_least_damping)


@compiled
def hush(p, s, still, period):
    """Let K_P and K_D fade while swings go on though the reference is ``still``; called after `watch_swings`."""
    thrown = s.rest_wave > 0.0 and abs(s.smooth - s.slow) > max(p.large, THROWN * s.rest_wave)
    if thrown or not still:
        s.rest_swings, s.rest_wave = 0, 0.0
    if s.rest_wave == 0.0:
        s.hush = min(s.hush + period / BACK_TIME, 0.0)
    if still and s.since == 0.0:
        s.rest_swings = s.rest_swings + 1 if s.swings > 0 else 0
        if s.rest_swings > LASTING:
            s.rest_wave = min(s.rest_wave, s.wave) if s.rest_wave > 0.0 else s.wave
            s.hush = max(s.hush - p.back_off, LEAST_HUSH)


@compiled
def fade_at_rest(p, s, wave, period):
    """As `hush`, where not the loop's own error but the encoder shows the swing, of half wave ``wave`` [m]."""
    s.rest_wave = max(s.rest_wave, wave)
    s.hush = max(s.hush - p.back_off * period / UNSEEN_TIME, LEAST_HUSH)


@compiled
def lower_ceilings(p, s):
    """Answer one swing: a longer filter against a fast one while there is room, else lower gains."""
    fast = s.since < 0.5 * p.time_unit
    if fast and s.log_filter < p.log_filter_ceiling:
        s.log_filter += p.back_off
        return
    low = p.log_least_ceiling
    present = min(s.ceiling, s.log_kp)
    step = p.back_off if abs(s.peak) > p.large or present > p.log_prompt else SLOWLY * p.back_off
    s.ceiling = max(present - step, low)
    if fast:
        s.damping_ceiling = max(min(s.damping_ceiling, s.log_kd) - p.damping_share * step, p.log_least_damping)


@compiled
def project(p, s, still, stands):
    """Bring the gains back into the stable set: floor, ceilings, and not too far from each other.

    While the axis ``stands`` no gap is being crossed: K_I may come up to K_P, or a move never ends;
    and while the reference is ``still``, K_I may under a long filter too.
    """
    shrunk = min(s.ceiling - p.log_joint, 0.0)
    soft = softness(p, s)
    ahead = min(p.log_integral_ceiling - p.log_ceiling, max(s.ceiling - p.log_joint, 0.0))
    follow = p.follow if shrunk == 0.0 else 0.0
    s.log_kp = min(max(s.log_kp, p.log_floor), s.ceiling, between(soft, p.log_ceiling, p.log_soft_proportional))
    calm = max(p.log_soft_integral, p.log_soft_proportional) if still else p.log_soft_integral
    lowered = max(s.ceiling + ahead + (STANDING if stands and shrunk < 0.0 else shrunk), p.log_least_integral)
    top = min(lowered, between(soft, p.log_integral_ceiling, calm), s.log_kp + p.log_spread)
    s.log_ki = min(max(s.log_ki, 2.0 * p.log_floor), top)
    least = max(p.log_floor, min(s.log_kp, 0.0), follow * max(s.log_ki, 0.0) if follow > 0.0 else p.log_floor)
    s.log_kd = min(max(s.log_kd, least), s.damping_ceiling, between(soft, p.log_damping_ceiling, p.log_soft_damping))


@compiled
def softness(p, s):
    """How far the filter has been made longer, 0 ... 1, by the logarithm."""
    return min(s.log_filter / p.log_filter_ceiling, 1.0) if p.filter_ceiling > 1.0 else 0.0


@compiled
def between(soft, top, calm):
    """Logarithm of a ceiling on its way from ``top`` to ``calm``, both logarithms; never above ``top``."""
    return top + soft * min(calm - top, 0.0)


@compiled
def take_over(p, s, pid_s, friction, own_share):
    """Feed-forward [V] beyond ``own_share`` of the modelled ``friction`` [V], so much as K_I has given way; no jump of
    the output."""
    more = softness(p, s) * max(p.soft_share - own_share, 0.0)
    pid_s.integral -= (more - s.more_share) * friction
    s.more_share = more
    return more * friction


@compiled
def fed_forward(p, s):
    """Share of the feed-forward [1] under the present ceiling: it falls as K_I does, for across a gap it throws the
    stage too."""
    return math.exp(2.0 * min(s.ceiling - p.log_joint, 0.0))


@compiled
def come_to_rest(p, s, pid_s, period):
    """Follow whether the axis is at rest at its target: stuck blocks hold it, and gains only pass on the encoder's
    noise."""
    if pid_s.reference_velocity == 0.0 and abs(pid_s.error) < p.calm_band:
        s.calm = min(s.calm + period / p.calm_time, 1.0)
    else:
        s.calm = 0.0


@compiled
def adaptation_step(p, s, pid_p, pid_s, period, scale, fades):
    """Tune the gains of ``pid_s`` from its newest error, without a jump of the output.

    ``scale`` [1] of the tuned ones; ``fades``: whether swings at rest let them fade (not those in a gap, which a motor
    has to get out of).
    """
    if p.raw > 0.5:
        up, ui, ud = adapt_raw(p, s, pid_s.error, period)
        pid_change(pid_p, pid_s, pid_s.kp + up, pid_s.ki + ui, pid_s.kd + ud)
        return
    if pid_s.saturated == 0:
        adapt_robust(p, s, pid_s.error, pid_s.reference_velocity, period, fades)
    pid_s.filter_time = pid_p.filter_time * math.exp(max(s.log_filter, FILTERED * p.follow * s.log_kd, 0.0))
    come_to_rest(p, s, pid_s, period)
    share = scale * (1.0 - s.calm * (1.0 - p.calm_gain))
    fade = math.exp(s.hush) if s.hush < 0.0 else 1.0
    kp = fade * share * pid_p.proportional * math.exp(s.log_kp)
    held = s.hush < 0.0 and abs(s.smooth) < HELD
    ki = 0.0 if held else share * pid_p.proportional / pid_p.integral_time * math.exp(s.log_ki)
    kd = (
        fade
        * share
        * (1.0 - s.calm * (1.0 - p.calm_damping))
        * pid_p.proportional
        * pid_p.derivative_time
        * math.exp(s.log_kd + s.damping_fade)
    )
    pid_change(pid_p, pid_s, kp, ki, kd)
