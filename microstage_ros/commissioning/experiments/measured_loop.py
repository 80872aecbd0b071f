"""The open loop of a law, measured on the machine at rest and in motion with a multi-sine added to the voltage.

The self-tuning laws answer a test signal: their gains follow the error that it makes, and the observer law learns the
drive from it. What is measured here is the law as the axis file holds it, with nothing learned on the way (`FROZEN`):
the loop that the margins of the design are of, and with which every start begins.
"""

import math

import numpy as np
from scipy.signal import lfilter

from microstage_ros.commissioning.estimation.frequency_response import multi_sine, responses
from microstage_ros.commissioning.experiments.closed_loop import LOOSE, Loop
from microstage_ros.commissioning.experiments.first_motion import joined
from microstage_ros.control.laws.controller import Controller, controller_parameters, gain_list
from microstage_ros.control.observer.drive_learning import NOISE_DOUBT
from microstage_ros.control.observer.motor_constant import FILTER_TIME, UNTOLD
from microstage_ros.control.trajectories.profiles import jerk_limited_move
from microstage_ros.control.tuning.margins import frequency_response, loop_of, pid_transfer, regimes
from microstage_ros.control.tuning.tuning import GUARDED

FROZEN = {
    "speed": 0.0,
    "back_off": 0.0,
    "calm_gain": 1.0,
    "calm_damping": 1.0,
    "resistance_spread": 0.0,
    "zero_spread": 0.0,
    "emf_spread": 0.0,
    "level_variability": 0.0,
}
"""Gains with which a self-tuning law learns nothing."""
HELD = {
    "waves": 0,
    "unfollowed": 0,
    "emf_doubt": 0.0,
    "emf_ratio_time_s": 0.0,
    "strayed": 0.0,
    "steady": 0.0,
    "running": math.inf,
}
"""What the observer law finds that no gain turns off, set back before each period: swings in a row and periods in which
the current does not follow (`source_doubt`), the motor constant read from one motion and the doubt in it
(`motor_constant`), a position that stays beside the encoder, for how long the voltage has been explained (without that
no change of the drive is found), for how long its noise has been averaged (`drive_learning`). The ratio of back-EMF to
speed, filtered, swings by a fifth with the test signal: the doubt that came of it took up to 85 % off the loop gain,
alike in each period of the signal, so that the coherence did not show it."""
OBSERVED = "self_tuning_observer"
STEP_SHARE, FAST = 0.2, 1e-4
"""The observer law takes steps of the voltage between periods for noise, and believes the back-EMF less where they are
beyond its doubt; that cannot be turned off. What is added has steps of at most ``STEP_SHARE`` of the noise that the
doubt stands for (more at longer periods than ``FAST`` [s], where a minute holds fewer of them)."""
FLAT = (30.0, 60.0, 120.0, 240.0)
"""Frequencies [Hz] up to which all lines have one size; from there they fall with 1/f, so that every line has the same
share of the steps. The first is taken that keeps the next limit too."""
PEAK_UNTOLD = 0.5
"""Slow voltages added, at most, over the voltage of which the observer law says nothing: more was taken for another
motor constant, and is more than the loop needs."""
SPEED_SHARE = 0.15
"""Rms of the speed added in motion, over that of the motion: the stage does not come near to standing. On four
current-driven motors, where the loop amplified the lines to 0.4, it stood for moments, and friction added up to 11° of
phase; with 0.25 it went down to 0.15 of the speed and the margins were 0.3 to 2.8° off, with 0.15 and 0.08 up to
0.16°."""
PEAK_SHARE = 0.3  # of the voltage limit, largest voltage added
UNSEEN = 0.03  # modelled loop gain above which there are lines
REST_SHARE = 0.25  # of breakaway, rms of the voltage added at rest
USUAL_SHARE = 0.35  # of the voltage that slides the stage, rms of the voltage added for the observer law
SLIDE_SPEED = 1e-3  # m/s
LINES, REST_PERIODS = 60, 20
INTERPOLATED = 4
"""Multiples of speed over signal period at which an encoder's interpolation errs: one and two by offset, gain and phase
of its two signals (Heydemann, Applied Optics 20 (1981)), up to four by their distortion. It is in step with the slide,
so that the coherence does not show it."""
SLIDES, OBSERVED_SLIDES = 6, 10


