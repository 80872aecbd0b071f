"""The current-driven motor against closed forms."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from microstage_ros.solver.open_loop import respond

T = 2.5e-4
RATIO = 5e-3 / (2 * math.pi)


def _rigid(plant):
    """The same machine on a rigid transmission, for closed forms."""
    plant["rigid"], plant["plain"], plant["quick"] = 1, 0, 0
    return plant


def test_step_of_torque_follows_the_current_loop(bare):
    """M dv/dt + c v = F (1 − exp(−t/τ)) on a rigid screw: v and i in closed form."""
    plant = _rigid(bare("current_motor", drive__supply_voltage=0.0))
    n = np.arange(400)
    t, tau = n * T, 1 / (2 * math.pi * 800.0)
    found = respond(plant, 0.1 + 0.0 * t)
    mass, c, force = 20.0 + 4e-5 / RATIO**2, 120.0, 0.1 / RATIO
    a = c / mass
    v = force / c * (1 - np.exp(-a * t)) - force / mass * (np.exp(-t / tau) - np.exp(-a * t)) / (a - 1 / tau)
    assert np.allclose(found["current"], 0.1 / 0.08 * (1 - np.exp(-t / tau)), rtol=1e-9, atol=1e-12)
    assert np.max(np.abs(found["v"] - v)) < 1e-9 * np.max(v)


def test_command_is_clipped_at_the_current_limit(bare):
    found = respond(bare("current_motor", drive__supply_voltage=0.0), np.full(100, 5.0))
    assert found["current"][-1] == pytest.approx(6.0, rel=1e-9)


def test_supply_ends_the_torque_at_the_no_load_speed(bare):
    """At last R i + K_E ω = U: with torque k_M i = c r² ω the speed is U / (K_E + R c r²/k_M)."""
    plant = _rigid(bare("current_motor", drive__supply_voltage=6.0))
    found = respond(plant, np.full(40000, 0.4))
    drag = 120.0 * RATIO**2
    assert found["omega"][-1] == pytest.approx(6.0 / (0.08 + 0.6 * drag / 0.08), rel=1e-6)
    assert 0.6 * found["current"][-1] + 0.08 * found["omega"][-1] == pytest.approx(6.0, rel=1e-6)


def test_flexible_screw_against_an_independent_integration(bare):
    plant = bare("current_motor", drive__supply_voltage=0.0)
    t = np.arange(200) * T
    u = 0.3 * np.sign(np.sin(2 * np.pi * 37 * t + 0.1))
    tau, j, k, d, m, c = 1 / (2 * math.pi * 800.0), 4e-5, 5e7, 3e3, 20.0, 120.0

    def rates(_, z, command):
        i, w, th, v, x = z
        spring = k * (RATIO * th - x) + d * (RATIO * w - v)
        return [(command / 0.08 - i) / tau, (0.08 * i - RATIO * spring) / j, w, (spring - c * v) / m, v]

    z, x = np.zeros(5), []
    for command in u:
        x.append(z[4])
        z = solve_ivp(rates, (0, T), z, args=(command,), method="Radau", rtol=1e-10, atol=1e-13).y[:, -1]
    assert np.max(np.abs(respond(plant, u)["x"] - x)) < 1e-10
