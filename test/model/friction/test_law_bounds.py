"""What holds for every law and every motion: bounded, passive, split where it must be, the same by mirror."""

import hypothesis
import hypothesis.strategies as st
import numpy
import pytest
from law_contact import OWN, pack

from microstage_ros.model.friction.registry import LAWS, advance_law, run_law

NAMES = [law.name for law in LAWS]
SYMMETRIC = {"static_negative": 1.0, "coulomb_negative": 0.6, "viscous_negative": 0.05}
velocities = st.lists(
    st.one_of(st.just(0.0), st.floats(-1e6, 1e6), st.floats(-1.0, 1.0), st.floats(-1e-6, 1e-6)), min_size=2, max_size=40
)
quick = hypothesis.settings(max_examples=60, deadline=None, derandomize=True)


@pytest.mark.parametrize("name", NAMES)
@quick
@hypothesis.given(velocity=velocities, exponent=st.floats(-9.0, 4.0), factor=st.floats(0.85, 1.15))
def test_force_is_bounded_at_any_step_and_velocity(name, velocity, exponent, factor):
    damped = {"damping": 0.0} if "damping" in OWN[name] else {}
    law, packed = pack(name, viscous=0.0, viscous_negative=0.0, **damped)
    force = run_law(law, packed, velocity, 10.0**exponent, limit_factor=factor)
    assert numpy.isfinite(force).all()
    assert force.max() <= factor * 1.0 * (1.0 + 1e-9)
    assert force.min() >= -factor * 0.9 * (1.0 + 1e-9)


@pytest.mark.parametrize("name", ["lugre", "elasto_plastic", "leuven"])
@quick
@hypothesis.given(velocity=velocities, exponent=st.floats(-9.0, 4.0))
def test_micro_damping_never_adds_more_than_its_cap(name, velocity, exponent):
    law, packed = pack(name, viscous=0.0, viscous_negative=0.0, damping=1e3)
    assert numpy.abs(run_law(law, packed, velocity, 10.0**exponent)).max() <= 1.0 + 4.0 * 2.0 + 1e-9


