"""A bag names its message types; only what the ROS index of installed packages declares is imported for it."""

import sys

import pytest

pytest.importorskip("rclpy")

from microstage_ros.commands.messages.replay import message_class_of  # noqa: E402


def test_a_declared_message_is_found():
    assert message_class_of("std_msgs/msg/String").__name__ == "String"


@pytest.mark.parametrize("kind", ["evil/msg/Payload", "evil.deeper/msg/Payload", "os/path/join", "std_msgs/msg/Nothing",
                                  "std_msgs/srv/String", "std_msgs/msg/../String", "", "a/b", "std_msgs/msg/String/msg/String"])
def test_no_other_module_is_imported(kind, tmp_path, monkeypatch):
    """A package on the path that looks like the type's, but is no interface package, must not run."""
    folder = tmp_path / "evil" / "msg"
    folder.mkdir(parents=True)
    (tmp_path / "evil" / "__init__.py").write_text("raise SystemExit('imported')")
    (folder / "__init__.py").write_text("class Payload: pass")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert message_class_of(kind) is None
    assert "evil" not in sys.modules
