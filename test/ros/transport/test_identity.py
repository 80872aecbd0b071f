"""Who may publish on a topic is known by the identity of its process; without a holder nobody is obeyed where it counts."""

from types import SimpleNamespace

import numpy as np
import rclpy
from microstage_msgs.msg import VoltageCommand
from rclpy.context import Context
from ros_support import spin_until

from microstage_ros.ros.transport.c_calls import GID_AT, INFO_WORDS, known
from microstage_ros.ros.transport.identity import ANYBODY, Holder


def message_of(numbers):
    """What the middleware tells of a message from a process."""
    info = np.zeros(INFO_WORDS, np.int64)
    info[GID_AT : GID_AT + 2] = numbers
    return info


def test_without_a_holder_a_strict_topic_obeys_nobody(node):
    strict, open_to_all = Holder(node, "command"), Holder(node, "command")
    strict.be_strict()
    stranger = message_of((77, 5))
    for holder in (strict, open_to_all):
        holder.look()
        assert not holder.found
    assert not strict.is_of(stranger) and not known(stranger, strict.words)
    assert open_to_all.is_of(stranger) and known(stranger, open_to_all.words)
    publisher = node.create_publisher(VoltageCommand, "command", 10)
    spin_until(node, lambda: strict.look() is not None and strict.found)
    mine = tuple(strict.words.tolist())
    assert mine != ANYBODY and strict.name == node.get_fully_qualified_name()
    assert known(message_of(mine), strict.words) and not known(stranger, strict.words)
    node.destroy_publisher(publisher)
    spin_until(node, lambda: strict.look() is not None and not strict.found)
    assert not known(message_of(mine), strict.words)


def test_a_stranger_that_came_first_gives_way_to_the_expected_sender(node):
    """The controller hears nobody until the graph names a driver, and leaves a stranger for the driver."""
    holder = Holder(node, "command", ("str_controller",))
    holder.be_strict()
    stranger = node.create_publisher(VoltageCommand, "command", 10)
    spin_until(node, lambda: holder.look_for_expected() is not None and holder.found)
    assert holder.name == node.get_fully_qualified_name()
    context = Context()
    rclpy.init(context=context)
    controller = rclpy.create_node("str_controller", namespace=node.get_namespace(), context=context)
    try:
        controller.create_publisher(VoltageCommand, "command", 10)
        wanted = controller.get_fully_qualified_name()
        spin_until(node, lambda: holder.look_for_expected() is not None and holder.name == wanted)
        assert not holder.is_of(message_of((77, 5)))
        holder.look_for_expected()
        assert holder.name == wanted  # and stays
    finally:
        controller.destroy_node()
        rclpy.try_shutdown(context=context)
        node.destroy_publisher(stranger)


def test_a_name_that_the_graph_learns_late(monkeypatch):
    """The middleware's own word for it is told nobody; the holder is the same before and after."""
    info = SimpleNamespace(endpoint_gid=list(range(1, 17)), node_namespace="_NODE_NAMESPACE_UNKNOWN_", node_name="_NODE_NAME_UNKNOWN_")
    graph = SimpleNamespace(resolve_topic_name=str, get_namespace=lambda: "/axis", get_publishers_info_by_topic=lambda topic: [info])
    holder = Holder(graph, "command", ("str_controller",))
    holder.look()
    held = holder.words.tolist()
    holder.learn_name()
    assert holder.found and holder.name == "unknown"
    info.node_namespace, info.node_name = "/axis", "str_controller"
    holder.learn_name()
    assert holder.name == "/axis/str_controller" and holder.words.tolist() == held
