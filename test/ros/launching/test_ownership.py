"""What a lock tells whoever looks for an axis, before anything of ROS is loaded."""

import math

from microstage_ros.commands.operator import name_live_axes
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
