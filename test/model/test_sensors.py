"""The current's sensor against its differential equations, and what an axis file may say of sensors."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from microstage_ros.model.sensors.current import current_filter, sensed_transient
from microstage_ros.model.sensors.readings import read_sensors
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state

SETTLING, PERIOD = 22e-6, 1e-4


@pytest.mark.parametrize("bandwidth", [0.0, 1e3, 15e3, 1.0 / (2 * math.pi * SETTLING)])
@pytest.mark.parametrize("skew", [0.0, 2e-6, 3e-5])
def test_filter_is_the_solution_of_its_differential_equations(bandwidth, skew):
    """di/dt = (a - i) R/L and ds/dt = (i - s)/S over a period, from any start."""
    start, filtered, end = 0.3, -0.2, 1.1
    corner = 2 * math.pi * bandwidth if bandwidth else 1e9
    found = solve_ivp(lambda t, y: [(end - y[0]) / SETTLING, (y[0] - y[1]) * corner], (0, PERIOD), [start, filtered if bandwidth else start],
                      method="LSODA", rtol=1e-10, atol=1e-13, dense_output=True).sol
    weights = current_filter(PERIOD - skew, PERIOD, SETTLING, bandwidth)
    assert sum(weights) == pytest.approx(1.0)
    assert np.dot(weights, [found(PERIOD)[0], start, filtered]) == pytest.approx(found(PERIOD - skew)[1], abs=5e-6)


def test_transient_without_a_filter_is_the_windings():
    assert sensed_transient(PERIOD, SETTLING, 0.0, 0.0) == pytest.approx(math.exp(-PERIOD / SETTLING))
    assert sensed_transient(PERIOD, SETTLING, 15e3, 2e-6) > sensed_transient(PERIOD, SETTLING, 0.0, 0.0)


def test_readings_are_offset_rounded_and_clipped(axis):
    plant, readings = make_plant(axis, NoiseSpec.none()), new_readings()
    state, count = new_state(plant), 5.0 / 2**15
    for current, expected in ((0.0, 1e-4), (0.5, 0.5001), (9.0, 2.5), (-9.0, -2.5)):
        state["current"] = state["current_before"] = state["filtered_current"] = current
        read_sensors(plant, state, readings)
        assert abs(readings["current"] - expected) <= 0.5 * count
        assert readings["current"] / count == pytest.approx(round(readings["current"] / count))


def test_interpolation_error_repeats_with_the_signal_period_and_adds_to_the_effect(axis):
    none = axis.with_values({"sensors.encoder.resolution": 0.0})
    plant, readings = make_plant(none, NoiseSpec.none(), {"encoder_sde": {"amplitude1_m": 1e-8}}), new_readings()
    state = new_state(plant)
    for x in np.linspace(0, 2e-5, 41):
        state["x"] = x
        read_sensors(plant, state, readings)
        phase = 2 * np.pi * x / 1e-5
        assert readings["encoder"] - x == pytest.approx(1.5e-8 * np.sin(phase) + 2.5e-9 * np.sin(2 * phase), abs=1e-15)


def test_interpolation_error_is_that_of_the_librarys_sine_to_the_last_bit_of_a_metre_and_below(axis):
    plant = make_plant(axis.with_values({"sensors.encoder.resolution": 0.0}), NoiseSpec.none())
    readings, state = new_readings(), new_state(plant)
    for x in np.random.default_rng(4).uniform(-2e-2, 2e-2, 300):
        state["x"] = x
        read_sensors(plant, state, readings)
        phase = 2 * np.pi * x / 1e-5
        expected = x + (5e-9 * np.sin(phase) + 2.5e-9 * np.sin(2 * phase))
        assert abs(readings["encoder"] - expected) <= 2.0 * np.spacing(abs(x))


def test_a_run_replaces_the_axis_files_noise(axis):
    own, given = make_plant(axis), make_plant(axis, NoiseSpec(current_A=0.0, encoder_m=1e-9))
    assert own["current_noise"] == axis.value("sensors.current.noise") and own["encoder_noise"] == 8e-9
    assert given["current_noise"] == 0.0 and given["encoder_noise"] == 1e-9 and given["amplifier_noise"] == 1e-3


@pytest.mark.parametrize("values, place", [
    ({"sensors.current.range": 0.0}, "sensors.current.range"), ({"sensors.current.skew": 2e-4}, "sensors.current.skew"),
    ({"sensors.encoder.interpolation_error": [1e-9, 1e-9, 1e-9]}, "interpolation_error"),
])
def test_what_no_sensor_can_be_is_refused(axis, values, place):
    with pytest.raises(InputError, match=place):
        make_plant(axis.with_values(values))
