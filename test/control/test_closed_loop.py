"""The compiled loop, the Python face and the figures they reach."""

import numpy as np
import pytest

from microstage_ros.control.runs.trials import gain_jump_trial, sine_trial, step_trial
from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.laws.registry import LAWS
from microstage_ros.control.runs.closed_loop import TRACE, run_loop
from microstage_ros.control.trajectories.profiles import jerk_limited_move, sine
from microstage_ros.control.tuning.tuning import allowed_overshoot
from microstage_ros.model.sensors.readings import read_sensors
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work
from microstage_ros.solver.step import advance
from test.rates import at_least

MOVE = [{"move_to_m": 1e-6, "dwell_s": 0.02}]


@pytest.mark.parametrize("kind", sorted(LAWS))
def test_stepping_in_python_is_the_compiled_loop(axis, run, kind):
    columns = run(kind, MOVE, seed=3)
    plant, readings = make_plant(axis, NoiseSpec()), new_readings()
    state, work, controller = new_state(plant, seed=3), new_work(plant), make_controller(kind, axis)
    for n in range(len(columns["t_s"])):
        read_sensors(plant, state, readings)
        voltage = controller.step(columns["reference_m"][n], readings["encoder"], readings["current"])
        assert voltage == columns["voltage_V"][n] and readings["encoder"] == columns["encoder_m"][n]
        advance(plant, state, work, voltage)


def test_a_seed_is_a_run_to_the_last_bit(run):
    first, again, other = (run("self_tuning_observer", MOVE, seed)["voltage_V"] for seed in (4, 4, 5))
    np.testing.assert_array_equal(first, again)
    assert np.any(first != other)


def test_disturbance_is_added_after_the_controller(axis, run):
    n = 2000
    push = np.where(np.arange(n) > 1000, 0.05, 0.0)
    columns = run("none", [{"move_to_m": 0.0}])
    from microstage_ros.control.runs.run_file import Run
    from microstage_ros.control.runs.simulate import simulate

    silent = dict(encoder_m=0.0, voltage_V=0.0, current_A=0.0, interferometer_m=0.0, friction_relative=0.0)
    pushed = simulate(axis, Run(controller={"type": "none"}, noise=silent, program=[{"reference": np.zeros(n), "disturbance": push}]))
    np.testing.assert_array_equal(pushed["voltage_V"], push)
    np.testing.assert_array_equal(pushed["disturbance_V"], push)
    assert "disturbance_V" not in columns
    held = simulate(axis, Run(controller={"type": "pid"}, noise=silent, program=[{"reference": np.zeros(n), "disturbance": push}]))
    assert abs(held["voltage_V"][-1]) < 0.03  # the controller works against it; voltage_V is the sum


@pytest.mark.parametrize("kind, sine_nm, settle_s", [
    ("pid", 60, 0.12), ("pid_feedforward", 60, 0.12), ("self_tuning", 60, 0.12), ("self_tuning_feedforward", 60, 0.12),
    ("nctf", 90, 0.15), ("self_tuning_observer", 25, 0.06),
])
def test_every_law_tracks_and_settles(run, kind, sine_nm, settle_s):
    program = [{"move_to_m": 1e-5, "dwell_s": 0.3}, {"sine": {"amplitude_m": 1e-5, "frequency_hz": 0.1, "cycles": 1.0}}]
    columns = run(kind, program, seed=11)
    error = columns["stage_m"] - columns["reference_m"]
    moved = 3200
    outside = np.flatnonzero(np.abs(columns["stage_m"][:moved] - 1e-5) > 25e-9)
    assert outside[-1] * 1e-4 < settle_s
    assert np.abs(error[moved + 10000 :]).max() * 1e9 < sine_nm


@pytest.mark.parametrize("distance", [1e-6, 1e-5])
@pytest.mark.parametrize("kind", ["pid", "pid_feedforward", "self_tuning", "self_tuning_feedforward", "nctf", "self_tuning_observer"])
def test_overshoot_is_within_five_percent_or_two_counts(axis, kind, distance):
    # relaxed contacts: the first move out of loaded ones is another experiment
    # seed 0 is one whose overshoot grew from move to move with more of the friction fed forward
    trial = step_trial(axis, kind, {}, distance, seed=0, moves=5, friction="relaxed")
    assert trial.overshoot.max() < allowed_overshoot(distance)
    assert trial.rest.max() < 50e-9 and np.all(trial.settling < 0.15)


@pytest.mark.parametrize("volts", [0.01, -0.01, 0.03])
def test_a_step_of_the_amplifiers_zero_at_rest_does_not_set_the_loop_swinging(axis, volts):
    """Too small a step to be noticed at once was once taken for R, or for a gap, and the loop swung by micrometres."""
    reference = np.concatenate([jerk_limited_move(0.0, 1e-5, 1e-4), np.full(10000, 1e-5)])
    step = len(reference) - 4000
    disturbance, trace = np.zeros_like(reference), np.empty((len(reference), len(TRACE)))
    disturbance[step:] = volts
    plant, readings = make_plant(axis, NoiseSpec()), new_readings()
    state, work, controller = new_state(plant, seed=75), new_work(plant), make_controller("self_tuning_observer", axis)
    run_loop(plant, state, work, readings, controller.parameters, controller.memory, reference, np.zeros_like(reference), disturbance, trace)
    error = np.abs(trace[step:, TRACE.index("stage_m")] - reference[step:])
    assert error.max() < 1e-7 and error[1000:].max() < 1.5e-8
    assert controller.memory["observer"]["contact"] == 0


