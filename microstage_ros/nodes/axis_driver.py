"""axis_driver: the only node that touches the hardware. Lifecycle; lockstep or paced; zero voltage on any fault.

lockstep   simulated time: period n begins when the command for n - 1 is in force and every follower has
           granted credit for it; stamps are n T. The run depends on seed and commands alone.
paced      wall clock: period n begins at its time whatever happens; the newest valid command is in force
           (`hardware.command_gate` says what happens to late, lost, repeated and bad ones).
"""

import queue
import sys
import threading
import time

import yaml
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from std_srvs.srv import Trigger

from microstage_msgs.msg import AxisState, Credit, VoltageCommand
from microstage_ros.axis.axis_file import load_axis
from microstage_ros.axis.errors import InputError
from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.command_gate import FAULTS, CommandGate
from microstage_ros.hardware.protocol import HardwareError, Reading, Setup
from microstage_ros.nodes import topics
from microstage_ros.nodes.codec import Codec
from microstage_ros.nodes.credit import Ledger
from microstage_ros.nodes.driver_topics import DriverTopics
from microstage_ros.nodes.parameters import Parameters
from microstage_ros.nodes.process import run_node, running
from microstage_ros.nodes.response_times import ResponseTimes
from microstage_ros.nodes.scheduling import SPIN, ask_for_priority, sleep_precisely, sleep_until
from microstage_ros.nodes.servo_path import make_servo_path, reader_qos
from microstage_ros.places import config_file

SLICE = 0.05
"""Longest wait [s] before the loop looks for requests of the other thread."""

TRAVEL_MARGIN = 1e-4