class HeldController(Controller):
    """The observer law with its findings set back to `HELD` before each period."""

    def step(self, reference, encoder, current=0.0):
        """As `Controller.step`."""
        observer = self.memory["observer"]
        for name, value in HELD.items():
            observer[name] = value
        observer["noise_variance"] = (float(self.parameters["observer"]["voltage_noise"]) / NOISE_DOUBT) ** 2
        return super().step(reference, encoder, current)


class Frozen(Loop):
    """The law of another `Loop` on the same machine, learning nothing: gains `FROZEN`, findings `HELD`."""

    def __init__(self, loop):
        known = {gain.name for gain in gain_list(loop.law)}
        held = {name: value for name, value in FROZEN.items() if name in known}
        super().__init__(loop.machine, loop.axis, loop.law, loop.sliding, {**loop.gains, **held})

    def _made(self, limit=None):
        controller = super()._made(limit)
        return HeldController(controller.type, controller.parameters) if self.law == OBSERVED else controller


def loop_at_rest(loop, breakaway, seed, keep):
    """(plant, loop) `Response` while the frozen law holds still.

    ``breakaway``: voltage at which the stage lets go [V]; ``seed``: of the phases [1].
    """
    machine, held = loop.machine, Frozen(loop)
    most = REST_SHARE * breakaway
    if loop.law == OBSERVED:
        made = _unnoticed(held, 5.0, most, seed)
    else:
        made = multi_sine(machine.period, 5.0, 0.42 / machine.period, lambda f: 1.0, seed, LINES)
        made = _scaled(made, most / np.sqrt(np.mean(made.signal**2)))
    settle = machine.periods(0.3)
    extra = np.concatenate([np.zeros(settle), made.times(REST_PERIODS + 1), made.signal[:1]])
    record = held.follow(np.full(len(extra), machine.position), extra)
    keep("response_at_rest", record)
    first = settle + made.rows
    return responses([_part(record, first, first + REST_PERIODS * made.rows + 1)], made, machine.period, "rest")


