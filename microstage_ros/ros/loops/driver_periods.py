"""The driver's servo loop: one control period after the other, and what lifecycle requests do between two of them.

All of it runs in the loop's own thread, which alone has the hardware and the gate.
"""

import math
import time
from contextlib import suppress

from microstage_msgs.msg import AxisState, VoltageCommand

from microstage_ros.hardware.command_gate import FAULTS
from microstage_ros.hardware.limits import begin_anew, in_words, look
from microstage_ros.hardware.protocol import HardwareError, Reading
from microstage_ros.ros.launching.process import running
from microstage_ros.ros.loops.driver_loop import (
    CROWDED,
    MISSED,
    MOMENT_NS,
    NO_CREDIT,
    STRANGE,
    TAKEN_AWAY,
    TRAVEL,
    WAITED,
)
from microstage_ros.ros.loops.driver_state import DriverState
from microstage_ros.ros.loops.period_timing import next_due
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.credit import UNLIMITED
from microstage_ros.ros.transport.scheduling import SPIN, sleep_precisely, sleep_until

SLICE = 0.05
"""Longest wait [s] before the loop looks for requests of the other thread."""

_ACTIVE, _SATURATED, _LATE, _FAULT, _ZEROED = (
    AxisState.STATUS_ACTIVE, AxisState.STATUS_SATURATED, AxisState.STATUS_COMMAND_LATE, AxisState.STATUS_FAULT,
    AxisState.STATUS_ZEROED)


