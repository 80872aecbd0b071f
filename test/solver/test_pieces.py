"""The pieces of the compiled step against closed forms and scipy."""

import math

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from microstage_ros.model.plant_record import LEVELS
from microstage_ros.numerics.compiled import compiled
from microstage_ros.numerics.random import normal, seed_state, uniform
from microstage_ros.solver import linear_core as core
from microstage_ros.solver.contact import limit, limit_and_slopes
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_state, new_work
from microstage_ros.solver.slip import near, relax
from microstage_ros.solver.step import advance
from microstage_ros.solver.variability import vary
from microstage_ros.solver.vectors import add_columns, fused, mode_rows


def test_random_numbers_are_normal_and_uniform():
    state = seed_state(3)
    # seeded; 0.05 and 0.35 are four standard errors: of a kurtosis √(24/200 000), of a count of 115 in the tails 1/√115
    draws = np.array([normal(state) for _ in range(200_000)])
    assert stats.kstest(draws, "norm").pvalue > 1e-3
    assert stats.kurtosis(draws) == pytest.approx(0.0, abs=0.05)
    assert np.mean(np.abs(draws) > 3.442619855899) == pytest.approx(2 * stats.norm.sf(3.442619855899), rel=0.35)
    assert stats.kstest([uniform(state) for _ in range(50_000)], "uniform").pvalue > 1e-3


def test_same_seed_same_numbers_other_seed_others():
    draw = lambda seed: [normal(s) for s in [seed_state(seed)] for _ in range(5)]
    assert draw(1) == draw(1) and draw(1) != draw(2)


def test_stribeck_table_follows_the_curve(quiet):
    contact = quiet()["actuator"]
    w = np.concatenate([[0.0], np.geomspace(1e-8, 50, 4000)])
    exact = 125.6e-6 + (219e-6 - 125.6e-6) * np.exp(-((w / 0.18) ** 0.9))
    table = np.array([limit(contact, x) for x in w])
    assert np.max(np.abs(table / exact - 1)) < 2e-6
    fine = w > 1e-6
    assert np.max(np.abs(table / exact - 1)[fine]) < 2e-8


def test_mode_matrices_equal_scipy_expm(quiet):
    plant = quiet()
    work = new_work()
    core.build_mode(plant, 0.8, 3e-6, 4e5, 20.0, 1, 3.41, 0.0, work["matrix"][0])
    lead, gear = plant["screw_ratio"], 19.0
    a = np.zeros((5, 5))       # i ω θ v x, written from the equations of motion
    a[0, :2] = [-3.41 / 75e-6, -6.589014636e-3 / 75e-6]
    r, k, d = lead / gear, 1.2e7, 600.0
    a[1] = np.array([6.59e-3, -3e-6 / gear - r * r * d, -0.8 / gear - r * r * k, r * d, r * k]) / 1e-7
    a[2, 1] = a[4, 3] = 1.0
    a[3] = np.array([0.0, r * d, r * k, -d - 20.0, -k - 4e5]) / 3.06
    start = np.array([0.1, 3.0, 0.0, 1e-3, 0.0])
    for level in (0, 3, LEVELS - 1):
        exact = expm(a * 1e-4 / 2**level) @ start
        m = work["matrix"][0][level]
        ours = m[core.I] * start[0] + m[core.OMEGA] * start[1] + m[core.V] * start[3]
        np.testing.assert_allclose(ours[:5], exact, rtol=1e-11, atol=1e-16)


def test_polynomial_inputs_equal_an_augmented_system(quiet):
    """Torque c0 + c1 s + c2 s² at the motor and force 0.3 − 0.2 s at the stage, s = t/h: states 1, s, s² beside the five, by expm."""
    plant = quiet()
    work = new_work()
    core.build_mode(plant, 0.0, 0.0, 0.0, 20.0, 1, 3.41, 0.0, work["matrix"][0])
    h, c = 1e-4, np.array([2e-5, -5e-5, 3e-5])
    a = np.zeros((8, 8))
    r, k, d = plant["ratio"], 1.2e7, 600.0
    a[0, :2] = [-3.41 / 75e-6, -6.589014636e-3 / 75e-6]
    a[1] = np.array([6.59e-3, -r * r * d, -r * r * k, r * d, r * k, *c]) / 1e-7
    a[2, 1] = a[4, 3] = 1.0
    a[3] = np.array([0.0, r * d, r * k, -d - 20.0, -k, 0.3, -0.2, 0.0]) / 3.06
    a[6, 5], a[7, 6] = 1.0 / h, 2.0 / h
    exact = expm(a * h)[:5, 5]
    m = work["matrix"][0][0]
    ours = c[0] * m[core.T0] + c[1] * m[core.T1] + c[2] * m[core.T2] + 0.3 * m[core.F0] - 0.2 * m[core.F1]
    np.testing.assert_allclose(ours[:5], exact, rtol=1e-11, atol=0.0)


