"""The experiments behind the table: their slider against scipy, their verdicts against theory."""

import numpy
import pytest
from scipy.integrate import solve_ivp

from microstage_ros.model.friction.lugre import EXAMPLE
from microstage_ros.model.friction.properties.contact import CURVE, INERTIA, ONE_SPRING, Contact
from microstage_ros.model.friction.properties.slider import run_slider
from microstage_ros.model.friction.properties.sliding import passivity
from microstage_ros.model.friction.properties.table import EXPERIMENTS, STATEMENTS, compare, measure
from microstage_ros.model.friction.registry import NAMES


@pytest.fixture(scope="module")
def table():
    return measure()


def test_stick_slip_of_lugre_agrees_with_scipy():
    spring, speed, period = 0.02, 0.2, 2e-5
    time = numpy.arange(20001) * period
    contact = Contact.of("lugre", viscous=CURVE["viscous"])
    position, velocity, _ = run_slider(contact, spring * speed * time, period, INERTIA, spring)
    stiffness = ONE_SPRING["stiffness"]

    def rhs(t, y):
        x, w, z = y
        drop = (CURVE["static"] - CURVE["coulomb"]) * numpy.exp(-(abs(w / CURVE["stribeck_velocity"]) ** 0.9))
        limit = CURVE["coulomb"] + drop
        rate = w - stiffness * abs(w) * z / limit
        damping = min(EXAMPLE["damping"], 4.0 * limit / max(abs(w), 1e-12))
        friction = stiffness * z + damping * rate + CURVE["viscous"] * w
        return [w, (spring * (speed * t - x) - friction) / INERTIA, rate]

    solution = solve_ivp(rhs, (0.0, 0.4), [0.0, 0.0, 0.0], method="LSODA", t_eval=time[::100], rtol=1e-9, atol=1e-12)
    assert velocity.max() > 3.0 * speed  # it slips ...
    assert numpy.abs(velocity[10000:]).min() < 0.01 * speed  # ... and sticks
    assert position[::100] == pytest.approx(solution.y[0], abs=2e-4 * position.max())


def test_slider_with_the_static_law_stays_at_rest_until_static_and_then_leaves():
    contact = Contact.of("coulomb_viscous_stribeck")
    load = numpy.linspace(0.0, 1.1 * CURVE["static"], 1101)
    position, velocity, friction = run_slider(contact, load, 1e-4, INERTIA)
    assert numpy.flatnonzero(velocity)[0] == 1001
    assert position[:1001].tolist() == [0.0] * 1001
    assert friction[1:1001] == pytest.approx(0.5 * (load[:1000] + load[1:1001]))


def test_a_slider_in_the_elastic_range_keeps_its_energy():
    contact = Contact.of("maxwell_slip")  # before the first block slips nothing is lost
    load, spring = numpy.full(20001, 0.1 * CURVE["static"]), 5.0
    position, velocity, _ = run_slider(contact, load, 1e-5, INERTIA, spring)
    stiffness = ONE_SPRING["stiffness"] + spring
    natural, rest = numpy.sqrt(stiffness / INERTIA), load[0] / stiffness
    assert position == pytest.approx(rest * (1.0 - numpy.cos(natural * numpy.arange(20001) * 1e-5)), abs=0.01 * rest)
    assert numpy.abs(velocity[-1000:]).max() == pytest.approx(rest * natural, rel=1e-3)


def test_every_law_has_every_finding(table):
    assert list(table) == list(EXPERIMENTS)
    for row in table.values():
        assert list(row) == list(NAMES)


@pytest.mark.parametrize(
    ("row", "yes"),
    [
        ("Stribeck curve", "coulomb_viscous_stribeck lugre elasto_plastic leuven generalised_maxwell_slip"),
        ("memory: Masing", "hsieh_pan maxwell_slip generalised_maxwell_slip"),
        ("memory: return point", "leuven hsieh_pan maxwell_slip generalised_maxwell_slip"),
        ("memory: wipe-out", "leuven hsieh_pan maxwell_slip generalised_maxwell_slip"),
        ("drift under small oscillation", "dahl lugre leuven"),
        ("creep under constant load", "hsieh_pan"),
        ("frictional lag", "lugre elasto_plastic leuven generalised_maxwell_slip"),
        ("rising static friction", ""),
        ("stick-slip", "coulomb_viscous_stribeck lugre elasto_plastic leuven generalised_maxwell_slip"),
        ("breakaway spread", "lugre elasto_plastic leuven generalised_maxwell_slip"),
    ],
)
def test_the_laws_that_show_a_property_are_those_whose_equations_hold_it(table, row, yes):
    assert [name for name in NAMES if table[row][name].shown] == yes.split()


def test_lugre_drifts_by_what_its_average_says(table):
    """Quasi-static, F = σ₀ z and dx = dz / (1 − sgn(dz) σ₀ z / F_s): a cycle of F does not close in x."""
    bias, swing = 0.2, 0.15
    phase = numpy.linspace(0.0, 2.0 * numpy.pi, 100001)
    level = bias + swing * numpy.sin(phase)
    rate = swing * numpy.cos(phase)
    per_cycle = numpy.trapezoid(rate / (1.0 - numpy.sign(rate) * level), phase)
    assert table["drift under small oscillation"]["lugre"].value == pytest.approx(per_cycle, rel=0.1)


def test_disagreement_with_the_paper_is_what_the_page_says(table):
    against = {(said.law, said.row) for said, _, agrees in compare(table) if not agrees}
    assert against == {("lugre", "rising static friction"), ("leuven", "rising static friction")}
    assert len(STATEMENTS) == len({(said.law, said.row) for said in STATEMENTS})


def test_only_the_published_generalised_maxwell_slip_makes_energy(table):
    assert [name for name in NAMES if not table["passive"][name].shown] == ["generalised_maxwell_slip"]
    assert passivity("generalised_maxwell_slip", passive=True).value > -1e-4
