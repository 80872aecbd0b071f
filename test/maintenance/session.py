"""Runs inside the patched copy: every new part simulated, commanded, recorded, plotted, diagnosed; prints what came of it as JSON."""

import json
import pathlib
import sys

import numpy as np

from microstage_ros.commands.analysis import laws
from microstage_ros.commands.analysis.simulate import main as simulate_command
from microstage_ros.control.runs.run_file import run_from_dict
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.diagnosis.case import diagnose_case
from microstage_ros.diagnosis.report.answer import write_answer
from microstage_ros.diagnosis.validation.fault_injection import one
from microstage_ros.diagnosis.validation.simulated_records import make_case
from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.protocol import Setup
from microstage_ros.model.axis_file import axis_from_dict, load_axis
from microstage_ros.model.effects import REGISTRY
from microstage_ros.model.friction.properties.table import EXPERIMENTS
from microstage_ros.model.friction.registry import law_named, run_law
from microstage_ros.records import read_record
from microstage_ros.report.plots import new_figure, plot_signal

WORK = pathlib.Path(sys.argv[1])
PAPER = load_axis("config/axis.yaml")


def leaf(value, unit):
    return {"value": value, "unit": unit, "source": "estimate"}


def through_the_command(axis, name, controller):
    """Simulated, commanded and recorded by ``microstage simulate``; read again, and its signals plotted."""
    axis.save(WORK / f"{name}.yaml")
    (WORK / "run.yaml").write_text(json.dumps({"controller": controller, "noise": {"friction_relative": 0.0},
                                               "program": [{"move_to_m": 2e-5, "dwell_s": 0.3}]}))
    simulate_command(["--axis", str(WORK / f"{name}.yaml"), "--run", str(WORK / "run.yaml"), "--out", str(WORK / f"{name}.csv")])
    record = read_record(WORK / f"{name}.csv")
    figure, axes = new_figure()
    plot_signal(np.ravel(axes)[0], record["t_s"], record["encoder_m"])
    figure.savefig(WORK / f"{name}.svg")
    return {"columns": list(record.columns), "end_m": float(record["encoder_m"][-1]), "plot": (WORK / f"{name}.svg").stat().st_size}


def friction_law():
    law = law_named("exponential")
    packed = law.pack({"stiffness": 50.0, "static": 1.0})
    way = np.linspace(0.0, 0.1, 101)
    force = run_law(law, packed, np.r_[0.0, np.full(100, 1.0)], 1e-3)
    tree = PAPER.as_dict()
    tree["contacts"]["guideway"] = {"law": "exponential", "stiffness": leaf(8.0e5, "N/m"), "static": leaf(0.9, "N"),
                                    "viscous": leaf(20.0, "N s/m")}
    found = EXPERIMENTS["pre-sliding hysteresis"]("exponential")
    return {
        # the first of the steps accelerates from rest: half a step of way
        "error": float(np.abs(force - (1.0 - np.exp(-50.0 * np.maximum(way - 0.0005, 0.0)))).max()),
        "hysteresis": found.shown, "in_table": laws.law_named("exponential").title,
        **through_the_command(axis_from_dict(tree, "axis"), "law", {"type": "self_tuning_observer"}),
    }


def effect():
    hidden = one("magnet_pull", np.random.default_rng(3))
    learn, hold, base = make_case(PAPER, hidden, 11, friction=0.02)
    diagnosis = diagnose_case(PAPER, learn, hold, base)
    report = write_answer(diagnosis, PAPER, WORK / "diagnosis", {})
    page = (WORK / "diagnosis" / "report.html").read_text()
    again = load_axis(WORK / "diagnosis" / "extended.yaml")
    return {"verdict": report["verdict"], "causes": [cause["id"] for cause in report["causes"]], "hidden": hidden.effects["magnet_pull"],
            "fitted": again.effects.get("magnet_pull"), "label_on_page": REGISTRY["magnet_pull"].label in page,
            "pictures": [picture.title for picture in diagnosis.pictures],
            **through_the_command(PAPER.with_effects(hidden.effects), "effect", {"type": "pid"})}


def actuator():
    tree = load_axis("config/emps.yaml").as_dict()
    tree["drive"] = {"type": "cylinder", "force_limit": leaf(300.0, "N"), "time": leaf(2.0e-3, "s")}
    tree["controller"] = {}
    axis = axis_from_dict(tree, "axis")
    return through_the_command(axis, "actuator", {"type": "pid"})


def sensor():
    tree = PAPER.as_dict()
    tree["sensors"]["encoder"] = {"type": "potentiometer", "turn": leaf(4.0e-7, "m"), "resolution": leaf(0.0, "m"), "noise": leaf(0.0, "m")}
    found = through_the_command(axis_from_dict(tree, "axis"), "sensor", {"type": "pid"})
    readings = read_record(WORK / "sensor.csv")["encoder_m"] / 4.0e-7
    return {**found, "off_a_turn": float(np.abs(readings - np.rint(readings)).max())}


def controller():
    return through_the_command(PAPER, "controller", {"type": "pd", "proportional": 2.0e5})


def backend():
    card = make_hardware("laboratory.card:Card", Setup(PAPER, seed=1, options={}))
    card.open()
    for _ in range(200):
        card.write(1.0e3 * (1.0e-5 - card.read().encoder))   # proportional, V/m: a shipped law would be compiled anew for this
    card.close()
    return {"moved_m": float(card.read().encoder)}


def simulated():
    """The unpatched parts still run."""
    columns = simulate(PAPER, run_from_dict({"controller": {"type": "none"}, "program": [{"move_to_m": 1e-6}]}, "run"), seed=1)
    return {"rows": len(columns["t_s"])}


if __name__ == "__main__":
    print(json.dumps({task.__name__: task() for task in (simulated, friction_law, controller, actuator, sensor, backend, effect)}))
