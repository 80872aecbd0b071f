"""Each law against what can be worked out on paper."""

import numpy
import pytest
from law_contact import OWN, pack

from microstage_ros.model.friction.blocks import blocks_from_segment_slopes, virgin_curve
from microstage_ros.model.friction.curve import relax, sliding_limit
from microstage_ros.model.friction.positions import force_along, maxwell_slip_force
from microstage_ros.model.friction.registry import advance_law, run_law

# Tables 1 and 3 of the paper
TABLE_1 = numpy.array([1159, 64.417, 13.066, 8.027, 2.043, 0.961]) * 1e-3
WEIGHT_1 = numpy.array([0.575, 0.160, 0.059, 0.120, 0.051, 0.034])
TABLE_3 = numpy.array([454610, 111088, 45601, 16402, 6899, 4295.0])
WEIGHT_3 = numpy.array([0.378, 0.138, 0.148, 0.177, 0.112, 0.046])


@pytest.mark.parametrize("speed", [-3.0, -0.2, 0.01, 0.5, 20.0])
@pytest.mark.parametrize(
    "name", ["coulomb_viscous_stribeck", "lugre", "elasto_plastic", "leuven", "generalised_maxwell_slip"]
)
def test_steady_sliding_is_the_stribeck_curve_of_that_direction(name, speed):
    law, packed = pack(name)
    direction = numpy.sign(speed)
    static, coulomb, viscous = (1.0, 0.6, 0.05) if speed > 0 else (0.9, 0.7, 0.08)
    expected = direction * (coulomb + (static - coulomb) * numpy.exp(-(abs(speed / 0.5) ** 1.3))) + viscous * speed
    settle = numpy.full(4000, speed)
    assert run_law(law, packed, settle, 1.0 / 400.0 / abs(speed) + 0.01)[-1] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "limits"), [("dahl", (0.6, 0.7)), ("maxwell_slip", (1.0, 0.9)), ("hsieh_pan", (1.0, 0.9))]
)
def test_laws_without_a_drop_slide_at_one_limit_per_direction(name, limits):
    law, packed = pack(name, viscous=0.0, viscous_negative=0.0, **({"exponent": 1.0} if name == "dahl" else {}))
    for direction, limit in zip((1.0, -1.0), limits, strict=True):
        for speed in (1e-2, 1.0, 30.0):
            force = run_law(law, packed, numpy.full(3000, direction * speed), 1e-2 / speed)[-1]
            assert force == pytest.approx(direction * limit, rel=1e-9)


def test_dahl_follows_its_exponential_in_one_step_or_in_many():
    law, packed = pack("dahl", exponent=1.0, viscous=0.0)
    for steps in (1, 7, 1000):
        state = law.initial_state(packed)
        for _ in range(steps):
            force = advance_law(law.number, packed, state, 0.3, 0.3, 0.05 / steps, 1.0)
        assert force == pytest.approx(0.6 * (1.0 - numpy.exp(-50.0 * 0.015 / 0.6)), rel=1e-12)
    back = advance_law(law.number, packed, state, -0.3, -0.3, 0.01, 1.0) + 0.08 * 0.3
    assert back == pytest.approx(-0.7 + (0.7 + state_before(0.015)) * numpy.exp(-50.0 * 0.003 / 0.7), rel=1e-12)


def state_before(distance):
    """Dahl's force after a first loading."""
    return 0.6 * (1.0 - numpy.exp(-50.0 * distance / 0.6))


@pytest.mark.parametrize("exponent", [0.5, 1.0, 2.0])
def test_dahl_exponent_has_the_closed_solution_of_its_power(exponent):
    law, packed = pack("dahl", exponent=exponent, viscous=0.0)
    distance = numpy.linspace(0.0, 0.02, 50)
    force = force_along(law, packed, distance, 1e-3)
    reach = 50.0 * distance / 0.6
    u = {0.5: (1.0 - 0.5 * reach) ** 2 * (reach < 2.0), 1.0: numpy.exp(-reach), 2.0: 1.0 / (1.0 + reach)}[exponent]
    assert force == pytest.approx(0.6 * (1.0 - u), rel=1e-10, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "stiffness"),
    [("dahl", 50.0), ("lugre", 50.0), ("elasto_plastic", 50.0), ("leuven", 56.0), ("maxwell_slip", 56.0),
     ("generalised_maxwell_slip", 56.0)],
)  # fmt: skip
def test_first_loading_starts_with_the_presliding_stiffness(name, stiffness):
    law, packed = pack(name, viscous=0.0, **({"damping": 0.0} if "damping" in OWN[name] else {}))
    force = run_law(law, packed, numpy.full(2, 1e-3), 1e-4)
    assert force[1] / 1e-7 == pytest.approx(stiffness, rel=1e-4)


