"""The observer law's regulator, told the true motion."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from microstage_ros.control.evaluation.least_error import least_error, sliding_loop
from microstage_ros.control.evaluation.limits import GAP_WIDTH, gap_sine, informed_sine
from microstage_ros.control.runs.trials import cycle_peaks, sine_trial
from microstage_ros.control.laws.controller import controller_parameters, make_controller
from microstage_ros.control.observer.flexible_mode import EFFORT, held_axis, held_gains
from microstage_ros.control.observer.lost_motion import NOTICED
from microstage_ros.control.observer.motion_filter import riccati
from test.rates import at_least


def test_told_nothing_it_is_the_law(axis):
    found = informed_sine(axis, 5, "nothing", 1e-3)
    assert found == sine_trial(axis, "self_tuning_observer", {}, 1e-5, 0.1, 5, period_s=1e-3).peak


@pytest.mark.parametrize("period", [1e-3, 5e-4])
def test_what_is_not_known_costs_most(axis, period):
    nothing, both = (informed_sine(axis, 5, told, period) for told in ("nothing", "both"))
    assert both < 0.5 * nothing


@pytest.mark.parametrize("seed", [51, 52, 54])
def test_an_unknown_gap_costs_what_the_closed_form_says_and_a_learned_one_less(ideal, seed):
    """sqrt(l^2 + k v b) of a search whose speed grows with the lag, from the lag l at which a gap is noticed."""
    effects = {"backlash": {"width_rad": 0.00873}}
    trial = sine_trial(ideal, "self_tuning_observer", {}, 1e-5, 0.1, seed, 3.25, effects=effects, friction="relaxed")
    reference, error = (trial.columns[name] for name in ("reference_m", "stage_m"))
    error = error - reference
    first = slice(len(error) // 13, 5 * len(error) // 13)
    at = first.start + np.abs(error[first]).argmax()
    speed = abs(reference[at] - reference[at - 1]) / 1e-4
    throw = 2.0 / float(make_controller("self_tuning_observer", ideal).parameters["observer"]["search_rate"])
    gap = 2e-3 / (2 * np.pi) * 0.00873
    assert np.abs(error[first]).max() < np.sqrt(NOTICED**2 + throw * speed * gap)
    assert cycle_peaks(trial, 0.1)[-1] < 1e-7


def test_told_the_gap_a_first_crossing_may_be_as_soft_as_a_learned_one(axis):
    """Within 100 nm in 50 of 60 records (95 %: 71 to 92 %; fewer than 6 of 12 come once in 800 times at 83 %), 148 nm at most, and in 59 while a
    swing behind a known gap raised no doubt; not told, 240 nm or more in 60 of 60."""
    assert at_least(6, (gap_sine(axis, seed, "gap", GAP_WIDTH, cycles=1.25)[0] < 1e-7 for seed in range(51, 63)))
    assert gap_sine(axis, 51, "nothing", GAP_WIDTH, cycles=1.25)[0] > 2e-7


@pytest.mark.parametrize("period", [1e-4, 2e-4, 5e-4, 1e-3])
def test_the_loop_of_least_error_is_stable(axis, period):
    closed, _, _ = sliding_loop(axis, period)
    assert np.abs(np.linalg.eigvals(closed)).max() < 1.0


def test_riccati_ends_whatever_the_last_bits_are(axis):
    """Sliding, (w, w', x, v) of the filter has a mode of 10^7 periods, in which rounding adds up: the doubling ends."""
    a, _, _ = held_axis(controller_parameters("self_tuning_observer", axis, {})["feedforward"], 1e-3)
    scale = np.diag([1e-8, 1e-5, 1e-8, 1e-6])
    a = (np.linalg.inv(scale) @ a @ scale).T
    seen = np.array([[1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]) @ scale / np.array([[1.2e-8], [1.5e-4]])
    random = np.random.default_rng(0)
    for _ in range(20):
        near = a * (1.0 + 1e-16 * random.standard_normal(a.shape))
        assert np.isfinite(riccati(near, 1e-14 * np.eye(4), seen.T @ seen)).all()


@pytest.mark.parametrize("period", [1e-4, 1e-3])
def test_regulator_of_the_swing_is_that_of_an_independent_solver(axis, period):
    """`held_gains` against SciPy's solver of the discrete Riccati equation."""
    model = controller_parameters("self_tuning_observer", axis.with_values({"period": period}), {})["feedforward"]
    a, b, push = held_axis(model, period)
    weight, effort = np.outer([1.0, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 0.0]), (EFFORT**2 * push) ** 2
    cost = solve_discrete_are(a, b, weight, np.array([[effort]]))
    np.testing.assert_allclose(held_gains(model, period), (b.T @ cost @ a / (effort + b.T @ cost @ b))[0], rtol=1e-3)


def test_least_error_grows_with_period_and_noise_and_no_other_feedback_is_better(axis):
    errors = [least_error(axis, period, seeds=4, duration=3.0)[0] for period in (2e-4, 5e-4, 1e-3)]
    assert errors[0] < errors[1] < errors[2]
    closed, push, noise = sliding_loop(axis, 1e-3)
    least = mean_square(closed, push, noise)
    assert errors[2] ** 2 == pytest.approx(least, rel=0.3)
    for k in range(4, 8):
        for factor in (0.98, 1.02):
            other = closed.copy()
            other[:, k] += (factor - 1.0) * np.concatenate([closed[:4, k], closed[:4, k]])
            with np.errstate(all="ignore"):  # some of them are not stable
                assert not mean_square(other, push, noise) < 0.999 * least


def mean_square(closed, push, noise, rows=3000):
    """Mean square of x + w over a run of ``rows`` periods from rest, by its covariance."""
    spread, found = np.zeros((8, 8)), 0.0
    for _ in range(rows):
        spread = closed @ spread @ closed.T + push @ np.diag(noise**2) @ push.T
        found += (spread[0, 0] + 2.0 * spread[0, 2] + spread[2, 2]) / rows
    return found
