"""The servo path: raw bytes through one reused WaitSet. All private calls of rclpy are in this file.

The executor of rclpy costs 160-400 µs per message; a WaitSet that is used again costs about 20 µs. The
subscriptions of this path belong to a callback group that never lets an executor have them. Where the
private calls are missing (another rclpy), `make_servo_path` falls back to the public ones, slower, and
says so in the node's log.
"""

import collections

from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from rclpy.executors import ExternalShutdownException, ShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy

try:
    from rclpy.impl.implementation_singleton import rclpy_implementation
except ImportError:  # another rclpy
    rclpy_implementation = None

RCLError = getattr(rclpy_implementation, "RCLError", RuntimeError)
"""What rclpy raises when the process is asked to stop in the middle of a call."""

PRIVATE = {
    "WaitSet": ("clear_entities", "add_subscription", "wait"),
    "Subscription": ("take_message",),
    "Publisher": ("publish_raw",),
}
"""Private classes and their methods that the fast way uses."""


def missing_private_calls(implementation=rclpy_implementation):
    """Names of the private calls that this rclpy lacks; empty where the fast way works."""
    if implementation is None:
        return ["rclpy.impl.implementation_singleton"]
    lacking = []
    for kind, methods in PRIVATE.items():
        owner = getattr(implementation, kind, None)
        lacking += [f"{kind}.{name}" for name in methods if not hasattr(owner, name)]
    return lacking


class ServoGroup(CallbackGroup):
    """A callback group whose members no executor ever runs."""

    def can_execute(self, entity):
        return False

    def beginning_execution(self, entity):
        return False

    def ending_execution(self, entity):
        pass


def reader_qos(depth, reliable, latched=False):
    """Quality of service of one reader of the servo path."""
    from rclpy.qos import DurabilityPolicy

    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


class Reader:
    """One subscription: `take` gives the oldest waiting message as bytes, or None."""

    def __init__(self, subscription):
        self.subscription = subscription
        self._take = subscription.handle.take_message
        self._type = subscription.msg_type

    def take(self):
        """CDR bytes of the oldest message that waits, None if none does."""
        found = self._take(self._type, True)
        return None if found is None else found[0]

    @property
    def publishers(self):
        """Number of matched publishers."""
        return self.subscription.get_publisher_count()


class FastServoPath:
    """Readers and writers of one node, and waiting for them, with the private calls."""

    def __init__(self, node):
        self._node = node
        self._group = ServoGroup()
        self._waits = {}

    def reader(self, message_type, topic, qos):
        """A `Reader` of CDR bytes."""
        return Reader(self._node.create_subscription(
            message_type, topic, lambda raw: None, qos, callback_group=self._group, raw=True))

    def writer(self, publisher):
        """The call that sends CDR bytes through ``publisher``."""
        return publisher.handle.publish_raw

    def wait(self, readers, timeout):
        """Sleep until one of ``readers`` (a tuple) has a message, at most ``timeout`` [s]."""
        wait_set = self._waits.get(readers)
        if wait_set is None:
            context = self._node.context.handle
            wait_set = self._waits[readers] = rclpy_implementation.WaitSet(len(readers), 0, 0, 0, 0, 0, context)
        wait_set.clear_entities()
        for reader in readers:
            wait_set.add_subscription(reader.subscription.handle)
        wait_set.wait(int(timeout * 1e9))


class QueueReader:
    """A reader of the public way: an executor's callbacks fill a queue."""

    def __init__(self):
        self.queue = collections.deque()
        self.subscription = None

    def take(self):
        """As `Reader.take`."""
        return self.queue.popleft() if self.queue else None

    @property
    def publishers(self):
        """Number of matched publishers."""
        return self.subscription.get_publisher_count()


class PlainServoPath:
    """The same with public calls alone: an executor of its own in the waiting thread."""

    def __init__(self, node):
        # a node of its own, so that the executor of parameters and services does not take the messages
        self._node = _companion(node)
        self._group = MutuallyExclusiveCallbackGroup()
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(self._node)

    def reader(self, message_type, topic, qos):
        """A `QueueReader`."""
        reader = QueueReader()
        reader.subscription = self._node.create_subscription(
            message_type, topic, lambda raw: reader.queue.append(raw), qos, callback_group=self._group, raw=True)
        return reader

    def writer(self, publisher):
        """The call that sends CDR bytes through ``publisher``."""
        return publisher.publish

    def wait(self, readers, timeout):
        """As `FastServoPath.wait`."""
        if any(reader.queue for reader in readers):
            return
        try:
            self._executor.spin_once(timeout_sec=timeout)
        except (ShutdownException, ExternalShutdownException):
            pass


def _companion(node):
    """A second node of the process, in the same namespace."""
    import rclpy

    return rclpy.create_node(f"{node.get_name()}_servo", namespace=node.get_namespace(), context=node.context,
                             use_global_arguments=False, start_parameter_services=False, enable_rosout=False)


def make_servo_path(node, plain=False):
    """The fastest way that this rclpy allows; ``plain`` asks for the public one."""
    lacking = missing_private_calls()
    if lacking:
        node.get_logger().warning("this rclpy lacks " + ", ".join(lacking) + ": the servo path uses an executor, slower")
    return PlainServoPath(node) if plain or lacking else FastServoPath(node)
