"""Settling, overshoot and error of a move, on made-up tracks."""

import math

import numpy as np
import pytest

from microstage_ros.control.trajectories.move import MOVING, SETTLING, Move, check_move
from microstage_ros.quantities.errors import InputError

PERIOD = 1e-3


def watched(track, **changes):
    """A move over 1 (in whatever unit) whose encoder followed ``track``, one value per period."""
    facts = {"start": 0.0, "target": 1.0, "tolerance": 0.1, "settle_time": 0.005, "timeout": 0.1, "start_sequence": 0,
             "rest_sequence": 10, "period": PERIOD, **changes}
    move = Move(**facts)
    for sequence, position in enumerate(track):
        move.update(sequence, position)
    return move


def test_settled_after_the_last_entry():
    track = np.r_[np.linspace(0, 1, 11), 1.2, 1.05, np.full(30, 0.98)]
    move = watched(track)
    assert move.reached and move.settling_time == pytest.approx(0.012)
    assert move.end_sequence == 17 and move.overshoot == pytest.approx(0.2)
    assert move.final_error == pytest.approx(np.mean([0.05] + [-0.02] * 5))


def test_the_settle_time_begins_at_rest():
    move = watched(np.full(100, 1.0))
    assert move.end_sequence == 15 and move.settling_time == 0.0


def test_timeout():
    move = watched(np.zeros(200))
    assert move.done and not move.reached and move.end_sequence == 101 and math.isnan(move.final_error)


def test_backward_move_overshoots_downwards():
    move = watched(-np.r_[np.linspace(0, 1, 11), 1.3, np.full(30, 1.0)], target=-1.0)
    assert move.reached and move.overshoot == pytest.approx(0.3)


def test_phases():
    move = watched([])
    assert move.phase(9) == MOVING and move.phase(10) == SETTLING


@pytest.mark.parametrize("changes, words", [
    ({"target": 2.0}, "target: got 2.0, expected a position from -1.0 to 1.0"), ({"target": math.nan}, "target"),
    ({"tolerance": 0.0}, "tolerance: got 0.0"), ({"timeout": math.inf}, "timeout"), ({"settle_time": -1.0}, "settle_time")])
def test_refusals(changes, words):
    facts = {"target": 0.5, "tolerance": 1e-3, "settle_time": 0.1, "timeout": 1.0, **changes}
    with pytest.raises(InputError, match=words):
        check_move(**facts, travel=(-1.0, 1.0))
