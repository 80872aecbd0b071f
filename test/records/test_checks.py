"""Records that lie are refused; records that are only weak are told."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from microstage_ros.model.axis_file import load_axis
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import Record, read_record
from microstage_ros.records.checks import Bounds, check_record

ROOT = Path(__file__).parents[2]
PRACTICE = ROOT.parent / "shared/data/practice"
BOUNDS = Bounds(25e-9, 0.05, 6.0, 3.41, 1e-4)


def honest(rows=20_000, reach=1e-3):
    """A sine of the stage with all its sensors."""
    generator = np.random.default_rng(8)
    t = np.arange(rows) * 1e-4
    true = reach * np.sin(6 * t)
    voltage = 0.8 * np.cos(6 * t) + generator.normal(0, 0.05, rows)
    return {
        "encoder_m": np.round((true + generator.normal(0, 8e-9, rows)) / 25e-9) * 25e-9,
        "reference_m": true + 1e-7, "voltage_V": voltage, "current_A": np.roll(voltage, 1) / 3.41,
        "interferometer_m": true + generator.normal(0, 1e-8, rows), "air_temperature_K": np.full(rows, 293.1),
        "air_pressure_Pa": np.full(rows, 101e3), "air_humidity": np.full(rows, 0.4),
        "stage_temperature_K": np.full(rows, 294.0), "motor_angle_rad": true * 6e4}


def check(columns, bounds=BOUNDS, period_s=1e-4):
    return check_record(Record(period_s, columns, "r.csv"), bounds)


@pytest.mark.parametrize("reach", [2e-6, 1e-5, 1e-3, 2.4e-2])
def test_an_honest_record_passes_without_a_word(reach):
    assert check(honest(reach=reach)) == []


LIES = {
    "encoder in mm": ({"encoder_m": 1e3}, ["encoder_m", "mm for m"]),
    "encoder in um": ({"encoder_m": 1e6}, ["encoder_m", "µm for m"]),
    "reference in mm": ({"reference_m": 1e3}, ["reference_m"]),
    "interferometer in um": ({"interferometer_m": 1e6}, ["interferometer_m"]),
    "voltage in mV": ({"voltage_V": 1e3}, ["voltage_V", "volts"]),
    "current in mA": ({"current_A": 1e3}, ["current_A", "mA for A"]),
    "the voltage with the other sign": ({"voltage_V": -1.0}, ["current_A", "other sign"]),
    "the encoder with the other sign": ({"encoder_m": -1.0}, ["motor_angle_rad against encoder_m", "other sign"]),
    "the reference with the other sign": ({"reference_m": -1.0}, ["reference_m against encoder_m", "other sign"]),
    "the interferometer with the other sign": ({"interferometer_m": -1.0}, ["interferometer_m against encoder_m", "other sign"]),
    "voltage and current with the other sign": ({"voltage_V": -1.0, "current_A": -1.0}, ["voltage_V and current_A against encoder_m", "other sign"]),
    "pressure in hPa": ({"air_pressure_Pa": 1e-2}, ["air_pressure_Pa", "pascal"]),
    "humidity in percent": ({"air_humidity": 1e2}, ["air_humidity", "0 to 1"]),
}


def test_a_load_that_is_lowered_has_no_wrong_sign():
    """It drives the motor: its current is that of the holding torque, its voltage the back-EMF's the other way; steps of the loop
    have one sign in both."""
    columns = honest(reach=1e-3)
    loop = columns["voltage_V"] - columns["voltage_V"].mean()
    loop *= 0.05 / np.abs(loop).max()
    columns |= {"voltage_V": loop - 0.5, "current_A": np.roll(loop, 1) / 3.41 + 0.05}
    assert np.mean(columns["voltage_V"] * columns["current_A"]) < 0.0
    check(columns)


@pytest.mark.parametrize("lie", LIES)
@pytest.mark.parametrize("reach", [1e-5, 1e-3])
def test_another_unit_is_refused(lie, reach):
    factors, told = LIES[lie]
    columns = honest(reach=reach)
    for name, factor in factors.items():
        columns[name] = columns[name] * factor
    with pytest.raises(InputError) as caught:
        check(columns)
    for words in ["r.csv", *told]:
        assert words in str(caught.value)


@pytest.mark.parametrize("one, other", [("encoder_m", "reference_m"), ("encoder_m", "voltage_V"),
                                        ("current_A", "voltage_V"), ("air_temperature_K", "air_pressure_Pa")])
def test_swapped_columns_are_refused(one, other):
    columns = honest()
    columns[one], columns[other] = columns[other], columns[one]
    with pytest.raises(InputError):
        check(columns)


@pytest.mark.parametrize("name", ["encoder_m", "interferometer_m", "motor_angle_rad", "current_A"])
def test_constant_sensors_are_refused(name):
    with pytest.raises(InputError, match=f"{name}: got 'constant'"):
        check({**honest(), name: np.full(20_000, 1e-6)})
    with pytest.raises(InputError, match="0 throughout"):
        check({**honest(), "voltage_V": np.zeros(20_000), "current_A": np.zeros(20_000)})


def test_motor_off_is_no_defect():
    columns = honest(reach=1e-7)
    assert check({**columns, "voltage_V": np.zeros(20_000), "current_A": np.zeros(20_000)}) == []


def test_celsius_short_and_millisecond_records_are_refused():
    with pytest.raises(InputError, match="kelvin"):
        check({**honest(), "stage_temperature_K": np.full(20_000, 21.0)})
    with pytest.raises(InputError, match="at least 1 s"):
        check(honest(rows=500))
    with pytest.raises(InputError, match="seconds"):
        check(honest(), period_s=0.1)


def test_saturation_is_told_or_refused():
    columns = honest()
    little, much = np.clip(columns["voltage_V"] * 9, -6, 6), np.sign(columns["voltage_V"]) * 6
    del columns["current_A"]
    assert "at the limit" in check({**columns, "voltage_V": little})[0]
    with pytest.raises(InputError, match="at the limit"):
        check({**columns, "voltage_V": much})


@pytest.mark.parametrize("name, reach", [("current_A", 0.1), ("interferometer_m", 4e-4), ("encoder_m", 4e-4)])
def test_a_sensor_at_the_end_of_its_range_is_told_or_refused(name, reach):
    columns = honest()
    told = check({**columns, name: np.clip(columns[name], -reach, reach)})
    assert len(told) == 2 and all(f"{name} stands at" in words for words in told)
    if name != "encoder_m":
        with pytest.raises(InputError, match="end of its range"):
            check({**columns, name: np.minimum(columns[name], np.quantile(columns[name], 0.4))})


def test_weak_points_are_told():
    columns = honest()
    columns["encoder_m"][:10] = np.nan
    assert "lacks 10 of 20000" in check(columns)[0]
    columns["encoder_m"][:11_000] = np.nan
    with pytest.raises(InputError, match="11000 of 20000 samples missing"):
        check(columns)
    assert "whole counts" in check({**honest(), "encoder_m": honest()["interferometer_m"]})[0]
    assert "sampled every 0.001 s" in check(honest(), period_s=1e-3)[0]
    assert "5 counts" in check(honest(reach=1e-3), replace(BOUNDS, resolution_m=5e-9))[0]


def test_a_record_without_a_command_is_checked_for_what_it_has():
    columns = {name: values for name, values in honest().items() if name != "voltage_V"}
    assert check(columns) == []
    with pytest.raises(InputError, match="mm for m"):
        check({**columns, "encoder_m": 1e3 * columns["encoder_m"]})


@pytest.mark.skipif(not PRACTICE.exists(), reason="the practice records (../shared/data/practice) are not here")
@pytest.mark.parametrize("case", ["healthy", "cable", "two"])
def test_records_of_another_simulator_pass(case):
    axis = load_axis(ROOT / "config/axis.yaml")
    assert check_record(read_record(PRACTICE / case / "rec1.csv.xz"), axis) == []
