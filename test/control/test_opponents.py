"""Opponents: what is searched, where, and a table that says where the shipped law loses."""

import math

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from microstage_ros.control.evaluation import opponents, repetition
from microstage_ros.control.evaluation.opponents import Figures, Opponent
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.robustness.conditions import Condition

OBSERVING = ("cascade_disturbance", "disturbance_rejection", "sliding_mode", "linear_quadratic")


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


def test_the_extended_state_observer_has_a_triple_pole(axis):
    period, rate = axis.value("period"), 700.0
    gain = controller_parameters("disturbance_rejection", axis, {"observer_rate": rate})["rejection"]["gain"]
    model = np.array([[1.0, period, 0.5 * period**2], [0.0, 1.0, period], [0.0, 0.0, 1.0]])
    closed = model - np.outer(gain, model[0])
    pole = math.exp(-rate * period)
    scale = np.diag([1.0, period, period**2])                    # so that the three states are of one size
    characteristic = np.poly(scale @ closed @ np.linalg.inv(scale))
    assert characteristic == pytest.approx(np.poly([pole] * 3), rel=1e-9)


def test_the_quadratic_regulator_solves_its_riccati_equation(axis):
    """x'' = u with the weight w^4 on the error and 1 on u: u = -w^2 x - sqrt(2) w x'."""
    rate = 150.0
    record = controller_parameters("linear_quadratic", axis, {"regulator_rate": rate})["quadratic"]
    weight = np.diag([rate**4, 0.0])
    found = solve_continuous_are(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), weight, np.eye(1))[1]
    assert found == pytest.approx([rate**2, math.sqrt(2.0) * rate], rel=1e-6)
    assert record["gain"][0, 0] < 1.0 and (record["gain"][2] < 0.0).all()     # a stage ahead of the model is braked less


@pytest.mark.parametrize("kind", OBSERVING)
def test_they_end_their_moves_at_the_target_and_hold_a_force(axis, kind):
    """Of the program's moves none ends more than 0.1 um off, also on a tilted axis, which the file does not know."""
    for condition in (None, Condition("tilt", effects={"gravity_tilt": {"angle_rad": 0.02}})):
        error, starts, period = opponents.run_program(axis, kind, {}, 7, condition)
        assert max(abs(part[-1]) for part in np.split(error, starts)[1:]) < 1e-7


@pytest.mark.parametrize("kind", repetition.KINDS)
def test_what_repeats_is_learned(kind):
    """A lag of 5 ms at 100 um/V, disturbed by the same 50 mV in every round."""
    period, rows = 1e-3, 2000
    time = np.arange(rows) * period
    push = 0.05 * np.sin(2 * math.pi * time / time[-1]) ** 2

    class Cell:
        limit, at = 6.0, 0.0

        def __call__(self, reference, added, anew):
            self.at = 0.0 if anew else self.at
            place = np.empty(len(reference))
            for n in range(len(reference)):
                place[n] = self.at
                self.at += period / 5e-3 * (1e-4 * (added[n] + push[n]) - self.at)
            return place, place

    gains = {"learn_proportional": 5e3, "learn_damping": 10.0, "learn_lead": 5e-3, "learn_cutoff": 40.0}
    error = [np.abs(repetition.run_trials(kind, Cell(), np.zeros(rows), 0, gains, period, trials)).max() for trials in (1, 8)]
    assert error[0] == pytest.approx(5e-6, rel=0.02) and error[1] < 0.1 * error[0]
