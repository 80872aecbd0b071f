"""``topic list``, ``topic echo``, ``topic hz``: what ``ros2 topic`` shows, where that program is not installed."""

import re
import sys
import time

import yaml

from microstage_ros.commands import answer, units
from microstage_ros.commands.messages.replay import message_class_of
from microstage_ros.commands.parser import Parser, nearest
from microstage_ros.quantities.errors import InputError

LONGEST = 20
"""Entries of a list that are shown; the rest is counted."""


def main(argv=None):
    """Run the command. Returns 0; 1 where nothing was heard.

    Raises InputError: a name where none is expected or none where one is, one that no topic can have, a count below 1.
    """
    parser = Parser(
        prog="microstage topic", description="Topics of the running nodes: list them, show messages, measure rates."
    )
    parser.add_argument("verb", choices=("list", "echo", "hz"), help="list all; echo the messages of one; hz: its rate")
    parser.add_argument("name", nargs="?", metavar="TOPIC", help="such as /axis/driver_status (echo, hz)")
    parser.add_argument(
        "--number",
        "-n",
        type=int,
        metavar="N",
        help="echo: so many messages, then end (default: until Ctrl-C)",
    )
    parser.add_argument("--once", action="store_true", help="echo: one message, then end")
    parser.add_argument(
        "--time", type=units.duration, default=2.0, metavar="TIME", help="hz: measure so long (default 2s)"
    )
    parser.add_argument(
        "--wait",
        type=units.duration,
        default=5.0,
        metavar="TIME",
        help="longest wait for the topic and its first message (default 5s)",
    )
    parser.add_argument("--all", action="store_true", help="list: hidden topics too")
    arguments = parser.parse_args(argv)
    if (arguments.name is None) != (arguments.verb == "list"):
        raise InputError(
            f"topic {arguments.verb}",
            arguments.name,
            "no name" if arguments.verb == "list" else "the name of a topic, such as /axis/driver_status",
        )
    if arguments.number is not None and arguments.number < 1:
        raise InputError("--number", arguments.number, "1 or more messages")
    if arguments.name is not None:
        arguments.name = arguments.name if arguments.name.startswith("/") else f"/{arguments.name}"
        if not re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", arguments.name):
            raise InputError(
                f"topic {arguments.verb}", arguments.name, "a name of letters, digits, _ and /, such as /axis/state"
            )
    return _run(arguments)


def _run(arguments):
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node("topic")
        if arguments.verb == "list":
            return _list(node, arguments)
        reader = _Reader(node, arguments)
        return (
            reader.echo(1 if arguments.once else arguments.number or 0)
            if arguments.verb == "echo"
            else reader.rate(arguments.time)
        )
    finally:
        rclpy.try_shutdown()


def _list(node, arguments):
    """One line per topic: name, type, who publishes and reads."""
    import rclpy

    end = time.monotonic() + min(arguments.wait, 1.0)
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.05)
    rows = [(name, kinds[0], node.count_publishers(name), node.count_subscribers(name))
            for name, kinds in sorted(node.get_topic_names_and_types()) if arguments.all or "/_" not in name]
    answer.state(topics=[dict(zip(("name", "type", "publishers", "readers"), row)) for row in rows])
    width = max((len(row[0]) for row in rows), default=0)
    for name, kind, publishers, readers in rows:
        print(
            f"{name:{width}}  {kind}  {publishers} publisher{'s' * (publishers != 1)}, {readers}"
            f" reader{'s' * (readers != 1)}"
        )
    return 0


class _Reader:
    """Hears one topic."""

    def __init__(self, node, arguments):
        import rclpy
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        from microstage_ros.ros.transport.topics import DEPTH

        self._node, self._wait, self._spin = node, arguments.wait, rclpy.spin_once
        self.name = arguments.name
        offered = self._offered(time.monotonic() + arguments.wait)
        kind = offered[0].topic_type
        message_class = message_class_of(kind)
        if message_class is None:
            raise InputError(self.name, kind, "a message type that is installed here")
        profiles = [entry.qos_profile for entry in offered]
        reliable = all(profile.reliability == ReliabilityPolicy.RELIABLE for profile in profiles)
        latched = all(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for profile in profiles)
        self._heard = []
        node.create_subscription(
            message_class,
            self.name,
            lambda message: self._heard.append((time.monotonic(), message)),
            QoSProfile(
                depth=DEPTH,
                reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
                durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
            ),
        )

    def _offered(self, end):
        """What the publishers of the topic offer. Raises `InputError` with the topics there are."""
        while not (offered := self._node.get_publishers_info_by_topic(self.name)):
            self._spin(self._node, timeout_sec=0.05)
            if time.monotonic() > end:
                names = sorted(name for name, _ in self._node.get_topic_names_and_types() if "/_" not in name)
                raise InputError(
                    "topic",
                    self.name,
                    f"one that somebody publishes{nearest(self.name, names)} (./microstage topic list)",
                )
        return offered

    def _first(self):
        """Wait for the first message; False where none comes."""
        end = time.monotonic() + self._wait
        while not self._heard:
            self._spin(self._node, timeout_sec=0.05)
            if time.monotonic() > end:
                print(f"{self.name}: no message within {self._wait:g} s", file=sys.stderr)
                return False
        return True

    def echo(self, number):
        """Print messages as YAML; ``number`` of them, 0: without end."""
        if not self._first():
            return 1
        shown = []
        while not number or len(shown) < number:
            while self._heard and (not number or len(shown) < number):
                message = as_plain(self._heard.pop(0)[1])
                print(yaml.safe_dump(message, sort_keys=False, allow_unicode=True) + "---", flush=True)
                shown = [*shown, message] if number else []
            if not number or len(shown) < number:
                self._spin(self._node, timeout_sec=0.05)
        answer.state(topic=self.name, messages=shown)
        return 0

    def rate(self, seconds):
        """Print how many messages a second come, and their spacing."""
        if not self._first():
            return 1
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._spin(self._node, timeout_sec=0.05)
        times = [at for at, _ in self._heard]
        if len(times) < 2:
            print(f"{self.name}: {len(times)} message in {seconds:g} s")
            answer.state(topic=self.name, messages=len(times))
            return 0
        gaps = [b - a for a, b in zip(times, times[1:])]
        rate = len(gaps) / (times[-1] - times[0]) if times[-1] > times[0] else float("nan")
        answer.state(
            topic=self.name, messages=len(times), rate_Hz=rate, spacing_min_s=min(gaps), spacing_max_s=max(gaps)
        )
        print(
            f"{self.name}: {rate:.1f} Hz, {len(times)} messages, spacing {min(gaps) * 1e3:.2f} …"
            f" {max(gaps) * 1e3:.2f} ms"
        )
        return 0


def as_plain(value):
    """``value``, a message or a field of one [its own unit], as plain data; long lists are cut and say so."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: as_plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, (bytes, bytearray)):
        value = list(value)
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        shown = [as_plain(entry) for entry in value[:LONGEST]]
        return shown + [f"… {len(value) - LONGEST} more"] if len(value) > LONGEST else shown
    return value
