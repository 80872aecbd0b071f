"""Motor constants, inertia and attraction from simulated bench runs with noise."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from microstage_ros.control.runs.run_file import Run, run_from_dict
from microstage_ros.control.runs.simulate import simulated_record
from microstage_ros.identification import experiments
from microstage_ros.identification.estimators.acceleration import identify_attraction, identify_inertia
from microstage_ros.identification.estimators.motor import cross_check, identify_motor, speed_by_voltage
from microstage_ros.identification.signals import (
    motor_signals,
    screw_ratio,
    steady_windows,
    window_means,
)
from microstage_ros.identification.whole_axis import with_windup
from microstage_ros.signals.current import centred_current
from test.identification.conftest import ROOT


@pytest.fixture(scope="module")
def speed_signals(actuator_bench):
    run = experiments.constant_speeds(screw_ratio(actuator_bench), speeds=(0.3, 1.0, 4.0, 16.0), duration=0.25, least_way=0.05)
    return [motor_signals(r, actuator_bench) for r in experiments.repeats(actuator_bench, [run], 3)]


@pytest.fixture(scope="module")
def acceleration_signals(actuator_bench):
    run = experiments.accelerations(screw_ratio(actuator_bench), cycles=16)
    return [motor_signals(r, actuator_bench) for r in experiments.repeats(actuator_bench, [run], 5)]


def test_resistance_back_emf_and_inductance(speed_signals, actuator_bench):
    found = identify_motor(speed_signals, actuator_bench).estimates
    assert found["drive.resistance"].value == pytest.approx(3.41, rel=2e-3)
    assert found["drive.back_emf"].value == pytest.approx(6.589014636e-3, rel=1e-3)
    assert found["drive.inductance"].value == pytest.approx(75e-6, rel=0.15)
    assert found["amplifier offset"].determined and abs(found["amplifier offset"].value) < 1e-4


def test_cross_check_is_told(speed_signals, actuator_bench):
    assert "Eq. 9" in cross_check(speed_signals, identify_motor(speed_signals, actuator_bench).estimates, actuator_bench)


def test_an_amplifier_offset_is_found(actuator_bench):
    run = experiments.constant_speeds(screw_ratio(actuator_bench), speeds=(0.3, 4.0), duration=0.25, least_way=0.05)
    run.effects = {"amplifier_offset": {"offset_V": 5e-3}}
    signals = [motor_signals(r, actuator_bench) for r in experiments.repeats(actuator_bench, [run], 3)]
    assert identify_motor(signals, actuator_bench).estimates["amplifier offset"].value == pytest.approx(5e-3, rel=0.1)


def test_speed_by_eq_9_agrees_with_the_encoder(speed_signals, actuator_bench):
    """Paper Eq. 9, ω_r = (U − R I) / (i K_E), as cross-check of the steady speeds."""
    signals = speed_signals[0]
    resistance, back_emf = actuator_bench.value("drive.resistance"), actuator_bench.value("drive.back_emf")
    for window in steady_windows(signals, least_travel=0.02):
        by_voltage = speed_by_voltage(signals, window, resistance, back_emf, 19.0)
        assert by_voltage == pytest.approx(window_means(signals, window)[0], rel=0.02, abs=0.005)


def test_inertia(acceleration_signals, actuator_bench):
    found = identify_inertia(acceleration_signals, actuator_bench).estimates["drive.rotor_inertia"]
    assert found.determined
    assert found.value == pytest.approx(1e-7, rel=0.01)


def test_inertia_without_fast_motion_is_not_determined(actuator_bench):
    run = Run(controller={"type": "pid"}, noise=experiments.BENCH_NOISE, program=[{"scan": {"to_m": 2e-5, "speed_m_s": 1e-5}}])
    signals = [motor_signals(r, actuator_bench) for r in experiments.repeats(actuator_bench, [run], 1)]
    assert not identify_inertia(signals, actuator_bench).estimates["drive.rotor_inertia"].determined


@pytest.mark.parametrize("attraction", [0.3, 1.0])
def test_attraction_and_its_interval_over_six_axes(actuator_bench, attraction):
    """Each with its own friction, 6 % of it at random; if that level is not in the law's limits C scatters by 15 %."""
    axis = actuator_bench.with_values({"contacts.actuator.attraction": attraction})
    run, key = experiments.accelerations(screw_ratio(axis), cycles=16), "contacts.actuator.attraction"
    found = [identify_attraction([motor_signals(record, axis)], actuator_bench).estimates[key]
             for record in experiments.repeats(axis, [run] * 6, 7)]
    assert all(f.determined and f.method == "profile likelihood" for f in found)
    assert [f.value for f in found] == pytest.approx([attraction] * 6, rel=0.15)
    assert sum(f.low < attraction < f.high for f in found) >= 5  # fewer by chance: 3 %
    assert np.mean([f.stderr for f in found]) < 0.1 * attraction


