"""Compiles the shipped axis and its default law into the cache; set-up runs it while the interfaces are built.

An axis whose friction is no sum of Maxwell-slip blocks takes other compiled code (`solver.plant.new_work`): see
`other_law`.
"""

from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.runs.run_file import run_from_dict
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.protocol import Setup
from microstage_ros.model.axis_file import axis_from_dict, load_axis
from microstage_ros.places import config_file


def main():
    """Compile what needs no ROS; the nodes' loops are compiled by the first cell."""
    axis = load_axis(config_file("axis.yaml"))
    make_hardware("simulated", Setup(axis, 1, {}))
    controller = make_controller("self_tuning", axis)
    controller.step(0.0, 0.0, 0.0)
    controller.reset()


def other_law():
    """Compile the loop of an axis with a friction law that has no blocks; the tests do, before they begin."""
    tree = load_axis(config_file("axis.yaml")).as_dict()
    contact = tree["contacts"]["guideway"]
    stiffness = {"value": 1.0e5, "unit": "N/m", "source": "estimate"}
    tree["contacts"]["guideway"] = {"law": "dahl", "stiffness": stiffness,
                                    "static": contact["static"], "viscous": contact["viscous"]}
    run = run_from_dict({"controller": {"type": "self_tuning"}, "program": [{"move_to_m": 1e-6}]}, "compile ahead")
    simulate(axis_from_dict(tree, "compile ahead"), run)


if __name__ == "__main__":
    main()
