"""The six nodes as six processes: moves, cancels, refusals, the bag."""

import json
import math
import os
import re
import time
from types import SimpleNamespace

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from microstage_msgs.action import MoveTo
from microstage_msgs.msg import DriverStatus, InterferometerReading
from microstage_msgs.srv import FollowReference, Move
from rclpy.action import GoalResponse
from rclpy.task import Future
from ros_support import ask, ros_node, spin_until

from microstage_ros.records.bags.bag import read_bag
from microstage_ros.records.bags.bag_reader import Bag
from microstage_ros.ros.client import AxisClient, NoAnswer
from microstage_ros.ros.launching.cell_processes import NODES, CellProcesses
from microstage_ros.ros.nodes.move_server import MoveServer, Refused
from microstage_ros.ros.transport.servo_path import RCLError
from microstage_ros.ros.transport.topics import LATCHED

RESULT = MoveTo.Result
SETTLE = {"settle_time": 0.02, "timeout": 2.0}


class Running:
    """A running cell, its client, and what was done with it."""

    def __init__(self, cell, node, client, bag):
        self.cell, self.node, self.client, self.bag = cell, node, client, bag


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cell")
    parameters = {"bag_recorder": {"directory": str(folder / "bag"), "run": "{purpose: test}"},
                  "move_server": {"pause_s": 600.0}, "axis_driver": {"seed": 7, "command_timeout_lockstep_s": 60.0}}
    with ros_node() as node, CellProcesses("/axis", parameters=parameters, logs=folder / "logs") as cell:
        cell.activate(node)
        yield Running(cell, node, AxisClient("/axis", node, wait=60.0), folder / "bag")


def test_six_processes(running):
    pids = {process.pid for process in running.cell.processes.values()}
    assert len(pids) == len(NODES) == 6 and os.getpid() not in pids


def test_action_moves_and_gives_feedback(running):
    seen = []
    result = running.client.move(1e-5, seen.append, **SETTLE)
    assert result.reached and result.code == RESULT.CODE_REACHED
    assert abs(result.final_error) <= 5e-8 and abs(result.interferometer_error) <= 8e-8
    assert 0.0 < result.settling_time < 0.5 and result.end_sequence > result.start_sequence
    assert seen and all(abs(f.position + f.error - 1e-5) < 1e-12 for f in seen)


def test_service_makes_the_same_move(running):
    answer = ask(running.node, Move, "/axis/move", Move.Request(target=0.0, **SETTLE))
    assert answer.reached and abs(answer.final_error) <= 5e-8


def test_cancel_stops_within_20_ms_and_holds(running):
    sequences = []
    running.node.create_subscription(InterferometerReading, "/axis/interferometer",
                                     lambda m: sequences.append((m.sequence, m.position)), 1000)
    asked = []

    def moving_fast():
        if not asked and sequences and sequences[-1][1] > 1e-4:
            asked.append(sequences[-1][0])
        return bool(asked)

    result = running.client.move(1e-3, cancel=moving_fast, max_velocity=1e-3, **SETTLE)
    assert result.code == RESULT.CODE_CANCELLED and not result.reached
    period, place, rest = (float(text) for text in re.fullmatch(
        r"cancelled in period (\d+); the reference rests at (\S+) m from period (\d+) on", result.message).groups())
    assert 0 < (rest - period) * 1e-4 <= 0.020
    assert 1e-4 < place < 9.9e-4
    running.client.move(0.0, **SETTLE)  # time goes on, past a window in which it held
    spin_until(running.node, lambda: sequences[-1][0] > rest + 200)
    track = np.array([position for sequence, position in sequences if rest + 100 <= sequence <= rest + 110])
    assert len(track) and np.abs(track - place).max() < 5e-6


def test_new_goal_supersedes_the_one_under_way(running):
    goal = MoveTo.Goal(target=-1e-3, max_velocity=1e-4, settle_time=0.02, timeout=60.0)  # ten seconds of simulated time
    first = running.client._action.send_goal_async(goal)
    spin_until(running.node, first.done)
    first_result = first.result().get_result_async()
    result = running.client.move(0.0, **SETTLE)
    spin_until(running.node, first_result.done)
    assert first_result.result().result.code == RESULT.CODE_SUPERSEDED
    assert "newer goal" in first_result.result().result.message
    assert result.reached


def test_the_later_goal_counts_even_if_it_begins_first(running, monkeypatch):
    """A thread that is held up begins a goal after a newer one: it must not stop that one, nor move at all."""
    server, begun = MoveServer(), []
    monkeypatch.setattr(server, "_check", lambda request: None)
    watched = server._move = SimpleNamespace(done=False)  # of a goal that is newer than both
    monkeypatch.setattr(server, "_begin", lambda request: begun.append(request) or SimpleNamespace())
    monkeypatch.setattr(server, "_watch", lambda *_: None)
    monkeypatch.setattr(server, "_fill", lambda result, move: None)
    first, second = MoveTo.Goal(target=1e-3), MoveTo.Goal(target=2e-3)
    for request in (first, second):
        assert server._number_goal(request) == GoalResponse.ACCEPT
    results = [server._make_move(server._numbers[id(request)], request, lambda: False, lambda *_: None)
               for request in (second, first)]
    assert begun == [second] and results[1].code == RESULT.CODE_SUPERSEDED and "newer goal" in results[1].message
    assert results[0].code != RESULT.CODE_SUPERSEDED
    assert not watched.done, "a goal that never began must end its own move alone"
    server.destroy_node()