def test_both_readings_of_the_papers_tables_give_the_virgin_curves_of_its_figures():
    static, weight = 219e-6, WEIGHT_1 / WEIGHT_1.sum()
    slip = weight * static / TABLE_1
    assert slip * 1e3 == pytest.approx([0.109, 0.544, 0.989, 3.27, 5.47, 7.75], rel=5e-3)
    assert virgin_curve(TABLE_1, weight * static, 7.75e-3) == pytest.approx(static, rel=1e-4)
    stiffness, share = blocks_from_segment_slopes(TABLE_3, WEIGHT_3, 0.9)
    assert stiffness == pytest.approx([343522, 65487, 29199, 9503, 2604, 4295], rel=1e-5)
    assert share.sum() == pytest.approx(1.0, rel=1e-12)
    assert share == pytest.approx([0.286, 0.136, 0.155, 0.153, 0.084, 0.185], abs=1e-3)
    assert share * 0.9 / stiffness * 1e6 == pytest.approx([0.75, 1.87, 4.79, 14.5, 29.1, 38.75], rel=5e-3)
    assert virgin_curve(stiffness, share * 0.9, 1e-6) == pytest.approx(0.37, abs=0.005)
    assert virgin_curve(TABLE_3, WEIGHT_3 * 0.9, 1e-6) == pytest.approx(0.52, abs=0.005)


@pytest.mark.parametrize("reading", ["segment_slopes", "blocks"])
def test_maxwell_slip_traces_virgin_curve_and_masing_branch(reading):
    stiffness, weight = TABLE_3, WEIGHT_3 / WEIGHT_3.sum()
    if reading == "segment_slopes":
        stiffness, weight = blocks_from_segment_slopes(TABLE_3, WEIGHT_3, 0.9)
    law, packed = pack("maxwell_slip", stiffness=stiffness, weight=weight, static=0.9, coulomb=0.9,
                          static_negative=0.9, coulomb_negative=0.9, viscous=0.0, viscous_negative=0.0)  # fmt: skip
    out = numpy.linspace(0.0, 20e-6, 201)
    back = 20e-6 - numpy.linspace(0.0, 40e-6, 201)[1:]
    force = force_along(law, packed, numpy.concatenate((out, back)), 1e-4)
    first = virgin_curve(stiffness, 0.9 * weight, out)
    assert force[:201] == pytest.approx(first, rel=1e-12)
    assert force[201:] == pytest.approx(first[-1] - 2.0 * virgin_curve(stiffness, 0.9 * weight, 0.5 * (20e-6 - back)))
    assert maxwell_slip_force(numpy.concatenate((out, back)), stiffness, 0.9 * weight) == pytest.approx(force)


@pytest.mark.parametrize("velocity", [0.3, -0.3])
def test_leuven_with_a_linear_rate_is_exact_between_its_events(velocity):
    """With n = 1 the rate equation is linear while no element slips, so one step is as good as a thousand."""
    law, packed = pack("leuven", exponent=1.0, damping=0.0, viscous=0.0, viscous_negative=0.0)
    for distance in (0.005, 0.02, 0.05, 0.2):
        force = [run_law(law, packed, numpy.full(n + 1, velocity), distance / 0.3 / n)[-1] for n in (1, 1000)]
        assert force[0] == pytest.approx(force[1], rel=1e-9)


@pytest.mark.parametrize("steps", [1, 13])
def test_slipping_blocks_relax_with_the_time_constant_s_over_attraction(steps):
    law, packed = pack("generalised_maxwell_slip", viscous=0.0)
    state = law.initial_state(packed)
    n = 3
    weights = packed[-2 - n : -2]
    s_before, s_after = 0.9, sliding_limit(packed, 1.0, 2.0, 1.0)
    state[:n], state[n:] = weights * s_before, 1.0  # all slip, above the curve of the new speed
    for _ in range(steps):
        force = advance_law(law.number, packed, state, 2.0, 2.0, 0.02 / steps, 1.0)
    assert force == pytest.approx(s_after + (s_before - s_after) * numpy.exp(-20.0 * 0.02 / s_after), rel=1e-12)


def test_relaxation_onto_a_moving_target_solves_its_equation():
    late = numpy.linspace(0.0, 2.5, 20001)
    target = 1.0 + 0.8 * late / 2.5
    integral = numpy.trapezoid(numpy.exp(late - 2.5) * target, late)
    assert relax(3.0, 1.0, 1.8, 2.5) == pytest.approx(3.0 * numpy.exp(-2.5) + integral, rel=1e-8)
    assert relax(3.0, 1.0, 1.8, 1e-12) == pytest.approx(3.0)
    assert relax(3.0, 1.0, 1.8, 1e9) == pytest.approx(1.8)


def test_static_law_is_odd_without_asymmetry_and_zero_at_rest():
    law, packed = pack("coulomb_viscous_stribeck", static_negative=1.0, coulomb_negative=0.6, viscous_negative=0.05)
    velocity = numpy.array([-2.0, -0.1, 0.0, 0.1, 2.0])
    force = run_law(law, packed, velocity, 1e-3)
    assert force == pytest.approx(-force[::-1])
    assert force[2] == 0.0


def test_hsieh_pan_creeps_to_the_back_force_and_not_further():
    law, packed = pack("hsieh_pan", viscous=0.0)
    state = law.initial_state(packed)
    run_law(law, packed, numpy.full(11, 0.1), 1e-2, state=state)  # 0.01 of displacement, partly plastic
    held = run_law(law, packed, numpy.zeros(2000), 10.0, state=state)
    assert numpy.all(numpy.diff(held) <= 1e-15)
    assert held[-1] == pytest.approx(5.0 * state[-1], rel=1e-6)  # F_h = H p
    assert 0.0 < state[-1] < 0.01
