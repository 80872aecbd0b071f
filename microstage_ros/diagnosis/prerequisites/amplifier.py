"""Delay and lag of the amplifier: found first, from the fast part alone, and then taken into the input of all else."""

import dataclasses
import math

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from microstage_ros.diagnosis.catalogue.command import (
    DELAYS,
    FORMS,
    delay_and_lag_form,
    delay_form,
    delayed,
    lag_form,
    lagged,
    late_and_lagged,
    part_of,
    weight_of_old,
    whole_delay_form,
)
from microstage_ros.diagnosis.residuals.collection import Collection

GAIN = next(form for form in FORMS if not form.named)
LEAST_GAIN = 60.0   # χ²; derived: one size reaches it by chance in 10⁻¹⁴ of the cases
# periods by which a gain that differs by 1 may seem late; calibrated by:
# `microstage campaign --world second --kind single --seed 1003 --cases 60`: 2.3 of what this channel
# reads of the gain (0.04 of 0.07, case 12; the only one there)
GAIN_TIME = 4.0
# share of a lag that gain and lag cannot tell apart above 1 kHz; calibrated by: microstage campaign --form-errors
# (0.007 to 0.015)
LAG_ERROR = 0.015
# of a period, of a lag; calibrated by: `test/diagnosis/cases/plain_programmes.py --effect actuator_lag` (0.02 to 0.04)
LAG_STEP = 0.03
# of a period, of a delay, and of the weight of the command before it; calibrated by: the same (0.00098 to 0.0030)
DELAY_ERROR = 0.003
# of a period: next to a whole one, what is left of it hardly shows; calibrated by: validation.variation --group delay
# --cases 2 (half and double: the same answers)
DELAY_STEP = 0.02
LEAST_TIME = 2.0 * DELAY_STEP     # periods; derived: two steps; less is a matter of stamps
DOMINANCE = 0.5          # of the gain of the strongest form, accepted or not, that the answer must reach
HELD_SHARE = 0.1         # of what it can hold on held-out records; derived: as `selection.HELD_SHARE`
# of what an average learning record shows that is enough, too; calibrated by: validation.margins (0.097 to 0.48)
TAUGHT_SHARE = 0.2
# of what it can hold in the baseline's records that they may show of it; derived: 2 s − 1 of a baseline that has the
# share s = 0.65 of its time
IN_BASELINE = 0.3
# weight of the command of one period before, that it may seem to have where no baseline tells; calibrated by:
# `test/diagnosis/cases/test_default_law.py` (−0.025 under the shipped law), and by hand, with `_feigned_weight` of two
# records of moves to and fro (−0.039 and −0.042; no command prints these)
UNSEEN_WEIGHT = 0.04
LONGEST = 64             # periods; derived: the power of two above the 60 that `TransportDelay` may have
# periods; derived: half way between two of the catalogue's forms, and half as far again
DELAY_REACH = 0.75
DELAY_STEPS = np.arange(-DELAY_REACH, DELAY_REACH, LEAST_TIME)
# periods short of a whole one, where the winding just begins to answer; derived: up to two steps of a delay
SHORT_OF_WHOLE = tuple(DELAY_STEP * n for n in (2.0, 1.5, 1.0, 0.5))
MOST_SHIFTS = 5          # of the range searched; derived: 1.7⁵ is a factor of fourteen
REACH = 1.7              # of the range searched, upwards; derived: from 0.6 it spans 2.8, the forms' times 2.7
# of the form's own time, where to look for one that holds `MUCH_LESS` of it, and else from where on; derived: an
# optimum near an end moves the range on, so that neither decides anything
SHORTER, BELOW, MUCH_LESS = (0.01, 1.3), 0.6, 0.4
TOLERANCE = 2.0e-3       # of the time or the period; derived: a tenth of `DELAY_STEP`
MOST_TRIES = 14          # derived: 0.62¹⁴, by golden sections, is a thousandth of the range
AT_END = 1.02            # so near to its end an optimum lies beyond; derived: ten times the search's tolerance
# of what one of delay and lag explains, what both explain more; calibrated by: microstage campaign --world second
# --kind single --seed 12720, `--effect actuator_lag` and `--effect transport_delay` (1.1e-4 of lags and delays alone),
# and --kind two --seed 12701, case 32 (0.01)
BESIDE = 1.0e-3
SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)   # of a delay in what looks like one time; derived: even steps
SIDE = 0.1               # of that time, and of the lag; derived: half a step of `SHARES`
MOST_LOOKS = 80          # evaluations; derived: some fifteen halvings of the simplex, at five each
MOST = 0.5               # of a channel's χ²; derived: more than all else
# relative difference of χ² by which delay and lag must differ; calibrated by: validation.margins (0.0070 to 0.70), and
# microstage campaign --world second --kind two --seed 12901, case 12, and 12501, case 61 (0.019 and 0.025, lags)
CLEAR = 0.01
OPEN = 20.0              # χ², and by which they must at least; derived: odds of exp(20/2), 22 000 to one