def test_a_move_server_that_fails_in_a_move_says_so_and_stops_the_axis(running, monkeypatch):
    """Left to rclpy, the result of a failed callback is one of zeros, whose code says that the target was reached."""
    server, asked = MoveServer(), []
    monkeypatch.setattr(server, "_check", lambda request: None)
    monkeypatch.setattr(server, "_begin", lambda request: SimpleNamespace(done=False))
    monkeypatch.setattr(server, "_watch", lambda *_: 1 / 0)
    server._follow = SimpleNamespace(call_async=asked.append)
    request = MoveTo.Goal(target=1e-3)
    server._number_goal(request)
    result = server._make_move(server._numbers[id(request)], request, lambda: False, lambda *_: None)
    assert result.code == RESULT.CODE_FAULT and "division by zero" in result.message and not result.reached
    assert [len(stop.positions) for stop in asked] == [0]
    server.destroy_node()


def lose_first(monkeypatch, action, names, request):
    """The first call of each of ``names`` gets no answer; ``request``: because it is lost itself. Calls made, by name."""
    calls = dict.fromkeys(names, 0)

    def losing(name, ask):
        def call(*arguments, **options):
            calls[name] += 1
            if calls[name] > 1:
                return ask(*arguments, **options)
            if not request:
                ask(*arguments, **options)  # its answer reaches nobody
            return Future()

        return call

    for name in names:
        monkeypatch.setattr(action, name, losing(name, getattr(action, name)))
    monkeypatch.setattr("microstage_ros.ros.client.ASK_AGAIN", 0.5)
    monkeypatch.setattr("microstage_ros.ros.client.RESULT_AGAIN", 0.5)
    return calls


def made(client):
    """Moves that the server has counted."""
    return sum(row.count for row in client.statistics())


@pytest.mark.parametrize("request_is_lost", [True, False])
def test_a_move_whose_answers_are_lost_is_made_once(running, monkeypatch, request_is_lost):
    """The middleware may lose a request or an answer; a goal is sent again under its own identity."""
    running.client.move(0.0, **SETTLE)
    before = made(running.client)
    calls = lose_first(monkeypatch, running.client._action, ("send_goal_async", "_get_result_async"), request_is_lost)
    result = running.client.move(3e-6, **SETTLE)
    assert result.reached and result.end_sequence > result.start_sequence
    assert min(calls.values()) >= 2, "nothing was lost"
    assert made(running.client) == before + 1


def test_a_cancel_whose_request_is_lost_is_asked_for_again(running, monkeypatch):
    running.client.move(0.0, **SETTLE)
    calls = lose_first(monkeypatch, running.client._action, ("_cancel_goal_async",), request=True)
    seen = []
    result = running.client.move(1e-3, seen.append, cancel=lambda: len(seen) > 0, max_velocity=1e-5)
    assert result.code == RESULT.CODE_CANCELLED and calls["_cancel_goal_async"] >= 2


def test_a_move_that_the_server_does_not_know_has_no_result(running, monkeypatch):
    """The middleware answers such a question with zeros."""
    answer, sent = Future(), Future()
    answer.set_result(SimpleNamespace(status=GoalStatus.STATUS_UNKNOWN, result=RESULT()))
    sent.set_result(SimpleNamespace(get_result_async=lambda: answer))
    monkeypatch.setattr(running.client, "send", lambda *_: sent)
    with pytest.raises(NoAnswer, match="does not know this move"):
        running.client.move(1e-6)


def test_feedback_that_cannot_be_sent_ends_no_move(running, monkeypatch):
    server = MoveServer()

    def refuse(_):
        raise RCLError("cannot publish data")

    def move(number, request, cancelled, feedback):
        feedback(0.0, 0.0, 1)
        return RESULT(code=RESULT.CODE_REACHED, reached=True)

    monkeypatch.setattr(server, "_make_move", move)
    request, ended = MoveTo.Goal(target=1e-3), []
    server._number_goal(request)
    goal = SimpleNamespace(request=request, publish_feedback=refuse, succeed=lambda: ended.append(1), is_cancel_requested=False)
    assert server._execute(goal).reached and ended
    server.destroy_node()


