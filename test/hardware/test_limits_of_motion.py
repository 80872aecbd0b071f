"""Every limit that the driver holds the machine to: named, with the value and the bound, and silent on a healthy machine."""

import math

import numpy as np
import pytest

from microstage_ros.hardware.command_gate import FAULTS
from microstage_ros.hardware.limits import FROZEN_S, begin_anew, in_words, look, new_limits
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file

PERIOD = 1e-3
GIVEN = {"velocity": 0.01, "current": 0.5, "following_error": 1e-3, "encoder_motor": 5e-4, "voltage_rate": 2000.0}


class Machine:
    """Readings as a healthy machine would give them, until one is told to be otherwise."""

    def __init__(self, **given):
        axis = load_axis(config_file("axis.yaml")).with_values({"period": PERIOD}, source="estimate")
        self.limits, self.memory = new_limits(axis, (-0.01, 0.01), GIVEN | given)
        self.per_radian = float(self.limits["motor_travel"][0])
        self.position = self.voltage = self.current = 0.0

    def period(self, **reading):
        """One period; name of the fault."""
        found = {"encoder": self.position, "current": self.current, "motor_angle": self.position / self.per_radian,
                 "voltage": self.voltage, **reading}
        return FAULTS[look(self.limits, self.memory, *(float(found[name]) for name in ("encoder", "current", "motor_angle", "voltage")))]

    def move(self, speed, periods, voltage=1.0, **reading):
        """Periods at a constant speed [m/s]; the first fault and in which period it was seen."""
        for k in range(periods):
            self.position += speed * PERIOD
            self.voltage = voltage
            fault = self.period(**reading)
            if fault != "none":
                return fault, k
        return "none", periods

    def says(self, name):
        fault, text = in_words(FAULTS.index(name), self.limits, self.memory)
        assert fault == name and "bound" in text or name in ("travel", "encoder_absent")
        return text


@pytest.fixture
def machine():
    made = Machine()
    assert made.period() == "none"
    return made


def test_a_healthy_move_is_no_fault(machine):
    machine.memory["reference"] = 0.0
    assert machine.move(0.008, 100, 1.0)[0] == "none" and machine.move(-0.008, 100, -0.9)[0] == "none"


def test_travel(machine):
    machine.position = 0.0099
    begin_anew(machine.memory[0])
    assert machine.move(0.005, 30) == ("travel", 20)
    assert "the travel is -0.01 to 0.01 m" in machine.says("travel") and "0.010" in machine.says("travel")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_absent_encoder(machine, value):
    assert machine.period(encoder=value) == "encoder_absent" and "no number" in machine.says("encoder_absent")


def test_jumping_encoder(machine):
    bound = float(machine.limits["jump"][0])
    assert machine.period(encoder=0.9 * bound, motor_angle=math.nan) == "none"
    machine.position = 0.9 * bound
    assert machine.period(encoder=machine.position + 1.1 * bound, motor_angle=math.nan) == "encoder_jump"
    assert f"{bound:.6g} m in one period" in machine.says("encoder_jump") and f"{1.1 * bound:.6g}" in machine.says("encoder_jump")


def test_velocity_is_smoothed_and_bounded(machine):
    fault, seen = machine.move(0.012, 100)
    assert fault == "velocity" and 3 <= seen <= 12  # 5 ms of smoothing
    assert "the bound is 0.01 m/s" in machine.says("velocity")
    quick = Machine()
    quick.period()
    assert quick.move(0.02, 1)[0] == "none"  # a single quick period is noise


def test_current(machine):
    machine.current = 0.6
    fault, seen = machine.move(0.001, 100)
    assert fault == "current" and 3 <= seen <= 12 and "A, the bound is 0.5 A" in machine.says("current")
    assert Machine().period(current=math.nan) == "none"  # no sensor


def test_following_error(machine):
    machine.memory["reference"] = 2e-3
    assert machine.period() == "following_error" and "0.002 m, the bound is 0.001 m" in machine.says("following_error")
    machine.memory["reference"] = math.nan
    assert machine.period() == "none"


def test_frozen_encoder(machine):
    machine.voltage = 2.0
    fault, seen = machine.move(0.0, 1000, 2.0)
    assert fault == "encoder_frozen" and seen == pytest.approx(FROZEN_S / PERIOD, abs=2)
    assert "not changed by one count" in machine.says("encoder_frozen") and "2 V" in machine.says("encoder_frozen")
    resting = Machine()
    assert resting.move(0.0, 1000, 0.1)[0] == "none"  # friction holds so little


def test_encoder_against_motor_angle(machine):
    angle = machine.position / machine.per_radian
    assert machine.move(0.005, 99, motor_angle=angle)[0] == "none"
    assert machine.move(0.005, 3, motor_angle=angle)[0] == "encoder_motor" and "bound is 0.0005 m" in machine.says("encoder_motor")
    assert Machine().move(0.005, 200, motor_angle=math.nan)[0] == "none"  # no such sensor


def test_voltage_rate(machine):
    assert machine.move(0.0, 1, 1.9)[0] == "none"
    assert machine.move(1e-4, 1, -0.2)[0] == "voltage_rate" and "the bound is 2 V in one period" in machine.says("voltage_rate")


