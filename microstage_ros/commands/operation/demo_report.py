"""The demo told: a table beside the paper's, and one page with the moves as the bag has them."""

import numpy as np
from matplotlib.ticker import EngFormatter

from microstage_ros.metrology.repeatability import repeatability
from microstage_ros.records.bags.bag import read_bag
from microstage_ros.report.page import Page
from microstage_ros.quantities.readable import interval, quantity
from microstage_ros.report.plots import COLOURS, legend_above, new_figure, plot_signal

PAPER_4S = {1e-6: 173e-9, 1e-5: 160e-9, 1e-4: 219e-9, 1e-3: 255e-9}
"""Accuracy and precision 4s of the paper's Table 4 [m]."""

TAIL = 500
"""Control periods shown before and after a move."""


def accuracy_rows(results):
    """One row per target and direction: bias and 4s [m] by the interferometer (by the encoder where there is none),
    with intervals, and settling times [s]; ``results``: one `demo.move_facts` per move."""
    rows = []
    for target in dict.fromkeys(move["target_m"] for move in results):
        made = [move for move in results if move["target_m"] == target]
        moves = [move for move in made if move["reached"]]
        missed = len(made) - len(moves)
        if len(moves) < 2:
            rows.append({"target": target, "count": len(moves), "missed": missed, "repeatability": None})
            continue
        rows.append({
            "target": target, "count": len(moves), "missed": missed,
            "repeatability": repeatability(_errors(moves)),
            "encoder": repeatability([move["final_error_m"] for move in moves]),
            "settling": float(np.median([move["settling_time_s"] for move in moves])),
            "overshoot": float(np.max([move["overshoot_m"] for move in moves])),
            "paper": next(value for size, value in PAPER_4S.items() if np.isclose(size, abs(target))),
        })
    return rows


def _errors(moves):
    """By the interferometer [m]; by the encoder where there is none."""
    errors = [move["interferometer_error_m"] for move in moves]
    return errors if np.isfinite(errors).all() else [move["final_error_m"] for move in moves]


HEADER = ("target [µm]", "n", "bias [nm]", "4s [nm]", "95 % interval [nm]", "settling, median [ms]",
          "overshoot, largest [nm]", "paper's 4s [nm]")


def _count(row):
    """Moves that settled, and of how many where some did not."""
    return f"{row['count']} of {row['count'] + row['missed']}" if row["missed"] else str(row["count"])


def table_cells(rows):
    """The rows as texts."""
    cells = []
    for row in rows:
        r = row["repeatability"]
        if r is None:
            cells.append([f"{row['target'] * 1e6:+.0f}", _count(row), "too few moves settled", "", "", "", "", ""])
            continue
        low, high = r.four_s_interval
        cells.append([f"{row['target'] * 1e6:+.0f}", _count(row), f"{r.bias * 1e9:+.1f}", f"{r.four_s * 1e9:.1f}",
                      f"{low * 1e9:.0f} to {high * 1e9:.0f}", f"{row['settling'] * 1e3:.0f}",
                      f"{row['overshoot'] * 1e9:.0f}", f"{row['paper'] * 1e9:.0f}"])
    return cells


def print_table(rows, facts):
    """The table on standard output."""
    cells = [HEADER, *table_cells(rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(HEADER))]
    print(f"{_what(facts)} ({facts['axis']}), controller {facts['controller']}, seed {facts['seed']}: "
          f"errors by the {facts['instrument']}, mean over the settle time")
    for number, row in enumerate(cells):
        print("  ".join(f"{cell:>{width}}" for cell, width in zip(row, widths)))
        if number == 0:
            print("  ".join("-" * width for width in widths))


def _what(facts):
    """What moved."""
    return "Simulated axis" if facts["simulated"] else f"Backend {facts['backend']}"


