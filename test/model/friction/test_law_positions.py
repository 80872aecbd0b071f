"""The operators along measured positions against plain Python and against the laws themselves."""

import numpy
import pytest
from law_contact import BLOCKS, pack

from microstage_ros.model.friction.positions import force_along, maxwell_slip_force, stop_operators
from microstage_ros.model.friction.registry import LAWS, run_law
from microstage_ros.quantities.errors import InputError

STIFFNESS, LIMITS = numpy.array(BLOCKS["stiffness"]), numpy.array(BLOCKS["weight"])


def walk(shape, seed=1):
    return numpy.random.default_rng(seed).normal(scale=0.01, size=shape).cumsum(axis=-1)


def plain(displacement, factor, below, initial):
    """The same clip, block by block, in plain Python."""
    blocks, force = list(initial), [sum(initial)]
    for n in range(1, len(displacement)):
        step = displacement[n] - displacement[n - 1]
        for i in range(len(blocks)):
            blocks[i] += STIFFNESS[i] * step
            if step > 0.0:
                blocks[i] = min(blocks[i], factor[n] * LIMITS[i])
            elif step < 0.0:
                blocks[i] = max(blocks[i], -factor[n] * below[i])
        force.append(sum(blocks))
    return force


def test_operator_is_the_plain_clip_with_factor_asymmetry_and_initial_force():
    x, below, initial = walk(300), 0.8 * LIMITS, numpy.array([0.2, -0.1, 0.05])
    factor = 1.0 + 0.15 * numpy.sin(numpy.arange(300) / 9.0)
    force = maxwell_slip_force(x, STIFFNESS, LIMITS, factor, below, initial)
    assert force == pytest.approx(numpy.array(plain(x, factor, below, initial)), abs=1e-14)


def test_records_side_by_side_are_the_records_one_by_one():
    x = walk((2, 3, 120))
    factor, initial = 1.0 + 0.1 * walk((2, 3, 120), 5), walk((2, 3, 3), 6)
    force = maxwell_slip_force(x, STIFFNESS, LIMITS, factor, initial=initial)
    assert force.shape == x.shape
    for row in numpy.ndindex(2, 3):
        assert (
            force[row].tolist()
            == maxwell_slip_force(x[row], STIFFNESS, LIMITS, factor[row], initial=initial[row]).tolist()
        )


def test_stop_operators_span_maxwell_slip():
    x = walk(500)
    stops = stop_operators(x, LIMITS / STIFFNESS)
    assert stops.shape == (3, 500)
    assert STIFFNESS @ stops == pytest.approx(maxwell_slip_force(x, STIFFNESS, LIMITS), abs=1e-13)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_positions_of_a_constant_speed_give_what_the_velocity_gives(law):
    _, packed = pack(law.name)
    distance = 0.3 * 1e-2 * numpy.arange(100)
    along = force_along(law, packed, distance, 1e-2)
    assert along[1:] == pytest.approx(run_law(law, packed, numpy.full(100, 0.3), 1e-2)[1:], rel=1e-9)


def test_operator_and_law_agree_on_a_random_walk_with_a_limit_factor():
    law, packed = pack("maxwell_slip", viscous=0.0, viscous_negative=0.0)
    x, factor = walk(400), 1.0 + 0.1 * numpy.cos(numpy.arange(400.0))
    force = maxwell_slip_force(x, STIFFNESS, LIMITS, factor, 0.9 * LIMITS)
    assert force_along(law, packed, x, 1e-4, factor) == pytest.approx(force, abs=1e-13)


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        ({"displacement": numpy.array([0.0, numpy.nan])}, "displacement"),
        ({"displacement": numpy.zeros(0)}, "displacement"),
        ({"limits": LIMITS[:2]}, "limits"),
        ({"limit_factor": numpy.ones(7)}, "limit_factor"),
        ({"initial": numpy.zeros(4)}, "initial"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(arguments, names):
    good = {"displacement": walk(20), "stiffness": STIFFNESS, "limits": LIMITS}
    with pytest.raises(InputError, match=names):
        maxwell_slip_force(**{**good, **arguments})
