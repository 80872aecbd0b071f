"""Gaps of the drive, rattles and stick-slip: what is a swing of the loop, and what is not."""

import numpy as np
import pytest

from microstage_ros.control.half_waves import half_wave
from microstage_ros.control.laws import self_tuning_observer
from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.observer import inertia_doubt, lost_motion, source_doubt
from microstage_ros.control.robustness.campaign import examine
from microstage_ros.control.robustness.conditions import conditions, random_machine

LAW = "self_tuning_observer"


@pytest.fixture
def observer(axis):
    """(parameters, memory) of the observer in a new controller."""
    controller = make_controller(LAW, axis)
    return controller.parameters["observer"], controller.memory["observer"]


def longest_row(hysteresis, seed):
    """Swings in a row of a sine of 0.3 um and 70 Hz in noise of 20 nm, 0.1 s long."""
    noise = np.random.default_rng(seed).normal(0.0, 2e-8, 1000)
    peak, row, since, longest = 0.0, 0, 0.0, 0
    for fast in 3e-7 * np.sin(2.0 * np.pi * 70.0 * 1e-4 * np.arange(1000)) + noise:
        since += 1e-4
        row, turned = half_wave(fast, peak, row, since, 0.02, 6.3e-8, hysteresis)
        longest = max(longest, row)
        if turned or abs(fast) > abs(peak):
            peak, since = fast, 0.0 if turned else since
    return longest


def test_noise_at_the_change_of_sign_does_not_end_a_row():
    """A row of thirteen half waves was a row of three to seven (20 seeds)."""
    assert max(longest_row(0.0, seed) for seed in range(10)) < 9
    assert min(longest_row(6e-8, seed) for seed in range(10)) >= 12


@pytest.mark.parametrize("gap, peak, suspected", [(0.0, 1.1e-6, True), (0.0, 0.4e-6, False), (3e-6, 0.4e-6, True)])
def test_behind_a_gap_the_encoder_stays_doubted(axis, gap, peak, suspected):
    """A rattle brought both doubts back to those of the start: 63 of 1003 moves through 0.25 degrees ended more than 100 nm off, 11 since
    (`robustness --moves 1003 --seed 31000`)."""
    controller = make_controller(LAW, axis)
    parameters, memory = controller.parameters["observer"], controller.memory["observer"]
    memory["position_test"], memory["speed_test"], memory["waves"], memory["wave_first"] = 100.0, 1.0, 4, 0.5e-6
    memory["gap"], memory["wave_peak"], memory["wave_before"], memory["wave_time"] = gap, peak, 0.9 * peak, 3e-3
    source_doubt.doubt_more(parameters, controller.parameters["feedforward"], memory)
    assert (memory["suspected"] > 0.0) == suspected
    memory["rest_time_s"], memory["waves"], memory["encoder_factor"] = 0.0, 0, 8.0
    assert source_doubt.doubt_in_lost_motion(parameters, memory, 1e-4) == source_doubt.MOST_ENCODER
    memory["rest_time_s"] = 1.0
    for _ in range(3000):
        memory["encoder_factor"] = source_doubt.doubt_in_lost_motion(parameters, memory, 1e-4)
    assert memory["encoder_factor"] == source_doubt.AT_REST
    memory["waves"] = 1
    assert source_doubt.doubt_in_lost_motion(parameters, memory, 1e-4) == source_doubt.MOST_ENCODER


