"""``replay``: a bag back onto its topics, with its timing."""

import importlib
import sys
import time

from microstage_ros.commands import answer
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.progress import progress
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags.bag import Bag

DEPTH = 10_000
"""Messages that a publisher keeps for slow readers."""

AHEAD = DEPTH // 4
"""After so many on one topic its readers are waited for: faster than they read, older messages would be overwritten."""

PATIENCE_S = 30.0
"""Longest wait [s] for readers; one that was killed counts until the middleware gives it up, 20 s later."""


def main(argv=None):
    """Run the command. Returns 0; raises InputError for bad input."""
    parser = Parser(prog="microstage replay", description="Play a bag back onto its topics.")
    parser.add_argument("bag", metavar="BAG", help="an MCAP file or a rosbag2 folder")
    parser.add_argument("--rate", type=float, default=1.0, metavar="R", help="times as fast as recorded (default 1)")
    parser.add_argument("--delay", type=float, default=1.0, metavar="SECONDS",
                        help="before the first message, for readers to be found (default 1)")
    parser.add_argument("--topics", nargs="+", metavar="TOPIC", help="only these")
    arguments = parser.parse_args(argv)
    if not 0.0 < arguments.rate < float("inf"):
        raise InputError("--rate", arguments.rate, "a number above 0")
    if not 0.0 <= arguments.delay < 3600.0:
        raise InputError("--delay", arguments.delay, "a time in s from 0 to 3600")
    bag = Bag(arguments.bag)
    for remark in bag.remarks:
        print(f"warning: {remark}", file=sys.stderr)
    return _replay(bag, arguments)


def _replay(bag, arguments):
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node("replay")
        senders = _senders(node, bag, arguments.topics or list(bag.topics))
        if not senders:
            raise InputError(
                str(arguments.bag), ", ".join(bag.topics) or "no topics", "a topic whose type is installed"
            )
        time.sleep(arguments.delay)
        with progress("replaying", total=bag.end_ns - bag.start_ns if bag.start_ns is not None else 0) as bar:
            count = _play(bag, senders, arguments.rate, bar)
        for publisher in senders.values():
            _wait_for_readers(publisher)
        answer.state(messages=count, topics=sorted(senders))
        print(f"{count} messages on {len(senders)} topics")
    finally:
        rclpy.try_shutdown()
    return 0


def _senders(node, bag, wanted):
    """A publisher for every topic that can be replayed."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    senders = {}
    for name in wanted:
        if name not in bag.topics:
            raise InputError(f"{bag.path}: topic", name, "one of " + ", ".join(sorted(bag.topics)))
        kind = bag.topics[name].type
        message_class = message_class_of(kind)
        if message_class is None:
            print(f"{name}: type {kind} is not installed; not replayed", file=sys.stderr)
            continue
        latched = name.rsplit("/", 1)[-1] == "driver_status"
        durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        senders[name] = node.create_publisher(message_class, name, QoSProfile(
            depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE, durability=durability))
    return senders


def message_class_of(kind):
    """The class of a message type ``package/msg/Name``, None if no installed interface package declares it.

    The name comes from the bag: a module is imported only after the ROS index of installed packages lists this very
    message, so that a bag cannot have any other module run.
    """
    from ament_index_python import get_resource

    package, _, message = kind.partition("/msg/")
    if not (package.isidentifier() and message.isidentifier()):
        return None
    try:
        declared, _ = get_resource("rosidl_interfaces", package)
    except (LookupError, OSError, ValueError):
        return None
    if not {f"msg/{message}.msg", f"msg/{message}.idl"} & set(declared.split()):
        return None
    try:
        return getattr(importlib.import_module(f"{package}.msg"), message)
    except (ImportError, AttributeError):
        return None


def _wait_for_readers(publisher):
    """Until every reader has what was sent. Raises `InputError` if one does not take it."""
    from rclpy.duration import Duration

    if not publisher.wait_for_all_acked(Duration(seconds=PATIENCE_S)):
        raise InputError(publisher.topic_name, f"a reader has not taken what was sent for {PATIENCE_S:g} s",
                         "readers that go on; stop those that hang, or replay with a lower --rate")


def _play(bag, senders, rate, bar):
    """Send every message when its time has come; the number of messages."""
    began, first, count, ahead = time.monotonic(), None, 0, dict.fromkeys(senders, 0)
    for topic, time_ns, raw in bag.raw_messages(list(senders)):
        first = time_ns if first is None else first
        rest = (time_ns - first) * 1e-9 / rate - (time.monotonic() - began)
        if rest > 1e-3:
            time.sleep(rest)
        senders[topic].publish(raw)
        count += 1
        ahead[topic] += 1
        if ahead[topic] == AHEAD:
            _wait_for_readers(senders[topic])
            ahead[topic] = 0
        bar.reach(time_ns - first)
    return count
