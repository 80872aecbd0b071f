"""Margins: the linearised axis and loops against closed forms and against the compiled loop."""

import math

import control
import numpy as np
import pytest

from microstage_ros.control.design.linear_loop import QUADRATIC_STATES, quadratic_step
from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.runs.closed_loop import TRACE, run_loop
from microstage_ros.control.tuning.margins import (
    controller_margins,
    loop_margins,
    observer_loop,
    pid_margins,
    pid_transfer,
    quadratic_margins,
    regimes,
)
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work

T = 1e-4


def test_axis_without_friction_has_its_closed_forms(axis):
    plant = dict((name, plant) for name, plant, _ in regimes(axis))["pre-sliding"][0, 0]
    # held by all blocks, a volt moves the stage by (k_M/R) / (k_a r / N^2 ...): statics of springs in series and parallel
    r, gear = 2e-3 / 2 / math.pi, 19
    torque = 6.59e-3 / 3.41
    actuator = 1.247514 / 19  # sum k / N per motor radian
    guide, drive = 454610.0, 1.2e7
    series = guide * drive / (guide + drive) * (r / gear) ** 2
    expected = torque / (actuator + series) * (r / gear) * drive / (guide + drive)
    assert float(np.real(plant(0))) == pytest.approx(expected, rel=1e-3)


def test_resonance_is_where_it_belongs(axis):
    plant = regimes(axis)[2][1]
    poles = plant.poles()
    resonance = poles[np.argmin(np.abs(np.abs(poles) - 1980.0))]
    assert abs(resonance) == pytest.approx(math.sqrt(1.2e7 / 3.06 + 1.2e7 / 356), rel=0.01)


@pytest.mark.filterwarnings("ignore:stability_margins")
def test_margins_agree_with_python_control_on_a_plain_loop():
    plant = control.tf([1.0], [1.0, 3.0, 3.0, 1.0]) * 4.0
    loop = control.sample_system(control.ss(plant), 1e-3, "zoh")
    ours = loop_margins(loop, 1e-3)
    gain, phase, _, crossover = control.margin(loop)
    assert ours.stable
    assert ours.gain_db == pytest.approx(20 * math.log10(gain), abs=0.05)
    assert ours.phase_deg == pytest.approx(phase, abs=0.2)
    assert ours.crossover_hz == pytest.approx(crossover / 2 / math.pi, rel=0.01)
    assert not loop_margins(loop * gain * 1.05, 1e-3).stable


def test_transfer_function_is_that_of_the_law(axis):
    gains = dict(proportional=2e5, integral_time=0.02, derivative_time=0.006, filter_time=8e-4)
    controller = make_controller("pid", axis, **gains)
    controller.step(0.0, 0.0)
    got = [controller.step(0.0, -1e-9 if n == 0 else 0.0) for n in range(200)]
    _, wanted = control.impulse_response(pid_transfer(gains, T), np.arange(200) * T)
    np.testing.assert_allclose(got, np.squeeze(wanted) * T * 1e-9, rtol=1e-6, atol=1e-15)


def test_observer_loop_is_the_compiled_one(ideal):
    """A small push in pre-sliding: the law's answer is that of the linear loop from which the margins come."""
    plant, axis = make_plant(ideal, NoiseSpec.none()), ideal
    plant["quantum"] = plant["encoder_count"] = 0.0
    frozen = dict(resistance_spread=0.0, zero_spread=0.0, emf_spread=0.0, level_variability=0.0, speed=0.0, friction_share=0.0)
    controller = make_controller("self_tuning_observer", axis, **frozen)
    settling, n = 1000, 300  # periods in which the filter's gain settles
    push, trace = np.full(settling + n, 1e-3), np.empty((settling + n, len(TRACE)))
    push[:settling] = 0.0
    run_loop(plant, new_state(plant, seed=0), new_work(plant), new_readings(), controller.parameters, controller.memory,
             np.zeros(len(push)), np.zeros(len(push)), push, trace)
    answer, push = (trace[:, TRACE.index("voltage_V")] - push)[settling:], push[settling:]
    name, linear, slopes = regimes(axis)[0]
    loop = observer_loop(axis, linear, *slopes, controller.parameters)
    _, wanted = control.forced_response(control.feedback(-loop, 1, sign=1), np.arange(n) * T, push)
    assert np.sqrt(np.mean((answer - wanted) ** 2)) < 0.03 * np.sqrt(np.mean(wanted**2))


def test_the_quadratic_law_is_its_linear_form_and_gains_searched_without_margins_have_none(axis):
    """Gains of docs/evidence/control.md: best of 2000 runs on the nominal machine, with the sensors of the observer law.

    Without its axis the law grows 25-fold in a period: few periods are compared.
    """
    searched = {"regulator_rate": 1.11e3, "encoder_noise": 3.89e-9, "voltage_noise": 4.89e-3, "acceleration_noise": 8.61e-4, "friction_drift": 5.11}
    controller = make_controller("linear_quadratic", axis, **searched)
    step, state, voltage = quadratic_step(controller.parameters), np.zeros(QUADRATIC_STATES), 0.0
    for encoder, current in np.random.default_rng(2).normal(size=(6, 2)) * (1e-14, 1e-9) * [[0.0, 0.0], *[[1.0, 1.0]] * 5]:
        *state, wanted = step(np.array([*state, encoder, current, voltage]))
        voltage = controller.step(reference=0.0, encoder=encoder, current=current)
        assert voltage == pytest.approx(wanted, rel=1e-6, abs=1e-15)
    margins = quadratic_margins(axis, controller.parameters)
    assert all(m.stable and m.gain_db < 0.5 and m.phase_deg < 3.0 for m in margins)


def test_shipped_gains_keep_thirty_degrees_and_six_decibels(axis):
    for margins in controller_margins(axis, make_controller("pid", axis).parameters):
        if margins.regime != "sliding, 1 um/s":
            assert margins.stable and margins.phase_deg >= 30.0 and margins.gain_db >= 6.0
    assert all(m.stable for m in controller_margins(axis, make_controller("self_tuning_observer", axis).parameters))


def test_too_much_gain_is_told(axis):
    gains = {name: float(make_controller("pid", axis).parameters["pid"][name]) for name in
             ("proportional", "integral_time", "derivative_time", "filter_time")}
    assert not all(m.stable for m in pid_margins(axis, {**gains, "proportional": 10 * gains["proportional"]}))
