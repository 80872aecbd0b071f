"""Position sensors against closed forms."""

import pathlib

import numpy as np
import pytest

from microstage_ros.model.axis_file import axis_from_dict, load_axis
from microstage_ros.model.sensors import POSITION_SENSORS
from microstage_ros.model.sensors.readings import read_sensors
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state

AXES = pathlib.Path(__file__).resolve().parents[2] / "config" / "axes"


def _machine(kind, **numbers):
    """The voice-coil axis with a position sensor of this kind, no rounding unless asked for."""
    tree = load_axis(AXES / "voice_coil.yaml").as_dict()
    units = {name: spec.unit for sensor in POSITION_SENSORS for name, spec in sensor.parameters.items()} | {"signal_period": "m"}
    tree["sensors"]["encoder"] = {"type": kind, **{
        name: {"value": value, "unit": units[name], "source": "estimate"} for name, value in numbers.items()}}
    return axis_from_dict(tree)


def _read(axis, positions, noise=None, effects=None):
    plant = make_plant(axis, noise or NoiseSpec.none(), effects)
    state, readings = new_state(plant), new_readings()
    found = []
    for n, x in enumerate(positions):
        state["x"], state["time"] = x, n * float(plant["period"])
        read_sensors(plant, state, readings)
        found.append(float(readings["encoder"]))
    return np.array(found)


X = np.linspace(-1e-5, 1e-5, 401)


def test_sine_cosine_without_errors_reads_the_position_over_many_periods():
    assert np.allclose(_read(_machine("sine_cosine", signal_period=4e-6), X), X, atol=1e-18)


@pytest.mark.parametrize(("numbers", "error"), [
    ({"offset_sine": 1e-3}, lambda phase: 1e-3 * np.cos(phase)),
    ({"offset_cosine": 1e-3}, lambda phase: -1e-3 * np.sin(phase)),
    ({"amplitude_error": 1e-3}, lambda phase: 0.5e-3 * np.sin(2 * phase)),
    ({"phase_error": 1e-3}, lambda phase: 0.5e-3 * (1 + np.cos(2 * phase))),
])
def test_interpolation_error_is_the_first_order_form(numbers, error):
    period = 4e-6
    found = _read(_machine("sine_cosine", signal_period=period, **numbers), X) - X
    assert np.allclose(found, period / (2 * np.pi) * error(2 * np.pi * X / period), atol=2e-6 * period / (2 * np.pi))
    assert np.ptp(found) > 0.9e-3 * period / (2 * np.pi)


def test_converters_of_the_signals_bound_the_error_and_noise_follows_their_amplitude():
    period = 4e-6
    found = _read(_machine("sine_cosine", signal_period=period, bits=8), X) - X
    step = 2.5 / 2**8
    assert 0.1 * step < np.max(np.abs(found)) * 2 * np.pi / period < 0.75 * step        # √2/2 of half a step each
    noisy = _read(_machine("sine_cosine", signal_period=period, signal_noise=1e-3), np.zeros(4000))
    assert np.std(noisy) == pytest.approx(1e-3 * period / (2 * np.pi), rel=0.05)


def test_lvdt_departs_from_its_line_by_the_nonlinearity_and_ends_at_its_range():
    axis = _machine("lvdt", range=1e-3, nonlinearity=2e-3)
    x = np.linspace(-1e-3, 1e-3, 2001)
    error = _read(axis, x) - x
    assert np.max(np.abs(error)) == pytest.approx(2e-6, rel=1e-5)
    assert np.allclose(error[[0, 1000, 2000]], 0.0, atol=1e-18)
    assert np.allclose(_read(axis, [2e-3, -2e-3]), [1e-3, -1e-3])


def test_lvdt_follows_a_ramp_with_its_time_constant_and_drifts():
    band, speed, t = 200.0, 1e-2, np.arange(300) * 1e-4
    tau = 1 / (2 * np.pi * band)
    found = _read(_machine("lvdt", range=1e-2, bandwidth=band, drift=1e-6), speed * t)
    assert np.allclose(found, speed * (t - tau * (1 - np.exp(-t / tau))) + 1e-6 * t, atol=1e-15)
    counted = _read(_machine("lvdt", range=1e-2, bits=10), [0.0, 3.3e-5])
    assert np.allclose(counted / (2e-2 / 1024), np.rint([0.0, 3.3e-5 / (2e-2 / 1024)]))


def test_capacitive_sensor_is_exact_without_stray_and_tilt_and_bent_with():
    gap, x = 5e-5, np.linspace(-2e-5, 2e-5, 101)
    assert np.allclose(_read(_machine("capacitive", gap=gap, range=3e-5), x), x, atol=1e-18)
    d, stray = gap - x, 0.05
    found = _read(_machine("capacitive", gap=gap, range=3e-5, stray=stray), x)
    assert np.allclose(found, gap - d * (1 + stray) / (1 + stray * d / gap), atol=1e-18)


def test_tilted_plates_are_the_mean_of_the_reciprocal_gap():
    """C of a disc over a plane at the angle α: the mean of 1/(d + α ϱ r cos φ) over it, by quadrature."""
    gap, tilt, radius = 5e-5, 2e-3, 4e-3
    r = np.sqrt((np.arange(400) + 0.5) / 400)
    angle = (np.arange(400) + 0.5) / 400 * 2 * np.pi
    x = np.array([-1e-5, 0.0, 1e-5])
    mean = np.array([np.mean(1 / (gap - z + tilt * radius * np.outer(r, np.cos(angle)))) for z in x])
    found = _read(_machine("capacitive", gap=gap, range=2e-5, tilt=tilt, radius=radius), x)
    assert np.allclose(found, gap - 1 / mean, atol=1e-6 * gap)


def test_effects_act_on_every_sensor():
    found = _read(_machine("sine_cosine", signal_period=4e-6), X, effects={"scale_error": {"relative": 1e-3}})
    assert np.allclose(found, 0.999 * X, atol=1e-15)


def test_plates_that_would_touch_and_unknown_sensors_are_refused():
    with pytest.raises(InputError, match="sensors.encoder.range.*touch"):
        make_plant(_machine("capacitive", gap=1e-5, range=2e-5), NoiseSpec.none())
    with pytest.raises(InputError, match="sensors.encoder.type: got 'sonar', expected one of incremental, sine_cosine"):
        _machine("sonar")
