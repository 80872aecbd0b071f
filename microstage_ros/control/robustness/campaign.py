"""A campaign: one law on many machines that it was not given, each with several seeds; what failed, and how far.

One run: two sines, twenty moves of 1 to 1000 um, six seconds at rest. A run fails by an error beyond `LARGEST`
anywhere, by a swing of more than `SWING` peak to peak in the last second, or by a mean error beyond `LEFT` there.

Beside another law, which is run on the same machine with the same seed, two figures more: its largest error, and for
how long without a break the first law was worse. Worse is a `BLOCK` of time whose largest error is beyond `HARMLESS`
and more than `FACTOR` times the other's largest error within `NEAR` of it. Beside fixed laws with gains of their own
(`evaluation.opponents`), which are run on the same too, `FixedOutcome` says what each of them showed.

``gains``: {name: number in the unit of its `control.gains.Gain`}. ``seed``, ``seeds`` (k,) and ``jobs`` are counts [1].
"""

import functools
import math
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from microstage_ros.control.runs.run_file import Run
from microstage_ros.control.runs.simulate import simulate

LARGEST = 5e-6  # m
SWING = 2e-7  # m, peak to peak at rest
LEFT = 2e-7  # m, mean error at rest
BLOCK, NEAR, FACTOR, HARMLESS = 0.05, 0.25, 1.2, 2e-7  # s, s, 1, m
FIRST = 0.1  # s, of a run, that are not judged
REST_TIME = 6.0  # s
TARGETS = (1e-6, 0.0, 1e-5, 0.0, 1e-4, 0.0, 1e-3, 0.0, 1.1e-5, 1e-6)  # m, gone through twice
PROGRAM = [
    {"sine": {"amplitude_m": 1e-5, "frequency_hz": 0.25, "cycles": 1.0}},
    {"sine": {"amplitude_m": 1e-3, "frequency_hz": 0.25, "cycles": 1.0}, "dwell_s": 0.2},
    *[{"move_to_m": target, "dwell_s": 0.25} for target in 2 * TARGETS[:9]],
    {"move_to_m": TARGETS[9], "dwell_s": 0.25},
    {"move_to_m": 0.0, "dwell_s": REST_TIME},
]


class FixedOutcome(NamedTuple):
    """What a fixed law showed on the same machine with the same seed: fields as those of `Outcome` (m)."""

    law: str
    largest: float
    swing: float
    left: float

    @property
    def rests(self):
        """True if it neither swings at rest nor rests beside its target."""
        return self.swing < SWING and self.left < LEFT


class Outcome(NamedTuple):
    """What one run showed (true position; m)."""

    condition: str
    seed: int
    largest: float  # |error| anywhere after the first 0.1 s
    moving: float  # |error| in the sine of 10 um, without its first quarter
    swing: float  # peak to peak in the last second
    left: float  # |mean error| there
    worst_settled: float  # |error| at the end of a move's dwell
    other_largest: float = 0.0  # as `largest`, of the law beside
    worse_s: float = 0.0  # s, longest time for which this law was worse than the one beside
    fixed: tuple[FixedOutcome, ...] = ()

    @property
    def fault(self):
        """What failed, in words; empty if nothing did."""
        found = []
        if not self.largest < LARGEST:
            found.append(f"error {self.largest * 1e6:.3g} um")
        if not self.swing < SWING:
            found.append(f"swings {self.swing * 1e6:.3g} um at rest")
        if not self.left < LEFT:
            found.append(f"rests {self.left * 1e6:.3g} um off")
        return ", ".join(found)


def run_of(condition, law, gains=None):
    """`Run` of one condition under a ``law`` (a type of controller) with ``gains`` [{name: value}]."""
    return Run(
        period_s=condition.period_s, controller={"type": law, **(gains or {})}, noise=condition.noise, program=PROGRAM
    )


def examine(axis, condition, seed, law, gains=None, beside="", fixed=()):
    """`Outcome` of one run; ``beside``: a law that is run on the same, as it is shipped; ``fixed``: laws that are, with
    their gains (`evaluation.opponents.Opponent`)."""
    period, columns, error = _run(axis, condition, seed, law, gains)
    sine = error[round(1.0 / period) : round(4.0 / period)]
    moves = np.flatnonzero(np.diff(columns["reference_m"]) != 0.0)
    starts = moves[np.flatnonzero(np.diff(moves, prepend=-10) > 0.1 / period)]
    ends = starts[starts > 8.0 / period] - 1
    first = round(FIRST / period)
    largest, swing, left = _extent(error, period)
    found = Outcome(
        condition.name,
        seed,
        largest,
        float(np.abs(sine).max()),
        swing,
        left,
        float(np.abs(error[ends]).max()) if len(ends) else 0.0,
        fixed=tuple(
            FixedOutcome(opponent.kind, *_extent(_run(axis, condition, seed, opponent.kind, opponent.gains)[2], period))
            for opponent in fixed
        ),
    )
    if not beside:
        return found
    other = _run(axis, condition, seed, beside, None)[2]
    return found._replace(
        other_largest=_extent(other, period)[0], worse_s=worse_for(error[first:], other[first:], period)
    )