def test_a_dead_band_of_the_amplifier_is_learned_as_a_zero_that_changes(axis):
    """Its zero moves by 20 mV as the voltage changes its sign, too slowly to be noticed at once (not learned: a micrometre)."""
    assert sine_trial(axis, "self_tuning_observer", {}, 1e-5, 0.1, 300, effects={"amplifier_deadband": {"half_width_V": 0.01}}).peak < 1.5e-7


def test_a_calm_loop_at_rest_is_not_taken_for_another_delay(axis):
    """Steps of voltage as small as the amplifier's noise once found delays that were none, and R went astray with them."""
    trial = step_trial(axis, "self_tuning_observer", {"calm_gain": 0.5, "calm_time": 0.03}, 1e-5, 304, 8)
    assert np.abs(trial.errors).max() < 1e-8 and trial.rest.max() < 2e-8


@pytest.mark.parametrize("factor, peak_nm", [(0.4, 35), (0.5, 30), (0.7, 35), (1.4, 35), (2.0, 40), (2.5, 45)])
def test_observer_law_learns_an_amplifier_whose_gain_jumps(ideal, factor, peak_nm):
    """Cut at the amplifier with nothing learned the loop has a margin of about 1 dB; the jump is noticed within a period."""
    peaks, afterwards = zip(*(gain_jump_trial(ideal, "self_tuning_observer", factor, seed=seed) for seed in (0, 1)))
    assert max(peaks) < 1e-9 * peak_nm and max(afterwards) < 25e-9


@pytest.mark.parametrize("effects, period_s", [
    ({"friction_level_change": {"factor": 2.0}}, None),
    ({"friction_level_change": {"factor": 0.5}}, None),
    ({"payload_change": {"mass_kg": 6.12}}, None),
    ({"drive_compliance": {"stiffness_factor": 0.33}}, None),
    ({"resistance_rise": {"initial": 0.2, "rise_per_joule": 0.0, "time_s": 1e5}}, None),
    ({"transport_delay": {"delay_s": 2e-4}}, None),
    ({}, 1e-3),
])
def test_observer_law_holds_under_stress(run, effects, period_s):
    program = [{"move_to_m": place, "dwell_s": 0.5} for place in (1e-5, 0.0, 1e-5)]
    columns = run("self_tuning_observer", program, seed=2, effects=effects, period_s=period_s)
    rest = round(0.1 / (columns["t_s"][1] - columns["t_s"][0]))
    assert np.abs(columns["stage_m"][-rest:] - 1e-5).max() < 50e-9


BACKLASH = {"backlash": {"width_rad": 0.00873}}  # 0.5 degrees, 2.8 um at the stage


def test_observer_law_learns_lost_motion_and_crosses_it_softly(axis):
    """Its width always (2.71 to 2.84 um in 100 of 100 records), and a crossing is soft.

    The second and third one stay within 250 nm in 255 of 260 records (95 %: 95.6 to 99.4 %; 230 while no gap was looked for beside a
    doubted encoder); at 98 % fewer than 17 of 20 come once in 1700 times. A law that knows no gap: 0.6 to 1.2 um, in 10 of 10.
    """
    def peak(seed):
        columns = sine_trial(axis, "self_tuning_observer", {}, 1e-5, 0.1, seed=seed, cycles=1.4, effects=BACKLASH).columns
        return np.abs(columns["stage_m"] - columns["reference_m"])[60000:].max()

    assert at_least(17, (peak(seed) < 250e-9 for seed in range(20)))
    reference = sine(0.0, 1e-5, 0.1, 2.25, 1e-4)
    none = np.zeros_like(reference)
    for gap, least, most in ((BACKLASH, 2.3e-6, 3.0e-6), ({}, 0.0, 0.0)):
        controller, plant = make_controller("self_tuning_observer", axis), make_plant(axis, NoiseSpec(), effects=gap)
        run_loop(plant, new_state(plant, seed=1), new_work(plant), new_readings(), controller.parameters, controller.memory,
                 reference, none, none, np.empty((0, 0)))
        assert least <= controller.memory["observer"]["gap"] <= most


def test_moves_through_lost_motion_end_at_their_target(ideal):
    """A rate over records, for single ones are chaotic: in 0 of 1000 (95 %: 0 ... 0.4 %) a move from the fourth on ended beyond 100 nm, the farthest 88.

    At 0.4 %, more than 4 of 100 records come once in 10^4 times. One that still rattles is up to a gap to either side.
    """
    errors = np.array([step_trial(ideal, "self_tuning_observer", {}, 1e-5, seed, moves=6, effects=BACKLASH, friction="relaxed").errors[3:] for seed in range(100)])
    assert np.median(np.abs(errors)) < 10e-9 and np.abs(errors).max() < 2 * 2.8e-6
    assert np.count_nonzero(np.abs(errors).max(axis=1) > 100e-9) <= 4


def test_tenth_of_the_gains_is_made_up_within_three_moves(run):
    program = [{"move_to_m": place, "dwell_s": 0.3} for place in (1e-5, 0.0, 1e-5, 0.0)]
    columns = run("self_tuning_observer", program, seed=2, start=0.1)
    last = columns["stage_m"][-3279:]
    assert np.abs(last[1200:]).max() < 25e-9


def test_force_driven_axis_is_held_by_its_cascade(emps, run):
    program = [{"move_to_m": 0.02, "dwell_s": 0.3}]
    columns = run("cascade", program, machine=emps)
    assert "force_N" in columns and "current_A" not in columns
    # without an integral the friction leaves an error of at most (F_C + |offset|) / (gain K_pos K_vel)
    assert abs(columns["stage_m"][-1] - 0.02) < 1.3 * (20.4 + 3.2) / (35.15 * 160.18 * 243.45)