@dataclasses.dataclass(frozen=True)
class Slowness:
    """What was found: ``effect`` with its time [s], χ² reductions, and whether the other one fits as well.

    ``held_usual``: χ² that the baseline's noise alone leaves in the held-out rows, in units of theirs; ``lag`` [s] of
    an amplifier that delays, too, its standard error, and its part of ``held``; 0 without one.
    """

    effect: str
    time: float
    stderr: float
    gain: float
    held: float
    held_before: float
    held_rows: int
    rival: bool
    noise: float
    winding: float
    held_usual: float
    lag: float = 0.0
    lag_stderr: float = 0.0
    lag_held: float = 0.0

    @property
    def total(self):
        """Delay and lag together [s]."""
        return self.time + self.lag

    def apply(self, command, period):
        """The ``command`` (n,) as the slow amplifier passes it on, at a ``period`` [s]."""
        if self.lag:
            return late_and_lagged(command, self.time / period, self.lag / period, period / self.winding)
        if self.effect == "transport_delay":
            return delayed(command, self.time / period, period / self.winding)
        return lagged(command, self.time, period, period / self.winding)


def find_slowness(prepared, drive, more=None):
    """`Slowness` of the amplifier, or None.

    Parameters
    ----------
    prepared : {group: [`Prepared`]} with what is known. drive : of the records.
    more : voltage (n,) [V] that the amplifier puts out beyond the command, for each learning, then each held-out
        record; None before that is known. Without it a lag takes what is missing of the fast part, or too much, for its
        own: at a gain of 1.07 it was 8 % short (`campaign --world second --kind two --seed 12501`, case 66).
    """
    fast = Collection(prepared, drive, fast_only=True)
    if "command" not in fast.names:
        return None
    changed = [c["command"] for name in ("learn", "held") for c in fast.channels[name]]
    for channel, voltage in zip(changed, more or []):
        channel.put_out(channel.command + voltage)
    learn, period = fast.growing("command", [GAIN], "learn"), prepared["learn"][0].period
    winding = drive.inductance / drive.resistance
    forms = [*_candidates(fast), *_within_a_period(learn, period / winding)]
    trials, strongest = [], 0.0
    for form in forms:
        beta, _, gain = learn.alone(form).fit([form.key])
        strongest = max(strongest, gain)
        if form.accept(beta):
            trials.append((gain, form, float(beta[0])))
    best = {effect: max((t for t in trials if t[1].effect == effect), key=lambda t: t[0], default=None)
            for effect in ("transport_delay", "actuator_lag")}
    feigned = _feigned_weight(fast)
    doubt = abs(feigned) if fast.channels["base"] else UNSEEN_WEIGHT
    refined = [_refine(learn, trial, period, winding, feigned, doubt)
               for trial in best.values() if trial and trial[0] > LEAST_GAIN]
    refined = sorted((r for r in refined if r is not None), key=lambda r: -r[0])
    if not refined or refined[0][2] < LEAST_TIME * period:
        return None
    gain, effect, time, stderr = refined[0]
    if gain < DOMINANCE * strongest:  # a time that makes no sense explains more: neither is true
        return None
    noise = float(np.mean([c["command"].noise for c in fast.channels["held"]]))
    rival = len(refined) > 1 and refined[1][0] > gain - max(OPEN, CLEAR * gain)
    rows = sum(len(c["command"].residual) for c in fast.channels["held"])
    slow = Slowness(effect, time, stderr, gain, 0.0, 0.0, rows, rival, noise, winding, _usual(fast))
    single, form = _on_held(fast, slow, _form(effect, time, period)), _form(effect, time, period)
    both, pair = _delay_and_lag(learn, single, period)
    if both is not None:
        both = _on_held(fast, both, pair)
        left = single.held_before - single.held - single.held_usual
        if left > BESIDE * single.held and both.held > single.held + MOST * left:
            without = [_on_held(fast, both, one).held for one in (
                lag_form(both.lag, anyway=True), delay_form(both.time / period, period, anyway=True))]
            more = both.held - np.array(without)        # that the delay, and that the lag explains beside the other
            single, form = dataclasses.replace(both, lag_held=float(both.held * more[1] / more.sum())), pair
    return single if _stands(fast, single, form, period) else None


def _on_held(fast, slow, form):
    """``slow`` with χ² of the held-out records before it, and of its ``form`` there."""
    held = fast.gather("command", [form, GAIN], "held")
    return dataclasses.replace(slow, held=held.reduction([form.key], np.ones(1)), held_before=held.energy())


