"""What the driver publishes: the state as raw bytes, everything else every so many periods or once per second."""

import math

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, JointState, RelativeHumidity, Temperature

from microstage_msgs.msg import AxisState, DriverStatus, ServoTiming, SimulationTruth
from microstage_ros.hardware.command_gate import FAULTS
from microstage_ros.nodes import topics
from microstage_ros.nodes.codec import STAMP, Codec

AIR_PERIODS = 10_000
CLOCK_HEAD = b"\x00\x01\x00\x00"


def stamp(message, time_ns, frame):
    """Fill the header of a message."""
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(time_ns, 1_000_000_000)
    message.header.frame_id = frame
    return message


class DriverTopics:
    """The publishers of one driver.

    Parameters
    ----------
    node : the driver. servo : its servo path. axis : `Axis`. simulated : the hardware is a simulation.
    """

    def __init__(self, node, servo, axis, simulated):
        p = node.parameters
        self._node, self._frame, self._every = node, p.frame_id, p.simulation_decimation
        self._joint_every = p.joint_state_decimation
        self._state_codec = Codec("AxisState", p.frame_id)
        self.state_publisher = node.create_publisher(AxisState, topics.STATE, topics.SERVO)
        self.send_state = servo.writer(self.state_publisher)
        self._joint = node.create_publisher(JointState, topics.JOINT_STATES, topics.SLOW)
        self._status = node.create_publisher(DriverStatus, topics.DRIVER_STATUS, topics.LATCHED)
        self._timing = node.create_publisher(ServoTiming, topics.TIMING, topics.SLOW)
        self._diagnostics = node.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, topics.SLOW)
        self._clock = self._truth = None
        if p.mode == "lockstep" and p.publish_clock:
            self._clock = servo.writer(node.create_publisher(Clock, "/clock", topics.SLOW))
        if simulated:
            self._truth_codec = Codec("SimulationTruth", p.frame_id)
            self._truth_publisher = node.create_publisher(SimulationTruth, topics.SIMULATION, topics.SERVO)
            self._truth = servo.writer(self._truth_publisher)
            self._air = [node.create_publisher(kind, topic, topics.SLOW) for kind, topic in (
                (Temperature, topics.AIR_TEMPERATURE), (FluidPressure, topics.AIR_PRESSURE),
                (RelativeHumidity, topics.AIR_HUMIDITY))]
        self._limits = {"period": axis.value("period"), "minimum": axis.value("travel.minimum"),
                        "maximum": axis.value("travel.maximum"), "voltage_limit": axis.value("drive.voltage_limit")}

    def truth_has_readers(self, followers):
        """True if those of the followers that read the simulated instruments are there."""
        wanted = len({"interferometer_logger", "bag_recorder"} & set(followers))
        return self._truth is None or self._truth_publisher.get_subscription_count() >= wanted

    def state(self, time_ns, sequence, reading, applied, status, fault):
        """Send the state of one period; returns the bytes."""
        raw = self._state_codec.pack(time_ns, sequence, reading.encoder, applied, reading.current,
                                     reading.motor_angle, status, fault)
        self.send_state(raw)
        return raw

    def decimated(self, time_ns, sequence, reading, hardware):
        """Everything that goes out every so many periods."""
        if sequence % self._every == 0:
            if self._clock is not None:
                self._clock(CLOCK_HEAD + STAMP.pack(*divmod(time_ns, 1_000_000_000)))
            if self._truth is not None:
                truth = hardware.truth
                self._truth(self._truth_codec.pack(time_ns, sequence, *truth))
                if sequence % AIR_PERIODS == 0:
                    self._publish_air(time_ns, truth)
        if sequence % self._joint_every == 0:
            message = stamp(JointState(name=[self._frame], position=[reading.encoder]), time_ns, self._frame)
            self._joint.publish(message)

    def _publish_air(self, time_ns, truth):
        temperature, pressure, humidity = self._air
        temperature.publish(stamp(Temperature(temperature=truth.air_temperature), time_ns, self._frame))
        pressure.publish(stamp(FluidPressure(fluid_pressure=truth.air_pressure), time_ns, self._frame))
        humidity.publish(stamp(RelativeHumidity(relative_humidity=truth.air_humidity), time_ns, self._frame))

    def status(self, time_ns, sequence, gate, simulated):
        """The latched status."""
        p = self._node.parameters
        self._status.publish(stamp(DriverStatus(
            active=gate.active and gate.fault == "none", lockstep=p.mode == "lockstep", simulated=simulated,
            fault=FAULTS.index(gate.fault), message=gate.message, backend=p.backend, sequence=max(sequence, 0),
            **self._limits), time_ns, self._frame))

    def timing(self, time_ns, sequence, gate, overruns, responses):
        """Timing and diagnostics, once per second."""
        median, p99, p9999 = responses.percentiles(0.5, 0.99, 0.9999)
        counters = {"answered": gate.answered, "late": gate.late, "lost": gate.lost, "duplicated": gate.duplicated,
                    "reordered": gate.reordered, "overruns": overruns}
        self._timing.publish(stamp(ServoTiming(
            periods=sequence + 1, **counters, response_median=median, response_p99=p99, response_p9999=p9999,
            response_maximum=responses.maximum, response_histogram=responses.histogram()), time_ns, self._frame))
        good = gate.fault == "none"
        status = DiagnosticStatus(
            level=DiagnosticStatus.OK if good else DiagnosticStatus.ERROR, name=self._node.get_fully_qualified_name(),
            message="active" if good and gate.active else "inactive" if good else f"fault {gate.fault}: {gate.message}",
            hardware_id=self._node.parameters.backend)
        times = {"response_median_s": median, "response_p99_s": p99, "response_maximum_s": responses.maximum}
        status.values = [KeyValue(key=k, value=str(v)) for k, v in counters.items()] + [
            KeyValue(key=k, value=f"{v:.3g}") for k, v in times.items() if not math.isnan(v)]
        self._diagnostics.publish(stamp(DiagnosticArray(status=[status]), time_ns, self._frame))
