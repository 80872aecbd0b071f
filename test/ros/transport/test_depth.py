"""A reader that is held up loses the oldest messages, and its thread rests."""

import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from microstage_msgs.msg import AxisState
from ros_support import PATIENCE_S, ros_node, spin_until

from microstage_ros.ros.transport import topics

HELD_UP = """
import microstage_ros.ros, rclpy, time
from microstage_msgs.msg import AxisState
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.servo_path import ServoGroup, reader_qos
rclpy.init()
node = rclpy.create_node("held_up", namespace="/axis")
kept = node.create_subscription(AxisState, topics.STATE, lambda raw: None, reader_qos(topics.DEPTH, reliable={}),
                                callback_group=ServoGroup(), raw=True)
while kept.get_publisher_count() == 0:      # what is sent before the reader knows its writer is not kept
    time.sleep(0.01)
print("matched", flush=True)
input()
first = kept.handle.take_message(AxisState, False)
print(first[0].sequence, flush=True)
input()
"""
"""A process that takes nothing until it is told to, and then says which message was the oldest."""

TICKS = os.sysconf("SC_CLK_TCK")


def reading_threads(pid):
    """Processor time [s] of each thread that reads shared memory for a process."""
    found = {}
    for thread in Path(f"/proc/{pid}/task").iterdir():
        with suppress(OSError):
            name, _, rest = (thread / "stat").read_text().rpartition(")")
            if "dds.dsha" in name:
                found[thread.name] = sum(map(int, rest.split()[11:13])) / TICKS
    return found


@pytest.mark.parametrize("reliable", [False, True])
def test_the_oldest_go_where_a_reader_of_states_is_held_up(reliable):
    with ros_node() as node:
        states = node.create_publisher(AxisState, topics.STATE, topics.SERVO)
        process = subprocess.Popen([sys.executable, "-c", HELD_UP.format(reliable)], stdin=subprocess.PIPE,
                                   stdout=subprocess.PIPE, text=True)
        try:
            spin_until(node, lambda: states.get_subscription_count() == 1)
            assert process.stdout.readline() == "matched\n"
            spin_until(node, lambda: reading_threads(process.pid))
            sent = 3 * topics.DEPTH // 2
            for sequence in range(sent):
                states.publish(AxisState(sequence=sequence))
            end = time.monotonic() + PATIENCE_S
            before, now = None, reading_threads(process.pid)
            while now != before:  # all is read, and nothing more to do
                assert time.monotonic() < end
                time.sleep(0.5)
                before, now = now, reading_threads(process.pid)
            process.stdin.write("\n")
            process.stdin.flush()
            assert sent - topics.DEPTH <= int(process.stdout.readline()) < sent
        finally:
            process.kill()
            process.wait()
