"""Benchmark of the closed loop: sensors, controller and step per control period."""

import time

import numpy as np

from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.runs.closed_loop import TRACE, run_loop
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work

NANOSECONDS = 1e9
KINDS = ("pid", "self_tuning", "self_tuning_feedforward", "self_tuning_observer")


def bench(axis, periods=100_000, passes=40):
    """Rows {name, value, unit}: a 10 µm sine of 1 Hz under each controller, with and without noise; the PID also with
    its trace kept.

    ``periods`` of a run, and ``passes`` over all rows [1].
    The shortest of several runs of each row, row after row in turn: a shared machine is loud for seconds, which then
    spoils a pass of all rows and not all runs of one.
    """
    t = np.arange(periods) * axis.value("period")
    reference, nothing = 1e-5 * np.sin(2 * np.pi * t), np.zeros(periods)
    recorded, unrecorded = np.zeros((periods, len(TRACE))), np.zeros((0, len(TRACE)))
    runs, best = {}, {}
    for noise, words in ((NoiseSpec.none(), "no noise"), (NoiseSpec(), "all noise")):
        plant = make_plant(axis, noise)
        for kind in KINDS:
            for trace, what in ((unrecorded, ""), (recorded, ", recorded"))[: 2 if kind == "pid" else 1]:
                runs[f"loop, {kind}, {words}{what}"] = (axis, plant, kind, reference, nothing, trace)
    for _ in range(passes):
        for name, run in runs.items():
            best[name] = min(best.get(name, np.inf), _once(*run))
    for name, spent in best.items():
        yield {"name": name, "value": spent / periods * NANOSECONDS, "unit": "ns/period"}


def _once(axis, plant, kind, reference, nothing, trace):
    controller = make_controller(kind, axis)
    state, work, readings = new_state(plant, 1), new_work(plant), new_readings()
    start = time.perf_counter()
    run_loop(plant, state, work, readings, controller.parameters, controller.memory, reference, nothing, nothing, trace)
    return time.perf_counter() - start
