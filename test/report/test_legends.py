"""A legend lies on no curve: it stands above its plot, in the wide form and in the narrow one."""

import re
from pathlib import Path

import numpy as np
import pytest

from microstage_ros.control.evaluation.comparison import CONTROLLERS
from microstage_ros.commands.analysis import log
from microstage_ros.commands.operation import demo_report
from microstage_ros.commissioning import report
from microstage_ros.commissioning.estimation.frequency_response import MeasuredMargins, Response
from microstage_ros.diagnosis.logs.report.pictures import course
from microstage_ros.diagnosis.logs.selection.course import Point
from microstage_ros.diagnosis.report.drawing import curves, strengths
from microstage_ros.diagnosis.result import Finding, Picture
from microstage_ros.report.comparison_figures import moves_figure, tracking_figure
from microstage_ros.report.drawing_file import drawing, narrowed
from microstage_ros.report.page import LARGEST_SVG
from microstage_ros.report.plots import legend_above, new_figure

PACKAGE = Path(__file__).resolve().parents[2] / "microstage_ros"


def covered(figure):
    """What legends of a figure lie on or stick out of, in words."""
    figure.draw_without_rendering()
    found = []
    for axes in figure.axes:
        legend = axes.get_legend()
        if legend is None:
            continue
        box = legend.get_window_extent()
        for other in figure.axes:
            if box.overlaps(other.get_window_extent()):
                found.append(f"plot {figure.axes.index(other)}")
            for title in (other.title, other._left_title, other._right_title, other.xaxis.label):
                if title.get_text() and box.overlaps(title.get_window_extent()):
                    found.append(title.get_text())
        below = axes.xaxis.label.get_window_extent()
        if below.x0 < figure.bbox.x0 or below.x1 > figure.bbox.x1:
            found.append("label beyond the edge")
        if box.x0 < figure.bbox.x0 or box.x1 > figure.bbox.x1 or box.y1 > figure.bbox.y1:
            found.append("edge")
    return found


def plotted(labels, rows=1, title=""):
    """A figure of wild curves that fill their plots, with a legend on every one."""
    figure, plots = new_figure(rows, 1, squeeze=False, sharex=True)
    for axes in plots[:, 0]:
        for seed, label in enumerate(labels):
            axes.plot(np.random.default_rng(seed).normal(size=500), label=label)
        axes.set(ylabel="position [µm]", xlabel="time [s]" if axes is plots[-1, 0] else "")
        axes.set_title(title)
        legend_above(axes)
    return figure


def moves():
    """A comparison's moves of three controllers over two distances."""
    time = np.linspace(0.0, 0.5, 2000)
    stage = 1e-5 * np.minimum(time / 0.05, 1.0)
    curve = {"t": time, "reference": stage, "stage": stage + 1e-7 * np.sin(300 * time)}
    kinds = CONTROLLERS
    return moves_figure({"controllers": kinds, "positioning": {kind: dict.fromkeys((1e-5, 1.1e-5), {"curve": curve}) for kind in kinds}})


def timing():
    """A histogram of response times that reaches to its right end."""
    fields = [("response_histogram", int, 64), ("response_median", float), ("response_p99", float), ("response_p9999", float)]
    row = np.zeros(1, fields)
    row["response_histogram"], row["response_median"], row["response_p99"], row["response_p9999"] = 100, 2e-5, 1e-4, 5e-2
    return demo_report._timing_figure({"timing": row})


def bode():
    """A plant of which the smaller numbers lie where a legend used to."""
    frequency = np.geomspace(5.0, 900.0, 40)
    plain = np.ones(40)
    return report._bode([Response(what, condition, frequency, 1e-4 / frequency / (1 + 1j * frequency / 50), plain, plain, 0.02 * plain)
                         for what, condition in (("plant", "sliding"), ("plant", "rest"), ("plant", "sliding"), ("loop", "sliding"))])


X = np.linspace(0.0, 1.0, 400)
FIGURES = {
    "one": lambda: plotted(["measured", "model"]),
    "two plots with titles": lambda: plotted(["baseline ± 2 standard deviations", "now", "baseline with the causes"], 2, "forward"),
    "many long labels": lambda: plotted([f"response of the plant, condition number {k}, in closed loop" for k in range(5)], 2),
    "residual": lambda: curves(Picture("k", "t", "time [s]", "stage [m]", {"measured": (X, np.sin(90 * X)), "model": (X, np.cos(90 * X))}, "backlash")),
    "strengths": lambda: strengths([Finding("torque", f"coordinate {k}", 30.0 - 4 * k, 1.0, 2.0) for k in range(7)]),
    "course": lambda: course([Point(f"log {k}", 0, 0.1 * k, 0.1, k < 3) for k in range(8)], "change\n[% of the level]", [3], per_log=True),
    "moves": moves,
    "response times": timing,
    "frequency response": bode,
}


