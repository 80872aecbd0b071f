"""The figures of `compare`: the paper's Fig. 10 and Fig. 11 for every controller."""

import numpy as np

from microstage_ros.report.plots import legend_above, new_figure, plot_signal

STRETCHES = 500
"""Of a tracking error, smallest and largest of each: six laws stay a drawing, which a dark page can show."""

START = 1.0
"""From here on a sine's error sets the scale of its plot [s]."""


def tracking_figure(result):
    """Fig. 10: tracking error against time, one panel per controller, all in one scale."""
    kinds, largest = result["controllers"], 0.0
    figure, axes = new_figure(rows=len(kinds), columns=1, height=1.3, sharex=True, sharey=True)
    for ax, kind in zip(np.atleast_1d(axes), kinds):
        curve = result["tracking"][kind]["curve"]
        plot_signal(ax, curve["t"], 1e9 * curve["error"], STRETCHES, linewidth=0.6)
        ax.set_title(kind)
        ax.set_ylabel("error [nm]")
        follows = curve["t"] >= START
        largest = max(largest, float(np.abs(curve["error"][follows]).max(initial=0.0)))
    if largest > 0.0:
        np.atleast_1d(axes)[0].set_ylim(-1.15e9 * largest, 1.15e9 * largest)
    np.atleast_1d(axes)[-1].set_xlabel("time [s]")
    return figure


def moves_figure(result):
    """Fig. 11: approach to the target for every distance and controller, to a quarter of the way or 1 um from it."""
    distances = list(next(iter(result["positioning"].values())))
    figure, axes = new_figure(rows=len(distances), columns=1, height=1.8)
    for ax, distance in zip(np.ravel(axes), distances):
        band = min(0.25 * distance, 1e-6)
        for kind in result["controllers"]:
            curve = result["positioning"][kind][distance]["curve"]
            arrival = curve["t"][np.argmax(np.abs(curve["reference"] - distance) < band)]
            shown = (curve["t"] > arrival - 0.01) & (curve["t"] < arrival + 0.12)
            plot_signal(
                ax, 1e3 * curve["t"][shown], 1e9 * (curve["stage"][shown] - distance), label=kind, linewidth=0.8
            )
        reference = 1e9 * (curve["reference"][shown] - distance)
        plot_signal(
            ax, 1e3 * curve["t"][shown], reference, color="black", linestyle=":", linewidth=0.8, label="reference"
        )
        ax.set_ylim(-1e9 * band, 1e9 * band)
        ax.set_title(f"{distance * 1e6:g} µm")
        ax.set_ylabel("from the\ntarget [nm]")
    np.ravel(axes)[-1].set_xlabel("time since the start of the move [ms]")
    legend_above(np.ravel(axes)[0])
    return figure
