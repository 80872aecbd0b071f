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
* the gains stay between `floor` and `ceiling` times the tuned ones, K_I at most `spread` times ahead of K_P,
  and K_D not behind it: the stable set, whose margins `control.margins` computes;
* the set shrinks where the axis says so. A swing is a half wave of the error's fast part beyond
  `alternation`, shorter than 10 tau; the fifth in a row and every later one is answered. Swings faster than
  tau / 2 are those of a resonance: a longer filter of the derivative first, up to `filter_ceiling`, then less
  K_D (by `damping_share`). Every other answer lowers the ceilings of K_P and K_I by `back_off`; slow swings, of
  stick-slip or backlash, keep their damping. Below `prompt` it takes many more swings, so that one jolt of a
  lightly damped axis, which rings down by itself, does not cost more gain than it has to; a swing beyond `large`
  counts in full everywhere, for that is a gap being crossed, where a slow integral is what helps. Below `joint` the
  ceiling of K_I falls twice as far, and so does what is fed forward; K_I comes up again while reference and error stand
  still, so that a move ends at its target. None falls below its least, and all rise at `recovery`, slowly, so that an axis
  whose limit was found stays near it.
"""

import math

from microstage_ros.axis.compiled import compiled
from microstage_ros.control.gains import Gain, record_type
from microstage_ros.control.pid import pid_change

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
    Gain("filter_ceiling", "1", 1.0, 100.0, 3.0, "longest filter time over the tuned one"),
    Gain("recovery", "1/s", 0.0, 100.0, 0.003, "rise of the logarithm of a lowered ceiling"),
    Gain("dead_band", "m", 0.0, 1e-3, 2.5e-8, "error that teaches nothing"),
    Gain("alternation", "m", 1e-10, 1e-3, 4.0e-8, "smallest half wave of the error that is called a swing"),
    Gain("start", "1", 1e-4, 100.0, 1.0, "gains at reset over the tuned ones"),
    Gain("floor", "1", 1e-4, 1.0, 0.1, "lowest gains over the tuned ones"),
    Gain("least_ceiling", "1", 1e-4, 1.0, 0.12, "lowest that swings may bring the ceiling of K_P"),
    Gain("least_damping", "1", 1e-4, 1.0, 0.25, "lowest that swings may bring the ceiling of K_D"),
    Gain("least_integral", "1", 1e-4, 1.0, 0.03, "lowest that swings may bring the ceiling of K_I"),
    Gain("ceiling", "1", 1.0, 100.0, 1.2, "highest gains over the tuned ones"),
    Gain("spread", "1", 1.0, 10.0, 1.5, "how far K_I may be ahead of K_P"),
    Gain("calm_gain", "1", 0.05, 1.0, 1.0, "gains at rest over those in motion"),
    Gain("calm_damping", "1", 0.05, 1.0, 1.0, "K_D at rest over that, beside"),
    Gain("calm_band", "m", 0.0, 1e-3, 5.0e-8, "error up to which the axis is at rest"),
    Gain("calm_time", "s", 1e-3, 1e3, 0.1, "time in which it comes to rest"),
)
SLOWLY = 0.04  # of `back_off`, below `prompt`
PARAMETERS = record_type(GAINS)
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
    ("log_filter", "f8"),  # logarithm of the filter time over the tuned one
    ("log_kp", "f8"),  # natural logarithms of the gains over the tuned ones
    ("log_ki", "f8"),
    ("log_kd", "f8"),
    ("calm", "f8"),  # 0: in motion, 1: at rest
]


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
    s.ceiling = math.log(p.ceiling)
    s.damping_ceiling = s.ceiling
    s.log_filter = 0.0
    s.calm = 0.0
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
def adapt_robust(p, s, error, speed, period):
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
    watch_swings(p, s, error, period)
    long = 10.0 * p.time_unit
    stands = abs(speed) * long < p.dead_band and s.since > long
    project(p, s, stands)


@compiled
def watch_swings(p, s, error, period):
    """Count half waves of the fast part of the error; lower the ceiling while they go on."""
    s.smooth += min(period / (0.05 * p.time_unit), 1.0) * (error - s.smooth)
    s.slow += min(period / (2.0 * p.time_unit), 1.0) * (error - s.slow)
    fast = s.smooth - s.slow
    s.since += period
    s.ceiling = min(s.ceiling + p.recovery * period, math.log(p.ceiling))
    s.damping_ceiling = min(s.damping_ceiling + p.recovery * period, math.log(p.ceiling))
    if s.since > 10.0 * p.time_unit:
        s.swings = 0
    if fast * s.peak < 0.0:
        s.swings = s.swings + 1 if abs(s.peak) > p.alternation else 0
        if s.swings > 4:
            lower_ceilings(p, s)
        s.peak = fast
        s.since = 0.0
    elif abs(fast) > abs(s.peak):
        s.peak = fast


@compiled
def lower_ceilings(p, s):
    """Answer one swing: a longer filter against a fast one while there is room, else lower gains."""
    fast = s.since < 0.5 * p.time_unit
    if fast and s.log_filter < math.log(p.filter_ceiling):
        s.log_filter += p.back_off
        return
    low = math.log(p.least_ceiling)
    present = min(s.ceiling, s.log_kp)
    step = p.back_off if abs(s.peak) > p.large or present > math.log(p.prompt) else SLOWLY * p.back_off
    s.ceiling = max(present - step, low)
    if fast:
        s.damping_ceiling = max(min(s.damping_ceiling, s.log_kd) - p.damping_share * step, math.log(p.least_damping))


@compiled
def project(p, s, stands):
    """Bring the gains back into the stable set: floor, ceilings, and not too far from each other.

    While the axis ``stands`` no gap is being crossed: K_I may come up to K_P, or a move never ends.
    """
    low = math.log(p.floor)
    wide = math.log(p.spread)
    shrunk = min(s.ceiling - math.log(p.joint), 0.0)
    if stands and shrunk < 0.0:
        shrunk = wide
    s.log_kp = min(max(s.log_kp, low), s.ceiling)
    s.log_ki = min(max(s.log_ki, 2.0 * low), max(s.ceiling + shrunk, math.log(p.least_integral)), s.log_kp + wide)
    s.log_kd = min(max(s.log_kd, low, min(s.log_kp, 0.0)), s.damping_ceiling)


@compiled
def fed_forward(p, s):
    """Share of the feed-forward [1] under the present ceiling: it falls as K_I does, for across a gap it throws the stage too."""
    return math.exp(2.0 * min(s.ceiling - math.log(p.joint), 0.0))


@compiled
def come_to_rest(p, s, pid_s, period):
    """Follow whether the axis is at rest at its target: stuck blocks hold it, and gains only pass on the encoder's noise."""
    if pid_s.reference_velocity == 0.0 and abs(pid_s.error) < p.calm_band:
        s.calm = min(s.calm + period / p.calm_time, 1.0)
    else:
        s.calm = 0.0


@compiled
def adaptation_step(p, s, pid_p, pid_s, period):
    """Tune the gains of ``pid_s`` from its newest error, without a jump of the output."""
    if p.raw > 0.5:
        up, ui, ud = adapt_raw(p, s, pid_s.error, period)
        pid_change(pid_p, pid_s, pid_s.kp + up, pid_s.ki + ui, pid_s.kd + ud)
        return
    if pid_s.saturated == 0:
        adapt_robust(p, s, pid_s.error, pid_s.reference_velocity, period)
    if s.log_filter > 0.0:
        pid_s.filter_time = pid_p.filter_time * math.exp(s.log_filter)
    come_to_rest(p, s, pid_s, period)
    share = 1.0 - s.calm * (1.0 - p.calm_gain)
    kp = share * pid_p.proportional * math.exp(s.log_kp)
    ki = share * pid_p.proportional / pid_p.integral_time * math.exp(s.log_ki)
    kd = share * (1.0 - s.calm * (1.0 - p.calm_damping)) * pid_p.proportional * pid_p.derivative_time * math.exp(s.log_kd)
    pid_change(pid_p, pid_s, kp, ki, kd)
