"""Every move is answered: by the move server, or by the client itself where that answer is overdue."""

import threading
from types import SimpleNamespace

from microstage_msgs.msg import CellStatus, ControllerState

from microstage_ros.ros import client as client_module
from microstage_ros.ros.client import AxisClient
from microstage_ros.ros.nodes.move_server import MoveServer


def test_a_client_does_not_wait_for_ever_when_driver_or_controller_has_ended(monkeypatch):
    """Two of 120 goals were never answered after a kill of driver or controller."""
    client = object.__new__(AxisClient)
    client._prefix, client._cell, client._gone = "/axis/", None, None
    running, ended = CellStatus.STATE_RUNNING, CellStatus.STATE_ENDED
    names = ["axis_driver", "str_controller", "gms_observer"]
    client._on_cell_status(CellStatus(names=names, states=[running, running, ended]))
    monkeypatch.setattr(client_module, "OVERDUE", -1.0)
    assert client.lost(None) == ""  # an observer is started again
    client._on_cell_status(CellStatus(names=names, states=[running, ended, running]))
    assert "str_controller" in client.lost(None) and "zero volts" in client.lost(None)
    monkeypatch.setattr(client_module, "OVERDUE", 1e6)
    assert client.lost(None) == ""  # the move server has its time
    client._on_cell_status(CellStatus(names=names, states=[running, running, running]))
    monkeypatch.setattr(client_module, "OVERDUE", -1.0)
    assert client.lost(None) == ""  # another cell


def test_a_plan_that_was_refused_begins_where_the_controller_says_that_it_rests():
    """At 10 kHz under load the last state heard was 1 um behind the reference, and a move was refused twice."""
    given, asked, nothing = [], [], SimpleNamespace(max_velocity=1e-3, max_acceleration=1.0, max_jerk=1.0)
    server = SimpleNamespace(parameters=nothing, _changed=threading.Condition(), _stale=-1, _cell_says="", _patience=1.0,
                             _latest=(5, 1e-3, 1e-3, ControllerState.MODE_HOLDING), _check_alive=lambda: None,
                             _move="the move", _rest=None, _introduced=False, _ask=asked.append)

    def stop(feedback):
        server._rest = 2e-3

    def hand_over(request, limits, here=None):
        given.append(here)
        return SimpleNamespace(accepted=here == 2e-3, message="")

    server._stop, server._hand_over = stop, hand_over
    assert MoveServer._begin(server, nothing) == "the move" and given == [None, 2e-3]
    assert [len(request.positions) for request in asked] == [0]  # a first answer, which the middleware may lose
