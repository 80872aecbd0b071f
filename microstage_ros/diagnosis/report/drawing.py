"""Figures of a diagnosis: curves of a residual, and how strongly it goes with each coordinate."""

import numpy as np

from microstage_ros.report.plots import COLOURS, legend_above, new_figure, plot_signal, readable

BEFORE, AFTER = COLOURS["orange"], COLOURS["blue"]
MORE = (BEFORE, AFTER, COLOURS["green"], COLOURS["pink"], COLOURS["black"])
MEASURED_WIDTH = 2.2           # of a line: it is seen beside a model that lies on it [points]
FEW = 120                      # points up to which they are marked
LINEAR = 20.0                  # strength up to which the scale is linear


def curves(picture):
    """matplotlib figure of a `Picture`."""
    figure, axes = new_figure(height=3.0)
    every = list(picture.curves.values())
    across, x_label = readable(picture.x_label, [curve[0] for curve in every])
    up, y_label = readable(picture.y_label, [curve[1] for curve in every])
    for colour, (label, curve) in zip(MORE, picture.curves.items()):
        x, y = across * np.asarray(curve[0], float), up * np.asarray(curve[1], float)
        marker = {"marker": "o", "ms": 3} if len(x) <= FEW else {}
        plot_signal(axes, x, y, color=colour, label=label, lw=MEASURED_WIDTH if label == "measured" else 1.1, **marker)
        if len(curve) > 2:
            spread = up * np.asarray(curve[2], float)
            axes.fill_between(x, y - 2 * spread, y + 2 * spread, color=colour, alpha=0.15, lw=0)
    axes.axhline(0.0, color=COLOURS["grey"], lw=0.7, zorder=0)
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    legend_above(axes)
    return figure


def strengths(findings):
    """matplotlib figure of `Finding`s: statistic over threshold, before and after, a pair of bars for each; one where
    nothing was taken away."""
    strongest = {}                 # several looks at one coordinate: the one that shows most
    for finding in findings:
        known = strongest.setdefault((finding.coordinate, finding.channel), finding)
        if finding.statistic / max(finding.threshold, 1e-300) > known.statistic / max(known.threshold, 1e-300):
            strongest[finding.coordinate, finding.channel] = finding
    findings = list(strongest.values())
    figure, axes = new_figure(height=0.9 + 0.34 * len(findings))
    place = np.arange(len(findings))[::-1]
    largest = 1.0
    sides = [(0.18, BEFORE, "axis file", "statistic"), (-0.18, AFTER, "with the causes", "left")]
    if all(f.left == f.statistic for f in findings):
        sides = [(0.0, *sides[0][1:])]
    for shift, colour, label, field in sides:
        ratio = np.array([getattr(f, field) / max(f.threshold, 1e-300) for f in findings])
        largest = max(largest, float(np.nanmax(ratio)))
        axes.barh(place + shift, ratio, 0.34, color=colour, label=label)
    axes.axvline(1.0, color=COLOURS["black"], lw=1.0, ls="--")
    axes.set_yticks(place, [f"{f.coordinate} ({f.channel})" for f in findings])
    axes.set_xlabel("strength over what chance gives")
    if largest > LINEAR:
        axes.set_xscale("symlog", linthresh=1.0)
        axes.xaxis.set_major_formatter("{x:g}")
    legend_above(axes)
    return figure
