"""health_monitor beside a cell: it learns, publishes `health`, and diagnoses what it saw."""

import contextlib
import json
import sqlite3
from collections import deque
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from microstage_msgs.action import Investigate, MoveTo
from microstage_msgs.msg import ControllerState, Health
from rclpy.action import ActionClient
from ros_support import ros_node, spin_until

from microstage_ros.diagnosis.result import VERDICTS
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.ros.client import AxisClient
from microstage_ros.ros.launching.cell_processes import CellProcesses
from microstage_ros.ros.nodes import health_monitor
from microstage_ros.ros.transport.topics import LATCHED

NODES = ("axis_driver", "str_controller", "move_server", "health_monitor")
FAST = {"window": 2.0, "healthy_windows": 8}


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    folder = tmp_path_factory.mktemp("health")
    parameters = {
        "axis_driver": {"seed": 3, "command_timeout_lockstep_s": 60.0},
        "health_monitor": {**FAST, "directory": str(folder / "found"), "store": str(folder / "history.sqlite")},
    }
    with ros_node() as node, CellProcesses("/axis", NODES, parameters, logs=folder / "logs") as cell:
        cell.activate(node)
        yield node, AxisClient("/axis", node, wait=60.0), folder


def test_it_learns_watches_and_investigates(running):
    node, client, folder = running
    heard = []
    node.create_subscription(Health, "/axis/health", heard.append, LATCHED)
    place = 0.0
    for _ in range(200):
        place = 4.0e-3 - place
        client.move(place, max_velocity=4.0e-3, settle_time=0.02, timeout=20.0)
        if heard and heard[-1].state == Health.STATE_WATCHING:
            break
    last = heard[-1]
    assert (
        last.state == Health.STATE_WATCHING and last.healthy_windows == 8 and set(last.channel) >= {"torque", "windup"}
    )
    assert not any(last.alarm) and all(0.0 <= score < 1.0 for score in last.score)
    assert [h.state for h in heard][0] == Health.STATE_LEARNING
    with contextlib.closing(sqlite3.connect(folder / "history.sqlite")) as history:
        (begins,) = history.execute("SELECT MIN(time) FROM health").fetchone()
    first = next(h.header.stamp for h in heard if h.state == Health.STATE_WATCHING)
    assert begins == pytest.approx(first.sec + 1e-9 * first.nanosec - FAST["window"], abs=1e-6)  # as the command keeps it
    result = investigate(node, directory=str(folder / "report"))
    assert result.done and result.verdict in VERDICTS, result.message
    report = json.loads(Path(result.report).read_text(encoding="utf-8"))
    assert report["verdict"] == result.verdict and [cause["id"] for cause in report["causes"]] == list(result.cause)


def test_it_moves_within_the_limits_it_was_given(running):
    node, client, _ = running
    places = []
    node.create_subscription(ControllerState, "/axis/controller_state", lambda m: places.append(m.reference), 1000)
    client.move(0.0)
    spin_until(node, lambda: places and abs(places[-1]) < 1.0e-9)  # what was published before the end comes late
    places.clear()
    result = investigate(node, travel_min=-5.0e-4, travel_max=5.0e-4, duration=1.0, seed=5)
    assert "moves between" in result.message or "windows of motion" in result.message, result.message
    assert (
        len(places) > 100 and min(places) >= -5.0e-4 - 1e-9 and max(places) <= 5.0e-4 + 1e-9 and np.ptp(places) > 1.0e-5
    )


def test_limits_beyond_the_axis_are_refused_with_the_reason(running):
    result = investigate(running[0], travel_min=-1.0, travel_max=1.0)
    assert not result.done and "travel_min" in result.message


def investigate(node, **goal):
    """Result of the action for a goal."""
    action = ActionClient(node, Investigate, "/axis/investigate")
    spin_until(node, action.server_is_ready)
    sent = action.send_goal_async(Investigate.Goal(**goal))
    spin_until(node, sent.done)
    found = sent.result().get_result_async()
    spin_until(node, found.done, 240.0)
    action.destroy()
    return found.result().result