def _extent(error, period):
    """(largest, swing, left) [m] of a run's true ``error`` [m]: fields of `Outcome`."""
    rest = error[-round(1.0 / period) :]
    return float(np.abs(error[round(FIRST / period) :]).max()), float(np.ptp(rest)), float(abs(rest.mean()))


def _run(axis, condition, seed, law, gains):
    """(period [s], columns, true error [m])."""
    columns = simulate(condition.assumed_axis(axis), run_of(condition, law, gains), seed)
    return columns["t_s"][1], columns, columns["stage_m"] - columns["reference_m"]


def worse_for(error, other, period):
    """Longest time [s] for which the ``error`` [m] was worse than that of the ``other`` law [m]; ``period`` [s]."""
    rows, near = round(BLOCK / period), round(NEAR / BLOCK)
    ours, theirs = (np.abs(e[: len(e) // rows * rows]).reshape(-1, rows).max(axis=1) for e in (error, other))
    around = np.array([theirs[max(k - near, 0) : k + near + 1].max() for k in range(len(theirs))])
    longest = run = 0
    for worse in (ours > HARMLESS) & (ours > FACTOR * around):
        run = run + 1 if worse else 0
        longest = max(longest, run)
    return longest * BLOCK


def campaign(axis, chosen, seeds, law, jobs=1, progress=None, gains=None, each=None, beside="", fixed=()):
    """`Outcome` of every condition and seed, in order.

    ``chosen`` : `conditions.Condition` list. ``seeds`` : of the runs. ``progress`` is called with the number done.
    ``beside`` and ``fixed`` : laws that are run on the same, `examine` and `evaluation.opponents.Opponent`. ``each`` :
    function (function, items) → results in order, in place of ``jobs`` threads: other computers.
    """
    examined = functools.partial(_one, axis, law, gains, beside, fixed)
    work, done = [(condition, seed) for condition in chosen for seed in seeds], [0]
    if each:
        return each(examined, work)

    def one(job):
        found = examined(job)
        done[0] += 1
        if progress:
            progress(done[0])
        return found

    with ThreadPoolExecutor(jobs) as pool:
        return list(pool.map(one, work))


def _one(axis, law, gains, beside, fixed, job):
    condition, seed = job
    return examine(axis, condition, seed, law, gains, beside, fixed)


def summary(outcomes):
    """Rows by condition, in order: name, runs, failures, swings, off, largest [m], sine [m], settled [m], swing [m],
    left [m], the other law's largest [m], longest time for which it was better [s], and of every fixed law its largest
    [m] and the numbers of runs in which it failed and in which it did not rest; ``best`` of them: see `best_of`."""
    rows = {}
    for o in outcomes:
        rows.setdefault(o.condition, []).append(o)
    return [
        {
            "condition": name,
            "runs": len(group),
            "failed": sum(bool(o.fault) for o in group),
            "beyond": sum(not o.largest < LARGEST for o in group),
            "swinging": sum(not o.swing < SWING for o in group),
            "off": sum(not o.left < LEFT for o in group),
            "largest": max(o.largest for o in group),
            "sine": max(o.moving for o in group),
            "settled": max(o.worst_settled for o in group),
            "swing": max(o.swing for o in group),
            "left": max(o.left for o in group),
            "other": max(o.other_largest for o in group),
            "worse_s": max(o.worse_s for o in group),
            **_of_fixed([o.fixed for o in group]),
        }
        for name, group in rows.items()
    ]


def _of_fixed(runs):
    """{"fixed": rows of the fixed laws, "best": of `best_of`}; ``runs``: the `FixedOutcome` tuple of every run."""
    fixed = [
        {
            "law": found[0].law,
            "largest": max(one.largest if one.largest < math.inf else math.inf for one in found),  # of nan, too
            "failed": sum(not (one.largest < LARGEST and one.rests) for one in found),
            "restless": sum(not one.rests for one in found),
        }
        for found in zip(*runs)
    ]
    return {"fixed": fixed, "best": best_of(fixed)} if fixed else {}


def best_of(fixed):
    """Of the rows ``fixed`` of `summary` [m] that of the smallest largest error among those that rest in all runs; of
    all, if none does."""
    return min(fixed, key=lambda row: (row["restless"] > 0, row["largest"]))
