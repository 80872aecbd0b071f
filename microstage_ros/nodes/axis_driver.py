"""axis_driver: the only node that touches the hardware. Lifecycle; lockstep or paced; zero voltage on any fault.

lockstep   simulated time: period n begins when the command for n - 1 is in force and every follower has
           granted credit for it; stamps are n T. The run depends on seed and commands alone.
paced      wall clock: period n begins at its time whatever happens; the newest valid command is in force
           (`hardware.command_gate` says what happens to late, lost, repeated and bad ones).
"""

import sys
import threading
import time

from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from std_srvs.srv import Trigger

from microstage_msgs.msg import AxisState, Credit, VoltageCommand
from microstage_ros.axis.axis_file import load_axis
from microstage_ros.axis.errors import InputError
from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.command_gate import FAULTS, CommandGate
from microstage_ros.hardware.protocol import HardwareError, Reading, Setup
from microstage_ros.nodes import topics
from microstage_ros.nodes.blocks import Sender
from microstage_ros.nodes.codec import Codec
from microstage_ros.nodes.credit import UNLIMITED, CreditReader, Ledger
from microstage_ros.nodes.driver_loop import CROWDED, MISSED, NO_CREDIT, STRANGE, TRAVEL, WAITED, QuickPeriods, timing
from microstage_ros.nodes.driver_topics import DriverTopics
from microstage_ros.nodes.parameters import Parameters, yaml_mapping
from microstage_ros.nodes.process import run_node, running
from microstage_ros.nodes.response_times import ResponseTimes
from microstage_ros.nodes.scheduling import SPIN, sleep_precisely, sleep_until
from microstage_ros.nodes.requests import Requests
from microstage_ros.nodes.servo_path import FastServoPath, make_servo_path, reader_qos
from microstage_ros.places import config_file

SLICE = 0.05
"""Longest wait [s] before the loop looks for requests of the other thread."""

TRAVEL_MARGIN = 1e-4
_ACTIVE, _SATURATED, _LATE, _FAULT = (
    AxisState.STATUS_ACTIVE, AxisState.STATUS_SATURATED, AxisState.STATUS_COMMAND_LATE, AxisState.STATUS_FAULT)