@pytest.mark.parametrize("moved", [0, 5])
def test_moves_that_a_limit_ends_lose_no_window(monkeypatch, tmp_path, moved):
    """With a limit of 0.2 V the first move ended, what had been seen before was gone, and the message asked for limits, which had been
    given."""
    seen = []

    def diagnosed(axis, windows, *_):
        seen.extend(windows)
        if len(windows) < health_monitor.LEAST_WINDOWS:
            raise InputError("investigate: windows of motion", len(windows), "more of them")
        return {"verdict": "agrees", "causes": []}

    def moves(*_):
        monitor._kept.extend(["moved"] * moved)
        return "ended: the command reached 0.4 V"

    monkeypatch.setattr(health_monitor, "diagnose_windows", diagnosed)
    request = Investigate.Goal(travel_min=-5e-4, travel_max=5e-4, voltage_max=0.2, directory=str(tmp_path))
    monitor = SimpleNamespace(_axis=load_axis(config_file("axis.yaml")), _kept=deque(["before"] * 6), _make_moves=moves,
                              _tell=lambda *_: None, parameters=SimpleNamespace(baseline="", directory=str(tmp_path)))
    goal, result = SimpleNamespace(request=request, is_cancel_requested=False), Investigate.Result()
    assert health_monitor.HealthMonitor._find_cause(monitor, goal, result) == "ended: the command reached 0.4 V"
    assert seen.count("before") == (6 if moved < health_monitor.LEAST_WINDOWS else 0) and result.verdict == "agrees"
    monitor._kept.clear()
    with pytest.raises(InputError, match="ended: the command reached 0.4 V"):
        monitor._make_moves = lambda *_: "ended: the command reached 0.4 V"
        health_monitor.HealthMonitor._find_cause(monitor, goal, result)


class Moves:
    """Stands in for the action's client: each move ends with the next of ``codes``."""

    def __init__(self, *codes):
        self.codes, self.goals, self.cancelled = list(codes), [], 0

    def wait_for_server(self, seconds):
        return True

    def send_goal_async(self, goal, goal_uuid=None):
        self.goals.append(goal)
        code = self.codes.pop(0)
        result = SimpleNamespace(result=MoveTo.Result(code=code or 0, message="as the operator asked"))
        return done(SimpleNamespace(get_result_async=lambda: done(result, ended=code is not None), cancel_goal_async=self._cancel))

    def _cancel(self):
        self.cancelled += 1


def done(value, ended=True):
    return SimpleNamespace(done=lambda: ended, result=lambda: value)


def moving(moves, **more):
    """A monitor that makes ``moves``, and the goal of an investigation."""
    monitor = SimpleNamespace(_move=moves, _largest=0.0, _stroke=0.02, _in_turn=SimpleNamespace(call=lambda what: what()), _tell=lambda *_: None)
    monitor._one_move = lambda *what: health_monitor.HealthMonitor._one_move(monitor, *what)
    return monitor, SimpleNamespace(is_cancel_requested=False, **more)


LIMITS = health_monitor.Limits(-5.0e-3, 5.0e-3, 6.0)


@pytest.mark.parametrize("code", [MoveTo.Result.CODE_FAULT, MoveTo.Result.CODE_SUPERSEDED, MoveTo.Result.CODE_REFUSED, MoveTo.Result.CODE_CANCELLED])
def test_a_stop_or_a_hold_of_the_operator_ends_the_moves(code):
    """The next move began at once after a hold, and again after a reset; refused ones were counted as made."""
    moves = Moves(MoveTo.Result.CODE_REACHED, MoveTo.Result.CODE_TIMEOUT, code)
    monitor, goal = moving(moves)
    said = health_monitor.HealthMonitor._make_moves(monitor, goal, LIMITS, Investigate.Goal(duration=60.0))
    assert said.startswith("2 moves; ended: the move to ") and "as the operator asked" in said and len(moves.goals) == 3


def test_a_move_has_the_time_that_its_length_takes():
    moves = Moves(*[MoveTo.Result.CODE_REACHED] * 40, MoveTo.Result.CODE_FAULT)
    monitor, goal = moving(moves)
    health_monitor.HealthMonitor._make_moves(monitor, goal, LIMITS, Investigate.Goal(duration=60.0))
    lengths = np.abs(np.diff([-0.015, *(move.target for move in moves.goals)]))
    assert all(move.timeout > length / move.max_velocity + 5.0 for move, length in zip(moves.goals, lengths, strict=True))
    assert max(lengths / [move.max_velocity for move in moves.goals]) > 10.0  # the default would have ended these


def test_a_cancelled_investigation_cancels_its_move():
    moves = Moves(None)
    monitor, goal = moving(moves)
    monitor._tell = lambda *_: setattr(goal, "is_cancel_requested", True)
    assert health_monitor.HealthMonitor._make_moves(monitor, goal, LIMITS, Investigate.Goal(duration=60.0)) == "0 moves; ended: cancelled"
    assert moves.cancelled == 1
