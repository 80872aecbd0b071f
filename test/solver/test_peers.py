"""The benchmarks' peers solve the same equations: compiled ones agree with scipy and with the compiled step."""

import importlib.util

import numpy as np
import pytest

from microstage_ros.solver.benchmarks.compiled_peers import (
    dormand_prince,
    packed,
    rates,
    runge_kutta,
    solve_compiled,
    solve_with_sundials,
)
from microstage_ros.solver.benchmarks.peers import Equations, sizes
from microstage_ros.solver.open_loop import respond

PERIODS = 40


@pytest.fixture
def ride(quiet):
    plant = quiet()
    voltage = 0.5 * np.sin(300.0 * np.arange(1, PERIODS + 1) * plant["period"])
    return Equations(plant), voltage, respond(plant, np.append(voltage, 0.0))["x"][1:]


def test_compiled_right_hand_side_is_the_written_out_one(ride):
    equations, generator = ride[0], np.random.default_rng(5)
    numbers, blocks = packed(equations)
    for _ in range(20):
        z = generator.normal(0.0, 1.0, equations.size) * 3.0 * sizes(equations) * 1e3
        out = np.empty_like(z)
        rates(z, 0.7, numbers, blocks, out)
        assert np.allclose(out, equations.rates(z, 0.7), rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("method, accuracy, within", [(runge_kutta, 100, 0.05e-9), (dormand_prince, 1e-6, 0.05e-9)])
def test_compiled_peers_reach_our_answer(ride, method, accuracy, within):
    equations, voltage, ours = ride
    x = solve_compiled(equations, voltage, method, accuracy, sizes(equations))
    assert np.abs(ours).max() > 10 * within and np.abs(x - ours).max() < within


@pytest.mark.skipif(not importlib.util.find_spec("sksundae"), reason="scikit-sundae is not installed")
def test_sundials_reaches_our_answer(ride):
    equations, voltage, ours = ride
    assert np.abs(solve_with_sundials(equations, voltage, 1e-6, sizes(equations)) - ours).max() < 0.05e-9
