"""The PID law against an independent discrete filter, and what it does at its limits."""

import numpy as np
import pytest
from scipy.signal import lfilter

from microstage_ros.control.laws.controller import gain_list, make_controller
from microstage_ros.quantities.errors import InputError

T = 1e-4
GAINS = dict(proportional=2e5, integral_time=0.02, derivative_time=0.006, filter_time=8e-4)


def outputs(controller, reference, encoder):
    return np.array([controller.step(r, y) for r, y in zip(reference, encoder)])


@pytest.mark.parametrize("share", [0.0, 1.0])
@pytest.mark.parametrize("filter_time", [0.0, 8e-4])
def test_is_the_transfer_function_of_equations_11_and_12(axis, share, filter_time):
    random = np.random.default_rng(1)
    reference, encoder = np.cumsum(random.normal(0, 1e-9, (2, 400)), axis=1)
    gains = {**GAINS, "filter_time": filter_time}
    got = outputs(make_controller("pid", axis, derivative_on_reference=share, **gains), reference, encoder)
    kp = gains["proportional"]
    ki, kd = kp * T / gains["integral_time"], kp * gains["derivative_time"] / T
    error = reference - encoder
    pole = filter_time / (T + filter_time)
    rest = encoder[0]  # a controller starts at rest where the axis is
    derivative = lfilter([1 - pole, pole - 1], [1, -pole], encoder - rest)
    change = np.diff(reference, prepend=reference[0])
    wanted = kp * error + ki * np.cumsum(error) - kd * (derivative - share * change)
    np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-12)


def test_derivative_damps(axis):
    controller = make_controller("pid", axis, integral_time=1e6, derivative_on_reference=0.0)
    controller.step(0.0, 0.0)
    controller.step(0.0, 1e-9)
    assert controller.state.derivative_term < 0.0  # moving forward is braked


def test_output_is_limited_and_the_integral_does_not_wind_up(axis):
    controller = make_controller("pid", axis, **GAINS)
    out = outputs(controller, np.full(20000, 1e-3), np.zeros(20000))
    assert np.all(np.abs(out) <= 6.0) and controller.state.saturated
    before = controller.state.integral_term
    assert abs(before) <= 6.0
    # once the error is gone the output comes off the limit at once, instead of unwinding two seconds of error
    controller.step(0.0, 0.0)
    assert outputs(controller, np.zeros(5), np.full(5, 1e-6))[-1] < 6.0


def test_starts_without_a_jump(axis):
    controller = make_controller("pid", axis)
    controller.reset(voltage=0.08)
    assert controller.step(1e-6, 1e-6) == pytest.approx(0.08, abs=1e-12)


def test_other_gains_do_not_make_the_output_jump(axis):
    still, changed = make_controller("pid", axis, **GAINS), make_controller("pid", axis, **GAINS)
    path = np.concatenate([1e-7 * np.sin(np.arange(300) / 30), np.full(200, 5e-8)])
    outputs(still, np.zeros(500), path), outputs(changed, np.zeros(500), path)
    changed.change(proportional=4e5, derivative_time=0.001)
    jump = changed.step(0.0, path[-1]) - still.step(0.0, path[-1])
    assert abs(jump) <= 1.001 * (4e5 - 2e5) / 0.02 * abs(path[-1]) * T  # one integral step at the new gain
    assert abs(changed.state.proportional_term - still.state.proportional_term) > 100 * abs(jump)


def test_a_lost_sample_repeats_the_voltage(axis):
    controller = make_controller("pid", axis)
    before = controller.step(1e-6, 0.0)
    assert controller.step(1e-6, float("nan")) == before
    assert np.isfinite(controller.step(1e-6, 0.0))


@pytest.mark.parametrize("kind", ["pid", "self_tuning", "self_tuning_observer", "nctf", "cascade"])
def test_bad_gains_are_refused_with_value_and_bound(axis, kind):
    gain = gain_list(kind)[0]
    for bad in (-1.0, float("nan"), float("inf"), "much", None, True):
        with pytest.raises(InputError) as caught:
            make_controller(kind, axis, **{gain.name: bad})
        assert gain.name in caught.value.place and f"{gain.maximum:g}" in caught.value.expected
    with pytest.raises(InputError, match="one of"):
        make_controller(kind, axis, no_such_gain=1.0)


def test_unknown_type_is_refused_with_the_known_ones(axis):
    with pytest.raises(InputError, match="self_tuning_observer"):
        make_controller("fuzzy", axis)


def test_cascade_is_the_published_law(emps):
    controller = make_controller("cascade", emps)
    random = np.random.default_rng(2)
    reference, encoder = np.cumsum(random.normal(0, 1e-6, (2, 50)), axis=1)
    got = outputs(controller, reference, encoder)
    mean = 0.5 * (encoder + np.concatenate([encoder[:1], encoder[:-1]]))
    velocity = np.diff(mean, prepend=mean[0]) / 1e-3
    wanted = 160.18 * 243.45 * (reference - encoder) - 243.45 * velocity
    np.testing.assert_allclose(got, np.clip(wanted, -10, 10), rtol=1e-12, atol=1e-12)
