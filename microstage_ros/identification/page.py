"""The page of an identification: what was found, how sure, the curves with their data, bands and residuals."""

import numpy as np

from microstage_ros.report.page import Page
from microstage_ros.report.plots import COLOURS, new_figure

MOST_POINTS = 3000


def identification_page(result, axis, records, seed, warnings=()):
    """`Page` of an `Identification`.

    Parameters
    ----------
    result : `Identification`. axis : the axis file that was given. records : names of the records.
    seed : of the bootstrap. warnings : sentences about the records.
    """
    page = Page("Identification", f"{axis.name}: parameters from {len(records)} records", configuration=axis.place, seed=seed)
    told = [e for e in result.estimates.values() if e.determined]
    open_ones = [e for e in result.estimates.values() if not e.determined]
    page.verdict(f"{len(told)} parameters are determined by these records, {len(open_ones)} are not.",
                 "good" if told and not open_ones else "caution" if told else "bad",
                 "What is not determined keeps the value of the axis file; the table says which experiment would tell it.")
    page.section("Parameters")
    page.table(["parameter", "unit", "identified", "standard uncertainty", "95 % interval", "axis file before", "how"],
               [_row(e, axis) for e in told], "Determined by these records")
    if open_ones:
        page.table(["parameter", "why, and what would tell it"], [(e.key, e.remark) for e in open_ones], "Not determined")
    page.list([*result.remarks, *warnings])
    if result.curves:
        page.section("Curves")
    for curve in result.curves:
        page.figure(draw(curve), f"{curve.title}: data, model with its 95 % band; below, data minus model", curve.title)
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
    before = shown(axis.value(estimate.key)) if axis.has(estimate.key) else None
    interval = None
    if estimate.low is not None:
        lows, highs = np.atleast_1d(estimate.low), np.atleast_1d(estimate.high)
        interval = "; ".join(f"{low:.4g} … {high:.4g}" for low, high in zip(lows, highs))
    return [estimate.key, estimate.unit, shown(estimate.value), None if estimate.stderr is None else shown(estimate.stderr, 2),
            interval, before, estimate.method]


def shown(value, digits=5):
    """A number or a list of numbers as text."""
    return "; ".join(f"{v:.{digits}g}" for v in np.atleast_1d(value))


def draw(curve):
    """Figure of a `Curve`: data and model above, residuals below."""
    rows = 2 if curve.residual is not None else 1
    figure, axes = new_figure(rows, 1, height=2.6)
    axes = np.atleast_1d(axes)
    pick = np.unique(np.linspace(0, len(curve.x) - 1, min(len(curve.x), MOST_POINTS)).astype(int))
    axes[0].plot(curve.x[pick], curve.y[pick], ".", markersize=2.5, color=COLOURS["sky"], label="data")
    if curve.model_x is not None:
        order = np.argsort(curve.model_x)
        style = "-" if len(curve.model_x) < 500 else "."
        axes[0].plot(curve.model_x[order], curve.model_y[order], style, color=COLOURS["orange"], markersize=2, label="model")
        if curve.low is not None:
            axes[0].fill_between(curve.model_x[order], curve.low[order], curve.high[order], color=COLOURS["orange"], alpha=0.25)
    if np.min(curve.x) > 0 and np.max(curve.x) > 50 * np.min(curve.x):
        for each in axes:
            each.set_xscale("log")
    axes[0].set(title=curve.title, ylabel=curve.y_label)
    axes[0].legend()
    if curve.residual is not None:
        axes[1].plot(curve.x[pick], curve.residual[pick], ".", markersize=2.5, color=COLOURS["grey"])
        axes[1].set(ylabel="residual")
    axes[-1].set_xlabel(curve.x_label)
    return figure
