"""An operator's calls: late answers count, and nothing that moves the axis is asked for twice."""

import time
import types

import pytest
import rclpy
from microstage_msgs.srv import Jog
from std_srvs.srv import Trigger

from microstage_ros.ros.client import NoAnswer
from microstage_ros.ros.operator import Operator


class Client:
    """A service that answers after ``delay`` [s] and loses the first ``lost`` answers."""

    def __init__(self, delay=0.0, lost=0):
        self.delay, self.lost, self.asked = delay, lost, 0

    def service_is_ready(self):
        return True

    def call_async(self, request):
        self.asked += 1
        lost, at = self.asked <= self.lost, time.monotonic() + self.delay
        kind = Jog.Response(accepted=True) if isinstance(request, Jog.Request) else Trigger.Response(success=True)
        return types.SimpleNamespace(done=lambda: not lost and time.monotonic() >= at, result=lambda: kind)


def operator_of(name, client, monkeypatch, wait=3.0):
    monkeypatch.setattr(rclpy, "spin_once", lambda node, timeout_sec=0.0: time.sleep(timeout_sec))
    made = object.__new__(Operator)
    made._wait, made._prefix, made.took, made.node, made._clients = wait, "/axis/", 0.0, None, {name: client}
    return made


def test_an_answer_that_takes_longer_than_a_repetition_is_taken(monkeypatch):
    client = Client(delay=0.7)
    made = operator_of("hold", client, monkeypatch)
    assert made.hold()[0] and made.took == pytest.approx(0.7, abs=0.3) and client.asked == 2


def test_a_lost_answer_is_asked_for_again(monkeypatch):
    client = Client(lost=1)
    assert operator_of("stop", client, monkeypatch).stop()[0] and client.asked == 2


def test_a_jog_whose_answer_is_lost_is_not_made_twice(monkeypatch):
    client = Client(lost=1)
    with pytest.raises(NoAnswer, match="/axis/jog: no answer within 1.2 s"):
        operator_of("jog", client, monkeypatch, wait=1.2).jog(1e-3, 1.0)
    assert client.asked == 1
    slow = Client(delay=0.7)
    assert operator_of("jog", slow, monkeypatch).jog(1e-3, 1.0).accepted and slow.asked == 1
