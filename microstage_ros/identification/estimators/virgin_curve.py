"""Virgin curves to Maxwell-slip blocks: monotone, as many blocks as the data carry, Σα = 1.

The curve of first loading from rest of n blocks is concave and piecewise linear,

    F(x) = Σ w_j min(x / x_j, 1),      w_j = α_j F_s,   k_j = w_j / x_j,

so with the break points x_j given the w_j ≥ 0 follow from non-negative least squares, and only the break
points are searched. A repeat whose friction is larger by the factor c has the same stiffnesses and later
break points, F_c(x) = c F(x / c): repeats are registered by c before they are averaged, else their mean
would round off the corners.

Source: paper, Eqs. 3–5; the registration is derived: limits scaled by c at the same stiffnesses.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares, nnls

from microstage_ros.model.friction.blocks import virgin_curve
from microstage_ros.model.friction.contact import blocks_of
from microstage_ros.quantities.errors import InputError

MAX_BLOCKS = 8
GRID = 80


@dataclass(frozen=True)
class Blocks:
    """Maxwell-slip blocks of one contact.

    Attributes
    ----------
    stiffness : k_j [F/q], falling slip displacement order, shape (n,).
    weight : α_j [1], Σα = 1, shape (n,).
    static : F_s [F].
    """

    stiffness: np.ndarray
    weight: np.ndarray
    static: float

    @classmethod
    def of(cls, axis, contact):
        """The blocks of an `Axis`'s ``contact``, as the solver carries them."""
        stiffness, weight = blocks_of(axis, contact)
        return cls(stiffness, weight, axis.value(f"contacts.{contact}.static"))

    @property
    def slip_displacement(self):
        """x_j = α_j F_s / k_j [q], rising."""
        return self.weight * self.static / self.stiffness

    def curve(self, displacement):
        """Force of first loading [F] at displacements ≥ 0 [q]."""
        return virgin_curve(self.stiffness, self.weight * self.static, displacement)

    def segments(self):
        """The other reading of the paper's tables: segment slopes K_i = Σ_{j≥i} k_j, and the share of F_s
        that each segment rises (Table 3 prints these, Table 1 prints blocks).

        Returns (slopes, shares), both shape (n,).
        """
        slopes = np.cumsum(self.stiffness[::-1])[::-1]
        rises = slopes * np.diff(self.slip_displacement, prepend=0.0)
        return slopes, rises / rises.sum()

    def reading(self, name):
        """(stiffness, weight) as an axis file with ``reading: blocks`` or ``segment_slopes`` holds them."""
        return (self.stiffness, self.weight) if name == "blocks" else self.segments()


@dataclass(frozen=True)
class Loading:
    """One repeat of first loading: displacement from rest [q] and force [F], both rising from zero.

    One point per count of the sensor (`loading_from_samples`).
    """

    displacement: np.ndarray
    force: np.ndarray


def loading_from_samples(displacement, force, resolution):
    """`Loading` from samples: the mean force at each count, counts in rising order, from one count on.

    ``displacement`` from rest [q] and ``force`` [F], shape (n,), the load rising; ``resolution`` [q].
    """
    counts = np.round(np.maximum.accumulate(displacement) / resolution).astype(int)
    seen, first = np.unique(counts, return_index=True)
    totals = np.add.reduceat(force, first) / np.diff(np.append(first, len(force)))
    used = seen >= 1
    return Loading(seen[used] * resolution, totals[used])


def fit_blocks(displacement, force, count, first=None):
    """Blocks whose virgin curve is nearest to the data in the least-squares sense.

    The search for the break points starts from the solution on a dense grid of them, which is convex and
    so has no local minima, with neighbours merged until ``count`` are left.

    Parameters
    ----------
    displacement, force : shape (n,), displacements > 0 [q], forces [F].
    count : number of blocks [1].
    first : break points to start from instead, shape (count,).

    Returns
    -------
    Blocks, and the residual force − curve, shape (n,). Blocks that get no weight are left out.
    """
    x, y = np.asarray(displacement, float), np.asarray(force, float)
    low, high = np.log(x.min()), np.log(1.1 * x.max())

    def residual(log_knots):
        return _solve(x, y, np.exp(log_knots))[1] / np.std(y)

    start = np.log(_merged_knots(x, y, count) if first is None else np.sort(first))
    search = least_squares(
        residual, np.clip(start, low + 1e-6, high - 1e-6), bounds=(low, high), diff_step=1e-4, max_nfev=40
    )
    knots = np.sort(np.exp(search.x))
    levels, misfit = _solve(x, y, knots)
    kept = levels > 1e-4 * levels.sum()
    static = float(levels[kept].sum())
    return Blocks(levels[kept] / knots[kept], levels[kept] / static, static), misfit


def _solve(x, y, knots):
    """Levels w_j ≥ 0 for given break points, and the residual."""
    columns = np.minimum(x[:, None] / knots, 1.0)
    levels = nnls(columns, y)[0]
    return levels, y - columns @ levels


def _merged_knots(x, y, count):
    """``count`` break points: those of the dense solution, nearest in effect merged."""
    dense = np.geomspace(x.min(), x.max(), 60)
    levels, _ = _solve(x, y, dense)
    knots, levels = dense[levels > 0.0], levels[levels > 0.0]
    while len(knots) > count:
        merged = [_merge(knots, levels, i) for i in range(len(knots) - 1)]
        solved = [_solve(x, y, candidate) for candidate in merged]
        best = int(np.argmin([np.sum(misfit**2) for _, misfit in solved]))
        knots, levels = merged[best], solved[best][0]
    extra = np.geomspace(x.min() * 1.5, x.max() * 0.9, count - len(knots)) if len(knots) < count else []
    return np.sort(np.concatenate([knots, extra]))


