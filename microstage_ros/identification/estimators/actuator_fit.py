"""From features of many records to the friction parameters of the actuator, with bootstrap over repeats.

Sources: paper, Eqs. 3–5 (blocks) and 10 (sliding curve); bootstrap over whole repeats: B. Efron, R. Tibshirani, An
Introduction to the Bootstrap, Chapman & Hall 1993.
"""

from dataclasses import replace

import numpy as np

from microstage_ros.identification.estimators.estimate import Curve, Estimate, Identification, from_interval, narrow
from microstage_ros.identification.estimators.intervals import bootstrap, correlation
from microstage_ros.identification.estimators.stribeck import NAMES, fit_stribeck, point_spread, stribeck_curve
from microstage_ros.identification.estimators.virgin_curve import (
    choose_count,
    collapse,
    common_grid,
    identify_blocks,
    mean_curve,
)
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.readable import interval, quantity

UNITS = ("N m", "N m", "rad/s", "1", "N m s/rad")
FEWEST_REPEATS = 4  # below, scatter between repeats says nothing
FEWEST_SPEEDS = 8  # different by a fifth; five parameters and some to judge them by
RESAMPLES = 200
GRID_ERROR = 6e-4  # share of a value that the common grid of the repeats may put off
SLIDING_EXPERIMENT = (
    "constant speeds of the output from 0.03 to 16 rad/s in both directions, in eight or more repeats, would"
)
BLOCKS_EXPERIMENT = "slow reversals (2 mrad/s of the output, 30 mrad each way) at four or more places would"
PARTS = {
    "static": "speeds below a tenth of the Stribeck velocity would",
    "coulomb": "speeds between 3 and 10 Stribeck velocities would",
    "stribeck_velocity": "five or more speeds between a sixth and three times the Stribeck velocity would",
    "stribeck_exponent": "five or more speeds between a sixth and three times the Stribeck velocity would",
    "viscous": "fast runs (up to 16 rad/s of the output) would",
}


def by_unit(speed, friction, spread, unit):
    """Mean friction of each unit (repeat) at each speed (1 %); speeds > 0.

    Parameters
    ----------
    speed, friction, spread : steady points, shape (n,): [rad/s], [N m], standard deviation [N m].
    unit : the repeat of each, shape (n,).

    Returns
    -------
    speeds, shape (s,); friction, shape (units, s), NaN where a unit has none; standard deviation of the mean over
    all units, shape (s,), from their scatter where three or more have the speed.
    """
    _, column = np.unique(np.round(np.log(speed) / 0.01).astype(int), return_inverse=True)
    _, row = np.unique(unit, return_inverse=True)
    shape = row.max() + 1, column.max() + 1
    cell = row * shape[1] + column
    count = np.bincount(cell, minlength=shape[0] * shape[1]).reshape(shape)
    with np.errstate(invalid="ignore"):
        means = np.bincount(cell, friction, shape[0] * shape[1]).reshape(shape) / count
    here = (count > 0).sum(axis=0)
    per_speed = np.bincount(column)
    deviation = np.sqrt(np.bincount(column, spread**2)) / per_speed
    for j in np.flatnonzero(here >= 3):
        deviation[j] = np.nanstd(means[:, j], ddof=1) / np.sqrt(here[j])
    typical = np.median(deviation[here >= 3]) if (here >= 3).any() else 0.0
    return np.bincount(column, speed) / per_speed, means, np.maximum(deviation, 0.3 * typical)


