"""Whether the observer law may go on: swings, a rest beside the target, innovations; and the way to the encoder-only
law and back.

The observer law leans on its model of the drive. Three signs say that the model does not hold:

* a limit cycle: half waves of the error (encoder alone, without its slow part) beyond `swing`, each within `half_wave`
  of the one before: more than `swings` in a row for `cycle_time` (`HEAVY` times that where doubts hold a heavy stage or
  a soft drive, whose swing dies away slowly), since a motor that rattles in a gap finds its
  contact by then, and the observer its doubts (`observer.source_doubt`), or the fifth, beyond `large_swing`. Noise does
  not alternate so regularly, and a move gives one or two. At rest a smaller one is no sign: while the size of the
  error's fast part, averaged over `REST_TIME`, is beyond `rest_swing` (a sine of 0.19 um peak to peak), K_P and K_D
  fade;
* the axis rests beside its target: beyond `beside` for `beside_time` while the reference stands, or the error's size,
  averaged over `REST_TIME`, is beyond `rest_error` there: a swing that is too slow or too small for the first sign;
* innovations: the mean square of the position's and of the speed's innovation over what the filter expects stays beyond
  `position_test` or `speed_test` for `test_time`; or the error is beyond `lost` for `lost_time` while drive and stage
  are taken to be apart, which no crossing of a gap takes; or the current has been noisier than `loudest` for
  `NOISE_TIME` (normalised innovation squared; Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking
  and Navigation", Wiley 2001, section 5.4). After noise, and where lost motion is known or suspected, the encoder-only
  law is fed forward: the model of the axis holds.

Then the encoder-only self-tuning law goes on from the voltage that was last given, after swings from its mean. It
hands back once the axis has rested at its target and the innovations have been consistent for `calm_time`, and for
`proof_time` of motion since they last were not, not before `trial_time` has passed, and `patience` times that after
every further hand-over. For `probation` after that, and at the start, at rest, one error beyond `trial_error` ends the
trial.
"""

from microstage_ros.control.gains import Gain
from microstage_ros.control.half_waves import half_wave
from microstage_ros.numerics.compiled import compiled, internal