def write_report(path, bag, rows, results, facts):
    """Write the page.

    Parameters
    ----------
    path : of the page. bag : folder of the run's bag. rows : of `accuracy_rows`. results : one dict per move.
    facts : version, axis, namespace, seed, controller and conditions of the run.
    """
    simulated = facts["simulated"]
    page = Page("Point-to-point moves of a simulated axis" if simulated else "Point-to-point moves",
                f"{facts['axis']}; nothing moved" if simulated else f"{facts['axis']}, backend {facts['backend']}",
                configuration=facts["axis"], seed=facts["seed"], about={"ROS": facts["ros"]})
    _verdict(page, rows, results, simulated)
    page.section("Accuracy")
    page.table(HEADER, table_cells(rows), "Bias and 4s of the errors, target by target and direction by direction.")
    page.note(f"The error of a move is the mean of {facts['instrument']} − target over the settle time "
              f"({facts['settle_time_s'] * 1e3:.0f} ms within ±{facts['tolerance_m'] * 1e9:.0f} nm by the encoder). "
              "The instrument's own uncertainty is not in it. The interval is the chi-square one for so few repeats; "
              "4s leaves the mean error out, so it is a repeatability.")
    streams = _streams(bag, facts["namespace"])
    page.section("Moves")
    for target in sorted({abs(row["target"]) for row in rows}):
        move = next((m for m in results if m["target_m"] == target), None)
        if move and move["end_sequence"]:
            page.figure(
                _move_figure(streams, move, facts["period_s"], facts["command"]),
                f"First move to {target * 1e6:g} µm: position, error, {facts['command']['quantity']}.",
                "Reference, encoder and interferometer against time",
            )
    page.section("Gains and friction over the run")
    page.figure(
        _gain_figure(streams, facts["period_s"], facts["command"]["unit"]),
        f"Gains of the controller {facts['controller']}.",
        "Three gains against time",
    )
    if len(streams.get("simulation", ())):
        page.figure(
            _friction_figure(streams, facts["period_s"]),
            "Friction of both contacts: the observer's estimate and what the simulation knows to be true.",
            "Estimated and true friction against time",
        )
        words = _friction_words(streams)
        if words:
            page.text(words)
    page.section("The loop")
    page.figure(_timing_figure(streams), "From publishing a state to the command that answers it (wall clock); in "
                "lockstep simulated time waits for it.", "Histogram of response times")
    with page.details("How it was run"):
        page.text(
            "Separate processes over ROS 2 topics. The bag holds every message, every node's parameters, the seed and "
            "the axis file."
        )
        page.table(("topic", "messages"), [[name, len(values)] for name, values in sorted(streams.items())])
    page.save(path)


def comparison(row):
    """What the 95 % interval of a row's 4s says beside the paper's: ``below``, ``above`` or ``open``.

    A move that did not settle has no accuracy to speak of: with one among them a target is never ``below``.
    """
    if row["repeatability"] is None:
        return "open"
    low, high = row["repeatability"].four_s_interval
    if high < row["paper"]:
        return "below" if not row["missed"] else "open"
    return "above" if low > row["paper"] else "open"


def headline(rows, results):
    """(one sentence, whether it says without reserve that every target is reached better than the paper's axis did)."""
    missed = sum(not move["reached"] for move in results)
    said = [comparison(row) for row in rows]
    below, above, count = said.count("below"), said.count("above"), len(rows)
    good = [row["repeatability"] for row in rows if row["repeatability"] is not None]
    text = f"{len(results) - missed} of {len(results)} moves settled"
    if good:
        worst = max(good, key=lambda r: r.four_s)
        text += (f"; 4s is at most {worst.four_s * 1e9:.0f} nm (95 % interval {worst.four_s_interval[0] * 1e9:.0f} to "
                 f"{worst.four_s_interval[1] * 1e9:.0f} nm)")
    text += f"; by the intervals it is below the paper's for {below} of {count} targets"
    text += f", above for {above}" if above else ""
    if count - below - above:
        repeats = min((row["count"] for row in rows), default=0)
        text += f"; for the other {count - below - above} so few repeats ({repeats} each at least) cannot tell"
        text += " or a move did not settle" if missed else ""
    return text + ".", bool(not missed and below == count)


def _verdict(page, rows, results, simulated):
    good = [row for row in rows if row["repeatability"] is not None]
    text, significant = headline(rows, results)
    page.verdict(text, "good" if significant else "caution",
                 "The axis is simulated: this compares a model with a measured device." if simulated else "")
    cards = []
    for row in (row for row in good if row["target"] > 0):
        r = row["repeatability"]
        low, high = r.four_s_interval
        cards.append((f"4s at {row['target'] * 1e6:+.0f} µm", f"{r.four_s * 1e9:.1f} nm",
                      f"95 %: {interval(low, high, 'm')}; paper: {row['paper'] * 1e9:.0f} nm"))
    page.key_figures(cards)


def _streams(bag, namespace):
    """The topics of the axis ``namespace`` in the bag, as arrays, without the namespace."""
    inside = f"{namespace}/"
    return {name.removeprefix(inside): values for name, values in read_bag(bag).items() if name.startswith(inside)}


def _part(stream, first, last):
    """The messages of control periods first..last."""
    return stream[(stream["sequence"] >= first) & (stream["sequence"] <= last)]