class AxisDriver(LifecycleNode):
    """The driver's process: the servo loop has the hardware and the gate to itself, requests are handed to it."""

    def __init__(self):
        super().__init__("axis_driver")
        p = self.parameters = Parameters(self, "axis_driver")
        self.axis = load_axis(p.axis_file or config_file("axis.yaml"))
        self.period = self.axis.value("period")
        self._travel = (self.axis.value("travel.minimum") - TRAVEL_MARGIN,
                        self.axis.value("travel.maximum") + TRAVEL_MARGIN)
        self._lockstep = p.mode == "lockstep"
        self.gate = CommandGate(self.axis.value("drive.voltage_limit"))
        self.ledger = Ledger(p.followers)
        self.responses = ResponseTimes()
        self.sequence, self.overruns, self._time_ns, self._due, self._told = -1, 0, 0, None, None
        setup = Setup(self.axis, p.seed, yaml_mapping("axis_driver: backend_options", p.backend_options, "{position: 0.0}"))
        self.hardware = make_hardware(p.backend, setup)
        if p.mode == "lockstep" and not self.hardware.simulated:
            raise InputError("axis_driver: parameter mode", p.mode, f"paced: backend {p.backend} has its own time")
        servo = self._servo = make_servo_path(self)
        quick = p.compiled_loop and isinstance(servo, FastServoPath) and hasattr(self.hardware, "arrays")
        side = make_servo_path(self) if quick else servo
        self._requests, self._quick = Requests(servo.semaphore.post_now if quick else lambda: None), None
        self._credits = CreditReader(side.reader(Credit, topics.CREDIT, reader_qos(1000, reliable=True)), self.ledger,
                                     self._on_credit)
        self._commands = servo.reader(VoltageCommand, topics.COMMAND, reader_qos(100, reliable=False))
        self._command_readers = (self._commands,)
        self._idle_readers = (self._commands,) if quick else (self._credits.reader, self._commands)
        self._unpack_command = Codec("VoltageCommand").unpack
        self._constant_status = (AxisState.STATUS_SIMULATED if self.hardware.simulated else 0) | (
            AxisState.STATUS_LOCKSTEP if p.mode == "lockstep" else 0)
        self.topics = DriverTopics(self, servo, self.axis, self.hardware.simulated)
        if quick:
            self._quick = QuickPeriods(servo, self._commands, side.semaphore, self.topics, self.gate, self._requests.asked,
                                       self.responses, self._settings())
            self._quick.compile(self.hardware.own_arrays)
            self._sender = Sender(self.topics.outlets, side.semaphore, self._credits.take)
        self.create_service(Trigger, topics.RESET_FAULT, self._reset_fault)
        self.create_timer(1.0, self._once_per_second)
        if p.activate:
            self._starter = threading.Thread(target=self._start_alone, daemon=True)
            self._starter.start()

    def _settings(self):
        """What stays as it is in the compiled loop."""
        p, (low, high) = self.parameters, self._travel
        return {"paced": not self._lockstep, "block": self.topics.block, "every": p.simulation_decimation,
                "status": self._constant_status | _ACTIVE, "limit": self.gate.limit, "low": low, "high": high,
                "period": self.period, **timing(self.period, p.rate_limit, SLICE, not self._lockstep)}

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
        try:
            done = self._requests.ask(action) is not False
        except (HardwareError, InputError, TimeoutError) as error:
            self.get_logger().error(str(error))
            done = False
        return TransitionCallbackReturn.SUCCESS if done else TransitionCallbackReturn.FAILURE

    def _missing_readers(self):
        """What is missing for the first period, in words; waits a while for it."""
        until = time.monotonic() + self.parameters.ready_timeout_s
        while True:
            missing = self.topics.missing_readers(self.ledger.missing() if self._lockstep else [])
            if not missing or time.monotonic() > until:
                return missing
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
        period = self._lockstep_period if self._lockstep else self._paced_period
        while running():
            self._requests.serve()
            if self.gate.fault != "none":
                self._faulted_period()
            elif self.gate.active and self._quick is not None and self.hardware.arrays is not None:
                self._quick_periods()
            elif self.gate.active:
                period()
            else:
                self._idle()
            if self._told != (self.gate.active, self.gate.fault):
                self._tell()

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
        self.topics.flush()
        self._servo.wait(self._idle_readers, SLICE)
        self._take_commands()
        self._credits.take()

    def _begin(self, time_ns):
        """Read, publish: the control period begins."""
        try:
            reading = self.hardware.read()
        except HardwareError as error:
            self.gate.trip("hardware", str(error))
            reading = Reading(float("nan"))
        gate = self.gate
        late = gate.active and gate.last != gate.period
        self._announce(time_ns, reading, late)

    def _announce(self, time_ns, reading, late):
        """The state of the next period, as it was read."""
        gate = self.gate
        self.sequence = n = self.sequence + 1
        self._time_ns = time_ns
        if not self._travel[0] <= reading.encoder <= self._travel[1] and gate.fault == "none":
            gate.trip("travel", f"the encoder reads {reading.encoder!r} m, the travel is {self._travel} m")
        status = self._constant_status | (gate.active and _ACTIVE) | (gate.saturated and _SATURATED) | (late and _LATE) \
            | (gate.fault != "none" and _FAULT)
        gate.begin(n)
        raw = self.topics.state(time_ns, n, reading, gate.voltage, status, FAULTS.index(gate.fault))
        self._begun = (time_ns, n, raw, self.hardware)

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
        self._begin(round(n * self.period * 1e9))
        self._end_lockstep_period(n, begun, self._begun[2])
        self.topics.rest(*self._begun)

    def _end_lockstep_period(self, n, begun, raw):
        if self._await_command(n, begun, raw):
            self.responses.add(time.perf_counter() - begun)
            self._write(self.gate.voltage)

    def _await_command(self, n, begun, raw):
        """Until period ``n`` has its command or a fault; False if the driver was deactivated meanwhile."""
        gate, wait, readers, resent = self.gate, self._servo.wait, self._command_readers, begun
        self._take_commands()
        while True:
            if gate.last != n:
                wait(readers, SLICE)
                self._take_commands()
            if gate.last == n or gate.fault != "none":
                return True
            self._requests.serve()
            waited = time.perf_counter()
            if not gate.active or not running():
                return False
            if waited - begun > self.parameters.command_timeout_lockstep_s:
                gate.trip("command_timeout", f"no command for period {n} within {waited - begun:.1f} s")
            elif waited - resent > self.parameters.resend_s:
                resent = waited
                self.topics.states.send_single(raw)

    def _paced_period(self):
        self._hold_back(self.period)
        begun = time.perf_counter()
        self._begin(time.time_ns())
        self._write(self.gate.voltage)
        self._end_paced_period(self.sequence, begun)
        self.topics.rest(*self._begun)

    def _end_paced_period(self, n, begun):
        gate, readers = self.gate, self._command_readers
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
        if n % 100 == 0:
            self._credits.take()

    def _quick_periods(self):
        """Periods in compiled code until something needs a closer look, and the closer look."""
        quick, gate = self._quick, self.gate
        credit = self.ledger.limit if self._lockstep else UNLIMITED
        why = quick.run(self.hardware.arrays, self.sequence, credit, self._due, self.parameters.command_timeout_periods)
        self.sequence, self._time_ns, self.overruns = quick.sequence, quick.time_ns, self.overruns + quick.overruns
        self._due = quick.due_ns * 1e-9 or None
        self._write(gate.voltage)
        n, begun = self.sequence, quick.begun_ns * 1e-9
        if why == NO_CREDIT:
            self._await_credit(n + 1)
        elif why == CROWDED:
            self.topics.send_closed()
        elif why == TRAVEL:
            self.sequence -= 1
            self._announce(self._time_ns, self.hardware.last_reading, gate.last != gate.period)
            self.topics.rest(*self._begun)
        elif why in (WAITED, STRANGE, MISSED):
            if why == STRANGE:
                self._offer(quick.command)
            if self._lockstep:
                self._end_lockstep_period(n, begun, quick.state)
            elif why == MISSED:
                self._miss(begun)
            else:
                self._end_paced_period(n, begun)
            self.topics.instruments(self._time_ns, n, self.hardware)
            self.topics.end_of_block(self._time_ns, n)

    def _miss(self, begun):
        """No command came for more periods than tolerated; they may have been one long one."""
        missing = self.gate.period - self.gate.last + int((time.perf_counter() - begun) / self.period)
        self.gate.close_period(self.parameters.command_timeout_periods, missing)

    def _faulted_period(self):
        """Go on measuring in real time with zero voltage, whatever commands say."""
        self._hold_back(max(self.period, 1e-3))
        self._write(0.0)
        self._begin(round((self.sequence + 1) * self.period * 1e9) if self.parameters.mode == "lockstep"
                    else time.time_ns())
        self.topics.rest(*self._begun)
        self._take_commands()
        self._credits.take()

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
        self._credits.take()
        if n <= self.ledger.limit:
            return True
        self.topics.flush()  # who holds us up may be waiting for it
        self._servo.wait(self._idle_readers, SLICE)
        self._take_commands()
        self._credits.take()
        for name in self._credits.drop_silent(self.parameters.follower_timeout_s):
            self.get_logger().warning(f"{name} has been silent for {self.parameters.follower_timeout_s} s "
                                      "and is no longer waited for: it will miss messages")
        return n <= self.ledger.limit

    def _take_commands(self):
        """Offer all waiting commands to the gate; True if one is in force."""
        obeyed, take = False, self._commands.take
        while (raw := take()) is not None:
            obeyed = self._offer(raw) or obeyed
        return obeyed

    def _offer(self, raw):
        """Offer one command to the gate; True if it is in force."""
        sequence, voltage, _, _, _ = self._unpack_command(raw)
        return self.gate.offer(sequence, voltage)

    def _on_credit(self, limit):
        if self._quick is not None and self._lockstep:
            self._quick.grant(limit)
            self._servo.semaphore.post_now()

    def _once_per_second(self):
        if self._quick is not None:
            self._in_loop(lambda: None)  # the counters come back from compiled code
        self.topics.timing(self._time_ns, self.sequence, self.gate, self.overruns, self.responses)

    def close(self):
        """Zero voltage, let go of the hardware, send what is left."""
        self.gate.deactivate()
        self._write(0.0)
        self.hardware.close()
        if self._quick is not None:
            self._sender.stop()
        self.topics.flush()


def main(arguments=None):
    """Run the node."""
    return run_node(AxisDriver, arguments)


if __name__ == "__main__":
    sys.exit(main())
