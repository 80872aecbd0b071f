"""Malformed messages given to every callback of every node, in one process, so that each of them is known to arrive.

Over the network most of a flood is dropped before it is read: a best-effort reader keeps what fits. Here nothing lies
between message and node: readers of the servo path are queues, and every other subscription is called with what the
middleware makes of the bytes. Who sent a message is not looked at (every message counts as the right sender's), so this
is the harder half: what a stranger sends is dropped before (`hostile.trial`). The nodes run their own loops, one pass
for every `BATCH` messages. The compiled loops of driver and controller are not run here, their Python forms are.
"""

import json
import os
import random
import struct
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from importlib import import_module
from pathlib import Path
from unittest.mock import patch

import rclpy
from rclpy.serialization import deserialize_message, serialize_message

from microstage_ros.ros.transport import servo_path
from microstage_ros.ros.transport.codec import ENCAPSULATION

NODES = {
    "axis_driver": "AxisDriver",
    "str_controller": "StrController",
    "gms_observer": "GmsObserver",
    "interferometer_logger": "InterferometerLogger",
    "move_server": "MoveServer",
    "bag_recorder": "BagRecorder",
    "health_monitor": "HealthMonitor",
}
"""Module to class."""

LOOPS = (
    "loops.driver_periods",
    "loops.follower",
    *(f"nodes.{name}" for name in ("str_controller", "move_server", "bag_recorder", "health_monitor")),
)
"""Modules whose loops ask `running`."""

BATCH = 50
LONGEST_S = 1.0
BLOCK = "microstage_msgs/msg/MessageBlock"
NUMBERS = (0, 1, 7, 2**31, 2**62, 2**63, 2**63 + 5, 2**64 - 1)


class FedPath(servo_path.PlainServoPath):
    """A servo path whose readers are given their messages by hand; nobody waits."""

    made: list = []

    def reader(self, message_type, topic, qos):
        """A `QueueReader` that is kept in `made`."""
        reader = super().reader(message_type, topic, qos)
        self.made.append((reader, message_type))
        return reader

    def wait(self, readers, timeout):
        """At once, whatever the ``timeout`` [s]."""


class Once:
    """True once, then False, then True again: one pass of a loop that asks ``running()``; True for other threads."""

    def __init__(self):
        self._asked = False

    def __call__(self):
        if threading.current_thread() is not threading.main_thread():
            return True
        self._asked = not self._asked
        return self._asked


def malformed(chance, kind):
    """Bytes, of shape (n,), of a message of ``kind``: random, cut, changed, or a block with a wrong head."""
    good = serialize_message(kind())
    choice = chance.randrange(5 if hasattr(kind, "size") else 4)
    if choice == 0:
        return ENCAPSULATION[: chance.randrange(5)] + chance.randbytes(chance.randrange(200))
    if choice == 1:
        return good[: chance.randrange(len(good) + 1)]
    if choice == 4:
        length = chance.randrange(9000)
        size = chance.choice((0, 1, 7, 48, 49, 64, length, 2**32 - 1))
        return struct.pack(
            "<4sQII", ENCAPSULATION, chance.choice(NUMBERS), size, chance.choice((length, 0, 2**32 - 1))
        ) + chance.randbytes(length)
    raw = bytearray(good)
    if choice == 2 and len(raw) >= 12:  # a number that is none, or out of range
        at = chance.randrange(4, len(raw) - 7)
        raw[at : at + 8] = struct.pack("<Q", chance.choice((*NUMBERS, 0x7FF8000000000000, 0x7FF0000000000000)))
    else:
        raw[chance.randrange(len(raw))] ^= 1 << chance.randrange(8)
    return bytes(raw)