def _stands(fast, slow, form, period):
    """Whether a slow amplifier is no gain that differs, is there in the held-out records and not in the baseline."""
    if slow.total < GAIN_TIME * abs(_gain_beside(fast, form)) * period:
        return False
    held, base = (fast.gather("command", [form, GAIN], name) for name in ("held", "base"))
    # held-out records that move the amplifier less show less of it: then most of what they show is enough, or a part of
    # what it can hold there
    records = max(len(fast.channels["learn"]), 1)
    needed = min(TAUGHT_SHARE * slow.gain / records, MOST * held.energy(), HELD_SHARE * held.matrix[1, 1])
    if slow.gain < LEAST_GAIN or slow.held < max(needed, LEAST_GAIN):
        return False
    return base is None or base.reduction([form.key], np.ones(1)) <= IN_BASELINE * base.matrix[1, 1]


def _delay_and_lag(learn, slow, period):
    """(`Slowness`, `Form`) of an amplifier that both delays and lags, where that explains clearly more of the learning
    records than ``slow``, one of the two alone; else (None, None). ``period`` [s]."""
    def loss(place):
        form = delay_and_lag_form(abs(place[0]), math.exp(place[1]))
        return -learn.alone(form).reduction([form.key], np.ones(1))

    total = slow.time / period
    start = min(((share * total, math.log((1.0 - share) * total)) for share in SHARES), key=loss)
    simplex = np.array([start, (start[0] + SIDE * total, start[1]), (start[0], start[1] + SIDE)])
    found = minimize(loss, start, method="Nelder-Mead",
                     options={"initial_simplex": simplex, "xatol": TOLERANCE, "fatol": OPEN, "maxfev": MOST_LOOKS})
    periods, lag = abs(float(found.x[0])), math.exp(float(found.x[1]))
    if min(periods, lag) < LEAST_TIME or -found.fun < (1.0 + BESIDE) * slow.gain:
        return None, None
    error = float(np.hypot(LAG_ERROR * lag, LAG_STEP) * period)
    both = dataclasses.replace(slow, effect="transport_delay", time=periods * period, stderr=error, gain=-found.fun,
                               rival=False, lag=lag * period, lag_stderr=error)
    return both, delay_and_lag_form(periods, lag)


def _usual(fast):
    """χ² [1] that the noise of the baseline leaves in the held-out rows, each record's in units of its own noise, which
    holds what is not explained; without a baseline their number."""
    noises = {name: [c["command"].noise for c in some if "command" in c] for name, some in fast.channels.items()}
    usual = float(np.mean(noises["base"])) if noises["base"] else np.inf
    rows = [len(c["command"].residual) for c in fast.channels["held"]]
    return float(sum(n * min(usual / noise, 1.0) ** 2 for n, noise in zip(rows, noises["held"])))


def _feigned_weight(fast):
    """Weight [1] that the command of one period before seems to have in the baseline, whose amplifier is prompt; 0
    without one.

    A law that feeds back the measured current puts its noise into the next rows of the command (`residuals.command`):
    −0.025 under the shipped one, 0.001 where the encoder alone is read (`test_default_law.py`).
    """
    form = delay_form(1.0, anyway=True)
    base = fast.gather("command", [form, GAIN], "base")
    return 0.0 if base is None else float(base.fit([form.key])[0][0])


def _corrected(time, winding, feigned, doubt=None):
    """A delay [periods] and its standard error [periods], by the weight of the command of one period before.

    Of ``feigned`` [1], or without a baseline of ``doubt`` [1] with either sign, that weight holds something between
    none and all, as a law may feed back the current in some parts of a record only: half of it is taken off, and is an
    error beside `DELAY_ERROR`. Just beyond a whole period the weight hardly grows with the delay, just short of one it
    does all the more; so the delay's error is the larger distance to the delays of two errors of the weight, as of an
    even distribution. ``winding``: T/τ [1].
    """
    whole = int(time)
    weight = whole + weight_of_old(time - whole, winding) - 0.5 * feigned
    error = 2.0 * np.hypot(0.5 * (feigned if doubt is None else doubt), DELAY_ERROR)
    least, found, most = (np.floor(end) + part_of(end - np.floor(end), winding)
                          for end in (weight - error, weight, weight + error))
    return float(found), float(max(most - found, found - least) / np.sqrt(3.0))


def _candidates(fast):
    """Forms to try: the catalogue's, and delays around the one at which the residual repeats the command."""
    length, total = 2 * LONGEST, np.zeros(LONGEST - 1)
    for channel in (c["command"] for c in fast.channels["learn"]):
        command = channel.beside_speed(channel.command)
        residual, command = channel.whiten(np.hstack([channel.residual[:, None], command]))[0].T
        size = 2 ** int(np.ceil(np.log2(len(residual) + length)))
        spectrum = np.fft.rfft(residual, size) * np.conj(np.fft.rfft(command, size))
        total = total + np.fft.irfft(spectrum, size)[1:LONGEST]
    at = 1 + int(np.argmax(total))
    known = {form.variant for form in FORMS}
    near = [delay_form(at + part) for part in (-0.5, 0.0, 0.5)]
    return [*(form for form in FORMS if form.named), *(form for form in near if form.variant not in known)]


