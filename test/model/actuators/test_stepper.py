"""The stepper: static stiffness, its own oscillation, detents, microsteps, lost steps."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from microstage_ros.model.axis_file import load_axis
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.open_loop import COLUMNS, respond, run_open_loop
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work

from .conftest import AXES

T, RATIO, POLES, HOLDING, INERTIA, DAMPING = 2e-4, 1e-3 / (2 * math.pi), 50, 0.4, 5.7e-6, 2e-3
MICRO = 2 * math.pi / 3200
CYCLE = 2 * math.pi / POLES            # an electrical turn: four full steps


def test_load_below_the_holding_torque_turns_the_rotor_by_the_arcsine(bare):
    """sin(p θ) = τ/T_H under a constant force on the stage."""
    force = 1500.0
    plant = bare("stepper", drive__detent_torque=0.0, stage__offset_force=force)
    found = respond(plant, np.zeros(5000))
    assert found["theta"][-1] == pytest.approx(-math.asin(force * RATIO / HOLDING) / POLES, rel=1e-6)
    assert found["x"][-1] == pytest.approx(RATIO * found["theta"][-1] - force / 2e7, rel=1e-6)


def test_detent_holds_between_the_steps_without_current(bare):
    """T_D sin(4 p θ) alone: a load of half of it moves the rotor by asin(1/2)/(4 p)."""
    plant = bare("stepper", drive__holding_torque=1e-9, drive__detent_torque=0.02, stage__offset_force=0.01 / RATIO)
    assert respond(plant, np.zeros(8000))["theta"][-1] == pytest.approx(-math.asin(0.5) / (4 * POLES), rel=1e-5)


def test_large_oscillation_against_an_independent_integration(bare):
    """A rotor let go at 0.8 of the angle at which it would slip: a pendulum of large amplitude, with detents."""
    plant = bare("stepper")
    plant["rigid"] = 1
    start = 0.4 * CYCLE
    state = new_state(plant)
    state["theta"], state["x"] = start, RATIO * start
    t = np.arange(150) * T
    mass = INERTIA + 0.5 * RATIO**2

    def rates(_, z):
        theta, w = z
        torque = -HOLDING * math.sin(POLES * theta) - 0.015 * math.sin(4 * POLES * theta)
        return [w, (torque - (DAMPING + 10.0 * RATIO**2) * w) / mass]

    exact = solve_ivp(rates, (0, t[-1]), [start, 0], t_eval=t, rtol=1e-10, atol=1e-13).y[0]
    trace = np.empty((len(t), len(COLUMNS)))
    run_open_loop(plant, state, new_work(plant), new_readings(), np.zeros(len(t)), trace)
    found = trace[:, COLUMNS.index("theta")]
    assert np.max(np.abs(found - exact)) < 3e-3 * start and np.ptp(exact) > start


def test_field_moves_in_whole_microsteps(bare):
    plant = bare("stepper", drive__detent_torque=0.0)
    ends = [respond(plant, np.full(4000, u * MICRO))["theta"][-1] for u in (0.4, 0.6, 2.4, -1.6)]
    assert np.allclose(ends, np.array([0, 1, 2, -2]) * MICRO, atol=1e-3 * MICRO)


def test_overload_loses_whole_electrical_turns(bare):
    """A push beyond T_H and back: the rotor rests 4 k full steps from where it was, k ≥ 1, with the field unmoved."""
    plant = bare("stepper", drive__detent_torque=0.0)
    plant["push"] = -1.3 * HOLDING / RATIO
    state, work = new_state(plant), new_work(plant)
    run_open_loop(plant, state, work, new_readings(), np.zeros(60), np.empty((0, len(COLUMNS))))
    assert state["theta"] < -CYCLE
    plant["push"] = 0.0
    run_open_loop(plant, state, work, new_readings(), np.zeros(8000), np.empty((0, len(COLUMNS))))
    turns = state["theta"] / CYCLE
    assert turns < -0.5 and turns == pytest.approx(round(turns), abs=1e-6)


@pytest.mark.parametrize(("drag", "follows"), [(2e-3, True), (8e-3, False)])
def test_drag_beyond_the_holding_torque_leaves_the_rotor_behind(bare, drag, follows):
    """At 78 rad/s the drag is 0.16 or 0.63 N m, T_H is 0.4: the slow rotor follows, the other loses whole turns."""
    plant = bare("stepper", drive__damping=drag)
    u = np.concatenate([np.cumsum(np.minimum(np.arange(4000) / 3000, 1.0)) * 78.0 * T, np.full(3000, 0.0)])
    u[4000:] = u[3999]
    lost = (u[-1] - respond(plant, u)["theta"][-1]) / CYCLE
    assert (abs(lost) < 0.02) == follows
    if not follows:
        assert lost > 1 and lost == pytest.approx(round(lost), abs=0.05)


def test_pulses_of_more_than_a_full_step_per_period_are_refused():
    axis = load_axis(AXES / "stepper.yaml")
    with pytest.raises(InputError, match="pulse_rate.*80000"):
        make_plant(axis.with_values({"drive.pulse_rate": 1e6}), NoiseSpec.none())
