"""Benchmarks of the compiled step, each beside peers that solve the same equations in the same run."""

import math
import os
import resource
import subprocess
import sys
import tempfile
import time

import numpy as np

from microstage_ros.model.plant_record import PLANT, STATE
from microstage_ros.places import config_file
from microstage_ros.solver.benchmarks.compiled_peers import (
    dormand_prince,
    runge_kutta,
    solve_compiled,
    solve_with_sundials,
)
from microstage_ros.solver.benchmarks.peers import Equations, sizes, solve_with_runge_kutta, solve_with_scipy
from microstage_ros.solver.ensembles.ensemble import respond_batch
from microstage_ros.solver.open_loop import COLUMNS, respond, run_open_loop
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work

NANOSECONDS = 1e9
RIDES = {
    "pre-sliding sine": lambda t: 0.05 * np.sin(30 * t),
    "sliding": lambda t: 1.0 + 0.3 * np.sin(30 * t),
    "reversals through breakaway": lambda t: np.sin(30 * t),
}


def bench(axis, long=False):
    """All rows {name, value, unit, note?}, as a generator; ``long`` steps 10^9 periods for the memory."""
    yield from step_rows(axis)
    yield noisy_row(axis)
    yield ensemble_row(axis)
    yield ensemble_row(axis, noise=NoiseSpec())
    yield from peer_rows(axis)
    yield from start_rows()
    yield memory_row(axis, 1_000_000_000 if long else 2_000_000)