def _within_a_period(learn, winding):
    """The delay of less than a period that the fast part tells, as a list of one `Form`, or of none.

    All of these have one column, as large as `weight_of_old` of their time; ``winding``: T/τ [1]. The catalogue's few
    times are of a size that is hardly ever the right one where a winding answers within the period.
    """
    any_part = delay_form(DELAYS[0])
    old = float(learn.alone(any_part).fit([any_part.key])[0][0]) * weight_of_old(DELAYS[0], winding)
    return [delay_form(part_of(old, winding))] if 0.0 < old < 1.0 else []


def _form(effect, time, period):
    return (
        delay_form(time / period, period, anyway=True) if effect == "transport_delay" else lag_form(time, anyway=True)
    )


def _gain_beside(fast, form):
    """Relative size of the command that the current answers beside this form, less one."""
    top = bottom = 0.0
    for channel in (c["command"] for c in fast.channels["learn"]):
        left = channel.residual - form.columns(channel, fast.frame)[:, 0]
        command = channel.beside_speed(channel.command)
        left, command = channel.whiten(np.hstack([left[:, None], command]))[0].T
        top, bottom = top + float(left @ command), bottom + float(command @ command)
    return top / bottom if bottom > 0.0 else 0.0


def _around_whole_periods(loss, start, period):
    """Delays beside the best one on a fine grid around ``start`` [s]: the winding makes much of a little in a period, a
    narrow optimum beside a broad one. Where the best is the grid's last, the grid moves there."""
    centre = start / period
    for _ in range(MOST_SHIFTS):
        wholes = np.arange(np.ceil(centre - DELAY_REACH), np.floor(centre + DELAY_REACH) + 1.0)
        tried = np.concatenate([centre + DELAY_STEPS, *(wholes - part for part in SHORT_OF_WHOLE)])
        tried = np.sort(tried[tried > 0.0]) * period
        at = min(range(len(tried)), key=lambda n: loss(tried[n]))
        if 0 < at < len(tried) - 1:
            break
        centre = tried[at] / period
    at = int(np.clip(at, 1, len(tried) - 2))
    return tried[at - 1], tried[at + 1]


def _loss(learn, effect, period, winding):
    """The function of an effect's time [s] that is least where β = 1 explains most: less the reduction of χ²."""
    of_whole = {}

    def of_delay(time):
        whole = int(time / period)
        if whole not in of_whole:
            form = whole_delay_form(whole)
            of_whole[whole] = learn.alone(form), form.key
        evidence, key = of_whole[whole]
        return -evidence.reduction([key], np.array([1.0, weight_of_old(time / period - whole, period / winding)]))

    def of_lag(time):
        form = lag_form(float(time), anyway=True)
        return -learn.alone(form).reduction([form.key], np.ones(1))

    return of_delay if effect == "transport_delay" else of_lag


def _refine(learn, trial, period, winding, feigned=0.0, doubt=None):
    """(χ², effect, time, stderr) at the time where β = 1 explains most; ``winding`` = L/R [s]; ``feigned`` and
    ``doubt`` as in `_corrected`."""
    _, form, beta = trial
    start = float(form.variant) * (period if form.effect == "transport_delay" else 1.0)
    loss = _loss(learn, form.effect, period, winding)
    on_grid = form.effect == "transport_delay"
    if on_grid:
        low, high = _around_whole_periods(loss, start, period)
    else:
        low, high = SHORTER if beta < MUCH_LESS else (BELOW, REACH)
        low, high = low * start, high * start
    options = {"xatol": TOLERANCE * min(start, period), "maxiter": MOST_TRIES}
    for _ in range(MOST_SHIFTS):
        found = minimize_scalar(loss, bounds=(low, high), method="bounded", options=options)
        if on_grid or low * AT_END < found.x < high / AT_END:
            break
        low, high = found.x / REACH, found.x * REACH      # the optimum lies beyond where it was looked for
    time = float(found.x)
    step = DELAY_STEP * time
    bend = (loss(time - step) + loss(time + step) - 2.0 * found.fun) / step**2
    stderr = float(np.sqrt(2.0 / bend)) if bend > 0 else step
    form_error = float(np.hypot(LAG_ERROR * time, LAG_STEP * period))
    if on_grid:
        periods, form_error = _corrected(time / period, period / winding, feigned, doubt)
        time, form_error = periods * period, period * max(DELAY_ERROR, form_error)
    return -float(found.fun), form.effect, time, float(np.hypot(stderr, form_error))
