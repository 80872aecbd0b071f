"""Late, lost, repeated, reordered and bad commands: each has its effect."""

import math

import pytest

from microstage_ros.hardware.command_gate import FAULTS, STALE, CommandGate


class Clock:
    """A clock that is set by hand."""

    now_ns = 0

    def __call__(self):
        return self.now_ns


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def gate(clock):
    made = CommandGate(6.0, clock)
    assert made.activate()
    made.begin(0)
    return made


def test_answer_is_obeyed_and_clipped(gate):
    assert gate.offer(0, 1.5) and gate.voltage == 1.5 and not gate.saturated
    gate.begin(1)
    assert gate.offer(1, -9.0) and gate.voltage == -6.0 and gate.saturated and gate.command == -9.0
    assert gate.answered == 2 and gate.fault == "none"


def test_repeated_and_reordered_are_dropped_and_counted(gate):
    gate.begin(3)
    gate.offer(3, 1.0)
    assert not gate.offer(3, 2.0) and not gate.offer(2, 3.0)
    assert gate.voltage == 1.0 and (gate.duplicated, gate.reordered) == (1, 1)


def test_lost_keeps_the_voltage_and_late_still_counts(gate):
    gate.offer(0, 1.0)
    gate.close_period(0.1)
    gate.begin(1)
    gate.close_period(0.1)  # nothing came
    assert gate.voltage == 1.0 and gate.lost == 1 and gate.fault == "none"
    gate.begin(2)
    assert gate.offer(1, 2.0) and gate.voltage == 2.0 and gate.late == 1  # the newest there is
    assert gate.offer(2, 3.0) and gate.voltage == 3.0 and gate.answered == 2


def test_zero_after_the_hold_and_a_fault_after_the_time_out(gate, clock):
    """Both in seconds: how many periods pass meanwhile does not matter."""
    gate.offer(0, 1.0)
    for period, ms in enumerate((1, 3.9, 4.1, 100, 251), start=1):
        clock.now_ns = round(ms * 1e6)
        gate.begin(period)
        gate.hold(0.004)
        gate.close_period(0.25)
        assert gate.voltage == (1.0 if ms < 4.0 else 0.0) and gate.fault == ("none" if ms < 250 else "command_timeout")
    assert gate.zeroed == 1 and "251.0 ms, the bound is 250.0 ms" in gate.message


def test_a_command_after_the_hold_is_obeyed_again(gate, clock):
    gate.offer(0, 1.0)
    clock.now_ns = 5_000_000
    gate.begin(5)
    gate.hold(0.004)
    assert gate.voltage == 0.0 and gate.offer(5, 0.7) and gate.voltage == 0.7 and gate.fault == "none"
    gate.hold(0.004, ahead=0.005)  # the next look would come too late
    assert gate.voltage == 0.0


@pytest.mark.parametrize("voltage", [math.nan, math.inf, -math.inf])
def test_not_finite_trips(gate, voltage):
    gate.offer(0, 1.0)
    gate.begin(1)
    assert not gate.offer(1, voltage)
    assert gate.voltage == 0.0 and gate.fault == "command_not_finite" and repr(voltage) in gate.message


def test_a_period_that_has_not_begun_trips(gate):
    assert not gate.offer(1, 1.0) and gate.fault == "command_sequence"


def test_inactive(gate):
    gate.begin(100)
    gate.deactivate()
    assert not gate.offer(100 - STALE + 1, 1.0) and gate.fault == "none"  # was on its way
    assert not gate.offer(100 - STALE, 1.0) and gate.fault == "command_inactive" and gate.voltage == 0.0
    assert not gate.activate()


def test_the_first_fault_stays_until_reset(gate):
    gate.offer(0, math.nan)
    gate.trip("travel", "beyond")
    assert gate.fault == "command_not_finite"
    assert not gate.offer(0, 1.0) and gate.voltage == 0.0
    gate.reset()
    gate.begin(1)
    assert gate.fault == "none" and gate.offer(1, 1.0)


