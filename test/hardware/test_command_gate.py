"""Late, lost, repeated, reordered and bad commands: each has its effect."""

import math

import pytest

from microstage_ros.hardware.command_gate import FAULTS, STALE, CommandGate


@pytest.fixture
def gate():
    made = CommandGate(6.0)
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
    gate.close_period(5)
    gate.begin(1)
    gate.close_period(5)  # nothing came
    assert gate.voltage == 1.0 and gate.lost == 1 and gate.fault == "none"
    gate.begin(2)
    assert gate.offer(1, 2.0) and gate.voltage == 2.0 and gate.late == 1  # the newest there is
    assert gate.offer(2, 3.0) and gate.voltage == 3.0 and gate.answered == 2


def test_too_many_lost_in_a_row_trip(gate):
    gate.offer(0, 1.0)
    for period in range(1, 5):
        gate.begin(period)
        gate.close_period(3)
        assert gate.fault == ("none" if period <= 3 else "command_timeout")
    assert gate.voltage == 0.0 and "4 control periods" in gate.message


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


def test_codes_match_the_message():
    messages = pytest.importorskip("microstage_msgs.msg", reason="interfaces are not built: run ./microstage test")
    codes = {name.removeprefix("FAULT_").lower(): getattr(messages.AxisState, name)
             for name in dir(type(messages.AxisState)) if name.startswith("FAULT_")}
    assert codes == {name: code for code, name in enumerate(FAULTS)}
