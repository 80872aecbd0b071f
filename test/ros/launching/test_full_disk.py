"""A disk that is full: the recorder ends in one line, its log keeps what was said, and the axis goes on without it."""

import io
import types

import pytest

from microstage_ros.records.bags import bag_writer
from microstage_ros.records.bags.bag import BagStopped, BagWriter, installed_definition
from microstage_ros.ros.launching import process, supervision
from microstage_ros.ros.launching.cell_processes import CellFailure
from microstage_ros.ros.launching.supervision import MOST_RESTARTS, Supervisor
from microstage_ros.ros.nodes.bag_recorder import BagRecorder


class Full:
    """A file with ``room`` for so many bytes."""

    def __init__(self, path, room):
        self._file, self._room = io.FileIO(path, "w+"), room

    def write(self, data):
        if self._file.tell() + len(data) > self._room:
            raise OSError(28, "No space left on device")
        return self._file.write(data)

    def __getattr__(self, name):
        return getattr(self._file, name)


def test_a_recorder_on_a_full_disk_closes_its_bag(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(bag_writer, "open_file", lambda path: Full(path, 3000))
    bag = BagWriter(tmp_path / "bag", compression="")
    channel, count = bag.add_channel("/axis/credit", installed_definition("microstage_msgs/msg/Credit")), [0]

    def drain():
        bag.write(channel, count[0] * 10**9, bytes(500))
        bag.hand_over()
        count[0] += 1
        return 1

    recorder = types.SimpleNamespace(_bag=bag, _tracks={}, _drain=drain, parameters=types.SimpleNamespace(longest_drain_s=60.0),
                                     _collector=types.SimpleNamespace(found={}, run_facts=dict))
    with pytest.raises(BagStopped):
        for _ in range(10_000):
            drain()
    BagRecorder.close(recorder)
    assert "0 messages in" in capsys.readouterr().out  # and no traceback
    bag.close()


def test_a_node_that_cannot_begin_for_the_disk_says_so_in_one_line(monkeypatch, capsys):
    def make():
        raise BagStopped(28, "runs/today/bag_0.mcap: No space left on device")

    monkeypatch.setattr(process, "_hear_signals", lambda: None)
    monkeypatch.setattr(process, "started", lambda arguments: None)
    monkeypatch.setattr(process.rclpy, "try_shutdown", lambda: None)
    assert process.run_node(make) == 1
    said = capsys.readouterr().err
    assert "No space left on device" in said and len(said.splitlines()) == 1


class Ended:
    """A process that has ended."""

    returncode, reported_pid, stopped = 1, 0, False

    def poll(self):
        return self.returncode


def supervised(name):
    """A supervisor of one process that ends at once, each time; what it tells."""
    told, restarted = [], []
    cell = types.SimpleNamespace(processes={name: Ended()}, server_status=None, restart=restarted.append, last_words=lambda _: ": no room")
    made = Supervisor.__new__(Supervisor)
    made._cell, made._tell, made._publish = cell, told.append, lambda missing: told.append(missing)
    made._restarts, made._stopped_since, made._given_up = {name: []}, {}, {}
    return made, told, restarted


def test_a_recorder_that_ends_again_and_again_is_given_up_and_the_axis_goes_on():
    made, told, restarted = supervised("bag_recorder")
    for _ in range(MOST_RESTARTS + 10):
        made.look()
    assert restarted == ["bag_recorder"] * MOST_RESTARTS
    assert told[-1] == "bag_recorder ended 6 times in 60 s, the last time with status 1: no room; the axis goes on without it"
    assert sum("goes on without it" in text for text in told) == 11  # once to people, then in what is published


def test_any_other_process_that_does_ends_the_cell():
    made, _, restarted = supervised("move_server")
    with pytest.raises(CellFailure, match="move_server ended 6 times"):
        for _ in range(MOST_RESTARTS + 10):
            made.look()
    assert restarted == ["move_server"] * MOST_RESTARTS and supervision.GIVEN_UP == ("bag_recorder",)
