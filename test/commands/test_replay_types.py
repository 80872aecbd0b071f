"""Replay: only what the ROS index of installed packages declares is imported for a bag, and slow readers miss nothing."""

import sys
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from microstage_ros.commands.messages import replay  # noqa: E402
from microstage_ros.commands.messages.replay import message_class_of  # noqa: E402
from microstage_ros.quantities.errors import InputError  # noqa: E402


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


class Writer:
    """A publisher as the middleware makes it: it keeps so many messages for its readers, and loses the older ones."""

    topic_name = "/axis/command"

    def __init__(self, reads=True):
        self.waiting, self.lost, self._reads = 0, 0, reads

    def publish(self, raw):
        self.waiting += 1
        self.lost += self.waiting > replay.DEPTH

    def wait_for_all_acked(self, longest):
        if self._reads:
            self.waiting = 0
        return self._reads


class Messages:
    """A bag of 25 000 messages at 10 kHz."""

    def raw_messages(self, topics):
        return ((topics[0], n * 100_000, b"") for n in range(25_000))


def test_ten_times_as_fast_loses_nothing():
    writer, bar = Writer(), SimpleNamespace(reach=lambda ns: None)
    assert replay._play(Messages(), {"/axis/command": writer}, 10.0, bar) == 25_000 and writer.lost == 0
    with pytest.raises(InputError, match="a reader has not taken what was sent for 30 s"):
        replay._play(Messages(), {"/axis/command": Writer(reads=False)}, 10.0, bar)
