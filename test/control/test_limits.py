"""The observer law's regulator, told the true motion."""

import numpy as np
import pytest

from microstage_ros.control.controller import make_controller
from microstage_ros.control.limits import GAP_WIDTH, gap_sine, informed_sine
from microstage_ros.control.lost_motion import NOTICED
from microstage_ros.control.trials import cycle_peaks, sine_trial


def test_told_nothing_it_is_the_law(axis):
    found = informed_sine(axis, 5, "nothing", 1e-3)
    assert found == sine_trial(axis, "self_tuning_observer", {}, 1e-5, 0.1, 5, period_s=1e-3).peak


@pytest.mark.parametrize("period", [1e-3, 5e-4])
def test_what_is_not_known_costs_most(axis, period):
    nothing, both = (informed_sine(axis, 5, told, period) for told in ("nothing", "both"))
    assert both < 0.5 * nothing


@pytest.mark.parametrize("seed", [51, 52, 54])
def test_an_unknown_gap_costs_what_the_closed_form_says_and_a_learned_one_less(axis, seed):
    """sqrt(l^2 + k v b) of a search whose speed grows with the lag, from the lag l at which a gap is noticed."""
    effects = {"backlash": {"width_rad": 0.00873}}
    trial = sine_trial(axis, "self_tuning_observer", {}, 1e-5, 0.1, seed, 3.25, effects=effects)
    reference, error = (trial.columns[name] for name in ("reference_m", "stage_m"))
    error = error - reference
    first = slice(len(error) // 13, 5 * len(error) // 13)
    at = first.start + np.abs(error[first]).argmax()
    speed = abs(reference[at] - reference[at - 1]) / 1e-4
    throw = 2.0 / float(make_controller("self_tuning_observer", axis).parameters["observer"]["search_rate"])
    gap = 2e-3 / (2 * np.pi) * 0.00873
    assert np.abs(error[first]).max() < np.sqrt(NOTICED**2 + throw * speed * gap)
    assert cycle_peaks(trial, 0.1)[-1] < 1e-7


@pytest.mark.parametrize("seed", [51, 55])
def test_told_the_gap_a_first_crossing_is_no_worse_than_a_learned_one(axis, seed):
    first = {told: gap_sine(axis, seed, told, GAP_WIDTH, cycles=1.25)[0] for told in ("nothing", "gap")}
    assert first["gap"] < 1e-7 and first["nothing"] > 2.0 * first["gap"]
