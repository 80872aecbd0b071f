"""Following a stream of the servo path without waking for every message."""

import time

from microstage_ros.nodes.codec import Codec
from microstage_ros.nodes.credit import Granter
from microstage_ros.nodes.process import running
from microstage_ros.nodes.servo_path import make_servo_path, reader_qos
from microstage_ros.nodes.topics import DEPTH

BATCH = 0.005
"""The loop sleeps this long [s] and then takes all that came: a tenth of the effort of waking for each."""

QUIET = 0.05


class Follower:
    """Takes every message of one topic in order and grants the driver credit as it goes.

    Parameters
    ----------
    node : its node. kind, topic : message class and name. frame : of the messages. window : control periods
        that the driver may run ahead. take : called with (raw bytes, values after the header).

    Attributes
    ----------
    publisher : what the node makes of the stream; readers : matched ones it must have before the first credit.
    """

    def __init__(self, node, kind, topic, frame, window, take):
        self._node, self._window, self._handle = node, window, take
        self._codec = Codec(kind.__name__, frame)
        self.servo = make_servo_path(node)
        self._reader = self.servo.reader(kind, topic, reader_qos(DEPTH, reliable=True))
        self._granter = Granter(node)
        self._granted = 0.0
        self.last = -1
        self.publisher, self.readers = None, 0

    def loop(self):
        """Until the process is asked to stop."""
        while running():
            if not self.drain():
                self.servo.wait((self._reader,), QUIET)
            self._grant()
            time.sleep(BATCH)

    def drain(self):
        """Take all that waits; the number of messages."""
        take, unpack, handle, count = self._reader.take, self._codec.unpack, self._handle, 0
        while (raw := take()) is not None:
            values = unpack(raw)
            if values[0] != self.last:  # a state sent once more is taken once
                if values[0] < self.last:  # the driver began anew
                    self._granter.forget()
                self.last = values[0]
                handle(raw, values)
            count += 1
        return count

    def _grant(self):
        """Credit as far as the window goes; repeated while it is quiet."""
        if self._granter.until < 0 and not (
                self._reader.publishers and self.publisher.get_subscription_count() >= self.readers):
            return
        until, now = self.last + self._window, time.monotonic()
        if until > self._granter.until + self._window // 4 or now - self._granted > 0.5:
            self._granted = now
            self._granter.grant(until)