def _move_figure(streams, move, period, command_facts):
    first, last = max(move["start_sequence"] - TAIL, 0), move["end_sequence"]
    measured = "interferometer" if len(streams.get("interferometer", ())) else "state"
    state, command, light = (_part(streams[name], first, last) for name in ("state", "command", measured))

    def time(stream):
        return (stream["sequence"].astype(float) - move["start_sequence"]) * period * 1e3  # ms

    figure, (top, middle, bottom) = new_figure(3, 1, height=1.9, sharex=True)
    top.plot(time(command), command["reference"] * 1e6, color=COLOURS["grey"], label="reference")
    plot_signal(top, time(state), state["position"] * 1e6, color=COLOURS["blue"], label="encoder")
    plot_signal(top, time(light), light["position"] * 1e6, color=COLOURS["orange"], linewidth=0.8,
                label="interferometer" if measured != "state" else None)
    top.set_ylabel("position [µm]")
    legend_above(top)
    wanted = np.interp(light["sequence"], command["sequence"], command["reference"])
    plot_signal(middle, time(light), (light["position"] - wanted) * 1e9, color=COLOURS["orange"])
    middle.set_ylabel(f"{'interferometer' if measured != 'state' else 'encoder'}\n− reference [nm]")
    plot_signal(bottom, time(command), command["voltage"], color=COLOURS["green"])
    bottom.set_ylabel(f"{command_facts['quantity']} [{command_facts['unit']}]")
    bottom.set_xlabel("time since the start of the move [ms]")
    return figure


def _seconds(stream, period):
    return stream["sequence"].astype(float) * period


def _gain_figure(streams, period, unit):
    inside = streams["controller_state"]
    figure, axes = new_figure(3, 1, height=1.5, sharex=True)
    for plot, field, label in zip(axes, ("proportional_gain", "integral_gain", "derivative_gain"),
                                  (f"K_P [{unit}/µm]", f"K_I [{unit}/(µm s)]", f"K_D [{unit} s/m]")):
        factor = 1.0 if field == "derivative_gain" else 1e-6
        plot_signal(plot, _seconds(inside, period), inside[field] * factor)
        plot.set_ylabel(label)
    axes[-1].set_xlabel("time [s]")
    return figure


def _friction(streams):
    """Estimate and truth in the same control periods."""
    estimate, truth = streams["friction"], streams["simulation"]
    _, ours, theirs = np.intersect1d(estimate["sequence"], truth["sequence"], return_indices=True)
    return estimate[ours], truth[theirs]


def _friction_figure(streams, period):
    estimate, truth = _friction(streams)
    figure, (top, bottom) = new_figure(2, 1, height=1.9, sharex=True)
    for plot, field, factor, label in ((top, "actuator_torque", 1e6, "actuator [µN m]"),
                                       (bottom, "guideway_force", 1.0, "guideways [N]")):
        plot_signal(plot, _seconds(truth, period), truth[field] * factor, color=COLOURS["grey"], label="true")
        plot_signal(plot, _seconds(estimate, period), estimate[field] * factor, color=COLOURS["blue"], label="estimate",
                    linewidth=0.8)
        plot.set_ylabel(label)
    legend_above(top)
    bottom.set_xlabel("time [s]")
    return figure


def _friction_words(streams):
    """The error of the friction estimate in one sentence, contact by contact; empty where no true friction moves."""
    estimate, truth = _friction(streams)
    words = []
    for field, name in (("actuator_torque", "actuator and gearhead"), ("guideway_force", "guideways")):
        error, true = np.sum((estimate[field] - truth[field]) ** 2), np.sum(truth[field] ** 2)
        if true > 0.0 and np.isfinite(error):
            words.append(f"{name} {np.sqrt(error / true) * 100:.1f} %")
    said = "Error of the friction estimate over the run, rms relative to the true friction's rms: "
    return f"{said}{', '.join(words)}." if words else ""


def _timing_figure(streams):
    figure, axes = new_figure(height=2.2)
    timing = streams.get("timing")
    if timing is not None and len(timing):
        last = timing[-1]
        counts = last["response_histogram"]
        edges = 10.0 ** (-5 + np.arange(len(counts)) / 16)
        taken = counts > 0
        axes.bar(edges[taken], counts[taken], width=edges[taken] * (10 ** (1 / 16) - 1), align="edge")
        for field, words, colour in (("response_median", "median", "orange"), ("response_p99", "99 %", "pink"),
                                     ("response_p9999", "99.99 %", "green")):
            axes.axvline(
                last[field], color=COLOURS[colour], label=f"{words}: {quantity(float(last[field]), 's')}"
            )
        legend_above(axes)
    axes.set_xscale("log")
    axes.set_yscale("symlog", linthresh=1.0)  # the few late ones are what matters
    axes.xaxis.set_major_formatter(EngFormatter(unit="s"))
    axes.yaxis.set_major_formatter("{x:.0f}")
    axes.set_xlabel("response time")
    axes.set_ylabel("control periods")
    return figure
