"""Pictures of a log's diagnosis: over the stroke by direction, in time, the course from run to run, ripple by order."""

import numpy as np
from matplotlib.ticker import MaxNLocator

from microstage_ros.diagnosis.logs.preprocessing.coordinates import STEADY, cell_keys
from microstage_ros.diagnosis.logs.selection.effects import columns_of
from microstage_ros.diagnosis.logs.preprocessing.motion import STATES
from microstage_ros.report.plots import COLOURS, legend_above, new_figure, plot_signal, scale_of

BASE, NOW, MODEL = COLOURS["grey"], COLOURS["orange"], COLOURS["blue"]
SECONDS = 30.0             # of the overlay in time


def over_stroke(result, name):
    """Figure: mean of a channel over the stroke, each direction by itself: baseline with its spread, now, model with
    the causes; or None."""
    coordinates = result.evidence["reduced"].get(name)
    if coordinates is None:
        return None
    channel = coordinates.channel
    low, high = result.evidence["stroke"]
    steady = coordinates.kind == STATES[STEADY]
    places = result.evidence["places"]
    if places < 3 or not steady.any():
        return None
    level = _levels(result, name)
    fitted = _fitted(result, name)
    code = coordinates.condition[steady][0]
    scale = channel.scale[int(code)]
    figure, axes = new_figure(2, 1, height=2.0, sharex=True)
    across, place_unit = scale_of([low, high], result.context.place_unit)
    up, unit = scale_of(scale * (np.abs(level).max() + 0.1), channel.unit)
    for axis, direction, title in zip(axes, (1, -1), ("forward", "back")):
        own = steady & (coordinates.direction == direction) & (coordinates.condition == code)
        if not own.any():
            continue
        speeds = np.flatnonzero(own)
        order = speeds[np.argsort(coordinates.place[speeds], kind="stable")]
        unique = np.unique(coordinates.place[order])
        x = across * (low + (unique + 0.5) / places * (high - low))
        fold = lambda values: (
            up * scale * np.array([np.nanmean(values[order[coordinates.place[order] == p]]) for p in unique])
        )
        with np.errstate(all="ignore"):
            base, now = np.nanmean(coordinates.baseline, axis=0) + level, np.nanmean(coordinates.now, axis=0) + level
            spread = np.nanstd(coordinates.baseline, axis=0)
        mean, band = fold(base), fold(spread)
        axis.fill_between(x, mean - 2 * band, mean + 2 * band, color=BASE, alpha=0.25, lw=0)
        axis.plot(x, mean, color=BASE, label="baseline ± 2 standard deviations")
        axis.plot(x, fold(now), color=NOW, marker="o", ms=3, label="now")
        if fitted is not None:
            axis.plot(x, fold(base + fitted), color=MODEL, ls="--", label="baseline with the causes")
        axis.set_title(title)
        axis.set_ylabel(f"{_label(channel)} [{unit}]")
    axes[-1].set_xlabel(f"place [{place_unit}]")
    legend_above(axes[0])
    return figure


def _label(channel):
    """What an axis is called."""
    text = channel.kind.replace("_", " ")
    return text if channel.signed else f"|{text}|"


def _levels(result, name):
    """What the healthy model itself gives in each coordinate, relative to the scale; 0 in amplitudes."""
    reduced = result.evidence["reduced"][name]
    return np.concatenate([_cell_means(result, name, lambda channel, rows: channel.predicted(rows)),
                           np.zeros(len(reduced.kind) - len(result.evidence["cells"]))])


def _cell_means(result, name, values):
    """Mean over the rows of now in each cell of a function of the rows, relative to the scale."""
    reduced, cells = result.evidence["reduced"][name], result.evidence["cells"]
    total, count = np.zeros(len(cells)), np.zeros(len(cells))
    for rows in result.evidence["groups"]["now"]:
        slot, good = _slots(result, rows)
        scale = np.array([reduced.channel.scale.get(c, 1.0) for c in range(int(rows.condition.max()) + 1)] or [1.0])[
            np.maximum(rows.condition, 0)
        ]
        total += np.bincount(slot[good], (values(reduced.channel, rows) / scale)[good], len(cells))
        count += np.bincount(slot[good], minlength=len(cells))
    return total / np.maximum(count, 1)


def _slots(result, rows):
    cells = result.evidence["cells"]
    keys = cell_keys(rows, result.evidence["stroke"], result.evidence["places"], result.context.top_speed)
    slot = np.minimum(np.searchsorted(cells, keys), len(cells) - 1)
    return slot, cells[slot] == keys


def _stage_of(result, name):
    return next((s for s in result.evidence["stages"] if name in s.coordinates), None)


def _fitted(result, name):
    """What the chosen effects add in each coordinate of a channel, or None."""
    stage = _stage_of(result, name)
    if stage is None or not stage.chosen:
        return None
    names = [c.name for c in stage.chosen]
    total = np.hstack([stage.problem.effects[n] for n in names]) @ stage.problem.taken(names)[1]
    return total[stage.problem.where == name]


