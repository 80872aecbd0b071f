"""Repetitions: what in the logs counts as the machine doing the same once more."""

import numpy as np

MOST = 10               # repetitions that one file without labels is divided into
TURNS = 2               # turns that a part of an endless rotation must have, for its ripple to be read
FILES = 5               # files from which on each file is one repetition
PARTS = 3               # parts of the stroke by which repetitions are compared
# of the directions and parts of the stroke that a repetition must hold, if labels cut at the moves
COMPLETE = 0.75
COMMON = 0.03           # of the moving rows, from which on a direction and part counts


def repetitions(log, motion, description, files):
    """Number of the repetition of each row of a file, int array of shape (n,), from 0; and a sentence, empty where
    labels were kept.

    By the columns ``run``, by the pieces where time begins again with every cycle, or by `by_reversals`. Labels cut
    where the logger was started or its buffer was full, which need not be where the axis moves: where most labelled
    stretches lack a direction or a part of the stroke that the file has, and stretches between reversals are more
    complete, these count instead. With `FILES` files or more and no ``run``, a file is one repetition.
    """
    if description.run:
        labels, source = np.unique(log.run, return_inverse=True)[1], "The columns that number the runs"
    elif files >= FILES:
        return np.zeros(len(log), int), ""
    elif description.cycle_restarts:
        labels, source = np.unique(log.piece, return_inverse=True)[1], "The restarts of time"
    else:
        return by_reversals(log, motion), ""
    share = completeness(labels, log, motion)
    if share >= COMPLETE:
        return labels, ""
    moves = by_reversals(log, motion)
    if completeness(moves, log, motion) <= share:
        return labels, ""
    return (
        moves,
        (
            f"{source} cut within the motion: stretches of whole strokes, found from the motion, count as repetitions"
            " instead."
        ),
    )


def completeness(labels, log, motion):
    """Median share [1] of the directions and parts of the stroke, of its conditions, that a labelled stretch holds (0 …
    1)."""
    moving = motion.direction != 0.0
    if not moving.any():
        return 1.0
    low, high = np.quantile(motion.x, 0.002), np.quantile(motion.x, 0.998)
    place = (motion.x - low) / max(high - low, 1e-300) * PARTS if motion.absolute else np.zeros(len(log))
    part = np.clip(place.astype(int), 0, PARTS - 1)
    parts = 2 * PARTS
    key = ((log.condition * 2 + (motion.direction > 0.0)) * PARTS + part)[moving]
    count = np.bincount(key, minlength=parts * (int(log.condition.max()) + 1)).reshape(-1, parts)
    common = count >= np.maximum(COMMON * count.sum(axis=1), 1.0)[:, None]
    rows = np.bincount(labels[moving] * common.size + key, minlength=(int(labels.max()) + 1) * common.size)
    held = rows.reshape(-1, *common.shape) > 0
    met = held.any(axis=2)                     # a stretch is judged by the conditions that it holds
    wanted = met @ common.sum(axis=1)
    shares = (held & common).sum(axis=(1, 2)) / np.maximum(wanted, 1)
    return float(np.median(shares))


def by_reversals(log, motion):
    """The file, rows of shape (n,), divided at its reversals into at most `MOST` parts of equally many strokes, or,
    moving one way only, of equal time."""
    strokes = np.unique(motion.stroke[motion.direction != 0.0])
    directions = [motion.direction[motion.stroke == s][0] for s in strokes[:2000]]
    turns = np.flatnonzero(np.diff(directions) != 0) if len(directions) > 1 else np.array([])
    if len(turns) >= 5:
        first = float(directions[0])
        begin = [
            s for s, d, before in zip(strokes, directions, [-first, *directions]) if d == first and before != first
        ]
        cycles = len(begin)
        parts = min(MOST, cycles)
        edges = [begin[int(k * cycles / parts)] for k in range(1, parts)]
        return np.searchsorted(edges, motion.stroke, side="right")
    if len(turns) == 0 and len(strokes):
        parts = MOST if len(log) > 400 else 4
        if log.place_unit == "rad":
            parts = int(np.clip(float(np.ptp(motion.x)) / (TURNS * 2.0 * np.pi), 2, parts))
        return np.minimum((np.arange(len(log)) * parts) // len(log), parts - 1)
    return np.zeros(len(log), int)
