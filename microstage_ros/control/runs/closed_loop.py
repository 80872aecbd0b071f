"""The compiled loop of one run.

Row n of the trace is the state at the start of period n and the voltage held during it:

    read_sensors -> controller(reference[n], readings) -> + open_loop[n] + disturbance[n] -> record -> advance
"""

import numpy as np

from microstage_ros.control.laws import registry as laws
from microstage_ros.model.sensors.readings import read_sensors, sense_plainly
from microstage_ros.numerics.compiled import compiled, internal
from microstage_ros.solver.event_free import write_state
from microstage_ros.solver.step import advance_in_registers, note_friction, read_state

#: Columns of a trace, in order.
TRACE = (
    "encoder_m", "current_A", "motor_angle_rad", "interferometer_m", "voltage_V", "stage_m", "stage_velocity_m_s",
    "motor_speed_rad_s", "actuator_friction_Nm", "guideway_friction_N", "actuator_level", "guideway_level",
    "air_temperature_K", "air_pressure_Pa", "air_humidity", "stage_temperature_K",
)
#: Those of the surroundings, given only where they vary.
SURROUNDINGS = TRACE[-4:]


@internal
def _record(plant, state, readings, voltage, row):
    """Fill one row of the trace."""
    note_friction(plant, state)
    row[0] = readings.encoder
    row[1] = readings.current
    row[2] = readings.motor_angle
    row[3] = readings.interferometer
    row[4] = voltage
    row[5] = state.x
    row[6] = state.v
    row[7] = state.omega
    row[8] = state.torque_friction
    row[9] = state.guide_friction
    row[10] = state.actuator.factor
    row[11] = state.guideway.factor
    row[12] = readings.air_temperature
    row[13] = readings.air_pressure
    row[14] = readings.air_humidity
    row[15] = readings.stage_temperature


@compiled
def run_loop(plant, state, work, readings, parameters, memory, reference, open_loop, disturbance, trace):
    """Run one axis over all rows of ``reference`` [m]; fills ``trace`` (rows, len(TRACE)), or no rows if it has
    none."""
    moving, held = read_state(plant, state, work)
    for n in range(len(reference)):
        if plant.sensing == 1:
            write_state(state, moving)
            read_sensors(plant, state, readings)
            encoder, current = readings.encoder, readings.current
        else:
            encoder, current = sense_plainly(plant, state, readings, moving.x, moving.current, moving.theta)
        voltage = laws.controller_step(parameters, memory, reference[n], encoder, current)
        voltage += open_loop[n] + disturbance[n]
        if n < len(trace):
            write_state(state, moving)
            _record(plant, state, readings, voltage, trace[n])
        moving, held = advance_in_registers(plant, state, work, moving, held, voltage)
    write_state(state, moving)


@compiled
def run_pieces(plants, states, works, readings, parameters, memories, reference, open_loop, disturbance, trace):
    """`run_loop` of the only record of each array (`solver.period.as_array`): for many calls of few periods each."""
    run_loop(
        plants[0],
        states[0],
        works[0],
        readings[0],
        parameters[0],
        memories[0],
        reference,
        open_loop,
        disturbance,
        trace,
    )


def surroundings(trace):
    """Columns of air and stage {name: (rows,)} of a ``trace``, shape (rows, columns of `TRACE`).

    All of the air's if one varies, the stage's if it does; else none.
    """
    air, stage = SURROUNDINGS[:3], SURROUNDINGS[3:]
    found = {}
    for group in (air, stage):
        columns = {name: trace[:, TRACE.index(name)].copy() for name in group}
        if any(np.ptp(column) > 0.0 for column in columns.values()):
            found |= columns
    return found
