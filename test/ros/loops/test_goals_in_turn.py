"""Goals that wait for the move under way, a move whose states are not heard, and the way home: the move server without ROS."""

import contextlib
import threading
import time
import types
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from microstage_msgs.action import MoveTo
from microstage_msgs.msg import DriverStatus
from microstage_msgs.srv import FollowReference
from rclpy.task import Future
from std_srvs.srv import Trigger

from microstage_ros.control.trajectories.profiles import MotionLimits, move_duration
from microstage_ros.ros.loops import move_calls, move_requests
from microstage_ros.ros.loops.move_results import Readings
from microstage_ros.ros.nodes.move_server import MoveServer

THREADS = 6  # of the server's executor
RESULT = MoveTo.Result


class Server(MoveServer):
    """A move server whose controller answers through the executor's threads, as rclpy has it."""

    def __init__(self):
        self.pool, self.asked, self.heard = ThreadPoolExecutor(THREADS), [], True
        self.parameters = types.SimpleNamespace(max_velocity=6e-3, max_acceleration=0.15, max_jerk=15.0, driver_timeout_s=5.0,
                                                silence_timeout_s=0.4, pause_s=0.0, window=100, idle_window=1000)
        self._changed, self._turn, self._cell_says, self._move = threading.Condition(), threading.Lock(), "", None
        self._numbered, self._newest_goal, self._introduced, self._held_since, self._talking, self._stale = 0, 0, True, None, False, -1
        self._status = DriverStatus(active=True, period=1e-4, minimum=-0.025, maximum=0.025)
        self._sequence, self._latest, self._heard = 1, (1, 0.0, 0.0, 1), time.monotonic()
        self._granter = types.SimpleNamespace(until=10, grant=lambda *_: None)
        self._follow = types.SimpleNamespace(call_async=self._answer, remove_pending_request=lambda future: None)
        self._ended = threading.Event()
        threading.Thread(target=self._hear, daemon=True).start()

    def _answer(self, request):
        answer, count = Future(), len(request.positions)
        self.asked.append(count)
        response = FollowReference.Response(accepted=True, start_sequence=self._sequence + 1, rest_sequence=self._sequence + max(count, 80))
        threading.Timer(2e-3, self._take, (answer, response)).start()
        return answer

    def _take(self, answer, response):
        with contextlib.suppress(RuntimeError):  # the test has ended
            self.pool.submit(answer.set_result, response)

    def _hear(self):
        while not self._ended.wait(5e-3):
            with self._changed:
                self._sequence += 50
                if self.heard:
                    self._latest, self._heard = (self._sequence, 0.0, 0.0, 1), time.monotonic()
                    if self._move is not None and not self._move.done:
                        self._move.update(self._sequence, 0.0)
                    self._changed.notify_all()

    def get_logger(self):
        return types.SimpleNamespace(error=print, warning=print)

    def end(self):
        self._ended.set()
        self.pool.shutdown()

    __hash__ = object.__hash__


@pytest.fixture
def server(monkeypatch):
    monkeypatch.setattr(move_calls, "running", lambda: True)
    made = Server()
    yield made
    made.end()


@pytest.mark.parametrize("goals", [3, THREADS, 3 * THREADS])
def test_goals_that_come_together_leave_a_thread_for_the_controllers_answer(server, goals):
    """Six waiting goals held all threads for 5 s: the first was a fault, and no hold, cancel or status was served."""
    def move(number):
        return server._make_move(number, MoveTo.Goal(target=1e-3, timeout=1.0), lambda: False, lambda *_: None)

    made = [server.pool.submit(move, server._number()) for _ in range(goals)]
    codes = [each.result(60.0).code for each in made]
    assert codes[:-1] == [RESULT.CODE_SUPERSEDED] * (goals - 1) and codes[-1] in (RESULT.CODE_REACHED, RESULT.CODE_TIMEOUT)


def test_a_move_whose_states_are_not_heard_is_stopped(server):
    """It ended as a fault, and the plan went on for seconds."""
    threading.Timer(0.3, lambda: setattr(server, "heard", False)).start()
    result = server._make_move(server._number(), MoveTo.Goal(target=2e-2, timeout=60.0), lambda: False, lambda *_: None)
    assert result.code == RESULT.CODE_FAULT and "nothing has been heard" in result.message
    assert server.asked[0] > 10_000 and server.asked[-1] == 0


@pytest.mark.parametrize("place", [0.2, 1e-3])
def test_the_way_home_has_the_time_that_it_takes(server, monkeypatch, place):
    aside = []
    monkeypatch.setattr(server, "_move_aside", aside.append)
    monkeypatch.setattr(move_requests.MoveRequests, "_why_not", lambda self: "")
    server._ended.set()
    server._latest = (1, place, place, 1)
    answer = server._serve_home(Trigger.Request(), Trigger.Response())
    p = server.parameters
    takes = move_duration(place, MotionLimits(p.max_velocity, p.max_acceleration, p.max_jerk))
    assert answer.success and aside[0].timeout > takes + 4.0 and aside[0].target == 0.0


def test_there_is_no_way_home_where_home_is_out_of_the_travel(server, monkeypatch):
    monkeypatch.setattr(server, "_move_aside", lambda goal: pytest.fail("it moves"))
    monkeypatch.setattr(move_requests.MoveRequests, "_why_not", lambda self: "")
    server._status.minimum = 1e-3
    answer = server._serve_home(Trigger.Request(), Trigger.Response())
    assert not answer.success and "0 m is out of the travel, 0.001 to 0.025 m" in answer.message


@pytest.mark.parametrize("periods, waits", [(np.zeros(5, np.int64), False), (np.arange(5), True)])
def test_readings_without_control_periods_are_not_waited_for(server, periods, waits):
    """Those of an instrument of its own: every move was answered 0.4 s late for them."""
    server._readings, server._interferometer = Readings(), types.SimpleNamespace(publishers=1)
    server._readings.extend(periods, np.ones(5))
    began = time.monotonic()
    assert np.isnan(server._interferometer_error(types.SimpleNamespace(window=(50_000, 60_000), target=0.0)))
    assert (time.monotonic() - began > 0.3) == waits
