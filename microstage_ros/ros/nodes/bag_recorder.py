"""bag_recorder: every topic of the axis into a bag, raw bytes as they crossed; nothing is decoded.

Beside the messages the bag holds the parameters of every node, the version, the seed and the axis file
(`custom_data`). It grants the driver credit, so that a simulated axis never runs faster than the disk.
"""

import importlib
import json
import sys
import time
from contextlib import suppress
from datetime import datetime
from pathlib import Path

import numpy as np
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from microstage_ros import __version__
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags.bag import BagStopped, BagWriter, Qos, installed_definition
from microstage_ros.ros.launching.node_parameters import ParameterCollector
from microstage_ros.ros.launching.parameters import Parameters, yaml_mapping
from microstage_ros.ros.launching.process import keep_memory_steady, release_memory, run_node, running
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.blocks import Stream
from microstage_ros.ros.transport.codec import Codec, stamps_ns
from microstage_ros.ros.transport.credit import Granter, repeat_after
from microstage_ros.ros.transport.servo_path import make_servo_path, reader_qos

BATCH = 0.03
"""Time [s] from one look at all topics to the next: fewer looks, each for more; half a second's worth could wait."""
LEAST_SLEEP = 0.01
"""Sleep [s] between two looks of which one takes as long as `BATCH`: others want the processor too."""
WAIT_S = 0.05
LOOK = 0.5
DRAIN = 0.3
RELEASE_S = 5.0
"""Time [s] between two times at which free memory goes back to the system: a chunk's buffers are of all sizes."""
GLOBAL_TOPICS = ("/clock", "/diagnostics", "/parameter_events")


class Track:
    """One recorded topic of no fixed layout: its reader, its channel in the bag, and what has come."""

    missing = 0

    def __init__(self, reader, channel):
        self.reader, self.channel = reader, channel
        self.readers = (reader,)
        self.count = 0

    def drain(self, bag, time_ns):
        """Write all that waits into ``bag``, filed under ``time_ns()``. Returns how many [1]."""
        take, before = self.reader.take, self.count
        while (raw := take()) is not None:
            bag.write(self.channel, time_ns(), raw)
            self.count += 1
        return self.count - before


class ServoTrack:
    """One recorded topic of the servo path: block by block, and every gap in its numbers counted."""

    def __init__(self, stream, channel, kind, by_stamp):
        self.stream, self.channel, self._by_stamp = stream, channel, by_stamp
        self._codec = Codec(kind)
        self.count = self.missing = self._step = 0
        self.last, self.time_ns = -1, 0

    @property
    def readers(self):
        """What to wait for."""
        return self.stream.readers

    def drain(self, bag, time_ns):
        """Write all that waits into ``bag``, filed under their stamps, since what comes in a block comes late.

        Returns how many [1].
        """
        before = self.count
        while (rows := self.stream.take_all()) is not None:
            messages = self._codec.array(rows)
            sequence = messages["sequence"].astype(np.int64)
            again = sequence == np.concatenate(([self.last], sequence[:-1]))
            if again.any():  # a state that was sent once more is taken once
                rows, messages, sequence = rows[~again], messages[~again], sequence[~again]
            if not len(rows):
                continue
            by_stamp = self._by_stamp or not self.stream.singly
            times = stamps_ns(messages) if by_stamp else np.full(len(rows), time_ns())
            self._look_for_gaps(sequence)
            bag.write_block(self.channel, times, rows)
            self.count += len(rows)
            self.time_ns = int(times[-1])
        return self.count - before

    def _look_for_gaps(self, sequence):
        first, steps = int(sequence[0]), sequence[1:] - sequence[:-1]
        if self.last >= 0:
            self._count_gap(first - self.last)
        self.last = int(sequence[-1])
        if len(steps):
            self._step = self._step or int(steps[0])
            for step in steps[steps > self._step].tolist():
                self._count_gap(step)

    def _count_gap(self, step):
        """From one number to the next."""
        self._step = self._step or step
        if step > self._step > 0:
            self.missing += step // self._step - 1


