"""A real interferometer that enters by a topic: ``geometry_msgs/PointStamped``, x the reading [m], stamped when it was
read."""

import time
from collections import deque

import numpy as np

from microstage_ros.ros.launching.process import running
from microstage_ros.ros.transport.codec import Codec
from microstage_ros.ros.transport.servo_path import reader_qos

BATCH = 0.02            # time between two looks [s]
WAITING = 100_000       # most readings that wait; older ones are dropped


class InstrumentTopic:
    """Takes an instrument's readings and hands them on as the simulation's are handed on.

    Parameters
    ----------
    node : its node.
    topic : name of the instrument's topic.
    scale : metres along the axis per unit of x; negative where the instrument counts the other way.
    take : called with a structured array that has the fields of SimulationTruth: stamp and ``interferometer_position``;
        what the instrument does not tell is NaN, ``sequence`` 0.
    outlet : what the node makes of it.
    """

    def __init__(self, node, topic, scale, take, outlet):
        from geometry_msgs.msg import PointStamped  # only where an instrument is there

        self._scale, self._handle, self._outlet = scale, take, outlet
        self._codec = Codec("SimulationTruth")
        self._waiting = deque(maxlen=WAITING)
        node.create_subscription(PointStamped, topic, self._keep, reader_qos(1000, reliable=False))

    def _keep(self, message):
        stamp = message.header.stamp
        self._waiting.append((stamp.sec * 10**9 + stamp.nanosec, message.point.x))

    def loop(self):
        """Until the process is asked to stop."""
        while running():
            self.drain()
            time.sleep(BATCH)

    def drain(self):
        """Hand on all that waits; readings that are not finite are dropped."""
        got = [self._waiting.popleft() for _ in range(len(self._waiting))]
        got = [(stamp, x) for stamp, x in got if np.isfinite(x)]
        if not got:
            return
        seen = self._codec.blank(np.array([stamp for stamp, _ in got], np.int64))
        for name in seen.dtype.names:
            if seen.dtype[name] == np.float64:
                seen[name] = np.nan
        seen["interferometer_position"] = self._scale * np.array([x for _, x in got])
        self._handle(seen)
        self._outlet.flush()