class Fed:
    """One node with all ways in which it hears messages.

    Attributes
    ----------
    arrived : topic to how many messages its callback or reader was given. refused : topic to how many of the bytes the
        middleware's own decoding refuses. raised : what came out of the node, which must be nothing.
    """

    def __init__(self, name):
        before = len(FedPath.made)
        self.name = name
        self.node = getattr(import_module(f"microstage_ros.ros.nodes.{name}"), NODES[name])()
        readers = FedPath.made[before:]
        own = {id(reader.subscription) for reader, _ in readers}
        self._ways = [(reader.subscription.topic_name, kind, reader.queue.append, True) for reader, kind in readers]
        self._ways += [
            (heard.topic_name, heard.msg_type, heard.callback, False)
            for heard in self.node.subscriptions
            if id(heard) not in own and not heard.topic_name.startswith("/parameter")
        ]
        self.arrived, self.refused, self.raised, self.longest_s, self._sent = {}, {}, [], 0.0, 0

    def send(self, chance):
        """One message to each way in."""
        for topic, kind, take, raw in self._ways:
            message = malformed(chance, kind)
            if not raw:
                try:
                    message = deserialize_message(message, kind)
                except Exception:  # noqa: BLE001 - what the middleware refuses never reaches the node
                    self.refused[topic] = self.refused.get(topic, 0) + 1
                    continue
            self._given(take, message)
            self.arrived[topic] = self.arrived.get(topic, 0) + 1

    def turn(self):
        """Passes of the node's own loop until nothing waits that it would take; some take one message a pass."""
        before = None
        while before is None or 0 < self.waiting < before:
            before = self.waiting
            self._given(self.node.loop)

    def _given(self, call, *arguments):
        began = time.monotonic()
        try:
            call(*arguments)
        except Exception as error:  # noqa: BLE001 - exactly this must not happen
            self.raised.append(f"{self.name}: {type(error).__name__}: {error}"[:300])
        self.longest_s = max(self.longest_s, time.monotonic() - began)

    @property
    def waiting(self):
        """Messages that no pass has taken."""
        return sum(len(take.__self__) for _, _, take, raw in self._ways if raw)


def feed(count, seed, tell=lambda share: None):
    """Give ``count`` [1] malformed messages to the nodes; the facts as plain data. rclpy must be there, with default
    context. ``seed``: of the messages [1]; ``tell``: called with the share done [1]."""
    chance = random.Random(seed)
    with ExitStack() as stack:
        stack.enter_context(patch.object(servo_path, "missing_private_calls", lambda: ["as asked"]))
        stack.enter_context(patch.object(servo_path, "PlainServoPath", FedPath))
        fed = [Fed(name) for name in NODES]
        for module in LOOPS:
            stack.enter_context(patch(f"microstage_ros.ros.{module}.running", Once()))
        given = turns = 0
        while given < count:
            for one in fed:
                one.send(chance)
            turns += 1
            given = sum(sum(one.arrived.values()) + sum(one.refused.values()) for one in fed)
            if turns % BATCH == 0 or given >= count:
                for one in fed:
                    one.turn()
                tell(min(given / count, 1.0))
        driver = next(one.node for one in fed if one.name == "axis_driver")
        voltage = driver.gate.voltage
    raised = [text for one in fed for text in one.raised]
    longest = max(one.longest_s for one in fed)
    short = [
        text
        for text, bad in (
            (f"{len(raised)} exceptions, the first: {raised[0] if raised else ''}", raised),
            (f"{longest:.2f} s for one pass", longest > LONGEST_S),
            (f"{voltage:.3g} V", voltage != 0.0),
        )
        if bad
    ]
    return {
        "given": given,
        "arrived": sum(sum(one.arrived.values()) for one in fed),
        "refused_by_decoding": sum(sum(one.refused.values()) for one in fed),
        "ways_in": sum(len(one._ways) for one in fed),
        "left_waiting": sum(one.waiting for one in fed),
        "exceptions": len(raised),
        "longest_s": round(longest, 4),
        "voltage": voltage,
        "by_topic": {one.name: {"arrived": one.arrived, "refused": one.refused} for one in fed},
        "fell_short": "; ".join(short),
    }


def feed_in_a_process(count, seed):
    """`feed` in a process of its own, which may come to its end: the facts.

    ``count``: of messages [1]; ``seed``: of the messages [1].
    """
    done = subprocess.run(
        [sys.executable, "-m", __name__, str(count), str(seed)], capture_output=True, text=True, check=False
    )
    if done.returncode not in (0, 1) or not done.stdout.strip():
        last = (done.stderr.strip().splitlines() or [""])[-1]
        return {"given": count, "fell_short": f"the nodes' process ended with {done.returncode}: {last[:300]}"}
    return json.loads(done.stdout.splitlines()[-1])


def main():
    """``COUNT SEED``: the facts as JSON on standard output."""
    count, seed = map(int, sys.argv[1:3])
    with tempfile.TemporaryDirectory(prefix="microstage_fed_") as folder:
        rclpy.init(args=["--ros-args", "-r", "__ns:=/fed", "-p", f"directory:={Path(folder) / 'bag'}"])
        facts = feed(count, seed)
        print(json.dumps(facts), flush=True)
    os._exit(1 if facts["fell_short"] else 0)


if __name__ == "__main__":
    main()
