"""The observer law's regulator, told the true motion."""

import pytest

from microstage_ros.control.limits import informed_sine
from microstage_ros.control.trials import cycle_peaks, sine_trial


def test_told_nothing_it_is_the_law(axis):
    found = informed_sine(axis, 5, "nothing", 1e-3)
    assert found == sine_trial(axis, "self_tuning_observer", {}, 1e-5, 0.1, 5, period_s=1e-3).peak


@pytest.mark.parametrize("period", [1e-3, 5e-4])
def test_what_is_not_known_costs_most(axis, period):
    nothing, both = (informed_sine(axis, 5, told, period) for told in ("nothing", "both"))
    assert both < 0.5 * nothing


@pytest.mark.parametrize("seed", [52, 54])
def test_a_learned_gap_is_crossed_without_throwing_the_stage(axis, seed):
    effects = {"backlash": {"width_rad": 0.00873}}
    trial = sine_trial(axis, "self_tuning_observer", {}, 1e-5, 0.1, seed, 3.25, effects=effects)
    assert cycle_peaks(trial, 0.1)[-1] < 1e-7