def in_time(result, name):
    """Figure: one stretch of now, measured and as the baseline would have it, with and without the causes; or None."""
    reduced = result.evidence["reduced"].get(name)
    if reduced is None:
        return None
    rows = result.evidence["groups"]["now"][0]
    channel = reduced.channel
    start = int(np.flatnonzero(rows.condition >= 0)[0])
    piece = np.flatnonzero((rows.log.piece == rows.log.piece[start]) & (rows.condition == rows.condition[start]))
    shown = piece[: max(int(SECONDS / rows.log.period), 50)]
    slot, good = _slots(result, rows)
    scale = channel.scale.get(int(rows.condition[start]), 1.0)
    with np.errstate(all="ignore"):
        misfit = np.nan_to_num(np.nanmean(reduced.baseline, axis=0))[: len(result.evidence["cells"])]
    base = channel.predicted(rows) + np.where(good, misfit[slot], 0.0) * scale
    fitted = _fitted(result, name)
    figure, axes = new_figure(height=2.7)
    time = rows.log.time[shown] - rows.log.time[shown[0]]
    measured = channel.values(rows)[shown]
    up, unit = scale_of(measured, channel.unit)
    plot_signal(axes, time, up * measured, color=NOW, lw=0.9, label="measured now")
    plot_signal(axes, time, up * base[shown], color=BASE, label="as the baseline has it")
    if fitted is not None:
        plot_signal(
            axes,
            time,
            up * (base + _rows_fitted(result, name, rows))[shown],
            color=MODEL,
            ls="--",
            label="with the causes",
        )
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"{_label(channel)} [{unit}]")
    legend_above(axes)
    return figure


def _rows_fitted(result, name, rows):
    """What the chosen effects add to each row, in the channel's unit."""
    stage = _stage_of(result, name)
    columns = columns_of(result.evidence["stroke"], result.evidence["turn"])(
        result.evidence["reduced"][name].channel, rows
    )
    names = [c.name for c in stage.chosen]
    beta = stage.problem.taken(names)[1]
    total, at = np.zeros(len(rows.log)), 0
    for one in names:
        width = stage.problem.effects[one].shape[1]
        stacked = [columns[p] for p in stage.problem.parts[one] if p in columns]
        block = np.hstack(stacked) if stacked else np.zeros((len(rows.log), 0))
        if block.shape[1] == width:
            total += block @ beta[at: at + width]
        at += width
    return total


def course(points, label, changes=(), per_log=False):
    """Figure: a size from repetition to repetition with its 95 % interval, baseline first; dashed: change points.

    ``points``: `Point` each, drawn in per cent; ``label``: of the size; ``changes``: indices of points [1];
    ``per_log``: a point is a log, and those of now are numbered from 1.
    """
    figure, axes = new_figure(height=2.5)
    first = 1 - sum(p.baseline for p in points) if per_log else 1
    for baseline, colour, name in ((True, BASE, "baseline"), (False, NOW, "now")):
        index = [k for k, p in enumerate(points) if p.baseline == baseline]
        if index:
            axes.errorbar(
                [k + first for k in index],
                [100 * points[k].value for k in index],
                yerr=[196 * points[k].stderr for k in index],
                fmt="o",
                ms=3.5,
                color=colour,
                elinewidth=1.0,
                label=name,
            )
    for change in changes:
        axes.axvline(change + first - 0.5, color=COLOURS["black"], ls="--", lw=1.0)
    axes.axhline(0.0, color=COLOURS["grey"], lw=0.7, zorder=0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axes.set_xlabel(
        "log of now, in the order given (baseline: 0 and below)" if per_log
        else "repetition, in the order of the logs"
    )
    axes.set_ylabel(label)
    legend_above(axes)
    return figure


def ripple(result):
    """Figure: amplitude by order of the turn, before and now, or None."""
    spectra = result.context.spectra
    keys = [
        key
        for key in spectra
        if key[0] and (False, *key[1:]) in spectra and len(spectra[key][0]) == len(spectra[(False, *key[1:])][0])
    ]
    if not keys:
        return None
    figure, axes = new_figure(len(keys[:2]), 1, height=2.2, sharex=True, squeeze=False)
    for axis, key in zip(axes[:, 0], keys[:2]):
        orders, now = spectra[key]
        _, before = spectra[(False, *key[1:])]
        axis.bar(orders - 0.2, 100 * before, 0.4, color=BASE, label="baseline")
        axis.bar(orders + 0.2, 100 * now, 0.4, color=NOW, label="now")
        axis.set_title("forward" if key[2] > 0 else "back")
        axis.set_ylabel("amplitude [% of\nthe level]")
    axes[-1][0].set_xlabel("cycles per turn")
    legend_above(axes[0][0])
    return figure