@pytest.mark.parametrize("count, markers", [(1, {"o"}), (40, {"", "None"})])
def test_a_response_of_one_frequency_is_seen(count, markers):
    """At rest noise may leave a single coherent frequency: its line was in the legend and nowhere else."""
    frequency, plain = np.linspace(300.0, 400.0, count), np.ones(count)
    figure = report._bode([Response("plant", "rest", frequency, 1e-7 * plain, plain, plain, 0.02 * plain)])
    assert all(line.get_marker() in markers for axes in figure.axes for line in axes.lines)


@pytest.mark.parametrize("name", FIGURES)
def test_no_legend_covers_anything(name):
    figure = FIGURES[name]()
    assert any(axes.get_legend() for axes in figure.axes)
    assert not covered(figure)
    assert not covered(narrowed(figure)) and not covered(figure)


def test_the_start_does_not_set_the_scale_of_a_tracking_error():
    """The first periods, in which friction builds up, were four times all that follows, which was a thin line."""
    time = np.linspace(0.0, 42.0, 5000)
    curve = {"t": time, "error": 20e-9 * np.sin(time) - 1e-7 * (time < 0.1)}
    low, high = tracking_figure({"controllers": ["pid"], "tracking": {"pid": {"curve": curve}}}).axes[0].get_ylim()
    assert low == -high and 20.0 < high < 30.0


def test_the_errors_of_all_laws_stay_a_drawing():
    """As pixels they were white on a dark page, and too small to read on a phone."""
    time = np.linspace(0.0, 42.0, 200_000)
    curve = {"t": time, "error": 2e-8 * np.random.default_rng(1).normal(size=len(time))}
    figure = tracking_figure({"controllers": CONTROLLERS, "tracking": dict.fromkeys(CONTROLLERS, {"curve": curve})})
    assert len(drawing(figure, "a")) < LARGEST_SVG


def test_response_times_are_read_with_their_unit():
    axes = timing().axes[0]
    axes.figure.draw_without_rendering()
    assert {"10 µs", "100 µs", "1 ms", "10 ms"} <= {label.get_text() for label in axes.get_xticklabels()}


def test_strengths_on_a_logarithmic_axis_are_plain_numbers():
    axes = FIGURES["strengths"]().axes[0]
    axes.figure.draw_without_rendering()
    assert axes.get_xscale() == "symlog" and [label.get_text() for label in axes.get_xticklabels()][:3] == ["0", "1", "10"]


def test_margins_have_as_many_digits_as_their_doubt_lets_stand():
    """A gain margin was stated as 2.4 dB ± 0.0 dB, and one that is not there as inf."""
    said = report._margins_in_words(MeasuredMargins(26.1, 0.06, 2.4137, 0.014, 64.2, 4.6, 3745.0))
    assert "phase margin 26.10 ± 0.12 °" in said and "gain margin 2.414 ± 0.028 dB" in said
    assert "gain margin none, no crossing" in report._margins_in_words(MeasuredMargins(26.1, 0.06, np.inf, 0.0, 64.2, 4.6, 3745.0))


def test_friction_along_the_travel_is_drawn_in_its_own_scale():
    """Forwards and backwards in one plot were two straight lines."""
    class Command:
        quantity, unit = "voltage", "V"

    place = np.linspace(-0.02, 0.02, 30)
    plots = report._along(np.stack([place, 1.45 + 0.1 * place, -1.45 + 0.1 * place], axis=1), Command).axes
    assert [axes.get_title(loc="left") for axes in plots] == ["forwards", "backwards"]
    assert all(np.ptp(axes.get_ylim()) < 0.01 and axes.get_ylabel() == "voltage [V]" for axes in plots)


def test_the_picture_of_a_log_names_its_shades_and_a_magnitude(tmp_path):
    """Grey and yellow were told in the caption alone, and a current without sign had the label of one with."""
    time = np.arange(0.0, 8.0, 0.01)
    place = np.clip(np.where(time < 4.0, 20.0 * (time - 1.0), 20.0 * (7.0 - time)), 0.0, 40.0)
    rows = np.stack([time, place, place, 0.4 * np.abs(np.gradient(place)) + 0.1], axis=1)
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", fmt="%.5f", header="time,set_point,actual,current", comments="")
    assert log.main([str(tmp_path / "log.csv"), "--out", str(tmp_path / "out")]) == 0
    text = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert ">accelerates or brakes</text>" in text and ">at rest</text>" in text and ">|current| [mA]</text>" in text
    assert "found in it: time, " in text


def test_what_covers_is_noticed():
    figure = plotted(["measured", "model"])
    figure.axes[0].legend(loc="best")
    assert covered(figure) == ["plot 0"]


def test_a_plot_without_names_has_no_legend():
    figure, axes = new_figure()
    axes.plot([0, 1])
    legend_above(axes)
    assert axes.get_legend() is None


def test_every_legend_of_the_package_is_placed_so():
    """Whoever draws asks the one owner; `axes.legend` puts it where curves may be."""
    own = [str(path.relative_to(PACKAGE)) for path in PACKAGE.rglob("*.py") if re.search(r"\.legend\(", path.read_text(encoding="utf-8"))]
    assert own == ["report/plots.py"]
