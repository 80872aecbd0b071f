"""A change of the drive: found within periods, learned from one reading, never found where there is none."""

import numpy as np
import pytest

from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.laws.self_tuning_observer import regulate
from microstage_ros.control.observer import drive_learning
from microstage_ros.control.friction_observer import FrictionObserver
from microstage_ros.control.runs.closed_loop import TRACE, run_loop
from microstage_ros.control.trajectories.profiles import sine
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work

BEFORE, AFTER = 0.3, 5e-4  # s


def run_until_changed(axis, change, seed=0, after=AFTER, **conditions):
    """Memory of the observer, before and ``after`` [s] from when ``change`` was applied to the plant."""
    reference = sine(0.0, 1e-5, 0.5, 0.5, 1e-4)
    plant, readings = make_plant(axis, NoiseSpec(), **conditions), new_readings()
    state, work, controller = new_state(plant, seed=seed), new_work(plant), make_controller("self_tuning_observer", axis)
    seen, start = [], 0
    for seconds in (BEFORE, after):
        part = reference[start : start + round(seconds / 1e-4)]
        none, start = np.zeros_like(part), start + len(part)
        run_loop(plant, state, work, readings, controller.parameters, controller.memory, part, none, none, np.empty((0, len(TRACE))))
        seen.append(controller.memory["observer"].copy())
        change(plant)
    return seen


@pytest.mark.parametrize("factor", [0.4, 0.5, 0.7, 0.85, 1.2, 1.4, 2.0, 2.5])
@pytest.mark.parametrize("delay", [0.0, 2e-4])
def test_jump_of_the_gain_is_found_and_learned_within_five_periods(axis, factor, delay):
    def jump(plant):
        plant["gain"] *= factor

    before, after = run_until_changed(axis, jump, after=AFTER + delay, effects={"transport_delay": {"delay_s": delay}})
    assert before["changes"] == 0 and after["changes"] >= 1
    drop, emf = float(after["drop"]), 393.3 * float(after["v"])
    called = after["learned"][0] * drop + after["learned"][1] + after["learned"][2] * emf
    assert called == pytest.approx((drop + emf) / factor, rel=0.03, abs=2e-3)


def test_jump_of_the_zero_is_found(axis):
    def jump(plant):
        plant["amplifier_offset"] += 0.05

    before, after = run_until_changed(axis, jump)
    assert before["changes"] == 0 and after["changes"] >= 1


SINE = [{"sine": {"amplitude_m": 1e-5, "frequency_hz": 0.25, "cycles": 1.0}}]
MOVES = [{"move_to_m": place, "dwell_s": 0.1} for place in (1e-5, 0.0, 1e-3)]


@pytest.mark.parametrize("conditions", [
    {},
    {"effects": {"friction_level_change": {"factor": 2.0}}},
    {"effects": {"payload_change": {"mass_kg": 6.12}}},
    {"effects": {"drive_compliance": {"stiffness_factor": 0.33}}},
    {"effects": {"transport_delay": {"delay_s": 2e-4}}},
    {"effects": {"resistance_rise": {"initial": 0.2, "time_s": 5.0}}},
    {"effects": {"amplifier_gain": {"factor": 0.5}}},
    {"noise": {"current_A": 1e-3}},
    {"period_s": 1e-3},
])
def test_no_change_is_found_where_there_is_none(axis, run, conditions):
    for program in (SINE, MOVES):
        columns = run("self_tuning_observer", program, seed=3, **conditions)
        observer = FrictionObserver(axis, period=conditions.get("period_s"))
        voltage = np.concatenate([[0.0], columns["voltage_V"][:-1]])
        observer.advance_all(columns["encoder_m"], voltage, columns["current_A"])
        assert observer.memory["changes"] == 0


@pytest.mark.parametrize("factor", [0.4, 2.5])
def test_new_gain_from_one_reading_is_voltage_over_what_it_should_be(axis, factor):
    """Where gain alone may have changed: 1 / factor = (u - o) / (R i + E v), whatever was believed before."""
    observer = FrictionObserver(axis)
    memory, model, parameters = observer.memory, observer.model, observer.parameters
    parameters["voltage_noise"] = 1e-6
    drop, speed = 0.11, 2e-4
    emf = float(model["volts_per_velocity"]) * speed
    memory["v"], memory["learned_covariance"] = speed, 0.0
    memory["voltages"][:] = memory["answered"] = (drop + emf) / factor
    drive_learning.relearn(parameters, model, memory, drop)
    called = memory["learned"][0] * drop + memory["learned"][1] + memory["learned"][2] * emf
    assert called == pytest.approx((drop + emf) / factor, rel=1e-3)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_controller_counts_with_the_changed_drive_at_once(axis, factor):
    """The voltage that the nominal axis would get, times R i + E v of the drive as learned; the gain of the loop stays."""
    def jump(plant):
        plant["gain"] *= factor

    before, after = run_until_changed(axis, jump)
    np.testing.assert_allclose(before["applied"], [1.0, 0.0, 1.0], atol=2e-3)
    np.testing.assert_allclose(after["applied"], after["learned"], rtol=0.05, atol=5e-3)  # of the period before
    given = drive_learning.drive_voltage(after, 0.11, 0.002)
    assert given == pytest.approx(0.112 / factor, rel=0.08)


def test_controller_leaves_a_drive_alone_that_is_learned_as_nominal(axis):
    """What sliding one way leads the learned drive astray by is not applied."""
    observer = FrictionObserver(axis)
    memory = observer.memory
    memory["steady"], memory["learned"] = 1.0, (1.04, 8e-3, 0.97)
    for _ in range(5000):
        drive_learning.apply_learned(observer.parameters, memory, 1e-4)
    np.testing.assert_array_equal(memory["applied"], [1.0, 0.0, 1.0])
    memory["learned"] = 1.3, 0.05, 1.0
    for _ in range(20000):
        drive_learning.apply_learned(observer.parameters, memory, 1e-4)
    np.testing.assert_allclose(memory["applied"], [1.25, 0.04, 1.0], rtol=1e-3)


@pytest.mark.parametrize("applied", [(1.0, 0.0, 1.0), (0.5, 0.0, 0.8), (0.5, 0.3, 0.8), (2.0, -0.2, 1.0)])
def test_a_drive_of_another_resistance_has_all_its_voltage(axis, applied):
    """What is learned of R, offset and E turns the regulator's nominal volts into volts: the limit is that of the latter."""
    controller, limit = make_controller("self_tuning_observer", axis), axis.value("drive.voltage_limit")
    for _ in range(50):
        controller.step(0.0, 0.0, 0.0)
    for far in (1e-3, -1e-3):
        memory = controller.memory.copy()
        memory["observer"]["applied"] = applied
        assert regulate(controller.parameters, memory, far) == np.copysign(limit, far)