def series_error(g):
    """Relative error of two factors exp(−g/2) by `decay_series`: each leaves out (g/2)^8/8! and smaller terms of changing sign."""
    return 2.0 * (0.5 * g) ** 8 / math.factorial(8) * math.exp(0.5 * g)


def test_relaxation_is_exact_in_steady_sliding_and_fourth_order_otherwise():
    s = 1.4e-4
    g = 1e-4 / s
    _, end, fade = relax(1.0, 2.0e-4, s, s, s, 1e-4)
    assert relax(1.0, s, s, s, s, 1e-4)[:2] == (s, s)              # no error at all once it is steady
    assert fade == pytest.approx(np.exp(-g), rel=series_error(g))
    assert end == pytest.approx(s + 0.6e-4 * np.exp(-g), abs=0.6e-4 * np.exp(-g) * series_error(g))
    curve = lambda t: 1.3e-4 + 0.6e-4 * np.exp(-t / 4e-4)

    def error(h):
        exact = solve_ivp(lambda t, f: 1 - f / curve(t), (0, h), [1.85e-4], rtol=1e-12, atol=1e-18, method="DOP853").y[0, -1]
        return abs(relax(1.0, 1.85e-4, curve(0.0), curve(h / 2), curve(h), h)[1] - exact)

    # of fourth order: the error of one chunk goes with h^5, that is 2^5 = 32 by halving, as h goes to 0; a third-order
    # scheme would give 16. A whole period's is a thousandth of the least random friction that runs ask for (1 %).
    assert 28.0 < error(5e-5) / error(2.5e-5) < 32.0 and 28.0 < error(2.5e-5) / error(1.25e-5) < 32.0
    assert error(1e-4) < 1e-5 * 1.85e-4


@compiled
def vary_for(plant, state, periods):
    for _ in range(periods):
        vary(plant, state)


def test_random_friction_has_the_stated_spread_and_lengths(axis):
    plant = make_plant(axis, NoiseSpec(friction_relative=0.04))
    q = []
    for seed in range(3000):
        state = new_state(plant, seed)
        first = float(state["actuator"]["q"])
        state["v"] = 1e-3
        vary_for(plant, state, 1000)          # 100 µm of travel in 0.1 s
        q.append([first, float(state["actuator"]["q"]), float(state["guideway"]["q"])])
    q = np.array(q)
    # seeded, 3000 draws; clipped at ±0.15, which takes 1 % of a spread and 0.02 of the product (12 000 draws). Beyond that 0.06 is four
    # standard errors 1/√6000 of a spread, and 0.1 four of a mean product, √(1 + ρ²)/√3000 = 0.02; 0.15 of 300 draws was but 2.3 of it
    assert q.std(0) == pytest.approx([0.04] * 3, rel=0.06)
    kept = np.mean(q[:, 0] * q[:, 1]) / 0.04**2      # 80 % · e^-1 + 20 % · e^-0.005
    assert kept == pytest.approx(0.8 * np.exp(-1) + 0.2, abs=0.1)
    assert abs(np.corrcoef(q[:, 1], q[:, 2])[0, 1]) < 0.08 and np.abs(q).max() <= 0.15 * (1.0 + 1e-12)


@compiled
def near_in_python(g, f0, s0):
    return near(g, f0, s0)


def test_slip_to_first_order_against_the_integrated_equation():
    """f' = C − ρ (1 + ε) f with ε = a x + b x² over the chunk (x = t/h), and G = ρ h.

    `near` leaves out the second order in ε, at most (G ∫|ε|)²/2 of the largest force, and the errors of its two quadratures of
    q = e^(G x) ε: Simpson's over the chunk, max|d⁴q/dx⁴|/2880, and to its middle max|d³q/dx³|/384 (Adams–Moulton of third order).
    """
    h, s0, f0 = 1e-4, 1.4e-4, 1.5e-4
    g, x = h / s0, np.linspace(0.0, 1.0, 101)
    for size in (1e-2, 1e-3):
        a, b = 0.6 * size, 0.4 * size
        e, e1, e2 = a * x + b * x**2, a + 2 * b * x, 2 * b
        third = np.max(np.exp(g * (x - 0.5)) * (g**3 * e + 3 * g**2 * e1 + 3 * g * e2))
        fourth = np.max(np.exp(g * (x - 1.0)) * (g**4 * e + 4 * g**3 * e1 + 6 * g**2 * e2))
        mean = a / 2 + b / 3
        second = (g * mean) ** 2 / 2 * (1 + g * size)
        exact = solve_ivp(lambda t, f: 1 - (1 + a * t / h + b * (t / h) ** 2) * f / s0, (0, h), [f0], t_eval=[h / 2, h],
                          rtol=1e-12, atol=1e-20, method="DOP853").y[0]
        mid, mid_m, mid_1, end, end_m, end_1, fade = near_in_python(g, f0, s0)
        e_mid, e_end = a / 2 + b / 4, a + b
        assert abs(mid + mid_m * e_mid + mid_1 * e_end - exact[0]) < (second + g * third / 384) * f0
        assert abs(end + end_m * e_mid + end_1 * e_end - exact[1]) < (second + g * fourth / 2880) * f0
        assert fade == pytest.approx(np.exp(-g), rel=series_error(g))
    assert near_in_python(g, s0, s0)[0::3][:2] == (s0, s0)              # exact in steady sliding