def test_what_is_not_known_of_the_stribeck_curve_widens_the_interval_of_the_attraction(actuator_bench):
    key, exponent = "contacts.actuator.attraction", "contacts.actuator.stribeck_exponent"
    [record] = experiments.repeats(actuator_bench, [experiments.accelerations(screw_ratio(actuator_bench), cycles=16)], 7)
    sure, other, unsure = (identify_attraction([motor_signals(record, actuator_bench)], axis).estimates[key] for axis in (
        actuator_bench, actuator_bench.with_values({exponent: 0.94}), actuator_bench.with_values({exponent: 0.9}, stderr={exponent: 0.04})))
    assert unsure.stderr**2 == pytest.approx(sure.stderr**2 + (other.value - sure.value) ** 2, rel=0.3)
    assert unsure.stderr > 1.2 * sure.stderr


def test_slow_motion_does_not_tell_the_attraction(actuator_bench):
    run = Run(controller={"type": "pid"}, noise=experiments.BENCH_NOISE, program=[{"scan": {"to_m": 2e-5, "speed_m_s": 1e-5}}])
    signals = [motor_signals(r, actuator_bench) for r in experiments.repeats(actuator_bench, [run], 1)]
    found = identify_attraction(signals, actuator_bench).estimates["contacts.actuator.attraction"]
    assert not found.determined and "would" in found.remark


def test_centred_current_of_a_ramp_is_shifted_by_the_settling():
    """Mean of the periods before and after: ½ (1 − 2 ε) rows later than the reading."""
    ramp = np.arange(10.0)
    assert centred_current(ramp, 0.2)[1:-1] == pytest.approx(ramp[1:-1] + 0.3)


def ordinary(axis, seed, effects=None):
    """Signals of one ordinary record, by the angle of the motor and by that of the stage."""
    tree = yaml.safe_load((ROOT / "config" / "experiments" / "whole_axis.yaml").read_text(encoding="utf-8"))
    noise = {"encoder_m": 8e-9, "voltage_V": 1e-3, "friction_relative": 0.04}
    record = simulated_record(axis, run_from_dict({**tree, "noise": noise, "effects": effects or {}, "program": tree["program"][2:]}), seed)
    stage = replace(record, columns={name: values for name, values in record.columns.items() if name != "motor_angle_rad"})
    return [with_windup(motor_signals(each, axis), axis) for each in (record, stage)]


def test_six_healthy_axes_leave_no_more_than_the_noise(paper_axis):
    for seed in range(1, 7):
        for signals in ordinary(paper_axis, seed):
            assert identify_motor([signals], paper_axis).remarks == []


@pytest.mark.parametrize("width, at", [(0.0005, (1,)), (0.005236, (0, 1))])
def test_a_hidden_gap_stands_above_the_noise(paper_axis, width, at):
    """A gap of 0.03° shows to the stage's encoder alone; of 0.3° the loop rattles, and the motor's angle is no better."""
    both = ordinary(paper_axis, 1, {"backlash": {"width_rad": width}})
    for number in at:
        [remark] = identify_motor([both[number]], paper_axis).remarks
        assert "lost motion" in remark and "The stated errors do not hold" in remark and "`diagnose`" in remark
    silent = paper_axis.with_values({"drive.noise": 0.0})
    assert identify_motor([both[1]], silent).remarks == []  # no noise is stated to hold it against
