"""bag_recorder: every topic of the axis into a bag, raw bytes as they crossed; nothing is decoded.

Beside the messages the bag holds the parameters of every node, the version, the seed and the axis file
(`custom_data`). It grants the driver credit, so that a simulated axis never runs faster than the disk.
"""

import importlib
import json
import sys
import time
from datetime import datetime
from pathlib import Path

import yaml
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from microstage_ros import __version__
from microstage_ros.axis.errors import InputError
from microstage_ros.nodes import topics
from microstage_ros.nodes.codec import stamp_ns
from microstage_ros.nodes.credit import Granter
from microstage_ros.nodes.node_parameters import ParameterCollector
from microstage_ros.nodes.parameters import Parameters
from microstage_ros.nodes.process import run_node, running
from microstage_ros.nodes.servo_path import make_servo_path, reader_qos
from microstage_ros.records.bag import BagStopped, BagWriter, Qos, installed_definition

BATCH = 0.005
QUIET = 0.05
LOOK = 0.5
DRAIN = 0.3
SEQUENCE_AT = {"AxisState", "VoltageCommand"}
GLOBAL_TOPICS = ("/clock", "/diagnostics", "/parameter_events")


class Track:
    """One recorded topic: its reader, its channel in the bag, and what has come."""

    def __init__(self, reader, channel, stamped, sequence_at):
        self.reader, self.channel, self.stamped, self.sequence_at = reader, channel, stamped, sequence_at
        self.count, self.last, self.missing, self.repeated = 0, -1, 0, 0


class BagRecorder(Node):
    """The recorder's process."""

    def __init__(self):
        super().__init__("bag_recorder")
        p = self.parameters = Parameters(self, "bag_recorder")
        path = Path(p.directory or f"runs/{datetime.now():%Y%m%d-%H%M%S}")
        self._bag = BagWriter(path, _run(p.run) | {"version": __version__},
                              compression="" if p.compression == "none" else p.compression)
        self._servo = make_servo_path(self)
        self._granter = Granter(self)
        self._collector = ParameterCollector(self)
        self._tracks, self._readers = {}, ()
        self._time_ns = 0
        self._looked = self._granted = 0.0
        self._prefix = self.get_namespace().rstrip("/") + "/"
        for name, kind in _SERVO_TYPES.items():
            if name in p.servo_topics:
                self._add(self._prefix + name, _OURS + kind, Qos(depth=topics.DEPTH),
                          reader_qos(topics.DEPTH, reliable=True))
        self._add(self._prefix + topics.DRIVER_STATUS, _OURS + "DriverStatus",
                  Qos(depth=1, durability="transient_local"), reader_qos(100, reliable=True, latched=True))
        for name, kind in _SLOW_TYPES.items():
            full = name if name.startswith("/") else self._prefix + name
            if name not in p.exclude:
                self._add(full, kind, Qos(depth=100), reader_qos(1000, reliable=True))

    def loop(self):
        """Take and write until the process is asked to stop."""
        self.get_logger().info(f"recording to {self._bag.file}")
        while running():
            try:
                if not self._drain():
                    self._servo.wait(self._readers, QUIET)
            except BagStopped as error:
                self.get_logger().fatal(f"recording stopped: {error}")
                return
            now = time.monotonic()
            if now - self._looked > LOOK:
                self._looked = now
                self._look_for_topics()
            self._grant(now)
            time.sleep(BATCH)

    def _drain(self):
        """Write all that waits; the number of messages."""
        total = 0
        for track in self._tracks.values():
            take, write, channel = track.reader.take, self._bag.write, track.channel
            by_stamp = self.parameters.log_time == "stamp"
            while (raw := take()) is not None:
                total += 1
                if track.sequence_at and self._seen(track, raw):
                    continue
                if not by_stamp:
                    self._time_ns = time.time_ns()
                elif track.stamped:
                    self._time_ns = stamp_ns(raw)
                track.count += 1
                write(channel, self._time_ns, raw)
        return total

    def _seen(self, track, raw):
        """Count gaps in the numbers of a servo topic; True for a message that has come before."""
        at = track.sequence_at
        sequence = int.from_bytes(raw[at:at + 8], "little")
        if sequence == track.last:
            track.repeated += 1
            return True
        if sequence > track.last + 1 and track.last >= 0:
            track.missing += sequence - track.last - 1
        track.last = sequence
        return False

    def _grant(self, now):
        """Credit as far as the window goes, once all servo topics have their publisher."""
        state = self._tracks.get(self._prefix + topics.STATE)
        until = (state.last if state else -1) + self.parameters.window
        if until <= self._granter.until + self.parameters.window // 4 and now - self._granted < 0.5:
            return
        if all(track.reader.publishers for name, track in self._tracks.items()
               if name.removeprefix(self._prefix) in self.parameters.servo_topics):
            self._granted = now
            self._granter.grant(until)

    def _look_for_topics(self):
        """Subscribe to topics of the axis that have appeared."""
        excluded = {self._prefix + name for name in self.parameters.exclude if name}
        for name, kinds in self.get_topic_names_and_types():
            ours = name.startswith(self._prefix) or name in GLOBAL_TOPICS
            hidden = any(part.startswith("_") for part in name.split("/"))
            if not ours or hidden or name in self._tracks or name in excluded or name == self._prefix + topics.CREDIT:
                continue
            offers = self.get_publishers_info_by_topic(name)
            if offers:
                latched = all(o.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for o in offers)
                reliable = all(o.qos_profile.reliability == ReliabilityPolicy.RELIABLE for o in offers)
                offered = Qos(depth=100, reliability="reliable" if reliable else "best_effort",
                              durability="transient_local" if latched else "volatile")
                self._add(name, kinds[0], offered, reader_qos(1000, reliable, latched))
        self._collector.look(self._prefix)

    def _add(self, name, kind, offered, qos):
        """Begin to record one topic."""
        try:
            definition = installed_definition(kind)
        except InputError as error:
            self.get_logger().warning(f"{name} is not recorded: {error}")
            return
        channel = self._bag.add_channel(name, definition, (offered,))
        fields = definition.fields
        stamped = name.startswith(self._prefix) and bool(fields) and fields[0].type == "std_msgs/Header"
        sequence_at = _sequence_place(definition) if kind.split("/")[-1] in SEQUENCE_AT else None
        self._tracks[name] = Track(self._servo.reader(_message_class(kind), name, qos), channel, stamped, sequence_at)
        self._readers = tuple(track.reader for track in self._tracks.values())

    def close(self):
        """Take what is still coming, put the parameters into the bag, close it."""
        try:
            quiet = time.monotonic() + DRAIN
            while time.monotonic() < quiet:
                if self._drain():
                    quiet = time.monotonic() + DRAIN
                time.sleep(BATCH)
            for name, values in self._collector.found.items():
                self._bag.custom_data[f"parameters {name}"] = json.dumps(values)
            missing = {name: track.missing for name, track in self._tracks.items() if track.missing}
            self._bag.custom_data["missing_messages"] = json.dumps(missing)
            self._bag.custom_data |= self._collector.run_facts()
        except BagStopped:
            pass
        finally:
            self._bag.close()
        counted = sum(track.count for track in self._tracks.values())
        print(f"{counted} messages in {self._bag.folder or self._bag.file}"
              + (f", missing: {missing}" if missing else ", none missing"), flush=True)


