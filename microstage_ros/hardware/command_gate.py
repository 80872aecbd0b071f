"""What happens to every command on its way to the amplifier; every fault leads to the safe command and is latched.

The safe command is zero voltage, or, for a drive whose command sets a position (`Actuator.holds_on_fault`), the last
command that was obeyed: zero would be a move.

| command                                        | effect |
|------------------------------------------------|--------|
| answers the present period, finite             | clipped to the limit and obeyed |
| answers an answered period again               | dropped, counted `duplicated` |
| answers an older period than the last obeyed   | dropped, counted `reordered` |
| answers an older period that had none, paced   | obeyed (the newest there is), counted `late` |
| none in this period, paced                     | the voltage before it stays, counted `lost` |
| none for longer than ``command_hold_s``, paced | zero voltage, counted `zeroed`; the next valid one is obeyed again |
| none for longer than the time-out              | fault `command_timeout` |
| NaN or infinite                                | fault `command_not_finite` |
| answers a period that has not begun            | fault `command_sequence` |
| while the driver is not active                 | fault `command_inactive` (answers to its last periods are let by) |
"""

import math
import time

FAULTS = (
    "none",
    "command_timeout",
    "command_not_finite",
    "command_inactive",
    "command_sequence",
    "hardware",
    "travel",
    "stopped",
    "watchdog",
    "process",
    "e_stop",
    "limit_switch",
    "velocity",
    "current",
    "voltage_rate",
    "following_error",
    "encoder_absent",
    "encoder_jump",
    "encoder_frozen",
    "encoder_motor",
    "encoder_interferometer",
)
"""Names of the fault codes of AxisState, by code."""


FIRST_NS = 5_000_000_000
"""After activation and reset the voltage is zero, so the first command has so much longer [ns] before it is missed."""

STALE = 10
"""Answers to so many periods before the driver stopped may still be on their way."""


class CommandGate:
    """Decides which voltage is in force.

    Attributes
    ----------
    placed : False while a drive that holds a position has had no command yet.
    voltage : in force now [V]. command : the same before clipping [V]; saturated : it was clipped.
    fault : a name of `FAULTS`, latched. message : the fault in words, with the value.
    answered, late, lost, duplicated, reordered, zeroed : counters of periods and commands.
    valid_ns : when the last valid command came [ns of the monotonic clock]; before the first, `FIRST_NS` after the
        activation.

    Parameters
    ----------
    limit : largest command [unit]. clock_ns : the monotonic clock. unit : of the command, for the messages.
    holds : the safe command is the last one obeyed, not zero.
    """

    def __init__(self, limit, clock_ns=time.monotonic_ns, unit="V", holds=False):
        self.limit, self.unit, self.holds = float(limit), unit, holds
        self.placed = not holds
        self.period = -1
        self.active = False
        self.last = -1
        self.voltage = self.command = 0.0
        self.saturated = False
        self.fault, self.message = "none", ""
        self.answered = self.late = self.lost = self.duplicated = self.reordered = self.zeroed = 0
        self._clock_ns, self.valid_ns = clock_ns, clock_ns()

    def activate(self):
        """Obey from now on. Returns False, and stays inactive, while a fault is latched."""
        self.active = self.fault == "none"
        self.valid_ns = self._clock_ns() + FIRST_NS
        return self.active

    def deactivate(self):
        """Zero voltage; further commands are faults."""
        self.active = False
        self.zero()

    def begin(self, period):
        """Control period number ``period`` [1] begins."""
        self.period = period

    def offer(self, sequence, voltage):
        """A command came that answers period number ``sequence`` [1]. Returns True if it is in force now.

        ``voltage``: the command, in the unit of the drive's command.
        """
        if self.fault != "none":
            return False
        if not self.active:
            if not self.period - STALE < sequence <= self.period:
                self.trip(
                    "command_inactive", f"a command of {voltage!r} {self.unit} came while the driver was not active"
                )
            return False
        if sequence > self.period:
            self.trip("command_sequence", f"a command answered period {sequence}, the present one is {self.period}")
            return False
        if sequence <= self.last:
            if sequence == self.last:
                self.duplicated += 1
            else:
                self.reordered += 1
            return False
        if not math.isfinite(voltage):
            self.trip("command_not_finite", f"a command of {voltage!r} {self.unit} for period {sequence}")
            return False
        if sequence == self.period:
            self.answered += 1
        else:
            self.late += 1
        self.last = sequence
        self.placed = True
        self.command = voltage
        self.voltage = min(max(voltage, -self.limit), self.limit)
        self.saturated = self.voltage != voltage
        self.valid_ns = self._clock_ns()
        return True

    @property
    def silent_s(self):
        """Time since the last valid command [s]."""
        return (self._clock_ns() - self.valid_ns) * 1e-9

    def hold(self, longest, ahead=0.0):
        """Zero voltage if there was no valid command for longer than ``longest`` [s], or will not have been in
        ``ahead`` [s]."""
        if not self.holds and self.command != 0.0 and self.silent_s + ahead > longest:
            self.zero()
            self.zeroed += 1

    def close_period(self, timeout):
        """The present period ends; trips if its command is missing, and any for longer than ``timeout`` [s]."""
        if not self.active or self.fault != "none" or self.last == self.period:
            return
        self.lost += 1
        silent = self.silent_s
        if silent > timeout:
            self.trip(
                "command_timeout", f"no valid command for {silent * 1e3:.1f} ms, the bound is {timeout * 1e3:.1f} ms"
            )

    def trip(self, fault, message):
        """Latch a fault; the first one stays."""
        self.zero()
        if self.fault == "none":
            self.fault, self.message = fault, message

    def reset(self):
        """Forget the fault; the driver may be made active again."""
        self.fault, self.message = "none", ""
        self.last = self.period
        self.valid_ns = self._clock_ns() + FIRST_NS

    def zero(self):
        """The safe command: no voltage, or the last command where the drive holds a position."""
        if not self.holds:
            self.voltage = 0.0
        self.command = self.voltage
        self.saturated = False

    def place(self, voltage):
        """A drive that holds a position stands where ``voltage`` holds it; None: nobody knows, so nothing is written
        before the first command."""
        self.placed = not self.holds or voltage is not None
        if self.holds and voltage is not None:
            self.voltage = self.command = float(voltage)

    @property
    def safe_words(self):
        """What the safe command is, for messages."""
        return "the command keeps its last value" if self.holds else "the voltage is zero"
