"""Laws that are not made of blocks, as the plant carries them over a chunk."""

import numpy as np
import pytest

from microstage_ros.model.friction.curve import DIRECTION_WIDTH
from microstage_ros.model.friction.registry import law_named, run_law
from microstage_ros.numerics.compiled import compiled
from microstage_ros.solver.other_laws import _follow
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_state

from .test_step import with_law

PERIOD, ASYMMETRY = 1e-4, 0.2


@compiled(cache=False)
def carry(contact, c, speed, period, force):
    """The contact's force after each of its chunks, speed linear between ``speed`` (n,)."""
    for i in range(1, len(speed)):
        _follow(0, contact, c, speed[i - 1], speed[i], period)
        force[i] = c.law_force


@pytest.mark.parametrize("law", ["leuven", "lugre"])
def test_limits_of_each_direction_hold_where_the_speed_turns_in_every_chunk(axis, law):
    """The noise of a rest turns the speed in every chunk: each part of it has the limits of its own direction."""
    plant = make_plant(with_law(axis, law), NoiseSpec.none(), {"direction_asymmetry": {"asymmetry": ASYMMETRY}})
    n = np.arange(400)
    w = np.concatenate([np.linspace(0.0, 0.05, 200), 4e-3 * (-1.0) ** n * (1.0 + 0.2 * np.sin(n))])
    force = np.zeros(len(w))
    carry(plant["actuator"], new_state(plant)["actuator"], w, PERIOD, force)
    packed = np.array(plant["actuator"]["law_parameters"])
    packed[:2] *= 1.0 + ASYMMETRY
    packed[DIRECTION_WIDTH:DIRECTION_WIDTH + 2] *= 1.0 - ASYMMETRY
    expected = run_law(law_named(law), packed, w, PERIOD)
    assert np.ptp(expected[200:]) > 0.1 * packed[0]         # the rest does wear the force off
    assert np.max(np.abs(force - expected)) < 1e-9 * packed[0]