class DriverPeriods(DriverState):
    """What `AxisDriver` does in its servo loop."""

    def loop(self):
        """The servo loop."""
        sleep_precisely()
        period = self._lockstep_period if self._lockstep else self._paced_period
        while running():
            self._requests.serve()
            if self.guard.taken:
                self._taken_away()
            if self.gate.fault != "none":
                self._faulted_period()
            elif self.gate.active and self._quick is not None and self._quick.machine.arrays is not None:
                self._quick_periods(self._quick)
            elif self.gate.active:
                period()
            else:
                self._idle()
            if self._reported != (self.gate.active, self.gate.fault):
                self._tell()

    def _open(self):
        self.hardware.open()
        self._opened = True
        if "outside_stop" in self._safety and not self.gate.holds:
            self._stop_from_outside = self._safety["outside_stop"]()
        self._written = 0.0
        if self.gate.holds:
            self.gate.place(getattr(self.hardware, "standing", None))
            self._written = self.gate.voltage

    def _taken_away(self):
        """The watchdog took the voltage away: this loop stood still. A short stop of the host is no fault, a long one
        is."""
        silent, gate = self.gate.silent_s, self.gate
        gate.zero()
        self._make_safe()
        if gate.active and silent > self.parameters.command_timeout_s:
            gate.trip(
                "watchdog",
                f"no valid command for {silent * 1e3:.1f} ms and this loop stood still; the watchdog took the "
                f"voltage away after {self.guard.taken_after * 1e3:.1f} ms",
            )
        self.guard.hand_back()

    def _activate(self):
        self._look_at_signals()
        if not self.gate.activate():
            self.get_logger().error(f"not activated: fault {self.gate.fault} is latched ({self.gate.message}); "
                                    f"service {topics.RESET_FAULT} forgets it")
            return False
        self._due = None
        begin_anew(self.memory[0])
        self._make_safe()
        self._energise()
        if self.gate.fault != "none":  # it stays inactive: a reset must not set it going
            self._deactivate()
            return False
        self._tell()
        return True

    def _energise(self):
        """Arm the card's watchdog, enable the drive, have the output watched: as far as no fault comes up."""
        for step in (self._arm_card, self._enable):
            if self.gate.fault == "none":
                step(True)
        if self.gate.fault == "none" and not self._lockstep:
            self.guard.arm()

    def _deactivate(self):
        self.gate.deactivate()
        self.guard.disarm()
        self._make_safe()
        self._enable(False)
        self._arm_card(False)
        self._tell()

    def _shut(self):
        self._deactivate()
        self._let_go()

    def _let_go(self):
        """Close the hardware."""
        self._opened = False
        self.hardware.close()

    def _trip(self, fault, message):
        """Latch a fault for another process or person: zero voltage now. False if another was latched before."""
        first = self.gate.fault == "none"
        self.gate.trip(fault, message)
        self._make_safe()
        return first

    def _forget_fault(self):
        """Reset; the driver goes on where it was active."""
        self.gate.reset()
        self._look_at_signals()
        begin_anew(self.memory[0])
        self._due = None
        if self.gate.active:
            self._energise()
        self._tell()

    def _tell(self):
        self._reported = (self.gate.active, self.gate.fault)
        if self.gate.fault != "none":
            self.guard.disarm()
            self._make_safe()
            if self._disables:
                self._enable(False)
            self.get_logger().error(f"fault {self.gate.fault}: {self.gate.message}; {self.gate.safe_words}")
        self.topics.status(self._time_ns, self.sequence, self.gate, self.hardware.simulated)

    def _idle(self):
        self.topics.flush()
        self._servo.wait(self._idle_readers, SLICE)
        self._take_commands()
        self._credits.take()
        if self._opened and not self.hardware.simulated:
            self._look_at_signals()
            if "follow" in self._instruments:
                with suppress(HardwareError):  # an error of it is the next read's, too
                    self._instruments["follow"]()

    def _begin(self, time_ns):
        """Read, publish: the control period begins."""
        try:
            reading = self.hardware.read()
        except HardwareError as error:
            self.gate.trip("hardware", str(error))
            reading = Reading(float("nan"))
        gate = self.gate
        late = gate.active and gate.last != gate.period
        code = 0
        if gate.active and gate.fault == "none":
            code = look(
                self.limits,
                self.memory,
                float(reading.encoder),
                float(reading.current),
                float(reading.motor_angle),
                gate.voltage,
            )
        self._announce(time_ns, reading, late, code)
        self._look_at_signals()

    def _announce(self, time_ns, reading, late, code):
        """The state of the next period, as it was read; ``code``: of the limit that was breached, 0 for none."""
        gate = self.gate
        self.sequence = n = self.sequence + 1
        self._time_ns = time_ns
        if code and gate.fault == "none":
            gate.trip(*in_words(code, self.limits, self.memory, gate.unit))
        zeroed = gate.active and not self._lockstep and gate.silent_s + self.period > self._hold_s
        status = (
            self._constant_status
            | (zeroed and _ZEROED)
            | (gate.active and _ACTIVE)
            | (gate.saturated and _SATURATED)
            | (late and _LATE)
            | (gate.fault != "none" and _FAULT)
        )
        gate.begin(n)
        raw = self.topics.state(time_ns, n, reading, gate.voltage, status, FAULTS.index(gate.fault))
        self._begun = (time_ns, n, raw, self.hardware)

    def _make_safe(self):
        """Write the safe command: zero, or what a drive that holds a position was last commanded, if anything."""
        if self.gate.placed:
            self._write(self.gate.voltage if self.gate.holds else 0.0)

    def _write(self, voltage):
        if not self.gate.placed:
            return
        low, high = self._switches
        push = voltage - self._written if self.gate.holds else voltage
        if low and push < 0.0 or high and push > 0.0:
            self.gate.trip(
                "limit_switch",
                f"{voltage:.3g} {self.gate.unit} towards the {'lower' if low else 'upper'} limit switch, "
                "which is actuated",
            )
            self.gate.place(self._written)
            voltage = self.gate.voltage
        try:
            self.hardware.write(voltage)
        except HardwareError as error:
            self.gate.trip("hardware", str(error))
            self._enable(False)
            return
        self._written = voltage
        self.guard.put(voltage)

    def _lockstep_period(self):
        n = self.sequence + 1
        if n > self.ledger.limit and not self._await_credit(n):
            return
        if (rate := self.parameters.rate_limit) > 0.0:
            due, pace = round((self._due or 0.0) * 1e9), round(self.period / rate * 1e9)
            due, rest = next_due(due, time.perf_counter_ns(), pace)
            self._due = due * 1e-9
            if rest > 0:
                time.sleep(min(rest * 1e-9, SLICE))
                return
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
        self.gate.hold(self._hold_s, self.period)
        self._begin(time.time_ns())
        if changed := self.gate.voltage != self._written:  # else the one write of a period is that of its command
            self._write(self.gate.voltage)
        self._end_paced_period(self.sequence, begun, changed)
        self.topics.rest(*self._begun)

    def _end_paced_period(self, n, begun, written):
        gate, readers = self.gate, self._command_readers
        end = (begun if self._due is None else self._due) + self.period - SPIN
        while gate.fault == "none" and gate.last != n:
            if (rest := end - time.perf_counter()) <= 0.0:
                break
            self._servo.wait(readers, rest)
            if self._take_commands():
                self._write(gate.voltage)
                written = True
        if self.guard.taken:  # before anything is written: what was in force when this loop stood still is over
            self._taken_away()
        gate.hold(self._hold_s)
        if not written or gate.voltage != self._written:  # a card's watchdog asks for a sign of life in every period
            self._write(gate.voltage)
        if gate.last == n:
            self.responses.add(time.perf_counter() - begun)
        gate.close_period(self.parameters.command_timeout_s)
        if n % 100 == 0:
            self._credits.take()

    def _quick_periods(self, quick):
        """Periods in compiled code until something needs a closer look, and the closer look."""
        gate = self.gate
        credit = self.ledger.limit if self._lockstep else UNLIMITED
        why = quick.run(self.sequence, credit, self._due, gate.valid_ns)
        self.sequence, self._time_ns = quick.sequence, quick.time_ns
        self._due = quick.due_ns * 1e-9 or None
        if self.guard.taken:
            self._taken_away()
        if why == TAKEN_AWAY:
            return
        self._write(gate.voltage)
        n, begun = self.sequence, quick.begun_ns * 1e-9
        if why == NO_CREDIT:
            self._await_credit(n + 1)
        elif why == CROWDED:
            self.topics.send_closed(wait=self._lockstep)
        elif why == TRAVEL:
            self.sequence -= 1
            self._announce(self._time_ns, quick.machine.last_reading, gate.last != gate.period, quick.fault)
            self.topics.rest(*self._begun)
        elif why in (WAITED, STRANGE, MISSED):
            if why == STRANGE:
                self._offer(quick.command.bytes)
            if self._lockstep:
                self._end_lockstep_period(n, begun, quick.state.bytes)
            elif why == MISSED:
                gate.close_period(self.parameters.command_timeout_s)
            else:
                self._end_paced_period(n, begun, written=True)
            self.topics.instruments(self._time_ns, n, self.hardware)
            self.topics.end_of_block(self._time_ns, n)

    def _faulted_period(self):
        """Go on measuring in real time under the safe command, whatever commands say."""
        self._hold_back(max(self.period, 1e-3))
        self._make_safe()
        if self._disables:
            self._enable(False)  # nothing, but where the hardware refused it before
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
        for wait in (MOMENT_NS * 1e-9, SLICE):
            if n <= self.ledger.limit:
                return True
            if wait == SLICE:
                self.topics.flush()  # who holds us up may be waiting for it
            self._servo.wait(self._idle_readers, wait)
            self._take_commands()
            self._credits.take()
        for name in self._credits.drop_silent(self.parameters.follower_timeout_s):
            self.get_logger().warning(f"{name} has been silent for {self.parameters.follower_timeout_s} s "
                                      "and is no longer waited for: it will miss messages")
        return n <= self.ledger.limit

    def _take_commands(self):
        """Offer all waiting commands to the gate; True if one is in force."""
        obeyed, take = False, self._checked.take
        while (raw := take()) is not None:
            obeyed = self._offer(raw) or obeyed
        return obeyed

    def _offer(self, raw):
        """Offer one command to the gate; True if it is in force."""
        if self.guard.taken:
            self._taken_away()
        sequence, voltage, reference, _, sender = self._unpack_command(raw)
        if not self.gate.offer(sequence, voltage):
            return False
        self.guard.commanded(self.gate.valid_ns)
        self.memory["reference"] = reference if sender == VoltageCommand.SENDER_CONTROLLER else math.nan
        return True
