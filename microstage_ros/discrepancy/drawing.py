"""Pictures of a diagnosis as SVG text: curves of a residual, and how strongly it goes with each coordinate."""

import io

import numpy as np
from matplotlib.figure import Figure

COLOURS = ("#b0453a", "#2a6f97", "#6a994e", "#7a5195")   # before, after, more
WIDTH, HEIGHT = 8.6, 3.0       # inches
NOT_SHOWN = 1e-3               # of the threshold, smallest bar drawn


def curves(picture):
    """SVG of a `Picture`."""
    figure = Figure(figsize=(WIDTH, HEIGHT), layout="constrained")
    axes = figure.subplots()
    for number, (label, curve) in enumerate(picture.curves.items()):
        x, y = np.asarray(curve[0], float), np.asarray(curve[1], float)
        colour = COLOURS[number % len(COLOURS)]
        marker = "o" if len(x) <= 120 else None
        axes.plot(x, y, color=colour, label=label, lw=1.3, marker=marker, ms=3, alpha=0.9)
        if len(curve) > 2:
            spread = np.asarray(curve[2], float)
            axes.fill_between(x, y - 2 * spread, y + 2 * spread, color=colour, alpha=0.15, lw=0)
    axes.axhline(0.0, color="#999999", lw=0.7, zorder=0)
    axes.set_xlabel(picture.x_label)
    axes.set_ylabel(picture.y_label)
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, 1.14), ncols=4, frameon=False, fontsize="small")
    return _svg(figure, axes)


def bars(findings):
    """SVG of `Finding`s: statistic over threshold before and after, one pair of bars per channel and coordinate."""
    figure = Figure(figsize=(WIDTH, 0.9 + 0.34 * len(findings)), layout="constrained")
    axes = figure.subplots()
    place = np.arange(len(findings))[::-1]
    for shift, colour, label, field in ((0.18, COLOURS[0], "axis file", "statistic"), (-0.18, COLOURS[1], "with the causes", "left")):
        ratio = [max(getattr(f, field) / max(f.threshold, 1e-300), NOT_SHOWN) for f in findings]
        axes.barh(place + shift, ratio, 0.34, color=colour, label=label)
    axes.axvline(1.0, color="#333333", lw=1.0, ls="--")
    axes.set_yticks(place, [f"{f.coordinate} ({f.channel})" for f in findings])
    axes.set_xlabel("strength over what chance gives")
    largest = max(max(f.statistic, f.left) / max(f.threshold, 1e-300) for f in findings)
    if largest > 20.0:
        axes.set_xscale("symlog", linthresh=1.0)
    axes.legend(loc="lower right", frameon=False, fontsize="small")
    return _svg(figure, axes)


def _svg(figure, axes):
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()[text.getvalue().index("<svg"):]
