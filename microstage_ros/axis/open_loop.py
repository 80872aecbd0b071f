"""The axis answering a given voltage: the compiled loop without a controller, for one axis or many."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from microstage_ros.axis.compiled import compiled
from microstage_ros.axis.linear_core import forget
from microstage_ros.axis.period import as_array
from microstage_ros.axis.plant import new_readings, new_state, new_work
from microstage_ros.axis.sensors import sense
from microstage_ros.axis.step import hold, note_friction

#: Columns of a trace, each as at the start of its period.
COLUMNS = ("x", "v", "theta", "omega", "current", "torque_friction", "guide_friction", "encoder", "read_current", "interferometer")


@compiled
def run_open_loop(plant, state, work, readings, voltage, trace):
    """Hold ``voltage[n]`` (V) over period n; fills ``trace`` (periods, len(COLUMNS)), or no rows if it has none."""
    for n in range(voltage.size):
        if n < len(trace):
            sense(plant, state, readings)
            note_friction(plant, state)
            trace[n, 0], trace[n, 1], trace[n, 2], trace[n, 3] = state.x, state.v, state.theta, state.omega
            trace[n, 4], trace[n, 5], trace[n, 6] = state.current, state.torque_friction, state.guide_friction
            trace[n, 7], trace[n, 8], trace[n, 9] = readings.encoder, readings.current, readings.interferometer
        hold(plant, state, work, voltage[n])


def respond(plant, voltage, seed=0, position=0.0, friction="virgin"):
    """Columns {name: (periods,)} of the axis's answer to a voltage (V, one per period), from rest."""
    voltage = np.ascontiguousarray(voltage, float)
    trace = np.empty((len(voltage), len(COLUMNS)))
    state = new_state(plant, seed, position, friction)
    run_open_loop(plant, state, new_work(plant), new_readings(), voltage, trace)
    return {name: trace[:, k] for k, name in enumerate(COLUMNS)}


@compiled
def _run_share(plants, states, works, voltage):
    """The axes of one thread, one after the other."""
    for k in range(len(plants)):
        forget(works[0])
        for n in range(voltage.size):
            hold(plants[k], states[k], works[0], voltage[n])


def respond_many(plants, voltage, states, threads=2):
    """Advance many axes (arrays of `PLANT` and `STATE` records, states changed in place) by the same voltage.

    ``threads``: the axes are shared out over this many threads; the result does not depend on it.
    """
    voltage = np.ascontiguousarray(voltage, float)
    works = [as_array(new_work(*plants)) for _ in range(threads)]
    shares = zip(np.array_split(plants, threads), np.array_split(states, threads), works)
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(lambda share: _run_share(*share, voltage), shares))