def test_a_drive_that_holds_a_position_keeps_its_last_command(clock):
    """Zero would be a move: neither silence nor a fault nor the end of the activity changes what it is told."""
    gate = CommandGate(6.0, clock, unit="rad", holds=True)
    assert not gate.placed
    gate.activate()
    gate.begin(0)
    gate.offer(0, -9.0)
    assert gate.placed and gate.voltage == -6.0
    clock.now_ns = 10**8
    gate.hold(0.004)
    gate.begin(1)
    assert not gate.offer(1, math.nan) and gate.fault == "command_not_finite"
    gate.deactivate()
    assert gate.voltage == gate.command == -6.0 and not gate.saturated and gate.zeroed == 0
    gate.place(None)
    assert not gate.placed and gate.voltage == -6.0
    gate.place(2.0)
    assert gate.placed and gate.voltage == 2.0


def test_codes_match_the_message():
    messages = pytest.importorskip("microstage_msgs.msg", reason="interfaces are not built: run ./microstage test")
    codes = {name.removeprefix("FAULT_").lower(): getattr(messages.AxisState, name)
             for name in dir(type(messages.AxisState)) if name.startswith("FAULT_")}
    assert codes == {name: code for code, name in enumerate(FAULTS)}


def test_before_the_first_period(clock):
    gate = CommandGate(6.0, clock)
    assert (gate.period, gate.last, gate.voltage, gate.command) == (-1, -1, 0.0, 0.0) and gate.placed and not gate.active and not gate.saturated
    assert (gate.answered, gate.late, gate.lost, gate.duplicated, gate.reordered, gate.zeroed) == (0,) * 6
    assert gate.unit == "V" and gate.fault == "none" and gate.safe_words == "the voltage is zero"
    assert CommandGate(6.0, clock, holds=True).safe_words == "the command keeps its last value"
    assert gate.activate() and not gate.offer(0, 1.0) and gate.fault == "command_sequence"
    assert gate.message == "a command answered period 0, the present one is -1"


def test_five_seconds_more_before_the_first_command_is_missed(clock):
    gate = CommandGate(6.0, clock)
    for begin in (gate.activate, gate.reset):
        begin()
        assert gate.silent_s == pytest.approx(-5.0)
    gate.begin(3)
    clock.now_ns = 5_000_000_000 + 20_000_000
    gate.close_period(0.02)
    assert gate.fault == "none" and gate.lost == 1
    clock.now_ns += 1_000_000
    gate.close_period(0.02)
    assert gate.fault == "command_timeout" and gate.message == "no valid command for 21.0 ms, the bound is 20.0 ms"
    gate.close_period(0.02)
    assert gate.lost == 2  # a fault is latched: nothing is expected any more


@pytest.mark.parametrize("sequence, fault", [(90, "command_inactive"), (91, "none"), (100, "none"), (101, "command_inactive")])
def test_answers_that_are_still_on_their_way(clock, sequence, fault):
    gate = CommandGate(6.0, clock, unit="A")
    gate.begin(100)
    assert not gate.offer(sequence, 1.5) and gate.fault == fault
    assert gate.message in ("", "a command of 1.5 A came while the driver was not active") and STALE == 10


def test_a_hold_looks_ahead(gate, clock):
    gate.offer(0, 1.0)
    clock.now_ns = 10_000_000
    gate.hold(0.011)
    gate.hold(0.010)
    assert gate.voltage == 1.0 and gate.zeroed == 0
    gate.hold(0.010, 0.001)
    assert gate.voltage == gate.command == 0.0 and gate.zeroed == 1 and not gate.saturated
    gate.hold(0.010, 0.001)
    assert gate.zeroed == 1  # it is zero already


def test_after_a_reset_the_present_period_is_answered(gate):
    gate.begin(5)
    gate.trip("hardware", "cable out")
    gate.reset()
    assert gate.last == 5 and not gate.offer(5, 1.0) and gate.duplicated == 1 and not gate.offer(4, 1.0) and gate.reordered == 1
    gate.close_period(0.0)
    assert gate.lost == 0


def test_where_a_drive_that_holds_a_position_stands(clock):
    gate = CommandGate(6.0, clock, holds=True)
    assert not gate.placed
    gate.place(None)
    assert not gate.placed
    gate.place(2)
    assert gate.placed and gate.voltage == gate.command == 2.0
    plain = CommandGate(6.0, clock)
    plain.place(2)
    assert plain.placed and plain.voltage == 0.0