@pytest.mark.parametrize("positions", [[], [0.0, 1e-9]])
def test_a_lost_answer_of_the_controller_ends_no_move(running, monkeypatch, positions):
    """The middleware may lose an answer, the first to a process that it has just found most of all: asked again."""
    server, asked = MoveServer(), []
    monkeypatch.setattr("microstage_ros.ros.loops.move_calls.PLAN_AGAIN", 0.1)
    server._status, server._heard = DriverStatus(lockstep=False), time.monotonic()

    def call(request):
        asked.append(len(request.positions))
        future = Future()
        if answered_after is not None and len(asked) > answered_after:
            future.set_result("answer")
        return future

    server._follow = SimpleNamespace(call_async=call, remove_pending_request=lambda _: None)
    answered_after = 2
    assert server._ask(FollowReference.Request(positions=positions)) == "answer" and server._introduced
    assert asked == [len(positions)] * 3
    asked.clear()
    answered_after = None
    server._heard = time.monotonic()
    with pytest.raises(Refused, match=r"does not answer: asked \d+ times in 0\.\d s, its last state came 0\.\d s ago"):
        server._ask(FollowReference.Request(positions=positions))
    assert len(asked) > 1 and (asked[-1] == 0), "a stop follows a plan that may have been heard"
    asked.clear()
    server._status, server._heard = DriverStatus(fault=3, message="the cable"), time.monotonic()
    with pytest.raises(Refused, match="the driver stopped the axis: the cable"):
        server._ask(FollowReference.Request(positions=positions))
    server.destroy_node()


@pytest.mark.parametrize("field, value, words", [
    ("target", 1.0, "-0.025 to 0.025"), ("target", math.nan, "target"), ("tolerance", 0.0, "tolerance"),
    ("tolerance", -1e-8, "tolerance"), ("timeout", math.inf, "timeout"), ("settle_time", math.nan, "settle_time"),
    ("settle_time", 1e9, "settle_time"),
    ("max_velocity", -1.0, "max_velocity")])
def test_refusals_name_the_reason(running, field, value, words):
    options = {**SETTLE, field: value}
    result = running.client.move(options.pop("target", 0.0), **options)
    assert result.code == RESULT.CODE_REFUSED and not result.reached
    assert words in result.message and field in result.message
    answer = ask(running.node, Move, "/axis/move", Move.Request(**{"target": 0.0, **SETTLE, field: value}))
    assert not answer.reached and answer.message == result.message


def test_statistics(running):
    rows = {round(row.target, 9): row for row in running.client.statistics()}
    assert rows[1e-5].count >= 1 and rows[1e-5].interferometer
    assert abs(rows[1e-5].mean_error) < 8e-8 and math.isnan(rows[1e-5].four_sigma)  # one move has no spread


def test_status_is_latched(running):
    found = []
    running.node.create_subscription(DriverStatus, "/axis/driver_status", found.append, LATCHED)
    spin_until(running.node, lambda: found)
    assert found[-1].active and found[-1].simulated and found[-1].period == 1e-4 and found[-1].maximum == 0.025


def test_inactive_driver_is_a_refusal_and_the_bag_is_whole(running):
    """Last, because it stops the cell."""
    running.cell.deactivate(running.node)
    result = running.client.move(1e-6, **SETTLE)
    assert result.code == RESULT.CODE_REFUSED and "not active" in result.message
    assert ask(running.node, ChangeState, "/axis/axis_driver/change_state", ChangeState.Request(
        transition=Transition(id=Transition.TRANSITION_ACTIVATE))).success
    assert running.client.move(2e-6, **SETTLE).reached  # it goes on from where it is
    running.client.wait_until_still()
    running.cell.stop()
    streams = read_bag(running.bag)
    assert not streams["/axis/driver_status"]["active"][-1]  # the last word of the driver
    state, command = streams["/axis/state"], streams["/axis/command"]
    assert np.array_equal(state["sequence"], np.arange(len(state))) and len(state) > 3000
    assert np.array_equal(command["sequence"], state["sequence"])
    held = state["applied_voltage"][1:] == np.clip(command["voltage"][:-1], -6.0, 6.0)
    assert (~held).sum() <= 1 and (state["applied_voltage"][1:][~held] == 0.0).all()  # where it was deactivated
    for name in ("controller_state", "friction", "interferometer", "simulation"):
        assert np.array_equal(np.diff(streams[f"/axis/{name}"]["sequence"]), np.full(len(streams[f"/axis/{name}"]) - 1, 10))
    facts = Bag(running.bag).custom_data
    assert facts["seed"] == "7" and facts["purpose"] == "test" and "format: 1" in facts["axis_file"]
    for name in NODES:
        assert isinstance(json.loads(facts[f"parameters /axis/{name}"]), dict)
    assert facts["missing_messages"] == "{}"
    _other_readers_open_it(running.bag, len(state))


def _other_readers_open_it(folder, count):
    from mcap_ros2.reader import read_ros2_messages
    from rosbags.highlevel import AnyReader

    with AnyReader([folder]) as reader:
        connections = [c for c in reader.connections if c.topic == "/axis/state"]
        assert connections[0].msgcount == count
        _, _, raw = next(reader.messages(connections=connections))
        assert reader.deserialize(raw, connections[0].msgtype).sequence == 0
    first = next(iter(read_ros2_messages(str(next(folder.glob("*.mcap"))), topics=["/axis/state"])))
    assert first.ros_msg.sequence == 0
