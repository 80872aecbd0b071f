"""Time that a fit has not seen: what is held back, in which parts, and what a model gains there.

A cause must pay twice: on parts of time left out in turn, and, where the motion repeats itself, on parts
of the motion left out in turn in every repetition. The second kind is what a model that merely learnt
this motion by heart cannot pass.
"""

from dataclasses import dataclass

import numpy as np

from microstage_ros.diagnosis.resimulation.fit import solve
from microstage_ros.diagnosis.resimulation.rests import TELLING

PARTS = 6                      # parts left out in turn
HELD_BACK = 0.3                # share of the time held back where no record is given for it
STRETCHES = 10                 # pieces of a motion without repetition, of which every third is held back
REPEAT = 1e-3                  # a motion repeats itself if it differs by less than this share of its stroke
BOOTSTRAP = 500


@dataclass(frozen=True)
class Folds:
    """Row masks over all rows: ``learn``, ``held`` (judged at the end), and lists of masks left out in turn.

    ``period_rows`` is the repetition of the motion, 0 if there is none.
    """

    learn: np.ndarray
    held: np.ndarray
    time: list
    motion: list
    period_rows: int


def repetition(reference):
    """Rows after which the motion, a ``reference`` (n,) [m], repeats itself, 0 if it does not within half of the
    record."""
    stroke = float(np.ptp(reference))
    if stroke == 0.0:
        return 0
    centred = reference - reference.mean()
    spectrum = np.fft.rfft(centred, 2 * len(reference))
    likeness = np.fft.irfft(np.abs(spectrum) ** 2)[: len(reference)] / np.arange(len(reference), 0, -1)
    # the first maximum behind the first fall below zero, then the exact row about it
    below = np.flatnonzero(likeness < 0.0)
    if not len(below):
        return 0
    rough = (
        below[0] + int(np.argmax(likeness[below[0] : len(reference) // 2 + 1])) if below[0] < len(reference) // 2 else 0
    )
    around = range(max(rough - rough // 50, 1), min(rough + rough // 50 + 1, len(reference) // 2 + 1))
    best, error = 0, np.inf
    for rows in around:
        difference = float(np.abs(reference[rows:] - reference[:-rows]).max())
        if difference < error:
            best, error = rows, difference
    return best if error < REPEAT * stroke else 0


def make_folds(parts, held):
    """`Folds` for measured parts (list of `Measured`); ``held``: list of bool, a record is held out.

    Where no record is held out, the last `HELD_BACK` of every record is; of a motion without repetition every
    third of `STRETCHES`, since its end is like nothing before it. Rows that tell nothing (`rests`) are in neither.
    """
    learns, phases, period = [], [], 0
    for part, held_out in zip(parts, held):
        rows = len(part)
        mask = np.zeros(rows, bool) if held_out else np.ones(rows, bool)
        own = repetition(part.reference)
        if not any(held):
            mask &= ~held_back(rows, own)
        period = max(period, own)
        learns.append(mask)
        phases.append(np.arange(rows) % own / own if own else np.full(rows, np.nan))
    tells = np.concatenate([part.tells for part in parts])
    whole, phase = np.concatenate(learns), np.concatenate(phases)
    learn, out = _telling(whole, tells), _telling(~whole, tells)
    order = np.cumsum(learn) - 1
    bounds = order * PARTS // max(int(learn.sum()), 1)
    time = [learn & (bounds == k) for k in range(PARTS)]
    motion = []
    if period and np.isfinite(phase[learn]).all():
        motion = [learn & (np.floor(phase * PARTS) == k) for k in range(PARTS)]
    return Folds(learn, out, time, motion, period)


def _telling(rows, tells):
    """The ``rows`` (n,) that tell something, or all of them where hardly any does."""
    both = rows & tells
    return both if both.sum() >= TELLING * rows.sum() else rows


def held_back(rows, period_rows):
    """Rows that the program holds back of a record itself, shape (rows,); ``period_rows``: of a repetition [1]."""
    if period_rows:
        return np.arange(rows) >= int((1.0 - HELD_BACK) * rows)
    return np.arange(rows) * STRETCHES // rows % 3 == 2


def left_out_residual(columns, residual, learn, parts):
    """Residual over the learning rows when every part is predicted by a linear fit to the others.

    ``columns`` (rows, p): derivatives of the residual; returns shape (rows,), zero outside ``learn``.
    """
    predicted = np.zeros(len(residual))
    for part in parts:
        seen = learn & ~part
        move = solve(columns[seen], -residual[seen])
        predicted[part] = residual[part] + columns[part] @ move
    return predicted


def mean_square(values, rows):
    """Mean square of ``values`` (n,) over rows, in their unit squared [unit of the values squared]."""
    return float(np.mean(values[rows] ** 2))


def bootstrap_interval(residual, block, seed):
    """95 % interval of the rms by resampling blocks of ``block`` [1] rows; ``seed``: of it [1]."""
    starts = np.arange(0, len(residual), block)
    sums = np.add.reduceat(residual**2, starts)
    counts = np.diff(np.append(starts, len(residual)))
    drawn = np.random.default_rng(seed).integers(0, len(starts), (BOOTSTRAP, len(starts)))
    rms = np.sqrt(sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1))
    return tuple(float(v) for v in np.quantile(rms, [0.025, 0.975]))
