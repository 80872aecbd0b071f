"""The encoder's error of interpolation: learned in fast motion, corrected at every speed."""

import math

import numpy as np
import pytest

from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.observer import interpolation
from microstage_ros.control.runs.closed_loop import run_loop
from microstage_ros.control.runs.run_file import Run
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.model.top_speed import top_speed
from microstage_ros.numerics.compiled import compiled
from microstage_ros.solver.plant import make_plant, new_readings, new_state, new_work, usual_start

LAW = "self_tuning_observer"
ERROR = "sensors.encoder.interpolation_error"
FAST = [{"move_to_m": place, "dwell_s": 0.1} for place in (1e-3, 0.0, 1e-3, 0.0)]
QUARTER = 2.5e-6  # m, where the first harmonic of a signal period of 10 um is largest


@compiled
def take(p, model, s, period, encoder, position, expected):
    """One reading, and an innovation of what is known of its error."""
    known = interpolation.interpolation_error(p, model, s, encoder)
    interpolation.learn_interpolation(p, model, s, period, position - known, expected)


def memory_after(axis, program, seed, machine=None, **gains):
    """Memory of the law's observer after a run of the ``machine``."""
    machine = machine or axis
    run = Run(controller={"type": LAW}, program=program)
    tables = run.tables(1e-4, top_speed(machine))
    plant, controller = make_plant(machine), make_controller(LAW, axis, **gains)
    state = new_state(plant, seed=seed, position=tables["start"], friction=usual_start(plant))
    run_loop(plant, state, new_work(plant), new_readings(), controller.parameters, controller.memory,
             tables["reference"], tables["open_loop"], tables["disturbance"], np.empty((0, 16)))
    return controller.memory["observer"]


def with_error(axis, amplitudes):
    return axis.with_values({ERROR: amplitudes}, source="derived")


def test_coefficients_of_readings_with_a_known_error(axis):
    """At constant speed, with white noise, as a least-squares fit of the same readings, prior included."""
    controller = make_controller(LAW, axis)
    p, model, s = controller.parameters["observer"], controller.parameters["feedforward"], controller.memory["observer"]
    truth = np.array([6e-9, -3e-9, 2e-9, 4e-9])
    places, noise = np.arange(2000) * 4.0e-7, 1e-8 * np.random.default_rng(3).normal(size=2000)
    phase = 2 * math.pi * places / 1e-5
    shape = np.column_stack([np.sin(phase), np.cos(phase), np.sin(2 * phase), np.cos(2 * phase)])
    readings = shape @ truth + noise
    s["v"] = 4.0e-3
    for place, reading in zip(places, readings):
        take(p, model, s, 1e-4, place, reading, 1e-16)
    passed = math.ceil(interpolation.FIRST_TURNS * 1e-5 / 4e-7) - 1
    together = interpolation.CORRELATED / 1e-4  # readings that count as one
    a, b = shape[passed:] / 1e-8 / math.sqrt(together), readings[passed:] / 1e-8 / math.sqrt(together)
    fitted = np.linalg.solve(a.T @ a + np.eye(4) / 1e-16, a.T @ b)
    np.testing.assert_allclose(s["interpolation"], fitted, atol=1.5e-10)
    spread = np.sqrt(np.diag(np.linalg.inv(a.T @ a + np.eye(4) / 1e-16)))
    np.testing.assert_allclose(np.sqrt(s["interpolation_variance"]), spread, rtol=0.1)


@pytest.mark.parametrize("speed", [7e-4, 2.1e-2], ids=["followed by the axis", "beyond half the sampling rate"])
def test_nothing_is_learned_at_speeds_that_do_not_tell(axis, speed):
    controller = make_controller(LAW, axis)
    p, model, s = controller.parameters["observer"], controller.parameters["feedforward"], controller.memory["observer"]
    s["v"] = speed
    for n in range(3000):
        take(p, model, s, 1e-4, n * 1e-4 * speed, 5e-9, 1e-16)
    assert not s["interpolation"].any()


def test_moves_of_one_signal_period_teach_nothing(axis):
    """What a start leaves in the innovation comes at the same place of the scale in every such move: 3 nm were learned of it."""
    short = [{"move_to_m": place, "dwell_s": 0.05} for place in 10 * (1e-5, 0.0)]
    assert not memory_after(axis, short, 1)["interpolation"].any()


@pytest.mark.parametrize("amplitudes", [[5e-9, 2.5e-9], [50e-9, 20e-9], [0.0, 0.0]], ids=["shipped", "ten times", "none"])
def test_the_machine_s_own_error_is_learned(axis, amplitudes):
    """Four moves of 1 mm: every coefficient within 2 nm, or 15 % of a large one."""
    for seed in range(3):
        found = memory_after(axis, FAST, seed, with_error(axis, amplitudes))["interpolation"]
        expected = [amplitudes[0], 0.0, amplitudes[1], 0.0]
        assert np.abs(found - expected).max() < max(2e-9, 0.15 * amplitudes[0])


def test_a_machine_that_is_heavier_does_not_feign_one(axis):
    heavy = axis.with_values({ERROR: [0.0, 0.0], "stage.mass": 3 * axis.value("stage.mass")}, source="derived")
    for seed in range(3):
        assert np.abs(memory_after(axis, FAST, seed, heavy)["interpolation"]).max() < 4e-9


def test_moves_end_at_their_true_targets(axis):
    """A quarter of a signal period off, where the error is largest: bias and spread over six seeds, without and with it."""
    program = [*FAST, *({"move_to_m": place, "dwell_s": 0.2} for place in (QUARTER, 0.0, QUARTER, 3 * QUARTER, QUARTER))]
    off = {}
    for spread in (0.0, 1e-8):
        gains = {"type": LAW, "interpolation_spread": spread}
        ends = []
        for seed in range(6):
            columns = simulate(with_error(axis, [2e-8, 0.0]), Run(controller=gains, program=program), seed)
            ends.append(np.mean((columns["stage_m"] - columns["reference_m"])[-500:]))
        off[spread] = np.mean(ends)
    assert off[0.0] == pytest.approx(-2e-8, abs=4e-9) and abs(off[1e-8]) < 4e-9


def test_an_encoder_without_signals_has_none(axis):
    controller = make_controller(LAW, axis, interpolation_spread=0.0)
    for n in range(500):
        controller.step(n * 4e-7, n * 4e-7, 0.0)
    assert not controller.memory["observer"]["interpolation"].any()
    assert controller.memory["observer"]["interpolated"] == 0.0
