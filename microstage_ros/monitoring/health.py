"""Scores of windows against the machine's own healthy spread, and alarms with a stated rate of false ones.

    t = (x − m) / (s √(1 + 1/N))           Student's t with N − 1 degrees of freedom, if the machine is as it was
    score of a channel = max over its traits of z(t) / z*

with mean m and standard deviation s of the trait in N healthy windows, z(t) the normal quantile of the same
probability, and z* the quantile at which one false alarm in a month of motion is expected to be seen. An alarm needs a
score of 1 or more in `IN_A_ROW` windows one after the other; z* is set as if such windows always came together,
which errs to the safe side. (Prediction interval: ISO 16269-8.)
"""

import dataclasses
import math

import numpy as np
from scipy.special import betaln, hyp2f1
from scipy.stats import norm, t

from microstage_ros.quantities.errors import InputError

MONTH = 30.0 * 86400.0  # s of motion
LEAST_WINDOWS = (
    8  # healthy windows below which a spread is no spread: t at 7 degrees of freedom is wide enough as it is
)
IN_A_ROW = 2
MOST_FALSE_ALARMS = 1000.0  # accepted per month of motion


@dataclasses.dataclass(frozen=True)
class Reference:
    """The healthy spread: {(channel, trait): (mean, standard deviation)}, from so many windows of ``window_s`` [s]."""

    spread: dict
    windows: int
    window_s: float

    @classmethod
    def of(cls, windows, window_s):
        """From healthy windows, a list of traits {(channel, trait): size}.

        Raises
        ------
        InputError : fewer than `LEAST_WINDOWS`, or windows that share no trait.
        """
        if len(windows) < LEAST_WINDOWS:
            raise InputError(
                "watch: healthy windows",
                len(windows),
                f"at least {LEAST_WINDOWS} windows of {window_s:g} s of healthy motion",
            )
        shared = set.intersection(*(set(window) for window in windows))
        if not shared:
            raise InputError("watch: healthy windows", "no residual channel in common", "records with the same columns")
        spread = {}
        for key in sorted(shared):
            sizes = np.array([window[key] for window in windows])
            spread[key] = (float(sizes.mean()), float(max(sizes.std(ddof=1), 1e-12 * max(abs(sizes.mean()), 1e-300))))
        return cls(spread, len(windows), float(window_s))

    def limit(self, per_month):
        """z* [1]: quantile that a window's trait may reach for ``per_month`` [1] false alarms in a month of motion."""
        tests = MONTH / self.window_s * len(self.spread)
        return float(norm.isf(min(per_month / tests, 0.5) / 2.0))

    def quantiles(self, window):
        """{(channel, trait): z}, how far each trait of a window is from healthy, as a normal quantile with its sign."""
        found = {}
        for key, (mean, deviation) in self.spread.items():
            if key in window:
                value = (window[key] - mean) / (deviation * math.sqrt(1.0 + 1.0 / self.windows))
                found[key] = math.copysign(_normal_quantile(_log_tail(abs(value), self.windows - 1)), value)
        return found


def _log_tail(value, freedom):
    """Logarithm of P(T > value) of Student's t, also where the probability is below what a float holds.

    ln(I_x(ν/2, 1/2) / 2) with x = ν/(ν + t²), by DLMF 8.17.8.
    """
    half, squared = freedom / 2.0, value * value
    inside, outside = freedom / (freedom + squared), squared / (freedom + squared)
    if outside < 0.1:
        return float(t.logsf(value, freedom))
    return float(
        half * math.log(inside)
        + 0.5 * math.log(outside)
        - math.log(2.0 * half)
        - betaln(half, 0.5)
        + math.log(hyp2f1(half + 0.5, 1.0, half + 1.0, inside))
    )


def _normal_quantile(log_tail):
    """Z with ln P(Z > z) = log_tail, also where the probability itself is no number any more."""
    if log_tail > -700.0:
        return float(norm.isf(math.exp(log_tail)))
    return math.sqrt(-2.0 * log_tail)


@dataclasses.dataclass(frozen=True)
class ChannelHealth:
    """A channel after a window: ``score`` [1], the ``trait`` behind it, ``alarm``, ``since`` when [s] (NaN: never).

    ``record``: whose time that is.
    """

    score: float
    trait: str
    alarm: bool
    since: float
    record: str = ""


class Watch:
    """Judges windows in the order of time.

    Parameters
    ----------
    reference : `Reference`. per_month : false alarms per month of motion that are accepted.
    """

    def __init__(self, reference, per_month=1.0):
        if not 0.0 < per_month <= MOST_FALSE_ALARMS:
            raise InputError("watch: false alarms per month", per_month,
                             f"a number above 0 and up to {MOST_FALSE_ALARMS:g}")
        self.reference, self.per_month = reference, per_month
        self.limit = reference.limit(per_month)
        self._high, self._alarms = {}, {}

    def judge(self, time, window, record=""):
        """`ChannelHealth` by channel after a window that began at ``time`` [s] of ``record``.

        An alarm stays until `reset`.
        """
        best = {}
        for (channel, trait), z in self.reference.quantiles(window).items():
            score = abs(z) / self.limit
            if score >= best.get(channel, (-1.0, ""))[0]:
                best[channel] = (score, trait)
        health = {}
        for channel, (score, trait) in best.items():
            run = self._high.setdefault(channel, [])
            run.append((time, record)) if score >= 1.0 else run.clear()
            if len(run) >= IN_A_ROW:
                self._alarms.setdefault(channel, run[0])
            health[channel] = ChannelHealth(score, trait, channel in self._alarms,
                                            *self._alarms.get(channel, (math.nan, "")))
        return health

    def reset(self):
        """Forget the alarms: the machine was put right."""
        self._high.clear()
        self._alarms.clear()
