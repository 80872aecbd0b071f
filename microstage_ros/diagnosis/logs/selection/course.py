"""The course of a size from repetition to repetition and from log to log, and where it changes.

A change point is accepted where two means describe the course better than one by more than chance gives:
likelihood ratio with the price 3 log n per further mean (a modified Schwarz criterion: Zhang and Siegmund, Biometrics
63, 2007).
"""

import dataclasses

import numpy as np

PRICE = 3.0                # times log n, per change point
LEAST = 1                  # points on either side of a change


@dataclasses.dataclass(frozen=True)
class Point:
    """One point of a course: log, number within it, size and standard error; ``baseline``: whether it belongs to the
    baseline."""

    source: str
    number: int
    value: float
    stderr: float
    baseline: bool


def course_of(stage, name, groups, per_file=False):
    """List of `Point`: the size of one effect in every repetition (or file) against the baseline's mean.

    ``name``: effect of the stage's problem with one leading size; sizes are relative to the channel's scale. The
    standard error is that of a single repetition (file), without what assembly may change.
    """
    problem = stage.problem
    spreads, points = stage.spreads, []
    first = next(iter(stage.coordinates.values()))
    means = np.concatenate([np.nan_to_num(_mean(c.baseline)) for c in stage.coordinates.values()])
    within = np.zeros((len(means), len(means)))
    at = 0
    for channel, coordinates in stage.coordinates.items():
        size = len(coordinates.kind)
        only = np.full(size, 2)
        within[at: at + size, at: at + size] = spreads[channel].covariance(coordinates, only, only, assembly=False)
        at += size
    x = problem.effects[name]
    for is_base, groups_of, key in ((True, first.group_baseline, "baseline"), (False, first.group_now, "now")):
        vectors = np.hstack([c.baseline if is_base else c.now for c in stage.coordinates.values()])
        for file in np.unique(groups_of):
            own = vectors[groups_of == file]
            rows = [_mean(own)] if per_file else list(own)
            shrink = 1.0 / np.sqrt(len(own)) if per_file else 1.0
            for number, vector in enumerate(rows):
                value, error = _size(vector - means, x, within)
                points.append(Point(groups[key][int(file)].log.source, number, value, error * shrink, is_base))
    return points


def _mean(vectors):
    count = np.isfinite(vectors).sum(axis=0)
    return np.where(count > 0, np.nansum(vectors, axis=0) / np.maximum(count, 1), np.nan)


def _size(difference, columns, covariance):
    """Leading size of a generalised least-squares fit on the coordinates that are there, and its standard error."""
    good = np.isfinite(difference)
    block = covariance[np.ix_(good, good)]
    inverse = np.linalg.inv(block + 1e-12 * np.trace(block) / max(good.sum(), 1) * np.eye(int(good.sum())))
    x = columns[good]
    used = np.abs(x).max(axis=0) > 1e-9
    if not used.any():
        return float("nan"), float("nan")
    x = x[:, used]
    gram = np.linalg.pinv(x.T @ inverse @ x)
    beta = gram @ x.T @ inverse @ difference[good]
    k = int(np.argmax(np.abs(beta)))
    return float(beta[k]), float(np.sqrt(max(gram[k, k], 0.0)))


def change_points(values, errors):
    """Indices before which the course's mean changes, ascending (binary segmentation).

    ``values``, ``errors``: sizes and their standard errors, each of shape (n,).
    """
    values, errors = np.asarray(values, float), np.asarray(errors, float)
    good = np.isfinite(values) & np.isfinite(errors) & (errors > 0.0)
    index = np.flatnonzero(good)
    if len(index) < 2 * LEAST:
        return []
    v, e = values[good], errors[good]
    # a course scatters more than its own errors say where the machine varies: the scatter between neighbours tells
    jumps = np.diff(v)
    scatter = max(float(np.median(np.abs(jumps))) / 0.954 if len(jumps) > 2 else 0.0, 0.0)
    weight = 1.0 / np.maximum(e, scatter) ** 2
    found, parts = [], [(0, len(v))]
    while parts:
        start, stop = parts.pop()
        best = _best_split(v[start:stop], weight[start:stop])
        if best is not None and best[1] > PRICE * np.log(len(v)):
            cut = start + best[0]
            found.append(int(index[cut]))
            parts += [(start, cut), (cut, stop)]
    return sorted(found)


def _best_split(values, weight):
    """(place, twice the gain in log likelihood) of the best split into two means, or None."""
    n = len(values)
    if n < 2:
        return None
    total = np.sum(weight)
    gains = np.full(n, -np.inf)
    for k in range(LEAST, n - LEAST + 1):
        left, right = np.sum(weight[:k]), np.sum(weight[k:])
        a, b = np.sum(weight[:k] * values[:k]) / left, np.sum(weight[k:] * values[k:]) / right
        gains[k] = left * right / total * (a - b) ** 2
    k = int(np.argmax(gains))
    return k, float(gains[k])
