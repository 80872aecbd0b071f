"""A state that starts in motion slides from the first period on."""

import pathlib

from microstage_ros.model.axis_file import load_axis
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_state, new_work
from microstage_ros.solver.step import advance

ROOT = pathlib.Path(__file__).resolve().parents[2]


def test_a_stage_in_motion_feels_friction_and_no_more():
    axis = load_axis(ROOT / "config/emps.yaml")
    plant = make_plant(axis, noise=NoiseSpec.none())
    for speed in (0.1, -0.1):
        state, work = new_state(plant, speed=speed), new_work(plant)
        force = axis.value("contacts.guideway.coulomb") * (1 if speed > 0 else -1)
        force += axis.value("contacts.guideway.viscous") * speed + axis.value("stage.offset_force")
        for _ in range(100):
            advance(plant, state, work, force / axis.value("drive.gain"))
        assert abs(state["v"] - speed) < 1e-9     # that force keeps the speed: nothing sticks
