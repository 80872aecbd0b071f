"""The axis answering a given voltage: the compiled loop without a controller (many axes at once: `side_by_side`)."""

import numpy as np

from microstage_ros.model.sensors.readings import sense
from microstage_ros.numerics.compiled import compiled
from microstage_ros.solver.event_free import write_state
from microstage_ros.solver.plant import new_readings, new_state, new_work
from microstage_ros.solver.step import advance_in_registers, note_friction, read_state

#: Columns of a trace, each as at the start of its period.
COLUMNS = ("x", "v", "theta", "omega", "current", "torque_friction", "guide_friction", "encoder", "read_current",
           "interferometer")


@compiled
def run_open_loop(plant, state, work, readings, voltage, trace):
    """Hold ``voltage[n]`` (V) over period n; fills ``trace`` (periods, len(COLUMNS)), or no rows if it has none."""
    moving, held = read_state(plant, state, work)
    for n in range(voltage.size):
        if n < len(trace):
            write_state(state, moving)
            sense(plant, state, readings)
            note_friction(plant, state)
            trace[n, 0], trace[n, 1], trace[n, 2], trace[n, 3] = state.x, state.v, state.theta, state.omega
            trace[n, 4], trace[n, 5], trace[n, 6] = state.current, state.torque_friction, state.guide_friction
            trace[n, 7], trace[n, 8], trace[n, 9] = readings.encoder, readings.current, readings.interferometer
        moving, held = advance_in_registers(plant, state, work, moving, held, voltage[n])
    write_state(state, moving)


def respond(plant, voltage, seed=0, position=0.0, friction="virgin"):
    """Columns {name: (periods,)} of the axis's answer to a voltage, from rest; names as in `COLUMNS`, SI.

    ``voltage`` (periods,) [V], each held for a period; ``seed`` of the noise and ``position`` [m] at the start;
    ``friction`` as for `plant.new_state`.
    """
    voltage = np.ascontiguousarray(voltage, float)
    trace = np.empty((len(voltage), len(COLUMNS)))
    state = new_state(plant, seed, position, friction)
    run_open_loop(plant, state, new_work(plant), new_readings(), voltage, trace)
    return {name: trace[:, k] for k, name in enumerate(COLUMNS)}
