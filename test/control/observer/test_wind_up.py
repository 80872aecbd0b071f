"""The planned wind-up of the drive train: a step of the reference teaches nothing."""

import numpy as np
import pytest

from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.observer import wind_up
from microstage_ros.control.trajectories.profiles import jerk_limited_move
from microstage_ros.solver.period import advance, read_sensors
from microstage_ros.solver.plant import make_plant, new_readings, new_state, new_work


def ridden(axis, references, seed):
    """Memory of the observer after a run along references [m], and the largest wind-up speed that was believed [m/s]."""
    plant, readings = make_plant(axis), new_readings()
    state, work, controller = new_state(plant, seed=seed, friction="random"), new_work(plant), make_controller("self_tuning_observer", axis)
    observer, fastest = controller.memory["observer"], 0.0
    for reference in references:
        read_sensors(plant, state, readings)
        advance(plant, state, work, controller.step(reference, readings["encoder"], readings["current"]))
        fastest = max(fastest, abs(float(observer["wind_up_speed"])))
    return observer, fastest


@pytest.mark.parametrize("size", [5e-9, 2.5e-8])
def test_a_step_of_the_reference_teaches_nothing_of_the_drive(axis, size):
    """As where a move begins at the encoder's reading. With the plan believed R fell to half of what it is."""
    for seed in range(3):
        observer, fastest = ridden(axis, np.repeat([0.0, size], 3000), seed)
        assert int(observer["changes"]) == 0 and float(observer["learned"][0]) == pytest.approx(1.0, abs=0.05)
        assert fastest < 1e-4


def test_a_smooth_move_is_planned(axis):
    """dw/dt = (dF_g/dt + m j) / K_c: a jerk j that is limited moves the wind-up slowly, and that is believed."""
    move = jerk_limited_move(0.0, 1e-3, axis.value("period"))
    observer, fastest = ridden(axis, move, 1)
    assert fastest > 1e-5 and int(observer["changes"]) == 0
    assert float(observer["learned"][0]) == pytest.approx(1.0, abs=0.05)


def test_a_jump_is_waited_for():
    record = np.zeros(1, [*wind_up.FIELDS, ("voltage_noise", "f8")]).view(np.recarray)[0]
    model = np.zeros(1, [("volts_per_velocity", "f8")]).view(np.recarray)[0]
    model["volts_per_velocity"], record["voltage_noise"] = 400.0, 2e-3
    plan = getattr(wind_up.plan_wind_up, "py_func", wind_up.plan_wind_up)
    seen = []
    for speed in (1e-5, 2e-5, 6e-3, -1.2e-2, 6e-3, 0.0, 1e-5, 1e-5, 1e-5, 1e-5):
        plan(model, record, speed)
        seen.append(float(record["wind_up_speed"]))
    assert seen == [1e-5, 2e-5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-5, 1e-5]