def test_a_crossing_noticed_late_says_little_of_the_gap(observer):
    """In fast moves a contact was seen to open when the drive had gone half the way: a gap of 1.36 um became one of 0.66 to 1.19 within a run
    (14 of 14 records), and moves ended up to 1.1 um off."""
    parameters, memory = observer
    for lead, least, most in ((3e-8, 0.9e-6, 1.0e-6), (9e-7, 1.34e-6, 1.36e-6)):
        memory["gap"], memory["gap_variance"], memory["side"], memory["confirmed"] = 1.36e-6, (3e-8) ** 2, -1.0, 1
        memory["contact"], memory["v"], memory["followed"] = lost_motion.TOUCHING, 1e-5, 1e-7
        memory["lead"], memory["mean_lead"], memory["steady_time_s"] = lead, 0.0, 1.0
        lost_motion.watch_contact(parameters, memory, 0.0, 1.0, 1e-7, True)
        assert memory["contact"] == lost_motion.IN_GAP
        memory["travel"], memory["x"], memory["push"] = 0.95e-6, memory["stage"], 0.0
        lost_motion.arrive(parameters, memory, True)
        assert least < memory["gap"] < most


@pytest.mark.parametrize("gap, steady, opens", [(3e-6, 0.02, False), (3e-6, 0.06, True), (0.0, 0.06, False), (0.0, 0.11, True)])
def test_contacts_open_in_steady_motion_only(observer, gap, steady, opens):
    parameters, memory = observer
    memory["gap"], memory["side"], memory["confirmed"], memory["calm"] = gap, -1.0, 1, 1.0
    memory["v"], memory["followed"], memory["lead"] = 1e-5, 1e-8, 4e-7
    memory["steady_time_s"] = steady
    lost_motion.watch_contact(parameters, memory, 0.0, 1.0, 1e-7, True)
    assert (memory["contact"] == lost_motion.IN_GAP) == opens


def test_an_acceleration_ends_a_steady_motion(observer):
    _, memory = observer
    assert memory["steady_time_s"] > lost_motion.SEARCHED  # the reference stands before the start
    inertia_doubt.plan_acceleration(memory, 1e-4, 1e-2 * 1e-3)
    assert memory["steady_time_s"] == 0.0
    for _ in range(200):
        inertia_doubt.plan_acceleration(memory, 1e-4, 4e-6 * 1e-4)
    assert 0.005 < memory["steady_time_s"] < 0.02


@pytest.mark.parametrize("change, swings, no_gain", [
    ({}, 0, True), ({"rest_time_s": 0.1}, 0, False), ({"steady_time_s": 0.0}, 0, False), ({"waves": 1}, 0, False), ({"encoder_factor": 4.0}, 0, False),
    ({"suspected": 5.0}, 5, True), ({"suspected": 5.0}, 50, False), ({"suspected": 5.0, "rest_time_s": 0.2}, 5, False),
    ({"gap": 3e-6, "steady_time_s": 0.0}, 5, True),
], ids=["stick-slip", "at rest", "accelerates", "the loop swings", "a heavy stage", "thrown across a gap", "a limit cycle", "long at rest", "a known gap"])
def test_stick_slip_and_throws_across_a_gap_lower_no_gain(axis, change, swings, no_gain):
    controller = make_controller(LAW, axis)
    memory = controller.memory["observer"]
    for name, value in change.items():
        memory[name] = value
    assert self_tuning_observer.no_gain_ends_swings(controller.parameters, memory, swings) == no_gain


def test_stick_slip_keeps_the_gains(axis):
    """Where static friction is twice the file's, its own swings took K_P to a tenth: 0.56 and 0.67 um in a slow sine, 0.18 and 0.22 since
    (seeds 12400 and 12401)."""
    machine = random_machine(axis, 8275, 2.0)
    assert np.median([examine(axis, machine, seed, LAW).moving for seed in (12600, 12601, 12602)]) < 4e-7


def test_a_weight_that_is_let_go_is_held(axis):
    """26 um in every record of six times the mass on a tilted axis, while its first half waves, of 1.1 and 2.2 um, brought the doubt in the
    encoder back to that of the start; since then beyond 10 um in 4 of 40 (seeds 12600 to 12639), of which three of five come once in 100 times."""
    heavy = next(c for c in conditions(axis) if c.name == "tilt 0.1 rad, mass x 6")
    assert np.median([examine(axis, heavy, seed, LAW).largest for seed in range(12600, 12605)]) < 1e-5
