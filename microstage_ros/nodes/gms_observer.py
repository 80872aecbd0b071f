"""gms_observer: friction of both contacts from encoder, voltage and current; the law is `control.observer`.

Follows `state`, publishes `friction`, decimated.
"""

import sys

from rclpy.node import Node

from microstage_msgs.msg import AxisState, FrictionState
from microstage_ros.axis.axis_file import load_axis
from microstage_ros.control.observer import FrictionObserver
from microstage_ros.nodes import topics
from microstage_ros.nodes.codec import Codec, stamp_ns
from microstage_ros.nodes.follower import Follower
from microstage_ros.nodes.parameters import Parameters
from microstage_ros.nodes.process import run_node
from microstage_ros.places import config_file

BLOCKS = 10


class GmsObserver(Node):
    """The observer's process."""

    def __init__(self):
        super().__init__("gms_observer")
        p = self.parameters = Parameters(self, "gms_observer")
        axis = load_axis(p.axis_file or config_file("axis.yaml"))
        self._observer = FrictionObserver(axis, observer_bandwidth=p.observer_bandwidth)
        FrictionObserver(axis).advance(0.0, 0.0, 0.0)  # compiled before anybody waits for credit
        self._codec = Codec("FrictionState", p.frame_id)
        self._follower = Follower(self, AxisState, topics.STATE, p.frame_id, p.window, self._take)
        publisher = self.create_publisher(FrictionState, topics.FRICTION, topics.SERVO)
        self._send = self._follower.servo.writer(publisher)
        self._follower.publisher, self._follower.readers = publisher, p.expected_subscribers
        self.loop = self._follower.loop

    def _take(self, raw, values):
        sequence, position, applied, current, *_ = values
        observer = self._observer
        observer.advance(position, applied, current)
        if sequence % self.parameters.decimation == 0:
            self._send(self._codec.pack(stamp_ns(raw), sequence, *_fields(observer.estimate)))

    def close(self):
        """Nothing to hold on to."""


def _fields(e):
    """The fields of FrictionState from a `FrictionEstimate`."""
    blocks, guide = e.block_torque, e.guideway_block_force
    total = len(e.block_slips) + len(e.guideway_block_slips)
    sliding = (int(e.block_slips.sum()) + int(e.guideway_block_slips.sum())) / total if total else 0.0
    return (e.actuator_torque, e.actuator_torque_stderr, e.guideway_force, e.guideway_force_stderr,
            *_padded(blocks), *_padded(guide), *_padded(e.block_slips), *_padded(e.guideway_block_slips),
            len(blocks), len(guide), e.level, e.level_stderr, e.asymmetry, e.actuator_share, sliding,
            e.equivalent_voltage)


def _padded(values):
    return list(values[:BLOCKS]) + [0] * (BLOCKS - len(values))


def main(arguments=None):
    """Run the node."""
    return run_node(GmsObserver, arguments)


if __name__ == "__main__":
    sys.exit(main())
