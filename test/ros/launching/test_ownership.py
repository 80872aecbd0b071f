"""What a lock tells whoever looks for an axis, before anything of ROS is loaded."""

import math
from types import SimpleNamespace

from microstage_ros.commands.operator import name_live_axes
from microstage_ros.ros import client
from microstage_ros.ros.launching.ownership import Ownership, owned_namespaces, starting_for


def test_a_cell_is_starting_until_its_axis_is_active(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert starting_for("/axis") == math.inf
    owned = Ownership("cell", "/axis")
    assert starting_for("/axis") < 60.0 and owned_namespaces() == ["/axis"]
    owned.activated()
    assert starting_for("/axis") == math.inf and owned_namespaces() == ["/axis"]
    owned.release()
    assert owned_namespaces() == []


def test_live_axes_are_named_where_the_wanted_one_was_not_started_here(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    name_live_axes("/left")
    assert "no axis is live here; ./microstage cell starts one" in capsys.readouterr().err
    owned = Ownership("cell", "/axis")
    name_live_axes("/left")
    assert "live here: /axis" in capsys.readouterr().err
    name_live_axes("/axis")
    assert capsys.readouterr().err == ""
    owned.release()


def test_a_cell_that_begins_after_its_client_is_waited_for(monkeypatch):
    """The client looks for an axis that nobody has started yet; its lock appears, servers come first, the axis last."""
    seen = iter([math.inf, math.inf, 0.1, 0.2, math.inf, math.inf, 0.4, math.inf])
    said = []
    monkeypatch.setattr(client, "starting_for", lambda here: seen.__next__())
    monkeypatch.setattr(client, "STARTING_SAID", 0.0)
    monkeypatch.setattr(client.rclpy, "spin_once", lambda node, timeout_sec: None)
    axis = client.AxisClient.__new__(client.AxisClient)
    ready = iter([False, False, False, True])
    axis._starting, axis._sought, axis._prefix, axis.node = said.append, 0.0, "/axis/", None
    axis._action = SimpleNamespace(server_is_ready=lambda: next(ready))
    axis._statistics = SimpleNamespace(service_is_ready=lambda: True)
    monkeypatch.setattr(axis, "statistics", lambda: said.append("answers"))
    monkeypatch.setattr(client, "live_axes", lambda node: ["/axis"])
    axis.wait_for_server(60.0)
    assert [sentence[:19] for sentence in said] == ["the axis at /axis i", "the axis at /axis i", "answers"] and next(seen, None) is None
