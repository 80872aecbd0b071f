"""A campaign: one law on many machines that it was not given, each with several seeds; what failed, and how far.

One run: two sines, twenty moves of 1 to 1000 um, six seconds at rest. A run fails by an error beyond `LARGEST`
anywhere, by a swing of more than `SWING` peak to peak in the last second, or by a mean error beyond `LEFT` there.

Beside another law, which is run on the same machine with the same seed, two figures more: its largest error, and for
how long without a break the first law was worse. Worse is a `BLOCK` of time whose largest error is beyond `HARMLESS`
and more than `FACTOR` times the other's largest error within `NEAR` of it.

``gains``: {name: number in the unit of its `control.gains.Gain`}. ``seed``, ``seeds`` (k,) and ``jobs`` are counts [1].
"""

import functools
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


def examine(axis, condition, seed, law, gains=None, beside=""):
    """`Outcome` of one run; ``beside``: a law that is run on the same, as it is shipped."""
    period, columns, error = _run(axis, condition, seed, law, gains)
    rest = error[-round(1.0 / period) :]
    sine = error[round(1.0 / period) : round(4.0 / period)]
    moves = np.flatnonzero(np.diff(columns["reference_m"]) != 0.0)
    starts = moves[np.flatnonzero(np.diff(moves, prepend=-10) > 0.1 / period)]
    ends = starts[starts > 8.0 / period] - 1
    first = round(FIRST / period)
    found = Outcome(
        condition.name,
        seed,
        float(np.abs(error[first:]).max()),
        float(np.abs(sine).max()),
        float(np.ptp(rest)),
        float(abs(rest.mean())),
        float(np.abs(error[ends]).max()) if len(ends) else 0.0,
    )
    if not beside:
        return found
    other = _run(axis, condition, seed, beside, None)[2]
    return found._replace(
        other_largest=float(np.abs(other[first:]).max()), worse_s=worse_for(error[first:], other[first:], period)
    )


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


def campaign(axis, chosen, seeds, law, jobs=1, progress=None, gains=None, each=None, beside=""):
    """`Outcome` of every condition and seed, in order.

    ``chosen`` : `conditions.Condition` list. ``seeds`` : of the runs. ``progress`` is called with the number done.
    ``beside`` : another law that is run on the same. ``each`` : function (function, items) → results in order, in place
    of ``jobs`` threads: other computers.
    """
    if each:
        return each(
            functools.partial(_one, axis, law, gains, beside),
            [(condition, seed) for condition in chosen for seed in seeds],
        )
    work, done = [(condition, seed) for condition in chosen for seed in seeds], [0]

    def one(job):
        found = examine(axis, *job, law, gains, beside)
        done[0] += 1
        if progress:
            progress(done[0])
        return found

    with ThreadPoolExecutor(jobs) as pool:
        return list(pool.map(one, work))


def _one(axis, law, gains, beside, job):
    return examine(axis, *job, law, gains, beside)


def summary(outcomes):
    """Rows by condition, in order: name, runs, failures, swings, off, largest [m], sine [m], settled [m], swing [m],
    left [m], the other law's largest [m], longest time for which it was better [s]."""
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
        }
        for name, group in rows.items()
    ]