def identify_sliding(features, seed, contact="actuator", resamples=RESAMPLES):
    """Stribeck curve by direction and pooled (the nominal one of the axis file).

    Parameters
    ----------
    features : `actuator.Features` with steady points.
    seed, resamples : of the bootstrap [1].

    Returns
    -------
    `Identification` with the keys ``contacts.actuator.static`` … ``viscous`` of the pooled curve, and a table
    by direction. Not determined where the points are too few.
    """
    result = Identification()
    keys = [f"contacts.{contact}.{name}" for name in NAMES]
    speed, friction, repeat = (np.asarray(v) for v in (features.speed, features.friction, features.repeat))
    if len(np.unique(np.round(np.log(np.abs(speed)) / 0.2))) < FEWEST_SPEEDS:
        return _too_few_runs(result, keys, len(speed))
    spread = point_spread(speed, friction)
    by_repeat = len(np.unique(repeat)) >= FEWEST_REPEATS
    sample = repeat if by_repeat else np.arange(len(speed))
    pooled = None
    rows = []
    for name, mask in (("both", np.ones(len(speed), bool)), ("ω > 0", speed > 0), ("ω < 0", speed < 0)):
        if mask.sum() < FEWEST_SPEEDS:
            continue
        try:
            fit = _bootstrap_curve(
                np.abs(speed[mask]), np.abs(friction[mask]), spread[mask], sample[mask], seed, resamples
            )
        except InputError:
            continue
        pooled = pooled or fit
        rows += [
            (name, NAMES[i], quantity(fit[0][i], UNITS[i], 4), interval(fit[2][i], fit[3][i], UNITS[i], 4))
            for i in range(5)
        ]
    if pooled is None:  # some resample had fewer than the five speeds that a curve needs
        return _too_few_runs(result, keys, len(speed))
    values, stderr, low, high, covariance = pooled
    for i, key in enumerate(keys):
        result.add(from_interval(key, values[i], stderr[i], UNITS[i], low[i], high[i],
                                 f"bootstrap over {'repeats' if by_repeat else 'steady runs'}", PARTS[NAMES[i]]))
    knee = result.estimates[keys[2]]
    if not knee.determined or np.abs(speed).min() > 0.5 * knee.value:
        why = (
            f"not determined by these records (no run far below the knee, slowest {np.abs(speed).min():.3g} "
            f"rad/s); {PARTS['static']}"
        )
        result.estimates[keys[0]] = replace(result.estimates[keys[0]], determined=False, remark=why)
    if not by_repeat:
        result.remarks.append(
            f"Sliding friction of {len(np.unique(repeat))} repeats: the intervals hold for this place and time; "
            "at another the friction differs by its variability."
        )
    result.correlations.append((tuple(keys), correlation(covariance)))
    result.tables.append(("Stribeck curve by direction (Table 2)", ("direction", "parameter", "value", "95 %"), rows))
    result.curves.append(_sliding_curve(speed, friction, values, covariance))
    return result


def _too_few_runs(result, keys, runs):
    for key, unit in zip(keys, UNITS):
        remark = f"not determined by these records ({runs} steady runs); {SLIDING_EXPERIMENT}"
        result.add(Estimate(key, float("nan"), unit, determined=False, remark=remark))
    return result


def _bootstrap_curve(speed, friction, spread, unit, seed, resamples):
    speeds, means, deviation = by_unit(speed, friction, spread, unit)

    def estimator(chosen, first=None):
        part = means[chosen]
        seen = np.isfinite(part).any(axis=0)
        return fit_stribeck(speeds[seen], np.nanmean(part[:, seen], axis=0), deviation[seen], first=first)[0]

    first = estimator(np.arange(len(means)))
    return bootstrap(lambda chosen: estimator(chosen, first), len(means), seed, resamples)


def _sliding_curve(speed, friction, values, covariance):
    """Points, fitted curve and its 95 % band, by linear propagation of the parameters' covariance."""
    grid = np.geomspace(np.abs(speed).min(), np.abs(speed).max(), 120)
    steps = 1e-4 * np.maximum(np.abs(values), 1e-12)
    model = stribeck_curve(values, grid)
    slopes = np.array([(stribeck_curve(values + step, grid) - model) / step.sum() for step in np.diag(steps)])
    width = 1.96 * np.sqrt(np.clip(np.einsum("ip,ij,jp->p", slopes, covariance, slopes), 0.0, None))
    residual = np.abs(friction) - stribeck_curve(values, speed)
    return Curve("Sliding friction (Fig. 5b)", "|speed of the output| [rad/s]", "|friction torque| [N m]",
                 np.abs(speed), np.abs(friction), grid, model, model - width, model + width, residual)


