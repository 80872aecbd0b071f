"""Compiles the shipped axis and its default law into the cache; set-up runs it while the interfaces are built."""

from microstage_ros.control.laws.controller import make_controller
from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.protocol import Setup
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file


def main():
    """Compile what needs no ROS; the nodes' loops are compiled by the first cell."""
    axis = load_axis(config_file("axis.yaml"))
    make_hardware("simulated", Setup(axis, 1, {}))
    controller = make_controller("self_tuning", axis)
    controller.step(0.0, 0.0, 0.0)
    controller.reset()


if __name__ == "__main__":
    main()