class AxisDriver(LifecycleNode):
    """The driver's process: the servo loop has the hardware and the gate to itself, requests are handed to it."""

    def __init__(self):
        super().__init__("axis_driver")
        p = self.parameters = Parameters(self, "axis_driver")
        self.axis = load_axis(p.axis_file or config_file("axis.yaml"))
        self.period = self.axis.value("period")
        self._travel = (self.axis.value("travel.minimum") - TRAVEL_MARGIN,
                        self.axis.value("travel.maximum") + TRAVEL_MARGIN)
        self.gate = CommandGate(self.axis.value("drive.voltage_limit"))
        self.ledger = Ledger(p.followers)
        self.responses = ResponseTimes()
        self.sequence, self.overruns, self._time_ns = -1, 0, 0
        self._requests = queue.SimpleQueue()
        self._due = self._told = None
        setup = Setup(self.axis, p.seed, _options(p.backend_options))
        self.hardware = make_hardware(p.backend, setup)
        if p.mode == "lockstep" and not self.hardware.simulated:
            raise InputError("axis_driver: parameter mode", p.mode, f"paced: backend {p.backend} has its own time")
        servo = self._servo = make_servo_path(self)
        self._commands = servo.reader(VoltageCommand, topics.COMMAND, reader_qos(100, reliable=False))
        self._credits = servo.reader(Credit, topics.CREDIT, reader_qos(1000, reliable=True))
        self._command = Codec("VoltageCommand", p.frame_id)
        self.topics = DriverTopics(self, servo, self.axis, self.hardware.simulated)
        self.create_service(Trigger, topics.RESET_FAULT, self._reset_fault)
        self.create_timer(1.0, self._once_per_second)
        ask_for_priority(self.get_logger(), p.real_time_priority)
        if p.activate:
            self._starter = threading.Thread(target=self._start_alone, daemon=True)
            self._starter.start()

    # --- requests from the other thread -------------------------------------------------------------------

    def on_configure(self, state):
        """Take hold of the hardware."""
        return self._in_loop(self._open)

    def on_activate(self, state):
        """Begin; refused while a fault is latched, or readers or followers are missing."""
        missing = self._missing_readers()
        if missing:
            self.get_logger().error(f"not activated: {missing}")
            return TransitionCallbackReturn.FAILURE
        return self._in_loop(self._activate)

    def on_deactivate(self, state):
        """Zero voltage."""
        return self._in_loop(self._deactivate)

    def on_cleanup(self, state):
        """Let go of the hardware."""
        return self._in_loop(self.hardware.close)

    def on_shutdown(self, state):
        """Zero voltage, let go of the hardware."""
        return self._in_loop(self._shut)

    def _in_loop(self, action):
        """Have the servo loop do it between two periods. Returns the transition's result."""
        done, result = threading.Event(), []
        self._requests.put((action, done, result))
        if not done.wait(5.0) or not result:
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS if result[0] is not False else TransitionCallbackReturn.FAILURE

    def _missing_readers(self):
        """What is missing for the first period, in words; waits a while for it."""
        p, until = self.parameters, time.monotonic() + self.parameters.ready_timeout_s
        while True:
            readers = self.topics.state_publisher.get_subscription_count()
            absent = self.ledger.missing() if p.mode == "lockstep" else []
            if readers >= p.expected_subscribers and not absent and self.topics.truth_has_readers(p.followers):
                return ""
            if time.monotonic() > until:
                return f"{readers} of {p.expected_subscribers} readers of the state; no credit from {absent}"
            time.sleep(0.005)

    def _reset_fault(self, request, response):
        fault = self.gate.fault
        response.success = self._in_loop(self.gate.reset) == TransitionCallbackReturn.SUCCESS
        response.message = f"was: {fault}"
        return response

    def _start_alone(self):
        """Without a lifecycle manager."""
        time.sleep(0.1)
        self.trigger_configure()
        self.trigger_activate()

    # --- in the servo loop --------------------------------------------------------------------------------

    def loop(self):
        """The servo loop."""
        sleep_precisely()
        period = self._lockstep_period if self.parameters.mode == "lockstep" else self._paced_period
        while running():
            self._serve_requests()
            if self.gate.fault != "none":
                self._faulted_period()
            elif self.gate.active:
                period()
            else:
                self._idle()
            if self._told != (self.gate.active, self.gate.fault):
                self._tell()

    def _serve_requests(self):
        while not self._requests.empty():
            action, done, result = self._requests.get()
            try:
                result.append(action())
            except (HardwareError, InputError) as error:
                self.get_logger().error(str(error))
            done.set()

    def _open(self):
        self.hardware.open()

    def _activate(self):
        if not self.gate.activate():
            self.get_logger().error(f"not activated: fault {self.gate.fault} is latched ({self.gate.message}); "
                                    f"service {topics.RESET_FAULT} forgets it")
            return False
        self._due = None
        self._tell()
        return True

    def _deactivate(self):
        self.gate.deactivate()
        self._write(0.0)
        self._tell()

    def _shut(self):
        self._deactivate()
        self.hardware.close()

    def _tell(self):
        self._told = (self.gate.active, self.gate.fault)
        if self.gate.fault != "none":
            self.get_logger().error(f"fault {self.gate.fault}: {self.gate.message}; the voltage is zero")
        self.topics.status(self._time_ns, self.sequence, self.gate, self.hardware.simulated)

    def _idle(self):
        self._servo.wait((self._commands, self._credits), SLICE)
        self._take_commands()
        self._take_credits()

    def _begin(self, time_ns):
        """Read, publish: the control period begins."""
        try:
            reading = self.hardware.read()
        except HardwareError as error:
            self.gate.trip("hardware", str(error))
            reading = Reading(float("nan"))
        gate = self.gate
        late = gate.active and gate.last != gate.period
        self.sequence = n = self.sequence + 1
        self._time_ns = time_ns
        if not self._travel[0] <= reading.encoder <= self._travel[1] and gate.fault == "none":
            gate.trip("travel", f"the encoder reads {reading.encoder!r} m, the travel is {self._travel} m")
        status = (gate.active and AxisState.STATUS_ACTIVE) | (self.hardware.simulated and AxisState.STATUS_SIMULATED) \
            | (self.parameters.mode == "lockstep" and AxisState.STATUS_LOCKSTEP) \
            | (gate.saturated and AxisState.STATUS_SATURATED) | (late and AxisState.STATUS_COMMAND_LATE) \
            | (gate.fault != "none" and AxisState.STATUS_FAULT)
        gate.begin(n)
        raw = self.topics.state(time_ns, n, reading, gate.voltage, int(status), FAULTS.index(gate.fault))
        self.topics.decimated(time_ns, n, reading, self.hardware)
        return raw

    def _write(self, voltage):
        try:
            self.hardware.write(voltage)
        except HardwareError as error:
            self.gate.trip("hardware", str(error))

    def _lockstep_period(self):
        n = self.sequence + 1
        if n > self.ledger.limit and not self._await_credit(n):
            return
        if self.parameters.rate_limit > 0.0:
            self._hold_back(self.period / self.parameters.rate_limit)
        begun = time.perf_counter()
        raw = self._begin(round(n * self.period * 1e9))
        gate, readers, resent = self.gate, (self._commands,), begun
        while gate.fault == "none" and gate.last != n:
            self._servo.wait(readers, SLICE)
            self._take_commands()
            if gate.last == n:
                break
            self._serve_requests()
            waited = time.perf_counter()
            if not gate.active or not running():
                return
            if waited - begun > self.parameters.command_timeout_lockstep_s:
                gate.trip("command_timeout", f"no command for period {n} within {waited - begun:.1f} s")
            elif waited - resent > self.parameters.resend_s:
                resent = waited
                self.topics.send_state(raw)
        self.responses.add(time.perf_counter() - begun)
        self._write(gate.voltage)

    def _paced_period(self):
        self._hold_back(self.period)
        begun = time.perf_counter()
        self._begin(time.time_ns())
        gate, n, readers = self.gate, self.sequence, (self._commands,)
        self._write(gate.voltage)
        end = self._due + self.period - SPIN
        while gate.fault == "none" and gate.last != n:
            rest = end - time.perf_counter()
            if rest <= 0.0:
                break
            self._servo.wait(readers, rest)
            if self._take_commands():
                self._write(gate.voltage)
        if gate.last == n:
            self.responses.add(time.perf_counter() - begun)
        gate.close_period(self.parameters.command_timeout_periods)
        if self._requests.empty() and n % 100 == 0:
            self._take_credits()

    def _faulted_period(self):
        """Go on measuring in real time with zero voltage, whatever commands say."""
        self._hold_back(max(self.period, 1e-3))
        self._write(0.0)
        self._begin(round((self.sequence + 1) * self.period * 1e9) if self.parameters.mode == "lockstep"
                    else time.time_ns())
        self._take_commands()
        self._take_credits()

    def _hold_back(self, period):
        """Sleep until the next period is due; a period that begins more than half of one late is an overrun."""
        now = time.perf_counter()
        if self._due is None:
            self._due = now
        self._due += period
        if now > self._due + period / 2:
            self.overruns += 1
            if now > self._due + period:
                self._due = now
        sleep_until(self._due)

    def _await_credit(self, n):
        """Wait for credit for period ``n``, one slice long."""
        self._take_credits()
        if n <= self.ledger.limit:
            return True
        self._servo.wait((self._credits, self._commands), SLICE)
        self._take_commands()
        self._take_credits()
        for name in self.ledger.drop_silent(self.parameters.follower_timeout_s):
            self.get_logger().warning(f"{name} has been silent for {self.parameters.follower_timeout_s} s "
                                      "and is no longer waited for: it will miss messages")
        return n <= self.ledger.limit

    def _take_commands(self):
        """Offer all waiting commands to the gate; True if one is in force."""
        obeyed = False
        while (raw := self._commands.take()) is not None:
            sequence, voltage, _, _, _ = self._command.unpack(raw)
            obeyed = self.gate.offer(sequence, voltage) or obeyed
        return obeyed

    def _take_credits(self):
        from rclpy.serialization import deserialize_message

        while (raw := self._credits.take()) is not None:
            self.ledger.add(deserialize_message(raw, Credit))

    def _once_per_second(self):
        self.topics.timing(self._time_ns, self.sequence, self.gate, self.overruns, self.responses)

    def close(self):
        """Zero voltage, let go of the hardware."""
        self.gate.deactivate()
        self._write(0.0)
        self.hardware.close()


def _options(text):
    """The mapping in parameter ``backend_options``."""
    try:
        options = yaml.safe_load(text) or {}
    except yaml.YAMLError as error:
        raise InputError("axis_driver: backend_options", text, f"YAML such as {{position: 0.0}} ({error})") from None
    if not isinstance(options, dict):
        raise InputError("axis_driver: backend_options", text, "YAML such as {position: 0.0}")
    return options


def main(arguments=None):
    """Run the node."""
    return run_node(AxisDriver, arguments)


if __name__ == "__main__":
    sys.exit(main())