def _merge(knots, levels, i):
    share = levels[i : i + 2] + 1e-300
    middle = np.exp(np.average(np.log(knots[i : i + 2]), weights=share))
    return np.concatenate([knots[:i], [middle], knots[i + 2 :]])


def register(loadings, blocks):
    """Factor c [1] of each repeat, (repeats,): least squares of F = c · curve(x / c) by ``blocks``, `Blocks`."""
    factors = []
    for loading in loadings:
        def misfit(c, loading=loading):
            return loading.force - c[0] * blocks.curve(loading.displacement / c[0])
        factors.append(least_squares(misfit, [loading.force[-1] / blocks.static], bounds=(0.2, 5.0),
                                     x_scale=0.1, max_nfev=30).x[0])
    return np.array(factors)


def common_grid(loadings):
    """Displacements [q] on which repeats are compared: from the third count seen to the longest, geometric."""
    start = max(np.median([loading.displacement[2] for loading in loadings]), 1e-4 * loadings[0].displacement[-1])
    return np.geomspace(start, np.median([loading.displacement[-1] for loading in loadings]), GRID)


def collapse(loadings, factors, grid):
    """Registered repeats: force(c x) / c [F], shape (repeats, grid); NaN beyond a repeat's end.

    ``factors`` c [1], shape (repeats,); ``grid`` [q], shape (grid,).
    """
    return np.array([
        np.interp(grid, loading.displacement / c, loading.force / c, left=np.nan, right=np.nan)
        for loading, c in zip(loadings, factors)
    ])


def choose_count(loadings, limit=MAX_BLOCKS):
    """Number of blocks: the smallest whose error on unseen repeats is within one standard error of the least.

    ``limit``: largest number that is tried [1].
    With fewer than four repeats the Bayesian information criterion of the mean curve decides.
    Returns (count, {count: held-out or in-sample rms [F]}).
    """
    grid = common_grid(loadings)
    factors = register(loadings, _rough_fit(loadings))
    curves = collapse(loadings, factors / factors.mean(), grid)
    if len(loadings) < 4:
        places, mean = mean_curve(grid, curves)
        return _count_by_information(places, mean, limit)
    folds = np.arange(len(curves)) % min(5, len(curves))
    errors = {}
    for count in range(1, limit + 1):
        squares = []
        for fold in np.unique(folds):
            places, mean = mean_curve(grid, curves[folds != fold])
            blocks, _ = fit_blocks(places, mean, count)
            squares.extend(np.nanmean((curves[folds == fold] - blocks.curve(grid)) ** 2, axis=1))
        errors[count] = np.array(squares)
    means = {count: values.mean() for count, values in errors.items()}
    best = errors[min(means, key=lambda count: means[count])]
    enough = best.mean() + best.std(ddof=1) / np.sqrt(len(best))
    chosen = next(count for count in sorted(means) if means[count] <= enough)
    return chosen, {count: float(np.sqrt(value)) for count, value in means.items()}


def mean_curve(grid, curves):
    """(displacement [q], mean force [F]) where at least one repeat reaches.

    ``grid`` (n,) [q], ``curves`` (repeats, n) [F].
    """
    seen = np.isfinite(curves).any(axis=0)
    return grid[seen], np.nanmean(curves[:, seen], axis=0)


def _count_by_information(grid, mean, limit):
    rms, scores = {}, {}
    for count in range(1, limit + 1):
        _, residual = fit_blocks(grid, mean, count)
        rms[count] = float(np.sqrt(np.mean(residual**2)))
        scores[count] = len(grid) * np.log(rms[count] ** 2 + (1e-4 * mean.max()) ** 2) + 2 * count * np.log(len(grid))
    return min(scores, key=lambda count: scores[count]), rms


def _rough_fit(loadings):
    grid = common_grid(loadings)
    statics = np.array([loading.force[-1] for loading in loadings])
    places, mean = mean_curve(grid, collapse(loadings, statics / statics.mean(), grid))
    return fit_blocks(places, mean, 6)[0]


def identify_blocks(loadings, count, blocks=None, factors=None):
    """Blocks of the mean of registered repeats.

    Parameters
    ----------
    loadings : list of `Loading`.
    count : number of blocks [1].
    blocks, factors : `Blocks`, and shape (repeats,) [1], of an earlier call on the same repeats, for resamples: its
        break points are the start and its factors the registration.

    Returns
    -------
    Blocks whose F_s is the mean of the repeats' static limits, and the factor of each repeat.

    Raises
    ------
    InputError : no repeat, or one without motion.
    """
    if not loadings or any(len(loading.displacement) < 2 * count for loading in loadings):
        raise InputError("virgin curve", f"{len(loadings)} repeats", f"repeats of at least {2 * count} points each")
    grid = common_grid(loadings)
    if blocks is not None:
        # factors are levels relative to the earlier mean curve: the resample's own mean is what varies
        level = factors.mean()
        places, mean = mean_curve(grid, collapse(loadings, factors, grid))
        found, _ = fit_blocks(places, mean, count, blocks.slip_displacement)
        return Blocks(found.stiffness, found.weight, found.static * level), factors
    factors = register(loadings, _rough_fit(loadings))
    for _ in range(2):
        places, mean = mean_curve(grid, collapse(loadings, factors / factors.mean(), grid))
        blocks, _ = fit_blocks(places, mean, count)
        factors = register(loadings, blocks)
    return blocks, factors
