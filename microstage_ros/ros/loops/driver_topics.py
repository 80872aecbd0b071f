"""What the driver publishes: the state as raw bytes, everything else every so many periods or once per second."""

import math

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from microstage_msgs.msg import AxisState, DriverStatus, ServoTiming, SimulationTruth
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, JointState, RelativeHumidity, Temperature

from microstage_ros.hardware.command_gate import FAULTS
from microstage_ros.model.actuators import actuator_of
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.blocks import Outlet, periods_per_block
from microstage_ros.ros.transport.codec import ENCAPSULATION, STAMP, Codec, stamps_ns
from microstage_ros.ros.transport.servo_path import never_raising

AIR_PERIODS = 10_000


def stamp(message, time_ns, frame):
    """Fill the header of a message."""
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(time_ns, 1_000_000_000)
    message.header.frame_id = frame
    return message


def _multiples(sequence, every):
    """Places of the multiples of ``every`` among rising numbers; most blocks hold none, and are not searched."""
    if int(sequence[-1]) // every == (int(sequence[0]) - 1) // every:
        return []
    return np.flatnonzero(sequence % every == 0).tolist()


class DriverTopics:
    """The publishers of one driver.

    Parameters
    ----------
    node : the driver. servo : its servo path. axis : `Axis`. instruments : the hardware tells what simulated
    instruments see.
    """

    def __init__(self, node, servo, axis, instruments):
        p = node.parameters
        self._node, self._frame, self._every = node, p.frame_id, p.simulation_decimation
        self._joint_every = p.joint_state_decimation
        self._pack_state = Codec("AxisState").pack
        self.states = Outlet(node, servo, AxisState, topics.STATE, always=True)
        self.states.sent = self._states_sent
        self.block = periods_per_block(axis.value("period"))
        self._joint = node.create_publisher(JointState, topics.JOINT_STATES, topics.SLOW)
        self._status = node.create_publisher(DriverStatus, topics.DRIVER_STATUS, topics.LATCHED)
        self._timing = node.create_publisher(ServoTiming, topics.TIMING, topics.SLOW)
        self._diagnostics = node.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, topics.SLOW)
        self._clock = self.truths = None
        if p.mode == "lockstep" and p.publish_clock:
            self._clock_publisher = node.create_publisher(Clock, "/clock", topics.SLOW)
            self._clock = servo.writer(self._clock_publisher)
        if instruments:
            self._pack_truth = Codec("SimulationTruth").pack
            self.truths = Outlet(node, servo, SimulationTruth, topics.SIMULATION)
            self.truths.sent = self._truths_sent
            self._air = [node.create_publisher(kind, topic, topics.SLOW) for kind, topic in (
                (Temperature, topics.AIR_TEMPERATURE), (FluidPressure, topics.AIR_PRESSURE),
                (RelativeHumidity, topics.AIR_HUMIDITY))]
        actuator = actuator_of(axis)
        self._limits = {"period": axis.value("period"), "minimum": axis.value("travel.minimum"),
                        "maximum": axis.value("travel.maximum"), "voltage_limit": actuator.command_limit(axis),
                        "command_quantity": actuator.command.quantity, "command_unit": actuator.command.unit}

    def missing_readers(self, absent):
        """What is missing for the first period, in words, empty if nothing; ``absent``: names without credit."""
        p, states = self._node.parameters, self.states
        instruments = len({"interferometer_logger", "bag_recorder"} & set(p.followers))
        if states.listeners >= p.expected_subscribers and states.followers >= p.expected_followers and not absent \
                and (self.truths is None or self.truths.followers >= instruments):
            return ""
        return (f"{states.listeners} of {p.expected_subscribers} readers of the state, {states.followers} of "
                f"{p.expected_followers} of its blocks; no credit from {absent}")

    @property
    def clock_address(self):
        """Of the C structure of the clock's publisher, 0 without one."""
        return 0 if self._clock is None else int(self._clock_publisher.handle.pointer)

    def state(self, time_ns, sequence, reading, applied, status, fault):
        """Send the state of one period to the controller; returns the bytes.

        Parameters
        ----------
        time_ns : stamp. sequence : number of the period [1]. reading : `Reading`.
        applied : command of the period before [unit of the command]. status, fault : the codes of `AxisState`.
        """
        encoder, current, motor_angle = reading
        raw = self._pack_state(time_ns, sequence, encoder, applied, current, motor_angle, status, fault)
        self.states.send_single(raw)
        return raw

    def rest(self, time_ns, sequence, raw, hardware):
        """Everything else of period ``sequence`` [1], when the controller has answered: nothing here is in its way."""
        self.states.keep(sequence, raw)
        self.instruments(time_ns, sequence, hardware)
        self.end_of_block(time_ns, sequence)

    def instruments(self, time_ns, sequence, hardware):
        """What the simulated instruments see in period ``sequence`` [1]."""
        if sequence % self._every == 0 and self.truths is not None:
            self.truths.send(sequence, self._pack_truth(time_ns, sequence, *hardware.truth))

    def end_of_block(self, time_ns, sequence):
        """The clock, and the blocks, if period ``sequence`` [1] is the last of one."""
        if (sequence + 1) % self.block == 0:
            if self._clock is not None:
                self._clock(ENCAPSULATION + STAMP.pack(*divmod(time_ns, 1_000_000_000)))
            self.flush()

    @property
    def outlets(self):
        """Of the topics that go out in blocks."""
        return [outlet for outlet in (self.states, self.truths) if outlet is not None]

    def send_closed(self, wait=True):
        """Send closed blocks now: whoever should have done so is late. ``wait`` as in `Outlet.send_closed`."""
        for outlet in self.outlets:
            outlet.send_closed(wait)

    def _states_sent(self, states):
        """A joint state every so many periods, from a block of states."""
        for k in _multiples(states["sequence"], self._joint_every):
            never_raising(self._joint.publish)(
                stamp(
                    JointState(name=[self._frame], position=[float(states["position"][k])]),
                    int(stamps_ns(states[k : k + 1])[0]),
                    self._frame,
                )
            )

    def _truths_sent(self, truths):
        """The air every so many periods, from a block of what the simulated instruments see."""
        for k in _multiples(truths["sequence"], AIR_PERIODS):
            self._publish_air(int(stamps_ns(truths[k:k + 1])[0]), truths[k])

    def flush(self):
        """Send what waits for its block to be full: the axis stands still."""
        for outlet in self.outlets:
            outlet.flush()

    def _publish_air(self, time_ns, truth):
        temperature, pressure, humidity = (never_raising(publisher.publish) for publisher in self._air)
        temperature(stamp(Temperature(temperature=float(truth["air_temperature"])), time_ns, self._frame))
        pressure(stamp(FluidPressure(fluid_pressure=float(truth["air_pressure"])), time_ns, self._frame))
        humidity(stamp(RelativeHumidity(relative_humidity=float(truth["air_humidity"])), time_ns, self._frame))

    def status(self, time_ns, sequence, gate, simulated):
        """The latched status in period ``sequence`` [1]; ``gate``: `CommandGate`."""
        never_raising(self._status.publish)(self.status_message(time_ns, sequence, gate, simulated))

    def status_message(self, time_ns, sequence, gate, simulated):
        """`DriverStatus` as it is now, in period ``sequence`` [1]; ``gate``: `CommandGate`."""
        p = self._node.parameters
        return stamp(DriverStatus(
            active=gate.active and gate.fault == "none", lockstep=p.mode == "lockstep", simulated=simulated,
            fault=FAULTS.index(gate.fault), message=gate.message, backend=p.backend, sequence=max(sequence, 0),
            **self._limits, **self._node.identity()), time_ns, self._frame)

    def timing(self, time_ns, sequence, gate, counters, responses):
        """Timing and diagnostics up to period ``sequence`` [1], once per second.

        ``gate``: `CommandGate`; ``counters``: fields of `ServoTiming`; ``responses``: `ResponseTimes`.
        """
        median, p99, p9999 = responses.percentiles(0.5, 0.99, 0.9999)
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
