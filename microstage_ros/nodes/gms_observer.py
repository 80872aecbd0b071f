"""gms_observer: friction of both contacts from encoder, voltage and current; the law is `control.observer`.

Follows `state`, publishes `friction`, decimated.
"""

import sys

import numpy as np
from rclpy.node import Node

from microstage_msgs.msg import AxisState, FrictionState
from microstage_ros.axis.axis_file import load_axis
from microstage_ros.control.observer import FrictionObserver
from microstage_ros.nodes import topics
from microstage_ros.nodes.blocks import Outlet
from microstage_ros.nodes.codec import Codec, stamps_ns
from microstage_ros.nodes.follower import Follower
from microstage_ros.nodes.parameters import Parameters
from microstage_ros.nodes.process import run_node
from microstage_ros.nodes.servo_path import make_servo_path
from microstage_ros.places import config_file

BLOCKS = 10


class GmsObserver(Node):
    """The observer's process."""

    def __init__(self):
        super().__init__("gms_observer")
        p = self.parameters = Parameters(self, "gms_observer")
        axis = load_axis(p.axis_file or config_file("axis.yaml"))
        self._observer = FrictionObserver(axis, observer_bandwidth=p.observer_bandwidth)
        FrictionObserver(axis).advance_all(*np.zeros((3, 2)))  # compiled before anybody waits for credit
        self._pack, self._every = Codec("FrictionState").pack, p.decimation
        servo = make_servo_path(self)
        self._outlet = Outlet(self, servo, FrictionState, topics.FRICTION)
        self.loop = Follower(self, servo, AxisState, topics.STATE, p.window, self._take, self._outlet,
                             p.expected_followers).loop

    def _take(self, states):
        columns = [np.ascontiguousarray(states[name]) for name in ("position", "applied_voltage", "current")]
        times, numbers, done = stamps_ns(states), states["sequence"], 0
        for told in np.flatnonzero(numbers % self._every == 0).tolist():
            self._observer.advance_all(*(column[done:told + 1] for column in columns))
            done, sequence = told + 1, int(numbers[told])
            self._outlet.send(sequence, self._pack(int(times[told]), sequence, *_fields(self._observer.estimate)))
        self._observer.advance_all(*(column[done:] for column in columns))

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
