"""The page of an identification: what was found, how sure, the curves with their data, bands and residuals."""

import numpy as np

from microstage_ros.identification.estimators.estimate import DETERMINED_HALF_WIDTH
from microstage_ros.report.page import Page
from microstage_ros.quantities.readable import interval, people
from microstage_ros.report.plots import COLOURS, legend_above, new_figure, readable

MOST_POINTS = 3000


def identification_page(result, axis, records, seed, warnings=()):
    """`Page` of an `Identification`.

    Parameters
    ----------
    result : `Identification`. axis : the axis file that was given. records : names of the records.
    seed : of the bootstrap [1]. warnings : sentences about the records.
    """
    page = Page(
        "Identification", f"{axis.name}: parameters from {len(records)} records", configuration=axis.place, seed=seed
    )
    determined = [e for e in result.estimates.values() if e.determined]
    open_ones = [e for e in result.estimates.values() if not e.determined]
    page.verdict(
        f"{len(determined)} parameters are determined by these records, {len(open_ones)} are not.",
        "good" if determined and not open_ones else "caution" if determined else "bad",
        "What is not determined keeps the value of the axis file; the table says which experiment would tell it.",
    )
    page.section("Parameters")
    page.table(
        ["parameter", "identified", "95 % interval", "axis file before", "how"],
        [_row(e, axis) for e in determined],
        "Determined by these records: the half width of the 95 % interval is at most "
        f"{DETERMINED_HALF_WIDTH:.0%} of the value (for an offset, of the size from which it "
        "would matter). ± is the standard uncertainty.",
    )
    if open_ones:
        page.table(
            ["parameter", "why, and what would tell it"], [(e.key, e.remark) for e in open_ones], "Not determined"
        )
    page.list([*result.remarks, *warnings])
    if result.curves:
        page.section("Curves")
    for curve in result.curves:
        band = " with its 95 % band" if curve.low is not None else ""
        below = "; below, data minus model" if curve.residual is not None else ""
        page.figure(draw(curve), f"{curve.title}: data and model{band}{below}", curve.title)
    for title, header, rows in result.tables:
        page.section(title)
        page.table(list(header), [list(row) for row in rows])
    with page.details("Correlation of what was fitted together"):
        for names, matrix in result.correlations:
            page.table(["", *names], [[name, *(f"{v:+.2f}" for v in row)] for name, row in zip(names, matrix)])
    with page.details("Records"):
        page.list(list(records))
    return page


def _row(estimate, axis):
    before = people(axis.value(estimate.key), estimate.unit, between="\n") if axis.has(estimate.key) else None
    between = None
    if estimate.low is not None:
        lows, highs = np.atleast_1d(estimate.low), np.atleast_1d(estimate.high)
        between = "\n".join(interval(low, high, estimate.unit, 4) for low, high in zip(lows, highs))
    return [estimate.key, in_words(estimate, "\n"), between, before, estimate.method]


def in_words(estimate, between="; "):
    """What an `Estimate` that is determined says: its number, or that it is an offset too small to matter."""
    return estimate.remark or people(estimate.value, estimate.unit, estimate.stderr, between)


def draw(curve):
    """Figure of a `Curve`: data and model above, residuals below."""
    rows = 2 if curve.residual is not None else 1
    figure, axes = new_figure(rows, 1, height=2.6)
    axes = np.atleast_1d(axes)
    across, x_label = readable(curve.x_label, [curve.x])
    up, y_label = readable(curve.y_label, [curve.y])
    pick = np.unique(np.linspace(0, len(curve.x) - 1, min(len(curve.x), MOST_POINTS)).astype(int))
    axes[0].plot(
        across * curve.x[pick],
        up * curve.y[pick],
        ".",
        markersize=5,
        color=COLOURS["blue"],
        alpha=0.35,
        label="data",
    )
    if curve.model_x is not None:
        order = np.argsort(curve.model_x)
        style = "-" if len(curve.model_x) < 500 else "."
        axes[0].plot(
            across * curve.model_x[order],
            up * curve.model_y[order],
            style,
            color=COLOURS["orange"],
            markersize=1.5,
            zorder=3,
            label="model",
        )
        if curve.low is not None:
            axes[0].fill_between(
                across * curve.model_x[order],
                up * curve.low[order],
                up * curve.high[order],
                color=COLOURS["orange"],
                alpha=0.25,
            )
    if np.min(curve.x) > 0 and np.max(curve.x) > 50 * np.min(curve.x):
        for each in axes:
            each.set_xscale("log")
    axes[0].set(title=curve.title, ylabel=y_label)
    legend_above(axes[0])
    if curve.residual is not None:
        fine, residual_label = readable(curve.y_label, [curve.residual])
        axes[1].plot(across * curve.x[pick], fine * curve.residual[pick], ".", markersize=2.5, color=COLOURS["grey"])
        axes[1].set(
            ylabel="residual " + residual_label[residual_label.find("[") :] if "[" in residual_label else "residual"
        )
    axes[-1].set_xlabel(x_label)
    return figure