def best_of(action, repeats=25):
    """Shortest wall time of ``repeats`` [1] runs of ``action`` [s]: the least disturbed one on a shared machine."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def step_rows(axis, periods=100_000):
    """Time per control period [ns] of one axis without noise, one core, by kind of ride, over ``periods`` [1]."""
    plant = make_plant(axis, NoiseSpec.none())
    work, readings, nothing = new_work(plant), new_readings(), np.empty((0, len(COLUMNS)))
    t = np.arange(periods) * plant["period"]
    rows = []
    for name, ride in RIDES.items():
        voltage = ride(t)

        def run():
            run_open_loop(plant, new_state(plant), work, readings, voltage, nothing)

        run()
        rows.append({"name": f"step, {name}", "value": best_of(run) / periods * NANOSECONDS, "unit": "ns/period"})
    return rows


def noisy_row(axis, periods=100_000):
    """Time per period [ns] with all noise, random friction and sensors read, over ``periods`` [1]."""
    plant = make_plant(axis)
    work, readings, trace = new_work(plant), new_readings(), np.empty((periods, len(COLUMNS)))
    voltage = RIDES["sliding"](np.arange(periods) * plant["period"])
    run = lambda: run_open_loop(plant, new_state(plant), work, readings, voltage, trace)
    run()
    return {"name": "step with all noise, sensors read", "value": best_of(run) / periods * NANOSECONDS,
            "unit": "ns/period"}


def ensemble_row(axis, axes=1000, periods=2000, noise=None):
    """Time per axis and period [ns] of many axes of different parameters on all cores.

    ``axes``: their number [1]; ``periods`` [1]; ``noise``: `NoiseSpec`, None: none.
    """
    noise = noise or NoiseSpec.none()
    threads = os.cpu_count()
    plants, states, rested = np.zeros(axes, PLANT), np.zeros(axes, STATE), np.zeros(axes, STATE)
    for k in range(axes):
        factor = 1.0 + 0.2 * k / axes
        plants[k] = make_plant(axis.with_values({"drive.resistance": 3.41 * factor,
                                                 "contacts.actuator.static": 219e-6 * factor}), noise)
    voltage = RIDES["sliding"](np.arange(periods) * plants[0]["period"])

    def run():
        states[:] = rested
        respond_batch(plants, voltage, states, threads)

    rested[:] = new_state(plants[0])
    run()
    words = ", all noise" if noise.friction_relative is None else ""
    return {"name": f"ensemble of {axes} different axes, {threads} threads{words}",
            "value": best_of(run, 8) / periods / axes * NANOSECONDS,
            "unit": "ns/(axis period)"}


def peer_rows(axis, periods=100, repeats=5):
    """The same ride by this solver and by others: best time per period of as many repeats, distance from our answer.

    Every solver gets the same voltages, the same number of periods and of repeats after one run to warm up, so that
    compiling counts for none: ``periods`` [1], ``repeats`` [1]. A peer that is not installed has a row that says so.
    """
    plant = make_plant(axis, NoiseSpec.none())
    plant["quantum"] = 0.0
    equations = Equations(plant)
    voltage = 0.5 * np.sin(60 * np.arange(1, periods + 1) * plant["period"])
    ours = respond(plant, np.append(voltage, 0.0))["x"][1:]
    scale = sizes(equations)
    solvers = {
        "this solver": lambda: respond(plant, np.append(voltage, 0.0))["x"][1:],
        "peer: Dormand–Prince compiled with numba, rtol 1e-6": lambda: solve_compiled(equations, voltage,
                                                                                      dormand_prince, 1e-6, scale),
        "peer: Runge–Kutta 4 compiled with numba, 1 µs": lambda: solve_compiled(equations, voltage, runge_kutta, 100,
                                                                                scale),
        "peer: SUNDIALS CVODE (C), rtol 1e-6": lambda: solve_with_sundials(equations, voltage, 1e-6, scale),
        "peer: scipy LSODA, rtol 1e-5": lambda: solve_with_scipy(equations, voltage, "LSODA", 1e-5),
        "peer: scipy Radau, rtol 1e-6": lambda: solve_with_scipy(equations, voltage, "Radau", 1e-6),
        "peer: numpy Runge–Kutta 4, 1 µs": lambda: solve_with_runge_kutta(equations, voltage, 100),
        "peer: plain Python Runge–Kutta 4, 1 µs": lambda: solve_with_runge_kutta(equations, voltage, 100,
                                                                                 plain_python=True),
    }
    for name, solve in solvers.items():
        row = {"name": f"{periods} periods, {name}", "value": math.nan, "unit": "ns/period"}
        try:
            x = solve()
        except ImportError as missing:
            yield {**row, "note": f"not installed: {missing.name}"}
            continue
        value = best_of(solve, repeats) / periods * NANOSECONDS
        yield {**row, "value": value, "note": f"{np.max(np.abs(x - ours)) * 1e9:.3f} nm from ours"}


def memory_row(axis, periods=2_000_000):
    """Growth of the process's resident memory [byte] over ``periods`` [1], after the first have run."""
    plant = make_plant(axis)
    work, readings, nothing = new_work(plant), new_readings(), np.empty((0, len(COLUMNS)))
    state, voltage = new_state(plant), RIDES["sliding"](np.arange(100_000) * plant["period"])
    run_open_loop(plant, state, work, readings, voltage, nothing)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(periods // len(voltage)):
        run_open_loop(plant, state, work, readings, voltage, nothing)
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {"name": f"growth of memory over {periods:.0e} periods", "value": (after - before) * 1024.0, "unit": "byte"}


def start_rows():
    """First call in a new process: compiling from nothing, and with the cache filled."""
    program = (
        "import time; t = time.perf_counter()\n"
        "import sys; from microstage_ros.model.axis_file import load_axis\n"
        "from microstage_ros.solver.open_loop import respond\n"
        "from microstage_ros.solver.plant import make_plant\n"
        "respond(make_plant(load_axis(sys.argv[1])), [0.1] * 10); print(time.perf_counter() - t)"
    )
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name in ("first call, compiling", "first call, cached"):
            result = subprocess.run([sys.executable, "-c", program, str(config_file("axis.yaml"))], capture_output=True,
                                    text=True,
                                    check=True, env={**os.environ, "MICROSTAGE_CACHE": folder})
            rows.append({"name": name, "value": float(result.stdout), "unit": "s"})
    return rows