GAINS = (
    Gain("supervised", "1", 0.0, 1.0, 1.0, "0: the observer law is never left, its doubts are not learned"),
    Gain("swing", "m", 1e-9, 1.0, 3.0e-7, "half wave of the error that counts as a swing"),
    Gain("swings", "1", 1.0, 1e6, 10.0, "of them in a row that are a limit cycle"),
    Gain("cycle_time", "s", 0.0, 100.0, 0.6, "for which they last"),
    Gain("large_swing", "m", 1e-9, 1.0, 1.0e-5, "half wave beyond which they are at once"),
    Gain("half_wave", "s", 1e-4, 10.0, 4e-2, "longest half wave of it"),
    Gain("beside", "m", 1e-9, 1.0, 1.5e-7, "error at rest that is no rest at the target"),
    Gain("beside_time", "s", 1e-3, 100.0, 0.25, "for which it lasts"),
    Gain("rest_error", "m", 1e-9, 1.0, 1.0e-7, "mean size of the error at rest that is no rest"),
    Gain("rest_swing", "m", 1e-9, 1.0, 6.0e-8, "mean size of the error's fast part at rest that is a swing"),
    Gain("lost", "m", 1e-9, 1.0, 1.2e-5, "error while drive and stage are apart that no gap explains"),
    Gain("lost_time", "s", 0.0, 100.0, 5e-3, "for which it lasts"),
    Gain("proof_time", "s", 0.0, 100.0, 0.05, "of motion, consistent, before the observer law is tried again"),
    Gain("position_test", "1", 1.0, 1e9, 30.0, "mean square of the position's innovation over the expected"),
    Gain("speed_test", "1", 1.0, 1e9, 30.0, "the same of the speed's"),
    Gain(
        "loudest",
        "V",
        1e-6,
        10.0,
        5e-2,
        "doubt in the voltage behind the back-EMF beyond which the current is worth nothing",
    ),
    Gain("test_time", "s", 1e-3, 100.0, 1.0, "for which innovations are too large"),
    Gain("calm_time", "s", 1e-3, 100.0, 0.1, "at rest and consistent before the observer law is tried again"),
    Gain("trial_time", "s", 1e-3, 1e6, 2.0, "before the first trial"),
    Gain("probation", "s", 0.0, 100.0, 1.0, "length of a trial"),
    Gain("trial_error", "m", 1e-9, 1.0, 1.5e-7, "error at rest that ends it"),
    Gain("patience", "1", 1.0, 1e3, 16.0, "by which the time to the next trial grows with every hand-over"),
)
OBSERVER, ENCODER_ONLY = range(2)
NOTHING, SWINGS, BESIDE, INNOVATIONS, START_CHECK, _, NOISE = range(7)  # 5: of bags before delays were allowed for
#: What is said of a hand-over, by its number.
REASONS = (
    "",
    "limit cycle",
    "rests beside its target",
    "innovations beyond what the filter expects",
    "unstable on the axis file's own model",
    "the voltage acts late",
    "the current is too noisy",
)
# times `cycle_time`: the swings of six times the mass on a third of the stiffness have died away within 0.9 s, and the
# encoder-only law is thrown by 80 um there: calibrated with `robustness --only "mass x 6, stiffness / 3"`
HEAVY = 3.0
NOISE_TIME = 0.05  # s: five times the shortest memory of the noise that is found
LARGE_SWINGS = 4  # in a row, the last one beyond `large_swing`: no gap is that wide, and a move gives one or two
SMOOTH_TIME, SLOW_TIME = 5e-4, 2e-2  # s, of the error's fast part
STILL_TIME = 0.05  # s, for which the reference has stood when a rest is judged
# s, over which a rest is averaged, and after which it is one: a gap may still be searched before
REST_TIME, SETTLED_TIME = 0.5, 1.0
AT_TARGET = 6e-8  # m, error of the encoder's smoothed reading that is a rest at the target
FIELDS = [
    ("law", "i8"),  # OBSERVER or ENCODER_ONLY
    ("reason", "i8"),  # of the last hand-over
    ("handovers", "i8"),
    ("since", "f8"),  # s, since the last change of the law
    ("wait", "f8"),  # s, before the next trial
    ("smooth", "f8"),  # m, error without noise
    ("mean_voltage_V", "f8"),  # over a swing: what the axis needs
    ("slow", "f8"),  # m, its slow part
    ("peak", "f8"),  # m, largest fast error since its sign changed
    ("last_half_wave_m", "f8"),  # size of the half wave before
    ("half", "f8"),  # s, since then
    ("swings", "i8"),  # in a row
    ("swinging", "f8"),  # s, since the first of them
    ("deaf", "f8"),  # s, for which the current was too noisy
    ("rest_time_s", "f8"),  # s, for which the reference has
    ("beside", "f8"),  # s, for which the axis has rested beside its target
    ("doubted", "f8"),  # s, for which innovations were too large
    ("rest_size", "f8"),  # m, mean size of the error at rest
    ("rest_swing", "f8"),  # m, that of its fast part
    ("lost", "f8"),  # s, for which the error has been too large while apart
    ("proved", "f8"),  # s, of motion with consistent innovations
    ("calm", "f8"),  # s, at rest at the target and consistent
]


@internal
def _count_anew(s):
    """What was counted under the law before is no evidence about the one that begins."""
    s.since = 0.0
    s.swings = 0
    s.beside = 0.0
    s.doubted = 0.0
    s.rest_size = s.rest_swing = 0.0


@compiled
def supervision_reset(p, s, unstable, voltage):
    """The observer law, unless the start's check said that it is ``unstable`` (1)."""
    s.law = ENCODER_ONLY if unstable != 0 else OBSERVER
    s.reason = START_CHECK if unstable != 0 else NOTHING
    s.handovers = 0
    s.wait = p.trial_time
    s.smooth = 0.0
    s.mean_voltage_V = voltage
    s.slow = 0.0
    s.peak = 0.0
    s.last_half_wave_m = 0.0
    s.half = 0.0
    s.swinging = 0.0
    s.deaf = 0.0
    s.rest_time_s = 0.0
    s.lost = 0.0
    s.proved = 0.0
    s.calm = 0.0
    _count_anew(s)