def identify_presliding(loadings, repeat, seed, contact="actuator", units=("N m/rad", "rad", "N m"), reading="blocks",
                        experiment=BLOCKS_EXPERIMENT, count=None, resamples=RESAMPLES // 2):
    """Maxwell-slip blocks of a contact from repeats of first loading.

    Parameters
    ----------
    loadings : list of `Loading`. repeat : the repeat each belongs to, shape (loadings,).
    seed, resamples : of the bootstrap [1].
    units : of stiffness, displacement and force. reading : ``blocks`` or ``segment_slopes``, as the axis file.
    count : number of blocks [1]; None lets the data choose (`choose_count`).

    Returns
    -------
    `Identification` with ``contacts.NAME.stiffness`` and ``.weight``, both (n,); the static limit of these loadings
    as ``pre-sliding limit of NAME``; tables with both readings.
    """
    result = Identification()
    keys = [f"contacts.{contact}.stiffness", f"contacts.{contact}.weight", f"pre-sliding limit of {contact}"]
    labels = np.unique(repeat)
    if len(labels) < FEWEST_REPEATS:
        for key, unit in zip(keys, (units[0], "1", units[2])):
            result.add(
                Estimate(
                    key,
                    float("nan"),
                    unit,
                    determined=False,
                    remark=f"not determined by these records ({len(labels)} repeats of first loading); {experiment}",
                )
            )
        return result
    chosen, errors = choose_count(loadings) if count is None else (count, {})
    count = chosen
    blocks, factors = identify_blocks(loadings, count)
    size = len(blocks.stiffness)
    members = [np.flatnonzero(np.asarray(repeat) == label) for label in labels]
    grid = common_grid(loadings)

    def estimator(chosen):
        rows = np.concatenate([members[k] for k in chosen])
        found, _ = identify_blocks([loadings[r] for r in rows], size, blocks, factors[rows] / factors.mean())
        if len(found.stiffness) != size:
            found = blocks
        return np.concatenate([*found.reading(reading), [found.static], found.curve(grid)])

    values, stderr, low, high, covariance = bootstrap(estimator, len(labels), seed, resamples)
    stderr, widen = np.hypot(stderr, GRID_ERROR * values), GRID_ERROR * np.abs(values)
    low, high = low - 1.96 * widen, high + 1.96 * widen
    parts = (slice(0, size), slice(size, 2 * size), slice(2 * size, 2 * size + 1))
    whole = narrow(*(array[: 2 * size] for array in (values, low, high)))  # a block is a stiffness and its weight
    for key, part, unit in zip(keys, parts, (units[0], "1", units[2])):
        pick = [array[part].tolist() for array in (values, stderr, low, high)]
        pick = [p[0] for p in pick] if part.stop - part.start == 1 else pick
        determined = whole if key in keys[:2] else narrow(pick[0], *pick[2:])
        value, deviation, least, most = pick
        result.add(
            Estimate(
                key,
                value,
                unit,
                deviation,
                least,
                most,
                determined=determined,
                method="bootstrap over repeats",
                remark=""
                if determined
                else f"not determined by these records (their repeats differ too much); {experiment}",
            )
        )
    _tables(result, contact, blocks, values, low, high, errors, units, reading)
    how = "chosen by the data" if errors else "as asked"
    result.remarks.append(
        f"{contact}: {size} blocks ({how}); repeats differ by {np.std(factors):.1%} (standard deviation)."
    )
    places, mean = mean_curve(grid, collapse(loadings, factors / factors.mean(), grid))
    curve = slice(2 * size + 1, None)
    result.curves.append(
        Curve(
            f"First loading of the {contact}",
            f"displacement [{units[1]}]",
            f"friction [{units[2]}]",
            places,
            mean,
            grid,
            values[curve],
            low[curve],
            high[curve],
            mean - np.interp(places, grid, values[curve]),
        )
    )
    result.correlations.append((tuple([f"K{j + 1}" for j in range(size)] + [f"α{j + 1}" for j in range(size)]),
                                correlation(covariance[: 2 * size, : 2 * size])))
    return result


def _tables(result, contact, blocks, values, low, high, errors, units, reading):
    size = len(blocks.stiffness)
    slopes, shares = blocks.segments()
    rows = [
        (
            j + 1,
            quantity(blocks.stiffness[j], units[0], 4),
            f"{blocks.weight[j]:.4f}",
            quantity(blocks.slip_displacement[j], units[1], 4),
            quantity(slopes[j], units[0], 4),
            f"{shares[j]:.4f}",
            interval(low[j], high[j], units[0], 4),
            f"{low[size + j]:.3f} … {high[size + j]:.3f}",
        )
        for j in range(size)
    ]
    header = ("block", "k", "α", "slips at", "segment slope K", "segment share",
              f"95 % of {'k' if reading == 'blocks' else 'K'}", "95 % of the weight")
    result.tables.append((f"Maxwell-slip blocks of the {contact}, both readings of the paper's tables", header, rows))
    if errors:
        result.tables.append((f"Number of blocks of the {contact}", ("blocks", "held-out rms"),
                              [(n, quantity(e, units[2], 4)) for n, e in errors.items()]))
