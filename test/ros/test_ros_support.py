"""What the ROS tests share leaves nothing behind in the process of the next test."""

import os

from microstage_msgs.action import MoveTo
from rclpy.action import ActionClient
from ros_support import ros_node


def sockets():
    """Number of sockets of this process; a participant of the middleware has seven."""
    found = 0
    for name in os.listdir("/proc/self/fd"):
        try:
            found += os.readlink(f"/proc/self/fd/{name}").startswith("socket:")
        except OSError:  # closed meanwhile
            pass
    return found


def test_no_participant_outlives_its_test_where_an_action_client_is_still_held():
    held, found = [], []
    for _ in range(3):
        with ros_node() as node:
            held.append(ActionClient(node, MoveTo, "/axis/move_to"))
        found.append(sockets())
    assert len(set(found)) == 1, found
