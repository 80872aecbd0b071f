"""Commands delayed, reordered, replayed and duplicated, by the very process that may command: what the driver makes of
them.

A stand-in for the controller answers the states of a real driver at the wall clock. Commands that may be obeyed have
the voltage `GOOD`, those that may not `BAD`: answers that come a second time, older ones after newer ones, whole
stretches of old ones played again. A stranger plays the good ones again from a process of its own. Whatever voltage the
driver reports as applied shows which were obeyed.
"""

import random
import tempfile
import time
from collections import deque

import rclpy
from microstage_msgs.msg import AxisState, ServoTiming, VoltageCommand

from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.ros.benchmarks.hostile.trial import another_context
from microstage_ros.ros.benchmarks.trial_cell import NAMESPACE
from microstage_ros.ros.launching.cell_processes import CellProcesses
from microstage_ros.ros.transport import topics

GOOD, BAD, FOREIGN = 0.003, 0.5, 0.7
PERIOD = 2e-3
WAYS = ("plain", "twice", "older", "replayed", "delayed", "foreign")
LONGEST_DELAY = 5
"""Periods."""


class Commander:
    """Stands in for the controller; ``counts``: how many commands of each of `WAYS` were sent."""

    def __init__(self, node, stranger, seed):
        self._chance, self._stranger = random.Random(seed), stranger
        self._sent, self._waiting = deque(maxlen=200), deque()
        self.counts, self.applied, self.faults = dict.fromkeys(WAYS, 0), {}, set()
        self.publisher = node.create_publisher(VoltageCommand, topics.COMMAND, 100)
        self._foreign = stranger.create_publisher(VoltageCommand, topics.COMMAND, 100)
        node.create_subscription(AxisState, topics.STATE, self._answer, 1000)

    def _send(self, sequence, voltage, publisher=None):
        (publisher or self.publisher).publish(
            VoltageCommand(sequence=sequence, voltage=voltage, sender=VoltageCommand.SENDER_MANUAL)
        )

    def _answer(self, state):
        volts = round(state.applied_voltage, 6)
        self.applied[volts] = self.applied.get(volts, 0) + 1
        if state.fault:
            self.faults.add(state.fault)
            return
        n, way = state.sequence, self._chance.choice(WAYS)
        if way == "delayed" and not (self._sent and self._sent[-1] == n - 1):
            way = "plain"  # the next period is to be answered before the delayed one is
        self.counts[way] += 1
        if way == "delayed":
            self._waiting.append((n + self._chance.randint(1, LONGEST_DELAY), n))
        else:
            self._send(n, GOOD)
            self._sent.append(n)
        if way == "twice":
            self._send(n, BAD)
        elif way == "older" and len(self._sent) > 1:
            self._send(self._sent[-2], BAD)
        elif way == "replayed":
            for old in self._chance.sample(sorted(self._sent), min(len(self._sent), 5)):
                self._send(old, BAD)
        elif way == "foreign":
            self._send(n + 1, FOREIGN, self._foreign)
        while self._waiting and self._waiting[0][0] <= n:
            self._send(self._waiting.popleft()[1], BAD)  # a newer one has been sent meanwhile


def disturb(count, seed):
    """About ``count`` commands [1] to one paced driver; the facts as plain data. ``seed``: of the disturbances [1]."""
    node = rclpy.create_node("str_controller", namespace=NAMESPACE)
    stranger = rclpy.create_node("stranger", namespace=NAMESPACE, context=another_context())
    timings = []
    try:
        with tempfile.TemporaryDirectory(prefix="microstage_disturbed_") as folder:
            axis = f"{folder}/axis.yaml"
            load_axis(config_file("axis.yaml")).with_values({"period": PERIOD}, source="estimate").save(axis)
            commander = Commander(node, stranger, seed)
            node.create_subscription(ServoTiming, topics.TIMING, timings.append, 10)
            parameters = {
                "axis_driver": {
                    "mode": "paced",
                    "axis_file": axis,
                    "expected_subscribers": 1,
                    "followers": [""],
                    "command_timeout_s": 5.0,
                }
            }
            with CellProcesses(NAMESPACE, ("axis_driver",), parameters, logs=folder) as cell:
                cell.activate(node)
                end = time.monotonic() + 20.0 + 5.0 * count * PERIOD
                while sum(commander.counts.values()) < count and time.monotonic() < end and not commander.faults:
                    rclpy.spin_once(node, timeout_sec=0.05)
                until = time.monotonic() + 1.5
                while time.monotonic() < until:  # the last figures of the driver
                    rclpy.spin_once(node, timeout_sec=0.05)
    finally:
        stranger.destroy_node()
        node.destroy_node()
    return _facts(commander, timings[-1] if timings else ServoTiming(), count)


def _facts(commander, timing, count):
    wrong = sum(number for volts, number in commander.applied.items() if volts not in (0.0, GOOD))
    facts = {
        "periods_answered": sum(commander.counts.values()),
        "sent_by_way": commander.counts,
        "applied_V": {str(volts): number for volts, number in commander.applied.items()},
        "wrongly_obeyed": wrong,
        **{
            name: getattr(timing, name) for name in ("answered", "late", "lost", "duplicated", "reordered", "foreign")
        },
        "faults": sorted(commander.faults),
    }
    short = [
        text
        for text, bad in (
            (f"{wrong} periods with a voltage that nobody may apply", wrong),
            (f"faults {sorted(commander.faults)}", commander.faults),
            ("not all were sent", facts["periods_answered"] < count),
            ("none was counted", not (timing.duplicated and timing.reordered and timing.foreign)),
        )
        if bad
    ]
    return facts | {"fell_short": "; ".join(short)}
