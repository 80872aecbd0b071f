"""The voice coil against the matrix exponential and an independent integration."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from microstage_ros.model.axis_file import load_axis
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.open_loop import respond
from microstage_ros.solver.plant import NoiseSpec, make_plant

from .conftest import AXES

T, R, L, K, M, C = 1e-4, 2.5, 1e-3, 12.0, 0.5, 4.0


def test_constant_force_constant_is_the_matrix_exponential(bare):
    plant = bare("voice_coil", drive__force_constant_curvature=0.0)
    u = np.repeat(np.random.default_rng(0).uniform(-5, 5, 40), 10)
    a = np.array([[-R / L, -K / L, 0], [K / M, -C / M, 0], [0, 1, 0]])
    whole = expm(np.block([[a, np.array([[1 / L], [0], [0]])], [np.zeros((1, 4))]]) * T)
    z, x, i = np.zeros(3), [], []
    for command in u:
        i.append(z[0])
        x.append(z[2])
        z = whole[:3, :3] @ z + whole[:3, 3] * command
    found = respond(plant, u)
    assert np.max(np.abs(found["x"] - x)) < 1e-12
    assert np.max(np.abs(found["current"] - i)) < 1e-9


def test_position_dependent_force_constant_against_an_independent_integration(bare):
    plant = bare("voice_coil", drive__force_constant_curvature=-4000.0, drive__force_constant_slope=20.0)
    t = np.arange(1500) * T
    u = 4.0 * np.cos(2 * np.pi * 6 * t)

    def rates(_, z, command):
        i, v, x = z
        k = K * (1 + 20.0 * x - 4000.0 * x * x)
        return [(command - R * i - k * v) / L, (k * i - C * v) / M, v]

    z, x = np.zeros(3), []
    for command in u:
        x.append(z[2])
        z = solve_ivp(rates, (0, T), z, args=(command,), rtol=1e-9, atol=1e-13).y[:, -1]
    found = respond(plant, u)["x"]
    assert np.max(np.abs(x)) > 5e-3                      # K falls by more than a tenth on the way
    assert np.max(np.abs(found - x)) < 2e-4 * np.max(np.abs(x))


def test_back_emf_and_force_constant_make_no_energy(bare):
    """Energy from the amplifier = heat in the coil + heat in the bearing + kinetic and magnetic energy, for any K(x)."""
    plant = bare("voice_coil", drive__force_constant_curvature=-4000.0)
    t = np.arange(4000) * T
    u = 5.0 * np.sin(2 * np.pi * 5 * t)
    f = respond(plant, u)

    def integral(values):
        return np.sum(0.5 * (values[1:] + values[:-1])) * T

    given = np.sum(u[:-1] * 0.5 * (f["current"][1:] + f["current"][:-1])) * T
    spent = integral(R * f["current"] ** 2) + integral(C * f["v"] ** 2)
    kept = 0.5 * M * f["v"][-1] ** 2 + 0.5 * L * f["current"][-1] ** 2
    assert given == pytest.approx(spent + kept, rel=2e-3)


def test_force_constant_that_vanishes_on_the_travel_is_refused():
    axis = load_axis(AXES / "voice_coil.yaml")
    with pytest.raises(InputError, match="force_constant_curvature.*above 5%"):
        make_plant(axis.with_values({"drive.force_constant_curvature": -1e4}), NoiseSpec.none())
