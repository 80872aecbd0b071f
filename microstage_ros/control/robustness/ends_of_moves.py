"""Where moves end on a machine that the law was not given: a rate over many moves, not the worst of a few.

A record begins at rest on loaded contacts and goes `ROUNDS` times from 0 to a distance and back. The first `FIRST`
moves are those in which a law may learn the machine; every later one is judged by the true position at the end of its
dwell: it missed its target if that is more than `MISSED` beside it.

Moves of one record are no independent trials, since the same law has learned the same. The interval of their rate is
therefore that of the records drawn again (B. Efron, Annals of Statistics 7, 1979); that of the records with any miss
is exact.

``gains``: {name: number in the unit of its `control.gains.Gain`}. ``seed``, ``seeds`` (k,) and ``jobs`` are counts [1].
"""

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from microstage_ros.control.runs.run_file import Run
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.metrology.rates import Rate, rate

ROUNDS, FIRST = 10, 3  # there and back; moves in which the machine is learned
DWELL = 0.4  # s
MISSED = 1e-7  # m
DRAWS = 2000  # of the records
#: Heads of a table of `row`.
HEADS = [
    "condition",
    f"moves more than {MISSED * 1e9:g} nm off",
    "records with one",
    "median (nm)",
    "99 % (nm)",
    "worst (um)",
]


class Ends(NamedTuple):
    """Errors [m] at the ends of the judged moves, (records, moves); the rates made from them."""

    errors: np.ndarray
    moves: Rate  # that missed, interval by records
    records: Rate  # with one that missed, exact


def judged_moves():
    """Number of moves that are judged in one record [1]."""
    return 2 * ROUNDS - FIRST


def record(axis, condition, law, distance, seed, gains=None):
    """Errors [m] at the ends of the judged moves of one record, (moves,); ``distance`` [m]."""
    program = [{"move_to_m": place, "dwell_s": DWELL} for _ in range(ROUNDS) for place in (distance, 0.0)]
    run = Run(
        period_s=condition.period_s, controller={"type": law, **(gains or {})}, noise=condition.noise, program=program
    )
    columns = simulate(condition.assumed_axis(axis), run, seed)
    rows = len(columns["t_s"]) // (2 * ROUNDS)
    last = rows * np.arange(FIRST + 1, 2 * ROUNDS + 1) - 1
    return columns["stage_m"][last] - columns["reference_m"][last]


def ends_of_moves(axis, condition, law, distance, seeds, jobs=1, progress=lambda: None, gains=None):
    """`Ends` over the records of ``seeds``, moves over ``distance`` [m]."""

    def one(seed):
        found = record(axis, condition, law, distance, seed, gains)
        progress()
        return found

    with ThreadPoolExecutor(jobs) as pool:
        errors = np.array(list(pool.map(one, seeds)))
    return rates_of(errors)


def rates_of(errors):
    """`Ends` of errors [m], (records, moves)."""
    missed = ~(np.abs(errors) <= MISSED)  # NaN missed as well
    per_record = missed.sum(axis=1)
    low, high = _interval(per_record, errors.shape[1])
    hits, cases = int(per_record.sum()), missed.size
    return Ends(errors, Rate(hits, cases, hits / cases, low, high), rate(int((per_record > 0).sum()), len(errors)))


def _interval(per_record, moves):
    """95 % interval of the rate of misses by drawing records again; where all records missed equally often, which drawn
    again say nothing, that of as many independent cases as there are records."""
    if np.ptp(per_record) == 0:
        exact = rate(round(len(per_record) * float(per_record[0]) / moves), len(per_record))
        return exact.low, exact.high
    generator = np.random.default_rng(17)
    drawn = per_record[generator.integers(0, len(per_record), (DRAWS, len(per_record)))].mean(axis=1) / moves
    return tuple(float(end) for end in np.quantile(drawn, (0.025, 0.975)))


def row(name, ends):
    """Cells of a table below `HEADS`."""
    size = np.abs(ends.errors)
    return [
        name,
        str(ends.moves),
        str(ends.records),
        f"{np.median(size) * 1e9:.3g}",
        f"{np.quantile(size, 0.99) * 1e9:.3g}",
        f"{size.max() * 1e6:.3g}",
    ]
