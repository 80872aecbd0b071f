"""Opponents: what is searched, where, and a table that says where the shipped law loses."""

import math

import pytest

from microstage_ros.control.evaluation import opponents
from microstage_ros.control.evaluation.opponents import Figures, Opponent


def test_every_gain_searched_is_one_of_the_law_and_its_shipped_value_lies_inside(axis):
    for kind in opponents.OPPONENTS:
        names, bounds = opponents.bounds_of(axis, kind)
        assert len(names) == len(bounds) and all(low < high for low, high in bounds)


def test_the_search_finds_a_minimum_and_counts_its_runs(axis, monkeypatch):
    def valley(axis, kind, gains):
        return sum((math.log(gains[name]) - math.log(aim)) ** 2 for name, aim in aims.items()) + gains["friction_share"]

    aims = {"proportional": 3e5, "derivative_time": 3e-3}
    monkeypatch.setattr(opponents, "cost", valley)
    found = opponents.searched(axis, "pid_feedforward", evaluations=2000, seed=1)
    assert found.evaluations >= 2000 and found.cost < 0.05
    assert all(found.gains[name] == pytest.approx(aim, rel=0.2) for name, aim in aims.items())


def test_cost_tells_a_weak_law_from_the_shipped_one(axis):
    assert opponents.cost(axis, "pid", {}, seeds=(0,)) < opponents.cost(axis, "pid", {"proportional": 4e4}, seeds=(0,)) - 0.5


def test_the_table_prints_where_the_shipped_law_loses():
    found = [Opponent("pid", {"proportional": 3e5}, -50.0, 2000), Opponent("self_tuning_observer", {}, -57.0, 0)]
    ours, theirs = Figures(1e-8, 2e-7, 5e-9), Figures(4e-8, 1e-7, 6e-9)
    gains, table = opponents.contest_tables(found, {"nominal": {"pid": theirs, "self_tuning_observer": ours}})
    assert gains[2][0] == ["pid", "2000", "-50.00", "proportional 3e+05"] and gains[2][1][1] == "shipped"
    assert table[2] == [["nominal", "40, 100, 6", "10, 200, 5", "moving"]]
