"""Every ROS test in a domain of its own, held by a lock so that tests beside it cannot have the same one."""

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here: run ./microstage test")

from ros_support import ros_node  # noqa: E402


@pytest.fixture
def node():
    """An rclpy node in a domain of its own."""
    with ros_node() as made:
        yield made
