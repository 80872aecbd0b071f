"""Measured responses and margins against the linear loop they are of; gains shaped on them."""

import math

import control
import numpy as np
import pytest

from microstage_ros.commissioning.design import loop_shaping
from microstage_ros.commissioning.experiments import measured_loop
from microstage_ros.commissioning.experiments.closed_loop import Loop
from microstage_ros.commissioning.estimation.frequency_response import Response, measured_margins, multi_sine, responses, write_responses
from microstage_ros.commissioning.experiments.machine import Machine
from microstage_ros.commissioning.experiments.open_loop import Strokes
from microstage_ros.commissioning.estimation.plant_fit import fit_plant, held_response, resonance_of
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.tuning.margins import controller_margins, loop_margins, loop_of, pid_transfer, regimes
from microstage_ros.control.tuning.tuning import GUARDED
from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.protocol import Setup
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError

AXIS = load_axis(config_file("axis.yaml"))
PERIOD = AXIS.value("period")


def test_a_linear_plant_in_closed_loop_with_noise():
    """A known discrete plant under feedback with noise: plant and loop come back within their bands."""
    plant = control.c2d(control.tf([50.0], [1.0, 20.0, 0.0]), 1e-3)
    numerator, denominator = plant.num[0][0], plant.den[0][0]
    made = multi_sine(1e-3, 2.0, 300.0, lambda f: 1.0, 1)
    rng, x, y, u = np.random.default_rng(2), np.zeros(3), [0.0, 0.0], [0.0, 0.0]
    rows = made.rows * 40
    extra = made.times(40)
    encoder, voltage = np.zeros(rows + 1), np.zeros(rows + 1)
    for n in range(rows + 1):
        position = -denominator[1] * y[-1] - denominator[2] * y[-2] + numerator[-2] * u[-1] + numerator[-1] * u[-2]
        read = position + 1e-4 * rng.standard_normal()
        volts = -8.0 * read + (extra[n] if n < rows else 0.0)
        encoder[n], voltage[n] = read, volts
        y, u = [y[-1], position], [u[-1], volts]
    del x
    disturbance = np.append(extra, 0.0)
    first = 10 * made.rows
    found, loop = responses([(encoder[first:], voltage[first:], disturbance[first:])], made, 1e-3, "linear")
    truth = plant(np.exp(2j * np.pi * found.frequency * 1e-3))
    kept = found.coherence > 0.9
    assert kept.sum() > 15
    off = np.abs(found.value / truth - 1.0)[kept]
    assert np.mean(off < 3.0 * np.maximum(found.relative[kept], 1e-4)) > 0.9
    assert np.abs(loop.value / (8.0 * truth) - 1.0)[kept].max() < 0.1


@pytest.mark.parametrize("law, gains", [("self_tuning_feedforward", {}), ("self_tuning_observer", {"voltage_noise": 9.2e-3})])
def test_the_margins_of_a_loop_in_motion(law, gains):
    """Measured in motion under a law that learns: within 3 degrees and 1 dB of the linearised loop of its gains."""
    axis = AXIS.with_controller({"type": "self_tuning"})
    backend = make_hardware("simulated", Setup(axis, 1, {}))
    backend.open()
    machine = Machine(backend, axis)
    machine.begin()
    loop = Loop(machine, axis, law, 0.07, gains)
    found = Strokes(3.41, 394.0, 3.1, 0.07, 0.0, 0.0, True, 0.01)
    _, measured = measured_loop.loop_in_motion(loop, found, 1, lambda name, record: None)
    margins = measured_margins(measured)
    truth = next(m for m in controller_margins(axis, controller_parameters(law, axis, gains)) if m.regime == GUARDED[1])
    assert margins.phase_deg == pytest.approx(truth.phase_deg, abs=3.0) and margins.phase_error_deg < 1.5
    assert margins.gain_dB == pytest.approx(truth.gain_db, abs=1.0) and margins.gain_error_dB < 0.5


def modelled(noise=0.0, seed=1, **values):
    """A plant response as the model has it, with relative noise."""
    frequency = np.geomspace(5.0, 1000.0, 45)
    value = held_response(AXIS, values, frequency, PERIOD, 1e-7, 2e-5)
    rng = np.random.default_rng(seed)
    value = value * (1.0 + noise * (rng.standard_normal(45) + 1j * rng.standard_normal(45)))
    return Response("plant", "sliding", frequency, value, np.full(45, 0.99), np.full(45, 1e-8), np.full(45, max(noise, 1e-4)))


def test_the_drive_train_is_fitted():
    truth = {"transmission.stiffness": 3e6, "transmission.damping": 400.0, "drive.rotor_inertia": 1.7e-7, "drive.back_emf": 8e-3}
    fit = fit_plant(AXIS, modelled(0.01, **truth), PERIOD, 1e-7)
    assert fit.resonance == pytest.approx(resonance_of(AXIS, truth), rel=0.01) and fit.delay == pytest.approx(2e-5, abs=2e-5)
    for key, value in truth.items():
        assert fit.values[key] == pytest.approx(value, rel=0.05), key


def test_shaped_gains_keep_their_margins(tmp_path):
    response = modelled(0.003)
    write_responses([response], tmp_path / "response.csv")
    read = loop_shaping.read_response(tmp_path / "response.csv")
    assert np.allclose(np.abs(read.value), np.abs(response.value), rtol=1e-6)
    parameters = controller_parameters("pid", AXIS, {})["pid"]
    gains = {name: float(parameters[name]) for name in parameters.dtype.names}
    found = loop_shaping.shape(read, gains, PERIOD)
    assert loop_shaping.enough(found.margins, read)
    truth = loop_margins(loop_of(regimes(AXIS)[2][1], pid_transfer(found.gains, PERIOD), PERIOD), PERIOD, "")
    assert truth.stable and truth.gain_db > 5.0
    frequency, damping = loop_shaping.resonance_in(read)
    assert frequency == pytest.approx(resonance_of(AXIS), rel=0.08) and 0.02 < damping < 0.15
    shaper = loop_shaping.zero_vibration(frequency, damping)
    assert sum(share for _, share in shaper) == pytest.approx(1.0)
    names = [name for name, _, _ in loop_shaping.exported(found.gains, AXIS)]
    assert len(names) == 4


def test_an_unstable_measured_loop_has_a_negative_gain_margin():
    frequency = np.geomspace(1.0, 1000.0, 80)
    s = 2j * math.pi * frequency
    for gain in (50.0, 1000.0):  # 1/(s (s/100 + 1)²) is at its limit with a gain of 200
        value = gain / (s * (s / 100.0 + 1.0) ** 2)
        loop = Response("loop", "", frequency, value, np.ones(80), np.zeros(80), np.zeros(80))
        assert measured_margins(loop).gain_dB == pytest.approx(20.0 * math.log10(200.0 / gain), abs=0.1)


@pytest.mark.parametrize("text, words", [("a,b\n1,2\n", "columns frequency_Hz"), ("frequency_Hz,magnitude,phase_deg\n1,2,3\n", "at least 8"),
                                         ("frequency_Hz,magnitude,phase_deg\n1,x,3\n", "row 1")])
def test_a_bad_file_is_one_line(tmp_path, text, words):
    (tmp_path / "response.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        loop_shaping.read_response(tmp_path / "response.csv")
