"""Figures of the reports: one look, colours that everyone can tell apart, long signals kept honest."""

import re
import textwrap

import numpy as np
from cycler import cycler
from matplotlib import rcParams
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation

from microstage_ros.quantities.readable import PREFIXES, exponent_of

COLOURS = {"blue": "#0072B2", "orange": "#D55E00", "green": "#009E73", "pink": "#CC79A7", "sky": "#56B4E9",
           "yellow": "#E69F00", "black": "#1d2329", "grey": "#8a949e"}
"""The colours of Okabe and Ito, distinguishable with any colour vision."""

CYCLE = ["blue", "orange", "green", "pink", "sky", "yellow", "black"]
LOOK = {
    "font.size": 9, "axes.titlesize": 10, "axes.titleweight": "normal", "axes.titlelocation": "left",
    "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": "#59636e", "axes.labelcolor": "#1d2329",
    "xtick.color": "#59636e", "ytick.color": "#59636e", "axes.grid": True, "grid.color": "#e4e8ec",
    "grid.linewidth": 0.7, "axes.axisbelow": True, "lines.linewidth": 1.2, "legend.frameon": False,
    "legend.fontsize": 8.5, "savefig.facecolor": "white",
    "axes.prop_cycle": cycler(color=[COLOURS[name] for name in CYCLE]),
}
FULL_WIDTH_INCH = 9.5
SHORTEST_LINE = 10
"""Letters of a legend's line, at least."""

TITLE_INCH = 0.23
"""Height of a plot's title with the space below it: above it stands the legend."""

POINTS = 1600
"""Points that a line across the page can show, smallest and largest of each."""


def new_figure(rows=1, columns=1, height=2.6, width=FULL_WIDTH_INCH, **options):
    """A figure in the look of the reports.

    Parameters
    ----------
    rows, columns : of plots [1].
    height, width : of one row, and of the figure [inch].
    options : of `Figure.subplots`.

    Returns
    -------
    figure, axes : as from `matplotlib.figure.Figure.subplots`.
    """
    rcParams.update(LOOK)  # titles and legends are made later and look there too
    figure = Figure(figsize=(width, height * rows), layout="constrained")
    return figure, figure.subplots(rows, columns, **options)


def legend_above(axes, most=0.8):
    """The legend of a plot above it, where no curve can be: at the left, over the plot's own title.

    Parameters
    ----------
    axes : whose labelled curves it names; nothing is drawn where none has a label.
    most : share of the figure's width that a row of it may take [1].
    """
    handles, labels = axes.get_legend_handles_labels()
    if not handles:
        return
    figure, letters = axes.figure, max(map(len, labels))
    titled = axes.get_title(loc="left") or axes.get_title()
    above = ScaledTranslation(0.0, TITLE_INCH if titled else 0.0, figure.dpi_scale_trans)
    width = most * figure.bbox.width
    for columns in [*range(len(labels), 0, -1), 1, 1, 1]:
        wrapped = [textwrap.fill(label, letters) for label in labels]
        legend = axes.legend(handles, wrapped, ncols=columns, loc="lower left", bbox_to_anchor=(0.0, 1.0),
                             bbox_transform=axes.transAxes + above, borderaxespad=0.3, borderpad=0.2)
        taken = legend.get_window_extent().width
        if taken <= width:
            return
        if columns == 1:  # a name too long for one line goes on in the next
            letters = max(int(0.9 * letters * width / taken), SHORTEST_LINE)


def decimate(x, y, points=POINTS):
    """A long signal with few points, every peak kept: smallest and largest of each stretch.

    Parameters
    ----------
    x, y : shape (n,); NaN in y is a gap.
    points : stretches [1]; at most 2 points each are left.

    Returns
    -------
    x, y : the samples themselves, in their order; unchanged if n <= 2 points.
    """
    x, y = np.asarray(x), np.asarray(y, dtype=float)
    n = len(y)
    if n <= 2 * points:
        return x, y
    edges = np.linspace(0, n, points + 1).astype(int)
    low = np.fmin.reduceat(y, edges[:-1])
    stretch = np.repeat(np.arange(points), np.diff(edges))
    filled_low, filled_high = np.where(np.isnan(y), np.inf, y), np.where(np.isnan(y), -np.inf, y)
    first_low = _first_of(filled_low == np.minimum.reduceat(filled_low, edges[:-1])[stretch], edges)
    first_high = _first_of(filled_high == np.maximum.reduceat(filled_high, edges[:-1])[stretch], edges)
    kept = np.unique(np.concatenate([first_low, first_high, edges[:-1][np.isnan(low)]]))
    return x[kept], y[kept]


def _first_of(hit, edges):
    """Index of the first hit in every stretch (every stretch has one)."""
    places = np.flatnonzero(hit)
    return places[np.searchsorted(places, edges[:-1])]


def plot_signal(axes, x, y, points=POINTS, **options):
    """`axes.plot` of a signal of any length, with every peak kept: ``x`` and ``y`` (n,), ``points`` stretches [1]."""
    return axes.plot(*decimate(x, y, points), **options)


def scale_of(values, unit):
    """A factor [1] and a unit with prefix that make ``values`` (n,), in ``unit``, easy to read on an axis of a plot.

    Returns
    -------
    factor, unit : multiply values by `factor` and label them with `unit`.
    """
    finite = np.abs(np.asarray(values, dtype=float))
    finite = finite[np.isfinite(finite)]
    exponent = exponent_of(float(finite.max()) if finite.size else 0.0)
    return 10.0**-exponent, PREFIXES[exponent] + unit


PREFIXED = ("m", "s", "V", "A", "N", "N m", "m/s", "rad", "rad/s", "Hz")
"""Units in brackets of an axis label that `readable` puts a prefix before."""


def readable(label, values):
    """Factor and label with a prefix before the unit in brackets: ``position [m]`` as 1e6, ``position [µm]``.

    Parameters
    ----------
    label : of an axis, its unit in brackets.
    values : list of arrays (n,) that are drawn along it, in that unit.
    """
    found = re.search(r"\[([^\]]+)\]", label)
    if not found or found[1] not in PREFIXED:
        return 1.0, label
    factor, unit = scale_of(np.concatenate([np.ravel(v) for v in values]), found[1])
    return factor, label.replace(found[0], f"[{unit}]")