_OURS = "microstage_msgs/msg/"
_SERVO_TYPES = {
    topics.STATE: "AxisState", topics.COMMAND: "VoltageCommand", topics.CONTROLLER_STATE: "ControllerState",
    topics.FRICTION: "FrictionState", topics.INTERFEROMETER: "InterferometerReading",
    topics.SIMULATION: "SimulationTruth",
}
_SLOW_TYPES = {
    topics.TIMING: _OURS + "ServoTiming", topics.JOINT_STATES: "sensor_msgs/msg/JointState",
    topics.AIR_TEMPERATURE: "sensor_msgs/msg/Temperature", topics.AIR_PRESSURE: "sensor_msgs/msg/FluidPressure",
    topics.AIR_HUMIDITY: "sensor_msgs/msg/RelativeHumidity", "/clock": "rosgraph_msgs/msg/Clock",
    topics.DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray",
}


def _sequence_place(definition):
    """Byte at which the sequence number begins, for the axis's frame."""
    from microstage_ros.records.layout import layout_of_type

    return layout_of_type(definition, {"header.frame_id": 5}).offset("sequence")


def _message_class(kind):
    """The Python class of ``package/msg/Name``."""
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def _run(text):
    """The mapping in parameter ``run``."""
    facts = yaml.safe_load(text) or {}
    if not isinstance(facts, dict):
        raise InputError("bag_recorder: run", text, "YAML such as {purpose: demo}")
    return {str(name): str(value) for name, value in facts.items()}


def main(arguments=None):
    """Run the node."""
    return run_node(BagRecorder, arguments)


if __name__ == "__main__":
    sys.exit(main())