@pytest.mark.parametrize("name", NAMES)
@quick
@hypothesis.given(velocity=velocities, exponent=st.floats(-6.0, 1.0))
def test_laws_with_equal_directions_are_odd(name, velocity, exponent):
    law, packed = pack(name, **SYMMETRIC)
    forth = run_law(law, packed, velocity, 10.0**exponent)
    back = run_law(law, packed, -numpy.array(velocity), 10.0**exponent)
    assert back == pytest.approx(-forth, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("name", NAMES)
@quick
@hypothesis.given(before=velocities, start=st.floats(0.01, 2.0), end=st.floats(-2.0, -0.01))
def test_a_step_through_zero_is_the_two_steps_beside_zero(name, before, start, end):
    law, packed = pack(name)
    state = law.initial_state(packed)
    run_law(law, packed, before, 1e-2, state=state)
    whole, parts = state.copy(), state.copy()
    to_zero = 0.1 * start / (start - end)
    force = advance_law(law.number, packed, whole, start, end, 0.1, 1.0)
    advance_law(law.number, packed, parts, start, 0.0, to_zero, 1.0)
    assert advance_law(law.number, packed, parts, 0.0, end, 0.1 - to_zero, 1.0) == pytest.approx(force, rel=1e-9)
    assert parts == pytest.approx(whole, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("name", ["dahl", "maxwell_slip"])
@quick
@hypothesis.given(distance=st.floats(-0.3, 0.3), cuts=st.integers(1, 50), speed=st.floats(1e-6, 1e6))
def test_rate_independent_laws_see_only_the_distance(name, distance, cuts, speed):
    law, packed = pack(name, viscous=0.0, viscous_negative=0.0)
    state, duration = law.initial_state(packed), abs(distance) / speed / cuts
    advance_law(law.number, packed, state, 1.0, 1.0, 0.013, 1.0)
    whole = state.copy()
    velocity = numpy.copysign(speed, distance)
    for _ in range(cuts):
        force = advance_law(law.number, packed, state, velocity, velocity, duration, 1.0)
    assert force == pytest.approx(advance_law(law.number, packed, whole, distance, distance, 1.0, 1.0), abs=1e-9)


PASSIVE = [(name, {}) for name in NAMES[:-1]] + [("generalised_maxwell_slip", {"passive": True})]


@pytest.mark.parametrize(("name", "changes"), PASSIVE)
@hypothesis.settings(max_examples=25, deadline=None, derandomize=True)
@hypothesis.given(seed=st.integers(0, 2**32 - 1), decade=st.floats(-3.0, 2.0), damping=st.floats(0.0, 20.0))
def test_no_random_motion_gets_more_energy_out_than_was_stored(name, changes, seed, decade, damping):
    """Over any stretch of any motion: work >= growth of the elastic energy."""
    damped = {"damping": damping} if "damping" in OWN[name] else {}
    law, packed = pack(name, viscous=0.0, viscous_negative=0.0, **damped, **changes)
    random = numpy.random.default_rng(seed)
    knots = random.normal(size=20) * 10.0 ** random.uniform(decade - 2.0, decade, size=20)
    velocity = numpy.interp(numpy.arange(0, 19, 2e-3), numpy.arange(20), knots)
    period = min(1e-3, 1e-4 / numpy.abs(velocity).max())
    state = law.initial_state(packed)
    force = numpy.empty(velocity.size)
    gain = numpy.zeros(velocity.size)
    for piece in range(0, velocity.size - 1, 50):
        rows = slice(piece, min(piece + 51, velocity.size))
        force[rows] = run_law(law, packed, velocity[rows], period, state=state)
        end = min(piece + 50, velocity.size - 1)
        gain[end] = law.stored_energy(packed, state)
    power = force * velocity
    work = numpy.concatenate(([0.0], numpy.cumsum(0.5 * (power[1:] + power[:-1]) * period)))
    ends = [0, *range(50, velocity.size - 1, 50), velocity.size - 1]
    lost = numpy.diff(work[ends]) - numpy.diff(gain[ends])
    travel = numpy.abs(velocity).sum() * period
    assert lost.min() > -2e-4 * travel


def test_published_generalised_maxwell_slip_gives_energy_away_and_the_passive_one_does_not():
    """A stroke just long enough to slip when fast, a crawl in which the force climbs to static, and back."""
    blocks = {"stiffness": (40.0,), "weight": (1.0,), "attraction": 20.0, "viscous": 0.0, **SYMMETRIC}
    half = numpy.concatenate((numpy.full(425, 10.0), numpy.full(40000, 1e-6)))
    cycle, period = numpy.concatenate((half, -half)), 1e-5
    net = {}
    for passive in (False, True):
        law, packed = pack("generalised_maxwell_slip", passive=passive, **{**blocks, "viscous_negative": 0.0})
        state = law.initial_state(packed)
        run_law(law, packed, numpy.tile(cycle, 2), period, state=state)
        stored = law.stored_energy(packed, state)
        net[passive] = numpy.trapezoid(run_law(law, packed, cycle, period, state=state) * cycle, dx=period)
        net[passive] -= law.stored_energy(packed, state) - stored
    # closed form: elastic energy regained at both ends, less sliding at F_C over what is left of the stroke
    slid = 2.0 * (425 * 10.0 * period - 1.6 / 40.0)
    assert net[False] == pytest.approx(-2.0 * (1.0 - 0.6**2) / (2.0 * 40.0) + 0.6 * slid, rel=0.02)
    assert net[False] < 0.0 <= net[True] + 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_nothing_changes_at_rest_but_creep(name):
    law, packed = pack(name)
    state = law.initial_state(packed)
    run_law(law, packed, numpy.linspace(0.0, 0.7, 30), 1e-3, state=state)
    run_law(law, packed, numpy.linspace(0.7, 0.0, 30), 1e-3, state=state)
    before = state.copy()
    first = advance_law(law.number, packed, state, 0.0, 0.0, 0.0, 1.0)
    later = advance_law(law.number, packed, state, 0.0, 0.0, 100.0, 1.0)
    if name == "hsieh_pan":
        assert later < first
    else:
        assert later == first
        assert state.tolist() == before.tolist()


@pytest.mark.parametrize("name", NAMES)
def test_limit_factor_scales_sliding_friction_but_not_its_viscous_part(name):
    law, packed = pack(name)
    sliding = numpy.full(4000, 2.0)
    level = {
        factor: run_law(law, packed, sliding, 1e-2, limit_factor=factor)[-1] - 0.05 * 2.0 for factor in (1.0, 1.12)
    }
    assert level[1.12] / level[1.0] == pytest.approx(1.12, rel=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_force_follows_a_limit_that_falls_while_sliding(name):
    law, packed = pack(name, viscous=0.0)
    state = law.initial_state(packed)
    run_law(law, packed, numpy.full(500, 0.1), 1e-2, limit_factor=1.15, state=state)
    lowered = run_law(law, packed, numpy.full(500, 0.1), 1e-2, limit_factor=0.85, state=state)[-1]
    fresh = run_law(law, packed, numpy.full(500, 0.1), 1e-2, limit_factor=0.85)[-1]
    assert lowered == pytest.approx(fresh, rel=1e-3)


def test_slip_lasts_through_a_stop_and_ends_with_the_direction():
    law, packed = pack("generalised_maxwell_slip")
    state = law.initial_state(packed)
    run_law(law, packed, numpy.full(200, 0.4), 1e-2, state=state)
    assert state[3:].tolist() == [1.0, 1.0, 1.0]
    run_law(law, packed, [0.4, 0.0, 0.0, 0.0], 1e-3, state=state)
    assert state[3:].tolist() == [1.0, 1.0, 1.0]
    advance_law(law.number, packed, state, -1e-6, -1e-6, 1e-3, 1.0)
    assert state[3:].tolist() == [0.0, 0.0, 0.0]
