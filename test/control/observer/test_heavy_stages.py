"""Heavy stages on soft drives, and the hand-over in a gap; what they cost before is in each docstring."""

import numpy as np
import pytest

from microstage_ros.control.laws import supervision
from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.observer import source_doubt
from microstage_ros.control.robustness.campaign import examine
from microstage_ros.control.robustness.conditions import conditions

LAW = "self_tuning_observer"


def outcomes(axis, name, seeds):
    """`Outcome` of the campaign's program by seed."""
    condition = next(c for c in conditions(axis) if c.name == name)
    return [examine(axis, condition, seed, LAW) for seed in seeds]


def test_six_times_the_mass_on_a_third_of_the_stiffness_is_held(axis):
    """84 um in every record while its swing of the start was taken for a rattle in a gap, in 5 of 240 (seeds 76000 to 76139, 77000 to 77099) while
    noise could end a row of half waves; beyond 5 um in 1 of 240 since, and 77033 and 77042 were two of the five."""
    found = outcomes(axis, "mass x 6, stiffness / 3", (74000, 74001, 74002, 74003, 77033, 77042))
    assert sum(o.largest > 5e-6 for o in found) <= 1
    assert np.median([o.largest for o in found]) < 2.5e-6 and np.median([o.worst_settled for o in found]) < 1e-7
    assert all(o.swing < 2e-7 and o.left < 2e-7 for o in found)


def test_ten_times_the_mass_ends_its_moves(axis):
    """While what rings on after a move raised the doubt in the voltage too, moves ended up to 100 nm off, with errors of 1.1 um."""
    found = outcomes(axis, "mass x 10", range(74000, 74004))
    assert max(o.largest for o in found) < 8e-7 and max(o.worst_settled for o in found) < 4e-8


def test_a_gap_of_one_degree_is_crossed_fed_forward_after_a_hand_over(axis):
    """32 um in moves of 1 mm without inertia and back-EMF in the encoder-only law; 6 to 17 in 200 records since, 8.8 in the median, and 22 in one on another processor's last bits
    (the gap is 5.6 um wide)."""
    found = sorted(o.largest for o in outcomes(axis, "backlash 1 deg", range(74000, 74005)))
    assert found[2] < 1.3e-5 and found[3] < 2.2e-5


def test_a_swing_of_a_few_counts_at_rest_raises_the_doubt(axis):
    """Three times the mass with a voltage that comes 0.3 ms late rang on by some 40 nm after every move, until it swung up at rest: 1.4 um with a hand-over in the
    first of these records, 0.8 and 3.5 um in the others. 0.42 um at most in 240 records since (seeds 76000 to 76039, 86000 to 86199)."""
    found = outcomes(axis, "delay 0.3 ms, mass x 3", (76039, 86069, 86172))
    assert max(o.largest for o in found) < 7e-7 and max(o.swing for o in found) < 1e-7


@pytest.mark.parametrize(
    "rest, position, speed, waves, suspected, rings",
    [(0.3, 2.0, 0.3, 0, 0.0, True), (0.1, 2.0, 0.3, 0, 0.0, False), (0.3, 0.4, 0.1, 0, 0.0, False), (0.3, 2.0, 1.0, 0, 0.0, False),
     (0.3, 2.0, 0.3, 4, 0.0, False), (0.3, 2.0, 0.3, 0, 5.0, False)],
    ids=["a stage rings", "a move has just ended", "noise", "the motor too", "a swing", "a rattle"],
)
def test_innovations_at_rest_beyond_the_expected_are_a_stage_that_rings(axis, rest, position, speed, waves, suspected, rings):
    memory = make_controller(LAW, axis).memory["observer"]
    for name, value in {"rest_time_s": rest, "position_test": position, "speed_test": speed, "waves": waves, "suspected": suspected}.items():
        memory[name] = value
    assert bool(source_doubt.rings_quietly(memory)) == rings


@pytest.mark.parametrize(
    "mechanical, doubt, lasts, raised",
    [(2.0, 1.0, 3e-3, True), (2.0, 3.0, 3e-3, False), (2.0, 3.0, 1e-3, True), (0.5, 3.0, 3e-3, True), (10.0, 1.0, 3e-3, False)],
    ids=["both", "a heavy stage rings", "too high a gain", "late", "the encoder alone"],
)
def test_a_law_that_doubts_the_encoder_keeps_its_voltage(axis, mechanical, doubt, lasts, raised):
    controller = make_controller(LAW, axis)
    memory, told = controller.memory["observer"], controller.parameters["observer"]
    memory["position_test"], memory["speed_test"], memory["encoder_factor"] = mechanical, 1.0, doubt * told["encoder_doubt"]
    memory["wave_time"] = lasts  # s, of a half wave; the file's stage rings with 1.6 ms
    memory["wave_first"] = memory["wave_before"] = memory["wave_peak"] = 1e-7
    before = float(memory["voltage_factor"])
    source_doubt.doubt_more(told, controller.parameters["feedforward"], memory)
    assert (memory["voltage_factor"] > before) == raised


@pytest.mark.parametrize("heavy, lasts, said", [(False, 0.7, True), (True, 0.7, False), (True, 2.0, True)])
def test_a_swing_of_a_heavy_stage_may_die_away(axis, heavy, lasts, said):
    controller = make_controller(LAW, axis)
    rule, memory = controller.parameters["supervision"], controller.memory["supervision"]
    memory["swings"], memory["peak"], memory["swinging"] = 20, 2e-6, lasts
    reason = supervision.sign_of_trouble(rule, memory, 1.0, 1.0, 0.0, heavy, 1e-4)
    assert reason == (supervision.SWINGS if said else supervision.NOTHING)
