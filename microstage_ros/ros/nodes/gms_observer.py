"""gms_observer: friction of both contacts from encoder, voltage and current; the law is `control.friction_observer`.

Follows `state`, publishes `friction`, decimated.
"""

import sys

import numpy as np
from microstage_msgs.msg import AxisState, FrictionState
from rclpy.node import Node

from microstage_ros.control.friction_observer import FrictionObserver
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.ros.launching.parameters import Parameters, yaml_mapping
from microstage_ros.ros.launching.process import run_node
from microstage_ros.ros.loops.follower import Follower
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.blocks import Outlet
from microstage_ros.ros.transport.codec import Codec, stamps_ns
from microstage_ros.ros.transport.servo_path import make_servo_path


class GmsObserver(Node):
    """The observer's process."""

    def __init__(self):
        super().__init__("gms_observer")
        p = self.parameters = Parameters(self, "gms_observer")
        axis = load_axis(p.axis_file or config_file("axis.yaml"))
        self._observer = FrictionObserver(
            axis, **yaml_mapping("gms_observer: gains", p.gains, "{encoder_noise: 3.0e-8}")
        )
        position, voltage, current = np.zeros((3, 2))
        FrictionObserver(axis).advance_all(position, voltage, current)  # compiled before anybody waits for credit
        self._codec, self._every = Codec("FrictionState"), p.decimation
        servo = make_servo_path(self)
        self._outlet = Outlet(self, servo, FrictionState, topics.FRICTION)
        self.loop = Follower(self, servo, AxisState, topics.STATE, p.window, self._take, self._outlet,
                             p.expected_followers).loop

    def _take(self, states):
        position, voltage, current = (states[name] for name in ("position", "applied_voltage", "current"))
        reported = np.flatnonzero(states["sequence"] % self._every == 0)
        found = self._observer.advance_all(position, voltage, current, reported)
        if len(reported):
            messages = self._codec.blank(stamps_ns(states[reported]))
            messages["sequence"] = states["sequence"][reported]
            _fill(messages, self._observer.estimates(found))
            self._outlet.send_all(messages)

    def close(self):
        """Nothing to hold on to."""


def _fill(messages, e):
    """The fields of FrictionState from a `FrictionEstimate` of arrays."""
    for contact, forces, slips in (("actuator_block", e.block_torque, e.block_slips),
                                   ("guideway_block", e.guideway_block_force, e.guideway_block_slips)):
        count = forces.shape[1]
        messages[f"{contact}_torque" if contact == "actuator_block" else f"{contact}_force"][:, :count] = forces
        messages[f"{contact}_slipping"][:, :count] = slips
        messages[f"{contact}_count"] = count
    slipping = np.hstack([e.block_slips, e.guideway_block_slips])
    messages["sliding_share"] = slipping.mean(axis=1) if slipping.shape[1] else 0.0
    for name, values in (
        ("actuator_torque", e.actuator_torque),
        ("actuator_torque_stddev", e.actuator_torque_stderr),
        ("guideway_force", e.guideway_force),
        ("guideway_force_stddev", e.guideway_force_stderr),
        ("level", e.level),
        ("level_stddev", e.level_stderr),
        ("asymmetry", e.asymmetry),
        ("actuator_share", e.actuator_share),
        ("equivalent_voltage", e.equivalent_voltage),
    ):
        messages[name] = values


def main(arguments=None):
    """Run the node."""
    return run_node(GmsObserver, arguments)


if __name__ == "__main__":
    sys.exit(main())
