"""The paper's section 4 on the simulated benches: Fig. 5, Fig. 7 and Tables 1 to 3 beside the paper.

    python -m microstage_ros.identification.reproduction --out DIR [--repeats 50] [--seed 1]

simulates the experiments with noise and random friction, identifies, and writes DIR/report.html,
DIR/axis.yaml (the whole axis with what was found) and DIR/figures.json.
"""

import argparse
import dataclasses
import json
import pathlib

import numpy as np

from microstage_ros.identification import experiments
from microstage_ros.identification.estimators.stribeck import NAMES, stribeck_curve
from microstage_ros.identification.estimators.virgin_curve import Blocks
from microstage_ros.identification.page import identification_page
from microstage_ros.identification.pipeline import identify
from microstage_ros.identification.signals import motor_signals
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.transmission import screw_ratio
from microstage_ros.places import config_file, share
from microstage_ros.report.plots import COLOURS, new_figure

PLACES = 2.0e-3  # repeats begin so far apart along the stroke [m]


def actuator_repeats(axis, count, seed):
    """All records of the actuator's bench: slow reversals, constant speeds and accelerations at ``count`` places.

    ``count`` and ``seed`` [1]. Accelerations come first, so that they are among the records that are kept whole.
    """
    ratio, places = screw_ratio(axis), [k * PLACES for k in range(count)]
    accelerations = [experiments.accelerations(ratio, place) for place in places[:4]]
    speeds = [experiments.constant_speeds(ratio, place) for place in places]
    slow = [experiments.slow_reversals(ratio, place) for place in places]
    for offset, runs in ((0, accelerations), (1000, speeds), (2000, slow)):
        yield from experiments.repeats(axis, runs, seed + offset)


def guideway_repeats(axis, count, seed):
    """Records of incremental loading, ``count`` [1], each with its own friction; ``seed`` of the first [1]."""
    yield from experiments.repeats(axis, [experiments.incremental_loading(axis.value("period"))] * count, seed)


def ramp_figure(axis, seed, count=10):
    """Fig. 5a as the paper measured it: voltage ramps up and down; torque against the output's angle.

    ``count`` ramps [1] each way; ``seed`` of the first [1].
    """
    figure, axes = new_figure(1, 1, height=3.0)
    ratio = screw_ratio(axis)
    for sign in (1.0, -1.0):
        runs = [experiments.voltage_ramp(axis.value("period"), 0.015 * sign)] * count
        for record in experiments.repeats(axis, runs, seed):
            signals = motor_signals(record, axis)
            torque = np.convolve(signals.torque, np.ones(200) / 200.0, "same")[100:-100:20]
            angle = record["encoder_m"][100:-100:20] / ratio
            end = np.argmax(np.abs(angle) > 8e-3) or len(angle)
            axes.plot(angle[:end] * 1e3, torque[:end] * 1e6, linewidth=0.7, color=COLOURS["sky"])
    blocks = Blocks.of(axis, "actuator")
    grid = np.linspace(0.0, 8e-3, 400)
    for sign in (1.0, -1.0):
        axes.plot(sign * grid * 1e3, sign * blocks.curve(grid) * 1e6, color=COLOURS["black"], linewidth=0.8)
    axes.set(
        xlabel="angle of the output [mrad]",
        ylabel="k_M I [µN m]",
        title="Fig. 5a: voltage ramps (blue), virgin curve of Table 1 (black)",
    )
    return figure


def comparison(result, bench, guideway):
    """Rows (parameter, unit, paper = simulated truth, identified, 95 %, deviation) of Tables 1 to 3, and the
    figures."""
    rows, figures = [], {}
    for contact, axis, unit in (("actuator", bench, "N m/rad"), ("guideway", guideway, "N/m")):
        for name in ("stiffness", "weight"):
            truth = np.asarray(axis.value(f"contacts.{contact}.{name}"), float)
            truth = truth / truth.sum() if name == "weight" else truth
            found = result.estimates[f"contacts.{contact}.{name}"]
            for j, value in enumerate(found.value):
                paper = truth[j] if len(truth) == len(found.value) else None
                rows.append(
                    (
                        f"{contact} {name} {j + 1}",
                        unit if name == "stiffness" else "1",
                        paper,
                        value,
                        f"{found.low[j]:.4g} … {found.high[j]:.4g}",
                        None if paper is None else f"{value / paper - 1:+.1%}",
                    )
                )
        static = result.estimates[f"contacts.{contact}.static"].value
        paper_blocks = Blocks.of(axis, contact)
        own_blocks = dataclasses.replace(Blocks.of(result.to_axis(axis), contact), static=static)
        grid = np.geomspace(0.1 * paper_blocks.slip_displacement[0], paper_blocks.slip_displacement[-1], 200)
        figures[f"{contact} pre-sliding curve, rms"] = float(
            np.sqrt(np.mean((own_blocks.curve(grid) / paper_blocks.curve(grid) - 1.0) ** 2))
        )
    values = []
    for name in NAMES:
        key = f"contacts.actuator.{name}"
        e, truth = result.estimates[key], bench.value(key)
        values.append((e.value, truth))
        figures[name] = e.value / truth - 1.0
        rows.append(
            (f"actuator {name}", e.unit, truth, e.value, f"{e.low:.4g} … {e.high:.4g}", f"{e.value / truth - 1:+.1%}")
        )
    speeds = np.geomspace(0.03, 16.0, 100)
    found, truth = (stribeck_curve(v, speeds) for v in zip(*values))
    figures["Stribeck curve, rms"] = float(np.sqrt(np.mean((found / truth - 1.0) ** 2)))
    return rows, figures


def main(argv=None):
    """Run the reproduction."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", required=True, metavar="DIR")
    parser.add_argument("--repeats", type=int, default=50, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    arguments = parser.parse_args(argv)
    out = pathlib.Path(arguments.out)
    out.mkdir(parents=True, exist_ok=True)
    bench, guideway = (
        load_axis(share() / "config" / "experiments" / f"{name}_bench.yaml") for name in ("actuator", "guideway")
    )
    result = identify(actuator_repeats(bench, arguments.repeats, arguments.seed), bench, arguments.seed, blocks=6)
    loading = identify(
        guideway_repeats(guideway, arguments.repeats, arguments.seed), guideway, arguments.seed, blocks=6
    )
    loading.estimates.pop("variability.relative", None)  # the actuator's series tells more
    result.merge(loading)
    rows, figures = comparison(result, bench, guideway)
    page = identification_page(
        result,
        load_axis(config_file("axis.yaml")),
        [f"{arguments.repeats} simulated repeats of each experiment"],
        arguments.seed,
    )
    page.section("Tables 1 to 3 beside the paper")
    page.table(["parameter", "unit", "paper (and the simulator)", "identified", "95 %", "deviation"], rows)
    page.figure(
        ramp_figure(bench, arguments.seed),
        "Simulated voltage ramps: they break away before the last blocks slip",
        "Fig. 5a",
    )
    page.save(out / "report.html")
    result.to_axis(load_axis(config_file("axis.yaml"))).save(out / "axis.yaml")
    (out / "figures.json").write_text(
        json.dumps({"repeats": arguments.repeats, "seed": arguments.seed, **figures}, indent=1) + "\n"
    )
    for row in rows:
        print(*(f"{v:.5g}" if isinstance(v, float) else v for v in row), sep="  ")
    print(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