def loop_in_motion(loop, found, seed, keep):
    """(plant, loop) responses while the frozen law slides the stage to and fro; (None, None) without a slide that holds
    two periods of the multi-sine. ``found``: `open_loop.Strokes`; ``seed``: of the phases [1]."""
    machine, held = loop.machine, Frozen(loop)
    speed = min(SLIDE_SPEED, 0.5 * held.top_speed)
    length = min(2.5e-3, 0.1 * machine.stroke)
    period, observed = machine.period, loop.law == OBSERVED
    lowest = max(5.0, 4.0 * speed / length)
    if observed:
        made = _unnoticed(held, lowest, USUAL_SHARE * (found.friction + found.volts_per_speed * speed), seed)
    else:
        made = _loud(held, found, lowest, speed, seed)
    centre, parts, records = machine.position, [], []
    rng = np.random.default_rng(seed)
    for number in range(OBSERVED_SLIDES if observed else SLIDES):
        move = jerk_limited_move(
            machine.position, centre + (length if number % 2 == 0 else 0.0), period, held.limits(speed)
        )
        steady = np.flatnonzero(np.abs(np.abs(np.diff(move)) / period - speed) < 1e-3 * speed)
        if len(steady) < made.rows * 2:
            return None, None
        first = steady[0] + min(machine.periods(0.1), made.rows)
        count = int((steady[-1] - first) // made.rows)
        extra, lead = np.zeros(len(move)), min(first, made.rows)
        shifted = np.roll(made.signal, rng.integers(made.rows))  # friction that repeats along the way is not in step
        extra[first : first + count * made.rows] = np.tile(shifted, count)
        extra[first - lead : first] = shifted[-lead:]
        pause = machine.periods(0.1)
        record = held.follow(
            np.append(move, np.full(pause, move[-1])),
            np.append(extra, np.zeros(pause)),
            error=LOOSE,
            fresh=not observed or number == 0,
            go_on=observed,
        )
        records.append(record)
        if count >= 1:
            parts.append(_part(record, first, first + count * made.rows + 1))
    if observed:
        machine.rest(0.0)
    keep("response_in_motion", joined(records))
    if not parts:
        return None, None
    kept = not_interpolated(made.lines / (made.rows * period), speed, machine.axis, 0.5 / (made.rows * period))
    return tuple(each.at(kept) for each in responses(parts, made, period, "sliding"))


def not_interpolated(frequency, speed, axis, near):
    """Which lines at ``frequency`` [Hz] no error of the encoder's interpolation reaches in a slide; bool, shape (n,).

    ``speed``: of the slide [m/s]; ``near``: so close to a multiple is on it [Hz]. The signal period is the sketch's, or
    the usual one: a wrong one costs four lines.
    """
    first = speed / axis.value("sensors.encoder.signal_period")
    return np.all([np.abs(frequency - k * first) > near for k in range(1, INTERPOLATED + 1)], axis=0)


def _loud(loop, found, lowest, speed, seed):
    """`MultiSine` for a law on the encoder: lines that each shake the stage at the same speed, where the loop amplifies
    them too, as far up as the modelled loop gain is above `UNSEEN`, together `SPEED_SHARE` of the ``speed`` [m/s] of
    the motion."""
    period, limit = loop.machine.period, loop.machine.limit
    inertia = 2.0 * math.pi * max(found.inertia, 0.0)
    frequency, response = _modelled(loop)
    highest = float(frequency[np.abs(response) > UNSEEN].max(initial=0.0))
    highest = min(max(highest, 20.0 * lowest), 0.42 / period)

    def amplitude(f):
        amplified = min(float(np.interp(f, frequency, np.abs(1.0 + response))), 1.0)
        return amplified * math.hypot(found.volts_per_speed, f * inertia)

    made = multi_sine(period, lowest, highest, amplitude, seed, LINES)
    line = SPEED_SHARE * speed * math.sqrt(2.0 / len(made.lines))
    return _scaled(made, min(line, PEAK_SHARE * limit / np.abs(made.signal).max()))


def _modelled(loop):
    """(frequency [Hz], loop [1]), shape (400,) each, of a law on the encoder, modelled in sliding."""
    period = loop.machine.period
    rule = controller_parameters(loop.law, loop.axis, loop.gains)["pid"]
    transfer = pid_transfer({name: float(rule[name]) for name in rule.dtype.names}, period)
    plant = next(plant for name, plant, _ in regimes(loop.axis) if name == GUARDED[1])
    frequency = np.geomspace(1.0, 0.49 / period, 400)
    return frequency, frequency_response(loop_of(plant, transfer, period), 2.0 * math.pi * frequency, period)


def _unnoticed(loop, lowest, most, seed):
    """`MultiSine` that the observer law takes neither for noise (`STEP_SHARE`) nor for another motor constant
    (`PEAK_UNTOLD`); ``most``: rms [V]."""
    period = loop.machine.period
    doubt = float(loop.controller.parameters["observer"]["voltage_noise"])
    allowed = STEP_SHARE * max(period / FAST, 1.0) * doubt / NOISE_DOUBT
    for flat in FLAT:
        made = multi_sine(period, lowest, 0.42 / period, lambda f, flat=flat: min(1.0, flat / f), seed, LINES)
        two = made.times(2)
        by_steps = allowed / np.sqrt(np.mean(np.diff(two) ** 2))
        by_peak = PEAK_UNTOLD * UNTOLD / np.abs(_low_passed(two, period)[made.rows :]).max()
        if by_steps <= by_peak:
            break
    return _scaled(made, min(by_steps, by_peak, most / np.sqrt(np.mean(made.signal**2))))


def _low_passed(values, period):
    """Through the filter of first order behind which the observer law compares speeds (`FILTER_TIME`)."""
    share = min(period / FILTER_TIME, 1.0)
    return lfilter([share], [1.0, share - 1.0], values)


def _scaled(made, factor):
    return type(made)(made.lines, made.rows, made.signal * factor)


def _part(record, start, stop):
    return tuple(values[start:stop] for values in (record["encoder_m"], record.command, record.disturbance))
