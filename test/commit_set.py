"""Tests that a commit does not wait for: each costs 1 to 60 s of a processor, and others beside it examine the same code.

`./microstage test` leaves them out where it is given neither a test nor a choice; `./microstage test --all`, another set of seeds,
and every file that is named run them too. A pytest plugin: `-p test.commit_set`.
"""

import pytest

LEFT_OUT = {
    "commands/test_diagnose.py": (
        "test_what_is_outside_the_catalogue_moves_the_plant_or_a_reading[supply that breathes]",
        "test_what_is_outside_the_catalogue_moves_the_plant_or_a_reading[friction bursts]",
        "test_what_is_outside_the_catalogue_moves_the_plant_or_a_reading[wavy force]",
    ),
    "commands/test_mutation.py": (
        "test_tests_of_something_else_notice_nothing",
        "test_workers_end_when_their_parent_is_stopped_or_killed[2]",
        "test_workers_end_when_their_parent_is_stopped_or_killed[9]",
    ),
    "commissioning/test_frequency_response.py": (
        "test_without_noise_the_measured_loop_is_the_linearised_one[7510-0.0001-gains1-0.006]",
    ),
    "commissioning/test_law_choice.py": ("test_slow_motion_has_a_say",),
    "commissioning/test_programme.py": ("test_friction_that_varies_slowly_is_in_the_intervals",),
    "control/runs/test_coarse_fine.py": ("test_each_component_is_diagnosed",),
    "control/test_robustness.py": (
        "test_a_drive_of_another_resistance_is_no_worse_than_the_law_that_knows_none[4028]",
        "test_a_drive_of_another_resistance_is_no_worse_than_the_law_that_knows_none[4168]",
    ),
    "diagnosis/cases/test_beside_a_larger_one.py": (
        "test_the_time_of_a_slow_amplifier_and_the_motors_speed_are_found_together",
        "test_a_payload_on_a_soft_drive_are_two_causes[sines-9920]",
        "test_a_payload_is_no_soft_drive[effects2-74-names2]",
        "test_an_amplifier_that_would_drive_the_motor_elsewhere_is_not_slow",
        "test_a_ripple_beside_a_growth_that_holds_a_thousand_times_as_much",
        "test_a_payload_is_no_soft_drive[effects1-73-names1]",
    ),
    "diagnosis/cases/test_default_law.py": (
        "test_two_faults_of_the_amplifier_are_told_with_their_sizes[effects0-58010]",
        "test_two_faults_of_the_amplifier_are_told_with_their_sizes[effects1-59010]",
        "test_two_faults_of_the_amplifier_are_told_with_their_sizes[effects3-71060]",
        "test_two_faults_of_the_amplifier_are_told_with_their_sizes[effects4-62010]",
        "test_a_lag_is_told_though_the_law_feeds_back_the_current[0.00036-420]",
        "test_a_slow_amplifier_between_long_rests_is_no_gap[actuator_lag-time_s-0.00058]",
        "test_two_faults_of_the_amplifier_are_told_with_their_sizes[effects5-63010]",
        "test_a_delay_is_no_further_off_than_it_says",
        "test_two_faults_of_the_amplifier_are_told_with_their_sizes[effects2-61030]",
        "test_a_slow_amplifier_between_long_rests_is_no_gap[transport_delay-delay_s-0.00042]",
    ),
    "diagnosis/cases/test_diagnose_case.py": (
        "test_slow_amplifier_and_offset",
        "test_creep_beside_a_vibration_of_the_floor[6e-08-least1]",
        "test_two_causes_of_other_shape_than_the_candidates",
        "test_a_sensor_that_not_all_records_have_is_not_used[baseline]",
        "test_creep_beside_a_vibration_of_the_floor[1.2e-07-least0]",
        "test_what_the_file_states_and_the_records_do_not_have_is_no_cause",
        "test_a_sensor_that_not_all_records_have_is_not_used[records]",
    ),
    "diagnosis/cases/test_every_verdict.py": (
        "test_a_nameless_force_beside_an_encoder_error_is_only_partly_explained",
        "test_command_line_with_a_baseline_that_already_shows_the_effect",
        "test_effects_of_fresh_seeds_are_named",
    ),
    "diagnosis/cases/test_force_axis.py": (
        "test_names_of_fresh_seeds",
        "test_emps_lacks_what_pays_on_time_it_was_not_fitted_on",
        "test_an_asymmetry_is_no_constant_force_and_ripple",
        "test_another_motion_held_out_is_no_noise[False]",
        "test_a_film_of_another_form_is_named_nonlinear",
    ),
    "diagnosis/cases/test_jitter.py": (
        "test_jitter_and_lost_samples_have_their_own_sizes[4-0.0-0.04]",
        "test_jitter_and_lost_samples_have_their_own_sizes[5-2e-05-0.05]",
    ),
    "diagnosis/cases/test_lost_motion.py": (
        "test_a_soft_drive_that_hangs_back_is_no_gap_however_fine_the_encoder",
        "test_a_gap_is_found_whether_the_loop_rattles_or_not[0.004-11]",
        "test_an_error_of_the_lead_neither_hides_a_gap_nor_passes_for_one",
    ),
    "diagnosis/cases/test_moves_with_rests.py": (
        "test_what_was_told_with_a_wrong_name_beside_it_is_named_alone[self_tuning-plain-effects0-21530]",
        "test_what_was_told_with_a_wrong_name_beside_it_is_named_alone[self_tuning_observer-half a stroke-effects2-22590]",
        "test_what_was_told_with_a_wrong_name_beside_it_is_named_alone[self_tuning_observer-half a stroke-effects3-22680]",
        "test_what_was_told_with_a_wrong_name_beside_it_is_named_alone[self_tuning-moves-effects1-21510]",
        "test_a_payload_winds_up_the_drive_train_by_its_inertia_too[9860]",
        "test_what_an_amplifier_makes_of_moves_with_rests_is_no_gap[effects1-9710-transport_delay]",
        "test_a_payload_winds_up_the_drive_train_by_its_inertia_too[9900]",
    ),
    "diagnosis/cases/test_position_drives.py": (
        "test_a_hidden_effect_is_named_and_sized[stepper-lvdt_nonlinearity]",
        "test_a_hidden_effect_is_named_and_sized[stepper-sensor_drift]",
        "test_a_hidden_effect_is_named_and_sized[piezo-sensor_drift]",
        "test_a_hidden_effect_is_named_and_sized[stepper-lost_steps]",
        "test_a_hidden_effect_is_named_and_sized[voice_coil-force_constant_droop]",
        "test_a_hidden_effect_is_named_and_sized[piezo-piezo_creep]",
        "test_a_hidden_effect_is_named_and_sized[piezo-piezo_hysteresis]",
    ),
    "diagnosis/cases/test_practice.py": (
        "test_right_names[two]",
        "test_an_explained_cable_holds_what_stood_out_though_the_baseline_is_quieter",
    ),
    "diagnosis/cases/test_unlisted_forms.py": (
        "test_a_ripple_a_signal_period_and_a_drift_that_are_on_no_list",
        "test_a_soft_drive_with_more_damping",
        "test_a_drive_that_swings_is_no_slow_amplifier",
        "test_a_delay_just_short_of_whole_periods_keeps_its_size[0.0003989]",
    ),
    "diagnosis/logs/test_file_kinds.py": (
        "test_a_proposal_is_accepted[camonitor]",
        "test_a_proposal_is_accepted[TwinCAT Scope]",
        "test_a_proposal_is_accepted[EPOS Studio]",
        "test_a_proposal_is_accepted[MATLAB]",
    ),
    "diagnosis/logs/test_many.py": ("test_a_killed_worker_loses_nothing",),
    "diagnosis/preprocessing/test_motion_on_a_soft_drive.py": (
        "test_no_friction_is_named_beside_a_drive_on_which_the_loop_swings",
    ),
    "diagnosis/prerequisites/test_characteristic.py": (
        "test_gap_and_soft_drive_are_both_named_and_no_friction_beside_them[gap and soft drive]",
        "test_no_straight_line_is_seen_where_there_is_a_gap_or_no_swing[a loop that rests]",
        "test_a_rattle_tells_gap_stiffness_and_damping_at_once[gap and soft drive-0.0362-0.89-0.025]",
        "test_a_rattle_tells_gap_stiffness_and_damping_at_once[gap and payload-0.598-0.598-0.002]",
        "test_a_drive_that_swings_without_a_gap_has_none[payload]",
        "test_no_straight_line_is_seen_where_there_is_a_gap_or_no_swing[gap and soft drive]",
    ),
    "diagnosis/prerequisites/test_law.py": (
        "test_a_law_that_is_not_asked_for_is_nearer_to_one_that_is[1]",
        "test_a_machine_of_another_law_is_judged_by_that_law[leuven-2]",
    ),
    "diagnosis/residuals/test_at_rest.py": (
        "test_a_healthy_axis_that_hardly_moves_agrees_without_a_baseline[pid-rest]",
        "test_a_healthy_axis_that_hardly_moves_agrees_without_a_baseline[pid-small sine]",
        "test_a_healthy_axis_that_hardly_moves_agrees_without_a_baseline[pid-micrometres]",
        "test_a_healthy_axis_that_hardly_moves_agrees_without_a_baseline[pid-tenths]",
    ),
    "diagnosis/resimulation/test_noise.py": (
        "test_a_drift_far_below_the_noise_is_sought_where_noise_alone_is_left",
        "test_what_a_second_cause_leaves_unlike_is_no_rival_any_more",
    ),
    "identification/test_identify_command.py": ("test_a_stage_that_rattles_in_a_gap_is_told_beside_the_errors",),
    "identification/test_motor.py": ("test_attraction_and_its_interval_over_six_axes[1.0]",),
    "monitoring/test_watch_command.py": (
        "test_a_history_that_was_begun_with_other_sensors_says_so",
        "test_records_of_unlike_sensors_are_judged_by_what_all_have",
    ),
    "ros/test_drives_in_a_cell.py": (
        "test_a_move_in_the_unit_of_the_drive[stepper]",
        "test_a_move_in_the_unit_of_the_drive[current_motor]",
    ),
    "ros/test_outside_backend.py": ("test_the_cell_drives_it[False]",),
    "solver/test_step.py": (
        "test_open_loop_within_a_nanometre_of_the_converged_solution[hold below breakaway]",
        "test_open_loop_within_a_nanometre_of_the_converged_solution[ramp to 3 V]",
        "test_open_loop_within_a_nanometre_of_the_converged_solution[reversals 3 V]",
        "test_open_loop_within_a_nanometre_of_the_converged_solution[multi-sine]",
    ),
}


def pytest_collection_modifyitems(config, items):
    """Leave out what is listed. Raises UsageError: a listed test is not there, renamed perhaps."""
    named = {f"test/{file}::{name}" for file, names in LEFT_OUT.items() for name in names}
    left = [item for item in items if item.nodeid in named]
    if len(left) < len(named):
        raise pytest.UsageError(f"test/commit_set.py: no such test: {sorted(named - {item.nodeid for item in left})}")
    config.hook.pytest_deselected(items=left)
    items[:] = [item for item in items if item.nodeid not in named]
