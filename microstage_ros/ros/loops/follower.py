"""Following a stream of the servo path block by block, and granting the driver credit for it."""

import time

import numpy as np

from microstage_ros.ros.launching.process import running
from microstage_ros.ros.transport.blocks import Stream
from microstage_ros.ros.transport.codec import Codec
from microstage_ros.ros.transport.credit import Granter, repeat_after

WAIT_S = 0.05
LOOK = 0.5
BATCH = 0.02
"""Time [s] between two looks: fewer wakings, each for more."""


class Follower:
    """Takes every message of one topic in order and grants the driver credit as it goes.

    Parameters
    ----------
    node : its node. kind, topic : message class and name. window : control periods that the driver may run
        ahead. take : called with the messages of one block as a structured array (`Codec.array`).
    outlet : what the node makes of the stream; its messages go out block by block too.
    expected : followers that it must have before the first credit.
    """

    def __init__(self, node, servo, kind, topic, window, take, outlet, expected):
        self._window, self._handle, self._outlet, self._expected = window, take, outlet, expected
        self._codec = Codec(kind.__name__)
        self._servo = servo
        self._stream = Stream(node, servo, kind, topic)
        self._granter = Granter(node)
        self._granted = self._looked = 0.0
        self.last = -1

    def loop(self):
        """Until the process is asked to stop."""
        while running():
            self._servo.wait(self._stream.readers, WAIT_S)
            self.drain()
            now = time.monotonic()
            self._grant(now)
            if now - self._looked > LOOK:
                self._looked = now
                self._stream.look()
            time.sleep(BATCH)

    def drain(self):
        """Take all that waits."""
        while (rows := self._stream.take_all()) is not None:
            messages = self._codec.array(rows)
            sequence = messages["sequence"].astype(np.int64)
            before = np.concatenate(([self.last], sequence[:-1]))
            if (sequence < before).any():  # the driver began anew
                self._granter.forget()
            if (sequence == before).any():  # a state that was sent once more is taken once
                messages = messages[sequence != before]
            self.last = int(sequence[-1])
            if not len(messages):
                continue
            self._handle(messages)
            self._outlet.flush()

    def _grant(self, now):
        """Credit as far as the window goes; repeated while it is quiet."""
        if self._granter.until < 0 and not (self._stream.publishers and self._outlet.followers >= self._expected):
            return
        until = self.last + self._window
        if until > self._granter.until + self._window // 4 or now - self._granted > repeat_after(self.last):
            self._granted = now
            self._granter.grant(until)