@compiled
def slopes_in_python(contact, w):
    return limit_and_slopes(contact, w)


def test_slopes_of_the_limit_are_those_of_the_curve(quiet):
    """Off by no more than a cubic through four Chebyshev nodes of a cell of width d: M d³/96 and M d² 10/96, M = |d⁴f/dw⁴|.

    (T_4 scaled to the cell has slopes up to 16 and second derivatives up to 80 at its ends.) d is at most w/16; M is taken
    from Cauchy's integral about w, its largest value on the cells that may hold w; a tenth for the next order.
    """
    contact = quiet()["actuator"]
    turn = np.exp(2j * np.pi * np.arange(64) / 64)

    def derivatives(f, w):
        values = f(w * (1.0 + 0.25 * turn))
        return [math.factorial(n) * np.mean(values * turn**-n).real / (0.25 * w) ** n for n in range(5)]

    per_limit = lambda w: 1.0 / (125.6e-6 + 93.4e-6 * np.exp(-((w / 0.18) ** 0.9)))
    for w in np.geomspace(1e-3, 3.0, 40):
        s, per_s, slope, bend = slopes_in_python(contact, w)
        exact = derivatives(per_limit, w)
        fourth = 1.1 * max(abs(derivatives(per_limit, at)[4]) for at in np.linspace(w * (1 - 1 / 16), w * (1 + 1 / 16), 9))
        d = w / 16
        rounding = 1e-15 * exact[0] * np.array([1.0, 1e3 / w, 1e6 / w**2])          # of the coefficients' differences
        assert s == pytest.approx(limit(contact, w), rel=1e-14)
        assert abs(per_s - exact[0]) < fourth * d**4 / 3072 + rounding[0] and s * per_s == pytest.approx(1.0, abs=4e-8)
        assert abs(slope - exact[1]) < fourth * d**3 / 96 + rounding[1]
        assert abs(bend - exact[2] / 2) < fourth * d**2 * 5 / 96 + rounding[2]


@compiled
def rows_in_python(work, slot, level, x):
    rows = mode_rows(work.matrix, slot, level, x[0], x[1], x[2], x[3], x[4], x[5], x[6])
    return rows, add_columns(rows, work.matrix, slot, level, core.T1, 0.5, core.T2, -2.0), fused(x[0], x[1], x[2])


def test_rows_of_a_mode_are_its_matrix_times_its_inputs(quiet):
    generator, work = np.random.default_rng(0), new_work(quiet())
    work["matrix"][5, 3] = m = generator.standard_normal((core.F1 + 1, 8))
    i, omega, v, u, t0, t1, f0 = x = generator.standard_normal(7)
    rows, more, product = rows_in_python(work, 5, 3, x)
    expected = (m[core.I] * i + m[core.OMEGA] * omega + m[core.V] * v + m[core.U] * u + m[core.T0] * t0 + m[core.T1] * t1 + m[core.F0] * f0)[:6]
    np.testing.assert_allclose(rows, expected, rtol=0, atol=1e-14)
    np.testing.assert_allclose(more, expected + 0.5 * m[core.T1, :6] - 2.0 * m[core.T2, :6], rtol=0, atol=1e-14)
    assert product == pytest.approx(i * omega + v, abs=1e-15)


def test_a_law_of_the_library_is_refused_where_it_was_not_compiled_in(quiet):
    plant, work = quiet(), new_work(quiet())
    plant["actuator"]["law"] = 2
    with pytest.raises(ValueError, match="new_work"):
        advance(plant, new_state(plant), work, 0.0)
    assert "any_law" in new_work(plant).dtype.names and "any_law" in new_work().dtype.names