def test_zero_is_no_limit_and_the_derived_ones_let_the_machine_reach_its_top_speed():
    axis = load_axis(config_file("axis.yaml"))
    limits, _ = new_limits(axis, (-0.01, 0.01), {})
    assert np.isinf(limits["following"][0]) and np.isinf(limits["voltage_step"][0]) and np.isinf(limits["motor_gap"][0])
    highest = axis.value("drive.voltage_limit") / axis.value("drive.resistance")
    assert limits["current"][0] == pytest.approx(1.3 * highest) and limits["velocity"][0] > 6e-3


def test_every_number_of_the_limits():
    """Of the shipped axis: 6 V over 25 nm, and what was given."""
    axis = load_axis(config_file("axis.yaml")).with_values({"period": PERIOD}, source="estimate")
    limits, memory = new_limits(axis, (-0.01, 0.02), GIVEN)
    bounds = limits[0]
    volts, count = axis.value("drive.voltage_limit"), axis.value("sensors.encoder.resolution")
    assert (bounds["low"], bounds["high"]) == (-0.01, 0.02) and bounds["blend"] == pytest.approx(0.2) and bounds["period"] == PERIOD
    assert bounds["jump"] == pytest.approx(3.0 * 0.01 * PERIOD + 100.0 * count)
    assert bounds["frozen_voltage"] == pytest.approx(0.25 * volts) and bounds["frozen_periods"] == pytest.approx(100.0)
    assert bounds["voltage_step"] == pytest.approx(2.0) and bounds["motor_gap"] == 5e-4 and bounds["following"] == 1e-3
    assert np.isnan(memory["reference"][0]) and memory["begun"][0] == 0.0
    slow = new_limits(axis.with_values({"period": 0.02}, source="estimate"), (-0.01, 0.01), GIVEN)[0][0]
    assert slow["frozen_periods"] == 10.0 and slow["blend"] == 1.0  # never fewer than ten periods, never more than the reading itself


def test_a_drive_that_holds_a_position_may_stand_still_under_command():
    piezo, _ = new_limits(load_axis(config_file("axes/piezo.yaml")), (-1e-3, 1e-3), {"velocity": 0.01})
    assert np.isinf(piezo["frozen_voltage"][0]) and np.isinf(piezo["current"][0])


def test_the_smoothing_of_speed_and_current(machine):
    """A first-order mean over 5 ms: a fifth of the difference in each millisecond."""
    machine.move(0.005, 1, current=0.1)
    assert machine.memory["velocity"][0] == pytest.approx(0.001) and machine.memory["current"][0] == pytest.approx(0.02)
    machine.move(0.005, 1, current=0.1)
    assert machine.memory["velocity"][0] == pytest.approx(0.0018) and machine.memory["current"][0] == pytest.approx(0.036)


def test_bounds_hold_both_ways(machine):
    begin_anew(machine.memory[0])
    assert machine.period(encoder=0.01) == "none" and machine.period(encoder=0.01 + 1e-9) == "travel"
    for way in (1.0, -1.0):
        made = Machine()
        made.period()
        assert made.move(way * 0.012, 100)[0] == "velocity"
        assert made.says("velocity").startswith(f"{made.memory['velocity'][0]:.6g} m/s, the bound is 0.01 m/s")
        made = Machine()
        made.period()
        assert made.move(0.0, 100, 0.1, current=way * 0.6)[0] == "current"
        made = Machine()
        made.period()
        made.memory["reference"] = way * 1.1e-3
        assert made.period() == "following_error" and f"{way * 1.1e-3:.6g} m, the bound" in made.says("following_error")
        made = Machine()
        made.period()
        assert made.period(voltage=way * 2.0) == "none" and made.period(voltage=-way * 0.1) == "voltage_rate"


def test_words_of_a_frozen_encoder(machine):
    machine.voltage = -2.0
    assert machine.move(0.0, 1000, -2.0)[0] == "encoder_frozen"
    assert machine.says("encoder_frozen") == "the encoder has not changed by one count for 0.101 s at -2 V (bound: 0.1 s above 1.5 V)"


def test_words_in_the_unit_of_another_command(machine):
    machine.move(1e-4, 1, -2.2)
    text = in_words(FAULTS.index("voltage_rate"), machine.limits, machine.memory, "A")[1]
    assert text == "the bound is 2 A in one period"


def test_one_count_keeps_an_encoder_alive(machine):
    for _ in range(3):
        assert machine.move(0.0, 100, 2.0)[0] == "none"
        machine.position += 25e-9
        assert machine.move(0.0, 1, 2.0)[0] == "none"


def test_after_a_reset_places_are_compared_anew(machine):
    machine.move(0.005, 10)
    begin_anew(machine.memory[0])
    assert machine.period(encoder=-5e-3, motor_angle=0.0) == "none"  # it was carried somewhere else meanwhile


def test_travel_per_radian_of_the_motor():
    """One turn of the screw is one pitch, behind the gear."""
    axis = load_axis(config_file("axis.yaml"))
    gear, pitch = axis.value("transmission.gear_ratio"), axis.value("transmission.pitch")
    assert float(new_limits(axis, (-0.01, 0.01), GIVEN)[0]["motor_travel"][0]) == pytest.approx(pitch / (2.0 * math.pi * gear))
