"""Lockstep: one seed, one run, to the last bit; and the bag plays back what it holds."""

import subprocess
import sys

import pytest
from microstage_msgs.msg import VoltageCommand
from ros_support import own_domain, ros_node, spin_until

from microstage_ros.records.bags.bag_reader import Bag
from microstage_ros.ros.client import AxisClient
from microstage_ros.ros.launching.cell_processes import CellProcesses
from microstage_ros.ros.transport import topics

TOPICS = ("state", "command", "controller_state", "friction", "interferometer", "simulation")


def make_bag(folder, seed, compiled_loop=True):
    """A bag of two short moves."""
    parameters = {"bag_recorder": {"directory": str(folder / "bag")}, "move_server": {"pause_s": 600.0},
                  "str_controller": {"compiled_loop": compiled_loop},
                  "axis_driver": {"seed": seed, "command_timeout_lockstep_s": 60.0, "compiled_loop": compiled_loop}}
    with ros_node() as node, CellProcesses("/axis", parameters=parameters, logs=folder / "logs") as cell:
        cell.activate(node)
        client = AxisClient("/axis", node, wait=60.0)
        for target in (1e-5, -1e-6):
            assert client.move(target, settle_time=0.01).reached
        client.wait_until_still()
        cell.deactivate(node)
    return folder / "bag"


def messages(bag):
    """Topic to the list of (log time, bytes)."""
    found = {}
    for topic, time_ns, raw in Bag(bag).raw_messages([f"/axis/{name}" for name in TOPICS]):
        found.setdefault(topic, []).append((time_ns, raw))
    return found


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    return make_bag(tmp_path_factory.mktemp("first"), 3)


def test_same_seed_same_bytes(first, tmp_path):
    ours, theirs = messages(first), messages(make_bag(tmp_path, 3))
    assert set(ours) == set(theirs) == {f"/axis/{name}" for name in TOPICS}
    for topic in ours:
        assert len(ours[topic]) == len(theirs[topic]) > 50, topic
        assert ours[topic] == theirs[topic], topic


def test_periods_in_python_are_the_same_to_the_last_bit(first, tmp_path):
    ours, theirs = messages(first), messages(make_bag(tmp_path, 3, compiled_loop=False))
    for topic in ours:
        assert ours[topic] == theirs[topic], topic


def test_another_seed_is_another_run(first, tmp_path):
    ours, theirs = messages(first), messages(make_bag(tmp_path, 4))
    assert ours["/axis/state"] != theirs["/axis/state"]


def test_replay_sends_the_same_bytes_in_order(first, tmp_path):
    """At a hundredth of its speed, by the command itself; a reader that was there first misses nothing."""
    import rclpy

    recorded = [raw for _, raw in messages(first)["/axis/command"]]
    with own_domain():
        rclpy.init()
        try:
            node, heard = rclpy.create_node("listener"), []
            node.create_subscription(VoltageCommand, "/axis/command", heard.append, topics.SERVO, raw=True)
            command = [sys.executable, "-m", "microstage_ros.commands", "replay", str(first), "--rate", "0.1", "--delay", "5",
                       "--topics", "/axis/command"]
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as player:
                spin_until(node, lambda: len(heard) >= len(recorded) or player.poll() is not None, 120.0)
                out = player.communicate()[0]
            assert player.returncode == 0 and out.startswith(f"{len(recorded)} messages")
            assert [bytes(raw[:len(kept)]) for raw, kept in zip(heard, recorded)] == recorded[:len(heard)]
            assert len(heard) == len(recorded)
        finally:
            rclpy.try_shutdown()