class BagRecorder(Node):
    """The recorder's process."""

    def __init__(self):
        super().__init__("bag_recorder")
        p = self.parameters = Parameters(self, "bag_recorder")
        path = Path(p.directory or f"runs/{datetime.now():%Y%m%d-%H%M%S}")
        self._bag = BagWriter(path, _run(p.run) | {"version": __version__},
                              compression="" if p.compression == "none" else p.compression,
                              split_bytes=p.split_mb * 1_000_000, keep_files=p.keep_files)
        self._servo = make_servo_path(self)
        self._granter = Granter(self)
        self._collector = ParameterCollector(self)
        self._tracks, self._readers = {}, None
        self._file_under = self._latest_stamp if p.log_time == "stamp" else time.time_ns
        self._looked = self._granted = self._released = 0.0
        self._prefix = self.get_namespace().rstrip("/") + "/"
        for name, kind in _SERVO_TYPES.items():
            if name in p.servo_topics:
                self._add_servo_topic(name, kind, p.log_time == "stamp")
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
            began = time.monotonic()
            try:
                if self._drain():
                    self._bag.hand_over()  # so that a kill loses a tenth of a second and no more
                else:
                    self._wait()
            except BagStopped as error:
                self.get_logger().fatal(f"recording stopped: {error}")
                return
            now = time.monotonic()
            if now - self._looked > LOOK:
                self._looked = now
                self._look_for_topics()
            if now - self._released > RELEASE_S:
                self._released = now
                release_memory()
            self._grant(now)
            time.sleep(max(LEAST_SLEEP, began + BATCH - time.monotonic()))

    def _wait(self):
        """Sleep until something comes."""
        if self._readers is None:
            self._readers = tuple(reader for track in self._tracks.values() for reader in track.readers)
        self._servo.wait(self._readers, WAIT_S)

    def _drain(self):
        """Write all that waits; the number of messages."""
        return sum(track.drain(self._bag, self._file_under) for track in self._tracks.values())

    def _latest_stamp(self):
        """The latest stamp [ns] on the servo path."""
        return max((track.time_ns for track in self._tracks.values() if isinstance(track, ServoTrack)), default=0)

    def _grant(self, now):
        """Credit as far as the window goes, once all servo topics have their publisher."""
        state = self._tracks.get(self._prefix + topics.STATE)
        until = (state.last if state else -1) + self.parameters.window
        if until <= self._granter.until + self.parameters.window // 4 and now - self._granted < repeat_after(
            state.last if state else -1
        ):
            return
        if all(track.stream.publishers for track in self._tracks.values() if isinstance(track, ServoTrack)):
            self._granted = now
            self._granter.grant(until)

    def _look_for_topics(self):
        """Subscribe to topics of the axis that have appeared, and singly to those whose sender makes no blocks."""
        for track in self._tracks.values():
            if isinstance(track, ServoTrack) and track.stream.look():
                self._readers = None
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
            channel = self._bag.add_channel(name, installed_definition(kind), (offered,))
        except InputError as error:
            self.get_logger().warning(f"{name} is not recorded: {error}")
            return
        self._tracks[name] = Track(self._servo.reader(_message_class(kind), name, qos), channel)
        self._readers = None

    def _add_servo_topic(self, name, kind, by_stamp):
        """Begin to record one topic of the servo path."""
        channel = self._bag.add_channel(
            self._prefix + name, installed_definition(_OURS + kind), (Qos(depth=topics.DEPTH),)
        )
        stream = Stream(self, self._servo, _message_class(_OURS + kind), name)
        self._tracks[self._prefix + name] = ServoTrack(stream, channel, kind, by_stamp)

    def close(self):
        """Take what is still coming, put the parameters into the bag, close it. On a full disk what the bag holds is
        kept, as `loop` has said."""
        missing: dict[str, int] = {}
        try:
            silent_until = time.monotonic() + DRAIN
            end = time.monotonic() + self.parameters.longest_drain_s   # an axis that goes on never falls silent
            while time.monotonic() < min(silent_until, end):
                if self._drain():
                    silent_until = time.monotonic() + DRAIN
                time.sleep(BATCH)
            for name, values in self._collector.found.items():
                self._bag.custom_data[f"parameters {name}"] = json.dumps(values)
            missing = {name: track.missing for name, track in self._tracks.items() if track.missing}
            self._bag.custom_data["missing_messages"] = json.dumps(missing)
            self._bag.custom_data |= self._collector.run_facts()
        except BagStopped:
            pass
        finally:
            with suppress(BagStopped):
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


def _message_class(kind):
    """The Python class of ``package/msg/Name``."""
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def _run(text):
    """The mapping in parameter ``run``."""
    facts = yaml_mapping("bag_recorder: run", text, "{purpose: demo}")
    return {str(name): str(value) for name, value in facts.items()}


def main(arguments=None):
    """Run the node."""
    keep_memory_steady()
    return run_node(BagRecorder, arguments)


if __name__ == "__main__":
    sys.exit(main())
