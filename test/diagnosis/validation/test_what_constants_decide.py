"""The two experiments by which constants of the diagnosis are calibrated: where decisions turn, and what else may stand in their place."""

import math

import numpy as np
import pytest

from microstage_ros.diagnosis.prerequisites import lost_motion, resonant
from microstage_ros.diagnosis.validation.margins import Watched, around, modules_with, watching
from microstage_ros.diagnosis.validation.variation import GROUPS, changed, moved, with_factor


def test_a_watched_constant_decides_as_its_value_and_keeps_where_it_would_not():
    turns = []
    constant = Watched(4.0, turns)
    assert np.float64(9.0) > 2.0 * constant and not np.float64(7.0) > constant * np.float64(2.0)
    assert 1.0 + constant <= 5.0 and 6.0 - constant < 3.0 and constant / 2.0 >= 2.0
    assert turns == [4.5, 3.5, 4.0, 3.0, 4.0]
    assert around(4.0, [1.0, 3.5, 4.5, 9.0]) == (3.5, 4.5) and around(4.0, []) == (-math.inf, math.inf)


def test_constants_are_watched_wherever_they_were_imported_and_put_back():
    before = resonant.FAR
    with watching({"prerequisites.resonant": ("FAR",)}) as turns:
        assert isinstance(lost_motion.FAR, Watched) and 2.0 > lost_motion.FAR
    assert turns == {("prerequisites.resonant", "FAR"): [2.0]} and lost_motion.FAR is resonant.FAR is before


@pytest.mark.parametrize("value, factor, expected", [
    ({"a": 2.0, "b": (1.0, 3.0)}, 2.0, {"a": 4.0, "b": (2.0, 6.0)}), (3.0, 0.5, 1.5), (20, 2.0, 40), (201, 0.5, 101), ((2.0, 8.0), 2.0, (1.0, 16.0)), ((1.0, 2.0, 3.0), 2.0, (2.0, 4.0, 6.0)),
])
def test_constants_are_changed_as_what_they_are(value, factor, expected):
    assert changed(value, factor) == expected


def test_a_group_is_changed_and_put_back():
    place, names, _ = GROUPS["resonant"]
    before = [getattr(resonant, name) for name in names]
    with with_factor(place, names, 2.0):
        assert [getattr(resonant, name) for name in names] == [2.0 * value for value in before]
    assert [getattr(resonant, name) for name in names] == before
    assert len(modules_with("FAR", resonant.FAR)) > 1


def test_how_far_sizes_moved_counts_in_standard_errors():
    assert moved({"a.x": (1.0, 0.1), "b.y": (2.0, 0.0)}, {"a.x": (1.3, 9.0), "b.y": (3.0, 1.0)}) == pytest.approx(3.0)
