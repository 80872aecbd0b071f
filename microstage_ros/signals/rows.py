"""Rows before and after, and missing samples: arrays of shape (n,), one entry per control period."""

import numpy as np


def of_row_before(values: np.ndarray) -> np.ndarray:
    """Entry n − 1 of ``values``, shape (n,), in row n, the first one twice; same shape.

    Of a command: the one that the reading of each row answers.
    """
    return np.concatenate([values[:1], values[:-1]])


def of_row_after(values: np.ndarray) -> np.ndarray:
    """Entry n + 1 of ``values``, shape (n,), in row n, the last one twice; same shape."""
    return np.concatenate([values[1:], values[-1:]])


def longest_gap(values: np.ndarray) -> tuple[int, int]:
    """(first row, number of rows) of the longest run of missing samples of ``values``, shape (n,); (0, 0): none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ~np.isfinite(values), [False]]).astype(int))).reshape(-1, 2)
    if not len(edges):
        return 0, 0
    start, stop = edges[np.argmax(edges[:, 1] - edges[:, 0])]
    return int(start), int(stop - start)


def bridged(values: np.ndarray) -> np.ndarray:
    """Missing samples (no finite number) on the straight line between their neighbours.

    ``values`` and what is returned have the shape (n,); at least one has to be finite.
    """
    seen = np.isfinite(values)
    if seen.all():
        return np.asarray(values, float)
    filled, missing = np.array(values, float), np.flatnonzero(~seen)
    filled[missing] = np.interp(missing, np.flatnonzero(seen), values[seen])
    return filled
