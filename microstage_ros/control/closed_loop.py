"""The compiled loop of one run, and of many axes at once.

Row n of the trace is the state at the start of period n and the voltage held during it:

    read_sensors -> controller(reference[n], readings) -> + open_loop[n] + disturbance[n] -> record -> advance
"""

import numpy as np

from microstage_ros.axis.compiled import compiled
from microstage_ros.axis.linear_core import forget
from microstage_ros.axis.sensors import read_sensors
from microstage_ros.axis.step import advance, note_friction
from microstage_ros.control import laws

#: Columns of a trace, in order.
TRACE = (
    "encoder_m", "current_A", "motor_angle_rad", "interferometer_m", "voltage_V", "stage_m", "stage_velocity_m_s",
    "motor_speed_rad_s", "actuator_friction_Nm", "guideway_friction_N", "actuator_level", "guideway_level",
    "air_temperature_K", "air_pressure_Pa", "air_humidity", "stage_temperature_K",
)
#: Those of the surroundings, told only where they vary.
SURROUNDINGS = TRACE[-4:]


@compiled
def run_loop(plant, state, work, readings, parameters, memory, reference, open_loop, disturbance, trace):
    """Run one axis over all rows of ``reference`` [m]; fills ``trace`` (rows, len(TRACE))."""
    for n in range(len(reference)):
        read_sensors(plant, state, readings)
        voltage = laws.controller_step(parameters, memory, reference[n], readings.encoder, readings.current)
        voltage += open_loop[n] + disturbance[n]
        note_friction(plant, state)
        trace[n, 0] = readings.encoder
        trace[n, 1] = readings.current
        trace[n, 2] = readings.motor_angle
        trace[n, 3] = readings.interferometer
        trace[n, 4] = voltage
        trace[n, 5] = state.x
        trace[n, 6] = state.v
        trace[n, 7] = state.omega
        trace[n, 8] = state.torque_friction
        trace[n, 9] = state.guide_friction
        trace[n, 10] = state.actuator.factor
        trace[n, 11] = state.guideway.factor
        trace[n, 12] = readings.air_temperature
        trace[n, 13] = readings.air_pressure
        trace[n, 14] = readings.air_humidity
        trace[n, 15] = readings.stage_temperature
        advance(plant, state, work, voltage)


@compiled
def run_ensemble(plants, states, work, readings, parameters, memories, reference, positions, encoders, voltages):
    """Run many axes over the same ``reference``, one after the other.

    ``plants``, ``states``, ``readings``, ``parameters``, ``memories``: arrays of records, one per axis.
    ``positions``, ``encoders`` [m], ``voltages`` [V]: (axes, rows), true position, encoder, command.
    """
    for k in range(len(plants)):
        forget(work)
        for n in range(len(reference)):
            read_sensors(plants[k], states[k], readings[k])
            voltage = laws.controller_step(
                parameters[k], memories[k], reference[n], readings[k].encoder, readings[k].current
            )
            positions[k, n] = states[k].x
            encoders[k, n] = readings[k].encoder
            voltages[k, n] = voltage
            advance(plants[k], states[k], work, voltage)


def surroundings(trace):
    """Columns of air and stage {name: (rows,)}: all of the air's if one varies, the stage's if it does; else none."""
    air, stage = SURROUNDINGS[:3], SURROUNDINGS[3:]
    found = {}
    for group in (air, stage):
        columns = {name: trace[:, TRACE.index(name)].copy() for name in group}
        if any(np.ptp(column) > 0.0 for column in columns.values()):
            found |= columns
    return found
