"""The piezo stack on its flexure: statics, hysteresis and creep in closed form, resonance by the matrix exponential."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from microstage_ros.solver.open_loop import COLUMNS, respond, run_open_loop
from microstage_ros.solver.plant import new_readings, new_state, new_work

T, STACK, FLEXURE, PER_VOLT, MASS, DAMPING = 1e-4, 3e7, 3e6, 1.4e-7, 0.2, 100.0
GAIN = STACK * PER_VOLT / (STACK + FLEXURE)
RADII, WEIGHT = np.array([1.0, 3.0, 6.0, 12.0, 20.0, 30.0]), 0.03


def _slow(plant, turns, rows=20000):
    """Quasi-static answer [m] to straight lines between the turning points, and the voltages."""
    u = np.concatenate([np.linspace(a, b, rows) for a, b in zip(turns, turns[1:])])
    return u, respond(plant, u)["x"]


def first_loading(u):
    """y(u) from the relaxed state, one-sided: u + w Σ max(|u| − r, 0) sgn u."""
    return u + np.sign(u) * WEIGHT * np.maximum(np.abs(np.asarray(u))[..., None] - RADII, 0.0).sum(-1)


def test_step_is_amplifier_lag_and_resonance(bare):
    plant = bare("piezo", drive__hysteresis_radius=[], drive__hysteresis_weight=[], drive__creep_gain=[], drive__creep_time=[])
    pace = 2 * math.pi * 1000.0
    a = np.array([[-pace, 0, 0, pace], [STACK * PER_VOLT / MASS, -DAMPING / MASS, -(STACK + FLEXURE) / MASS, 0], [0, 1, 0, 0], [0, 0, 0, 0]])
    exact = [(expm(a * n * T) @ [0, 0, 0, 10.0])[2] for n in range(200)]
    found = respond(plant, np.full(200, 10.0))["x"]
    assert np.max(np.abs(found - exact)) < 1e-15
    assert exact[-1] == pytest.approx(10 * GAIN, rel=0.05)


def test_curve_of_first_loading_and_masing_branches(bare):
    plant = bare("piezo", drive__creep_gain=[], drive__creep_time=[])
    u, x = _slow(plant, [0, 40, -40, 40])
    rows = 20000
    way = slice(50, rows)
    assert np.max(np.abs(x[way] - GAIN * first_loading(u[way]))) < 2e-9
    back = slice(rows + 50, 2 * rows)                    # twice the curve of first loading, from the turning point
    masing = GAIN * (first_loading(40.0) - 2 * first_loading((40.0 - u[back]) / 2))
    assert np.max(np.abs(x[back] - masing)) < 4e-9
    assert x[-1] == pytest.approx(x[rows - 1], abs=1e-9)          # the loop closes


def test_inner_loops_are_forgotten(bare):
    """Wiping out: after a larger extreme the smaller loops before it leave no trace."""
    plant = bare("piezo", drive__creep_gain=[], drive__creep_time=[])
    _, plain = _slow(plant, [0, 40, 0], 5000)
    _, looped = _slow(plant, [0, 25, 10, 18, 12, 40, 0], 5000)
    assert plain[-1] == pytest.approx(looped[-1], abs=1e-12)


def test_creep_is_a_sum_of_exponentials(bare):
    plant = bare("piezo", drive__hysteresis_radius=[], drive__hysteresis_weight=[])
    found = respond(plant, np.full(30000, 10.0))["x"]
    t = np.arange(30000) * T
    creep = 0.008 * sum(1 - np.exp(-t / tau) for tau in (0.1, 1.0, 10.0))
    after = slice(1000, None)
    lag = 1 / (2 * math.pi * 1000.0) + DAMPING / (STACK + FLEXURE)          # of amplifier and flexure, in a ramp
    slope = 0.008 * sum(np.exp(-t / tau) / tau for tau in (0.1, 1.0, 10.0))
    exact = 10 * GAIN * (1 + creep - (lag + 0.5 * T - 0.5 * T) * slope)
    assert np.max(np.abs(found[after] - exact[after])) < 1e-6 * 10 * GAIN
    assert np.ptp(found[after]) > 0.01 * 10 * GAIN


def test_a_start_away_from_zero_is_a_start_at_rest(bare):
    plant = bare("piezo")
    state = new_state(plant, position=3e-6)
    held = float(state["current"])
    u = [v for v in np.linspace(0, 40, 4001) if abs(first_loading(v) * 1.024 - held) < 0.02]
    trace = np.empty((400, len(COLUMNS)))
    run_open_loop(plant, state, new_work(plant), new_readings(), np.full(400, u[len(u) // 2]), trace)
    assert np.ptp(trace[:, 0]) < 5e-9
