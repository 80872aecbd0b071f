"""The driver's periods over a hardware that hangs, refuses or is pressed: what is written, enabled and stays active."""

import time
import types

import pytest

from microstage_ros.hardware.command_gate import CommandGate
from microstage_ros.hardware.limits import new_limits
from microstage_ros.hardware.protocol import HardwareError, Reading
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.ros.loops.driver_periods import DriverPeriods

ZEROED = "the watchdog put out 0 V"


class Guard:
    """The driver's side of a watchdog that acts when the test says so."""

    taken, taken_after = 0, 4.6e-3

    def put(self, voltage):
        pass

    def commanded(self, time_ns):
        pass

    def arm(self):
        self.armed = True

    def disarm(self):
        self.armed = False

    def hand_back(self):
        self.taken = 0


class Driver(DriverPeriods):
    """A paced driver without ROS, which is its own hardware."""

    simulated, name = False, "driver"
    _card_watchdog_s, _disables, _lockstep, _constant_status, _time_ns = 4.5e-3, True, False, 0, 0

    def __init__(self, hold_s=1.0, **members):
        self.gate, self.guard = CommandGate(6.0), Guard()
        self.limits, self.memory = new_limits(load_axis(config_file("axis.yaml")), (-1.0, 1.0), {})
        self.period, self._hold_s, self._due, self.overruns, self.sequence = 0.02, hold_s, None, 0, -1
        self._enabled, self._switches, self._written, self._opened = False, (False, False), 0.0, True
        self.hardware, self.written, self.hang, self.waiting = self, [], lambda: None, []
        self._safety, self._instruments, self._command_readers, self._idle_readers = members, {}, (), ()
        self.parameters = types.SimpleNamespace(command_timeout_s=60.0, mode="paced")
        self.responses = types.SimpleNamespace(add=lambda seconds: None)
        self._credits = types.SimpleNamespace(take=lambda: None)
        self._servo = types.SimpleNamespace(wait=lambda readers, seconds: time.sleep(max(seconds, 0.0)))
        self.topics = types.SimpleNamespace(state=lambda *_: b"", rest=lambda *_: None, status=lambda *_: None, flush=lambda: None)

    def get_logger(self):
        return types.SimpleNamespace(error=lambda text: None)

    def _take_commands(self):
        obeyed = False
        while self.waiting:
            obeyed = self.gate.offer(self.sequence, self.waiting.pop()) or obeyed
        return obeyed

    def read(self):
        self.hang()
        return Reading(0.0)

    def write(self, voltage):
        self.written.append(voltage)


def driven(**more):
    """A driver that puts out 3 V."""
    driver = Driver(**more)
    assert driver._activate()
    end = time.monotonic() + 60.0
    while driver._written != 3.0:  # a period that begins late, as while code is loaded, takes no command
        assert time.monotonic() < end
        driver._due, driver.waiting = None, [3.0]
        driver._paced_period()
    driver.written.clear()
    return driver


def test_what_the_watchdog_took_away_is_not_put_out_again():
    """The loop hangs in a reading; when it goes on, the watchdog has acted, and the last command is not written once more."""
    driver = driven()

    def hang():
        driver.guard.taken = time.monotonic_ns()
        driver.written.append(ZEROED)

    driver.hang = hang
    driver._paced_period()
    assert driver.written[0] == ZEROED and set(driver.written[1:]) == {0.0}
    assert not driver.guard.taken


def test_a_command_that_is_over_when_the_loop_goes_on_is_not_put_out_again():
    driver = driven(hold_s=0.05)
    driver.hang = lambda: time.sleep(0.1)
    driver._paced_period()
    assert driver.written == [0.0] and driver.gate.zeroed == 1 and driver.gate.fault == "none"


@pytest.mark.parametrize("refusals", [1, 3])
def test_an_enable_that_is_refused_is_switched_off_again(refusals):
    asked = []

    def enable(on):
        asked.append(on)
        if not on and asked.count(False) <= refusals:
            raise HardwareError("bus busy")

    driver = driven(enable=enable)
    driver._trip("stopped", "by an operator")
    driver._tell()
    for _ in range(refusals + 2):
        driver._faulted_period()
    assert asked == [True, *[False] * (refusals + 1)] and driver._enabled is False  # until it is done, and then no more
    assert set(driver.written) == {0.0}


def test_a_pressed_emergency_stop_is_seen_before_the_drive_is_enabled():
    asked, pressed = [], [True]
    driver = Driver(enable=asked.append, e_stop=lambda: pressed[0], watchdog=lambda seconds: asked.append(seconds))
    assert not driver._activate() and driver.gate.fault == "e_stop" and not driver.gate.active and not asked
    driver._forget_fault()  # still pressed
    assert driver.gate.fault == "e_stop" and True not in asked
    pressed[0] = False
    driver._forget_fault()
    assert driver._activate() and asked[-2:] == [4.5e-3, True]
    pressed[0] = True
    driver._trip("stopped", "by an operator")
    driver._tell()
    asked.clear()
    driver._forget_fault()  # active, and pressed
    assert driver.gate.fault == "e_stop" and True not in asked


def test_a_card_that_cannot_be_armed_leaves_the_driver_inactive():
    asked, fails = [], [True]

    def arm(seconds):
        asked.append(seconds)
        if fails.pop() if fails else False:
            raise HardwareError("the card does not take its configuration")

    driver = Driver(enable=asked.append, watchdog=arm)
    assert not driver._activate()
    assert driver.gate.fault == "hardware" and not driver.gate.active and True not in asked
    driver._forget_fault()
    assert not driver.gate.active and True not in asked  # a reset alone sets nothing going
    assert driver._activate() and asked[-2:] == [4.5e-3, True]


def test_an_inactive_driver_looks_at_its_emergency_stop_and_follows_the_counts():
    pressed, reads = [False], []
    driver = Driver(e_stop=lambda: pressed[0])
    driver.hang = lambda: pytest.fail("read is for control periods")
    driver._idle()
    driver._instruments = {"follow": lambda: reads.append(1)}
    driver._idle()
    assert reads == [1] and driver.gate.fault == "none"

    def unplugged():
        raise HardwareError("no answer")

    driver._instruments = {"follow": unplugged}
    driver._idle()
    assert driver.gate.fault == "none"  # nothing is commanded: the first period of an active driver tells it
    pressed[0] = True
    driver._idle()
    assert driver.gate.fault == "e_stop"


@pytest.mark.parametrize("simulated, opened", [(True, True), (False, False)])
def test_of_an_inactive_driver_neither_a_simulation_nor_a_closed_card_is_read(simulated, opened):
    driver = Driver(e_stop=lambda: pytest.fail("it was asked"))
    driver.simulated, driver._opened = simulated, opened
    driver._instruments = {"follow": lambda: pytest.fail("it was read")}
    driver._idle()
