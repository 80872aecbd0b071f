"""What the sensors say at the start of a period (docs/reference/model.md, and `model.effects.sensing`).

Source of the index's slopes: B. Edlén, Metrologia 2 (1966) 71, to first order about 20 °C and 101 325 Pa.
"""

import math

import numpy as np

from microstage_ros.model.sensors import POSITION_SENSORS
from microstage_ros.numerics.compiled import (
    compiled,
    dispatch,
    inlined_before_typing,
    internal,
    not_inlined,
    always_inlined,
)
from microstage_ros.numerics.random import normal, uniform
from microstage_ros.numerics.turns import sine_and_cosine

AIR_TEMPERATURE, AIR_PRESSURE, AIR_HUMIDITY, STAGE_TEMPERATURE = 293.15, 101325.0, 0.5, 293.15
PER_KELVIN, PER_PASCAL = -0.93e-6, 2.7e-9      # first-order terms of the index of air


@compiled
def read_sensors(plant, state, readings):
    """Fill ``readings`` (record `READINGS`): positions in m, current in A, angle in rad, K, Pa, 0…1."""
    sense(plant, state, readings)


@always_inlined
def sense(plant, state, readings):
    """`read_sensors`, for the few loops that run many periods."""
    if plant.sensing == 1:
        readings.motor_angle = state.theta
        _disturbed_sensors(plant, state, readings)
    else:
        sense_plainly(plant, state, readings, state.x, state.current, state.theta)


@inlined_before_typing
def sense_plainly(plant, state, readings, x, current, theta):
    """`read_sensors` where no effect acts on them, of an axis at this position, current and motor angle.

    Returns encoder and current.
    """
    encoder = _counted(plant, state, interpolated(plant, x, x))
    current = sensed_current(plant, state, current)
    interferometer = x
    if plant.interferometer_noise > 0.0:
        interferometer += plant.interferometer_noise * normal(state.random)
    state.last_encoder = readings.encoder = encoder
    state.last_current = readings.current = current
    readings.interferometer, readings.motor_angle = interferometer, theta
    readings.air_temperature, readings.air_pressure, readings.air_humidity = AIR_TEMPERATURE, AIR_PRESSURE, AIR_HUMIDITY
    readings.stage_temperature = STAGE_TEMPERATURE
    return encoder, current


_read = dispatch("read_position", [sensor.read for sensor in POSITION_SENSORS], "plant, state, y", "y")


@internal
def sensed_position(plant, state, y):
    """Reading [m] of a position sensor that is no incremental encoder, at position ``y`` [m]; its noise included."""
    not_inlined()
    return _read(plant.position_sensor, plant, state, y)


@inlined_before_typing
def _counted(plant, state, y):
    """Position y [m] with the sensor's noise, in whole counts."""
    if plant.position_sensor > 0:
        y = sensed_position(plant, state, y)
    elif plant.encoder_noise > 0.0:
        y += plant.encoder_noise * normal(state.random)
    if plant.encoder_count > 0.0:
        y = plant.encoder_count * np.rint(y * plant.per_count)
    return y


@inlined_before_typing
def interpolated(plant, x, y):
    """Reading y [m] at the place x [m] of the scale, with the encoder's own error of interpolation."""
    if plant.interpolates == 1:
        sine, cosine = sine_and_cosine(plant.signals_per_metre * x)
        y += sine * (plant.interpolation[0] + 2.0 * plant.interpolation[1] * cosine)
    return y


@inlined_before_typing
def sensed_current(plant, state, current):
    """Reading [A] of the current's sensor: first-order filter, sampled before the encoder, offset, noise, converter.

    The filter is followed in closed form for a current that approaches a held voltage's with L/R
    (`solver.plant.current_filter`).
    """
    if plant.senses_current == 1:
        now, before, filtered = current, state.current_before, state.filtered_current
        c, f = plant.current_sample, plant.current_filter
        current = c[0] * now + c[1] * before + c[2] * filtered + plant.current_offset
        state.filtered_current = f[0] * now + f[1] * before + f[2] * filtered
        state.current_before = now
    if plant.current_noise > 0.0:
        current += plant.current_noise * normal(state.random)
    if plant.current_quantum > 0.0:
        current = plant.current_quantum * np.rint(current * plant.per_current_quantum)
    if plant.current_range > 0.0:
        current = min(max(current, -plant.current_range), plant.current_range)
    return current


@internal
def _disturbed_sensors(plant, state, readings):
    """`read_sensors` with all that effects do to it."""
    not_inlined()
    t = state.time
    shake = _vibration(plant, t)
    readings.encoder, readings.current = _encoder_and_current(plant, state, shake)
    _surroundings(plant, t, readings)
    readings.interferometer = (
        state.x + shake + _drift(plant, t, readings) + plant.interferometer_noise * normal(state.random)
    )


@internal
def _encoder_and_current(plant, state, shake):
    late, lost = plant.late, False
    if plant.jitter > 0.0:
        late += abs(plant.jitter * normal(state.random))
    if plant.lost > 0.0:
        lost = uniform(state.random) < plant.lost and state.periods > 0
    if not lost:
        x = state.x + state.v * late + shake
        y = x * (1.0 + plant.scale)
        for n in range(3):
            if plant.sde_amplitude[n] != 0.0:
                y += plant.sde_amplitude[n] * math.sin((n + 1) * plant.sde_number * x + plant.sde_phase[n])
        state.last_encoder = _counted(plant, state, interpolated(plant, x, y))
        state.last_current = sensed_current(plant, state, state.current)
    return state.last_encoder, state.last_current


@internal
def _vibration(plant, t):
    shake = 0.0
    for k in range(plant.lines):
        shake += plant.line_amplitude[k] * math.sin(2.0 * math.pi * plant.line_frequency[k] * t + plant.line_phase[k])
    return shake


@internal
def _surroundings(plant, t, readings):
    not_inlined()
    swing = math.sin(2.0 * math.pi * t / plant.air_swing_time)
    readings.air_temperature = AIR_TEMPERATURE + plant.air_temperature_rate * t + plant.air_temperature_swing * swing
    readings.air_pressure = AIR_PRESSURE + plant.air_pressure_rate * t + plant.air_pressure_swing * swing
    readings.air_humidity = AIR_HUMIDITY
    rise = plant.stage_temperature_rise
    readings.stage_temperature = STAGE_TEMPERATURE
    if rise != 0.0:
        readings.stage_temperature += rise * (1.0 - math.exp(-t / plant.stage_temperature_time))


@internal
def _drift(plant, t, readings):
    """Interferometer − x: expansion of parts and, if the air is not compensated, its index [m]."""
    not_inlined()
    drift = plant.drift_rate * t + plant.drift_expansion * (readings.stage_temperature - STAGE_TEMPERATURE)
    if plant.drift_amplitude != 0.0:
        drift += plant.drift_amplitude * (1.0 - math.exp(-t / plant.drift_time))
    if plant.air_compensated == 0:
        index = PER_KELVIN * (readings.air_temperature - AIR_TEMPERATURE) + PER_PASCAL * (readings.air_pressure
                                                                                          - AIR_PRESSURE)
        drift += index * plant.air_path
    return drift