@compiled
def watch_error(p, s, error, reference_speed, in_gap, voltage, period):
    """One period of the encoder's ``error`` [m]: swings in a row, rest beside the target; ``in_gap``: drive and stage
    are taken to be apart."""
    s.since += period
    s.mean_voltage_V += min(period / SLOW_TIME, 1.0) * (voltage - s.mean_voltage_V)
    s.smooth += min(period / SMOOTH_TIME, 1.0) * (error - s.smooth)
    s.slow += min(period / SLOW_TIME, 1.0) * (s.smooth - s.slow)
    fast = s.smooth - s.slow
    s.half += period
    s.swinging = s.swinging + period if s.swings > 0 else 0.0
    s.swings, turned = half_wave(fast, s.peak, s.swings, s.half, p.half_wave, p.swing, 0.0)
    if turned:
        s.last_half_wave_m = abs(s.peak)
        s.peak = fast
        s.half = 0.0
    elif abs(fast) > abs(s.peak):
        s.peak = fast
    s.rest_time_s = s.rest_time_s + period if reference_speed == 0.0 else 0.0
    s.lost = s.lost + period if in_gap and abs(error) > p.lost else 0.0
    if s.rest_time_s > SETTLED_TIME:
        s.rest_size += period / REST_TIME * (abs(s.smooth) - s.rest_size)
        s.rest_swing += period / REST_TIME * (abs(fast) - s.rest_swing)
    else:
        s.rest_size = s.rest_swing = 0.0
    rests = s.rest_time_s > STILL_TIME
    s.beside = s.beside + period if rests and abs(s.slow) > p.beside else 0.0
    s.calm = s.calm + period if rests and abs(s.slow) < AT_TARGET and s.swings == 0 else 0.0


@compiled
def sign_of_trouble(p, s, position_test, speed_test, noise, heavy, period):
    """Why the observer law may not go on, `NOTHING` if it may; tests: normalised innovations squared [1]; ``noise``
    [V]; ``heavy``: its doubts are those of a heavy stage or a soft drive."""
    doubted = position_test > p.position_test or speed_test > p.speed_test
    s.doubted = s.doubted + period if doubted else 0.0
    s.deaf = s.deaf + period if noise > p.loudest else 0.0
    cycle_time = HEAVY * p.cycle_time if heavy else p.cycle_time
    if s.swings > p.swings and s.swinging > cycle_time or abs(s.peak) > p.large_swing and s.swings > LARGE_SWINGS:
        return SWINGS
    if s.handovers > 0 and s.since < p.probation and s.rest_time_s > s.since and abs(s.smooth) > p.trial_error:
        return SWINGS
    if s.beside > p.beside_time or s.rest_size > p.rest_error:
        return BESIDE
    if s.deaf > NOISE_TIME:
        return NOISE
    if s.lost > p.lost_time or s.doubted > p.test_time:
        return INNOVATIONS
    return NOTHING


@compiled
def hand_over(p, s, reason):
    """The encoder-only law from now on."""
    s.law = ENCODER_ONLY
    s.reason = reason
    s.handovers += 1
    if s.handovers > 1:
        s.wait *= p.patience
    _count_anew(s)
    s.lost = 0.0
    s.proved = 0.0
    s.calm = 0.0


@compiled
def may_return(p, s, position_test, speed_test, noise, period):
    """Whether the observer law is to be tried again."""
    if position_test > p.position_test or speed_test > p.speed_test or noise > p.loudest:
        s.calm = 0.0
        s.proved = 0.0
    elif s.rest_time_s == 0.0:
        s.proved += period
    return s.reason != START_CHECK and s.since > s.wait and s.calm > p.calm_time and s.proved > p.proof_time


@compiled
def hand_back(s):
    """The observer law from now on."""
    s.law = OBSERVER
    _count_anew(s)
