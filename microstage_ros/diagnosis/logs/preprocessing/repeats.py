"""Repetitions: what in the logs counts as the machine doing the same once more."""

import numpy as np

MOST = 10               # repetitions that one file without labels is divided into
TURNS = 2               # turns that a part of an endless rotation must have, for its ripple to be read
FILES = 5               # files from which on each file is one repetition


def repetitions(log, motion, description, files):
    """Number of the repetition of each row of a file, int array of shape (n,), from 0.

    By the columns ``run``, by the pieces where time begins again with every cycle; else the file is divided at its reversals
    into at most `MOST` parts of equally many strokes, or, moving one way only, of equal time. With `FILES` files or more and
    no ``run``, a file is one repetition.
    """
    if description.run:
        return np.unique(log.run, return_inverse=True)[1]
    if files >= FILES:
        return np.zeros(len(log), int)
    if description.cycle_restarts:
        return np.unique(log.piece, return_inverse=True)[1]
    strokes = np.unique(motion.stroke[motion.direction != 0.0])
    directions = [motion.direction[motion.stroke == s][0] for s in strokes[:2000]]
    turns = np.flatnonzero(np.diff(directions) != 0) if len(directions) > 1 else np.array([])
    if len(turns) >= 5:
        first = float(directions[0])
        begin = [s for s, d, before in zip(strokes, directions, [-first, *directions]) if d == first and before != first]
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
