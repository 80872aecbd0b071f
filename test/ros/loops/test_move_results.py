"""What the move server keeps of its moves does not grow."""

import math

import numpy as np
from rclpy.action import ActionServer

from microstage_ros.ros.loops.move_results import RESULT_KEPT_S, Results
from microstage_ros.ros.nodes import move_server


def test_the_newest_moves_by_distance_in_memory_of_one_size():
    results = Results(most=4)
    assert results.by_distance() == {}
    size = results._table.nbytes
    for k, distance in enumerate((5e-6, 1e-6, 1e-6 + 1e-13, -1e-6, 2e-6, 2e-6)):
        results.add(distance, float(k), math.nan, 0.1 * k)
    found = results.by_distance()
    assert results._table.nbytes == size and sorted(found) == [-1e-6, 1e-6, 2e-6]  # the first two have gone
    assert found[2e-6][:, 0].tolist() == [4.0, 5.0] and found[1e-6][:, 0].tolist() == [2.0]
    assert np.allclose(found[2e-6][:, 2], [0.4, 0.5])
    results.clear()
    assert results.by_distance() == {}


def test_results_of_goals_are_not_kept_for_long(node, monkeypatch):
    """The action server kept every goal for a quarter of an hour: a megabyte for 78 moves."""
    kept = {}

    class Watched(ActionServer):
        def __init__(self, *args, result_timeout=900, **options):
            kept["seconds"] = result_timeout
            super().__init__(*args, result_timeout=result_timeout, **options)

    monkeypatch.setattr(move_server, "ActionServer", Watched)
    made = move_server.MoveServer()
    try:
        assert kept["seconds"] == RESULT_KEPT_S < 100.0
    finally:
        made.destroy_node()
