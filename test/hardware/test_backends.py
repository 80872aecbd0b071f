"""The protocol of hardware, on the simulated axis, and the registry."""

import numpy as np
import pytest

from microstage_ros.hardware import BACKENDS, make_hardware
from microstage_ros.hardware.protocol import HardwareError, Setup, safety_members
from microstage_ros.hardware.simulated import machine_for
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError

AXIS = load_axis(config_file("axis.yaml"))
QUIET = {"noise": {"encoder_m": 0.0, "voltage_V": 0.0, "current_A": 0.0, "interferometer_m": 0.0,
                   "friction_relative": 0.0}}


def run(voltages, seed=1, **options):
    """Encoder and current at the start of every period."""
    axis = make_hardware("simulated", Setup(AXIS, seed, options))
    axis.open()
    readings = []
    for voltage in voltages:
        readings.append(axis.read())
        axis.write(voltage)
    axis.close()
    return np.array(readings), axis


def test_row_convention():
    """Row n: sensors at the start of period n, then the voltage held during it."""
    readings, axis = run([1.0, 1.0, 1.0], **QUIET)
    assert readings[0, 0] == 0.0 and abs(readings[0, 1] - 1e-4) < 1e-4  # its offset; the first reading moves nothing
    assert readings[1, 1] > 0.1  # the current answers the voltage of the row before
    assert axis.truth.stage_position >= 0.0


@pytest.mark.parametrize("options, words", [
    ({"noise": {"encoder": 8e-9}}, "option noise: encoder: got 8e-09, expected one of encoder_m, voltage_V"),
    ({"noise": {"encoder_m": "fine"}}, "option noise: encoder_m: got 'fine', expected"),
    ({"noise": 3}, "option noise: got 3, expected a mapping"),
    ({"position": "home"}, "option position: got 'home'"), ({"friction": "none"}, "option friction: got 'none', expected one of random, relaxed"),
    ({"machine": 5}, "option machine: got 5, expected the name of an axis file")])
def test_a_wrong_option_of_the_simulated_axis_is_one_line(options, words):
    with pytest.raises(InputError) as wrong:
        make_hardware("simulated", Setup(AXIS, 1, options))
    assert words in str(wrong.value)


@pytest.mark.parametrize("options, words", [
    ({"encoder": "a"}, "option encoder: got 'a', expected a whole number"), ({"output": 1.0}, "option output: got 1.0"),
    ({"port": None}, "option port: got None"), ({"position": "10um"}, "option position: got '10um', expected a number"),
    ({"current_A_per_hz": True}, "option current_A_per_hz: got True"), ({"current_encoder": 1.5}, "option current_encoder: got 1.5")])
def test_a_wrong_option_of_the_mesa_card_is_one_line(options, words):
    with pytest.raises(InputError) as wrong:
        make_hardware("mesa", Setup(AXIS, 1, options))
    assert words in str(wrong.value)


def test_same_seed_same_bits():
    voltages = 0.4 * np.sin(np.arange(500) * 0.02)
    first, second, other = run(voltages, 5)[0], run(voltages, 5)[0], run(voltages, 6)[0]
    assert first.tobytes() == second.tobytes() and first.tobytes() != other.tobytes()


def test_start_position_and_bad_option():
    assert run([0.0], position=1e-3, **QUIET)[0][0, 0] == pytest.approx(1e-3, abs=2.5e-8)
    with pytest.raises(InputError, match="colour.*position, noise, friction"):
        make_hardware("simulated", Setup(AXIS, 1, {"colour": "red"}))


@pytest.mark.parametrize("effects, said", [({"backlsh": {}}, "option effects: effects: backlsh: got 'unknown effect'"), ([1], "option effects: effects: got .1."),
                                           ({"backlash": {"width_rad": -1.0}}, "option effects: effects: backlash")])
def test_effects_of_the_simulated_axis_are_checked(effects, said):
    with pytest.raises(InputError, match=f"simulated axis: {said}"):
        make_hardware("simulated", Setup(AXIS, 1, {"effects": effects}))


def test_registry():
    with pytest.raises(InputError, match="expected one of simulated, daq"):
        make_hardware("abacus", Setup(AXIS))
    assert list(BACKENDS) == ["simulated", "daq", "mesa"]


def test_daq_card_says_what_is_missing():
    with pytest.raises(InputError, match="output.*Dev1/ao0"):
        make_hardware("daq", Setup(AXIS))
    card = make_hardware("daq", Setup(AXIS, options={"output": "Dev1/ao0", "counter": "Dev1/ctr0"}))
    try:
        import nidaqmx  # noqa: F401
    except ImportError:
        with pytest.raises(HardwareError, match="nidaqmx"):
            card.open()
    with pytest.raises(HardwareError, match="not open"):
        card.read()
    card.close()


def test_safety_members_are_optional():
    class Bare:
        simulated = False

    class WithEnable(Bare):
        e_stop = None

        def enable(self, on):
            """Nothing."""

    assert safety_members(Bare()) == {}
    assert list(safety_members(WithEnable())) == ["enable"]


def test_a_machine_that_is_not_what_the_controller_is_told(tmp_path):
    """`machine_for`: the same period and kind of drive, whatever else."""
    cold, resistance = tmp_path / "cold.yaml", AXIS.value("drive.resistance")
    AXIS.with_values({"drive.resistance": 0.5 * resistance}, source="estimate").save(cold)
    assert machine_for(AXIS, None) is AXIS and machine_for(AXIS, str(cold)).value("drive.resistance") == 0.5 * resistance
    assert run([0.5] * 50, machine=str(cold))[0][-1, 0] > 1.5 * run([0.5] * 50)[0][-1, 0]
    AXIS.with_values({"period": 2e-4}, source="estimate").save(cold)
    with pytest.raises(InputError, match="cold.yaml: period.*0.0001 s, as in"):
        machine_for(AXIS, str(cold))
    with pytest.raises(InputError, match="drive.type|period"):
        machine_for(AXIS, str(config_file("axes/voice_coil.yaml")))


def test_closed_it_gets_no_voltage():
    axis = make_hardware("simulated", Setup(AXIS, 1, QUIET))
    axis.open()
    assert axis.arrays is None  # until the first reading
    axis.read()
    axis.write(2.0)
    assert axis.arrays is axis.own_arrays and axis.simulated and axis.standing == 0.0
    axis.close()
    axis.read()
    assert abs(axis.read().current) < 1e-3
    axis.open()
    assert axis.arrays is None


def test_what_only_a_simulated_axis_can_tell():
    axis = make_hardware("simulated", Setup(AXIS, 1, {**QUIET, "position": 1e-3}))
    axis.open()
    axis.read()
    assert axis.last_reading == axis.read()._replace() and axis.truth.interferometer == pytest.approx(1e-3, abs=1e-6)
    assert 250.0 < axis.truth.air_temperature < 330.0 and 8e4 < axis.truth.air_pressure < 1.1e5 and 0.0 <= axis.truth.air_humidity <= 1.0
    assert 250.0 < axis.truth.stage_temperature < 330.0 and axis.truth.stage_velocity == pytest.approx(0.0, abs=1e-4)
