"""The nodes of one axis, for `ros2 launch microstage_ros cell.launch.py`, where the ROS launch system is installed.

    ros2 launch microstage_ros cell.launch.py namespace:=/left seed:=2 mode:=paced record:=runs/today
    ros2 launch microstage_ros cell.launch.py backend:=my_package.my_card:Card backend_options:=card.yaml mode:=paced axis_file:=mine.yaml
"""

import os
from pathlib import Path
from types import SimpleNamespace

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from microstage_ros.commands.backend import chosen_backend
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.ros.launching.cell_processes import NODES, started_parameters

ARGUMENTS = {
    "namespace": ("/axis", "namespace of the nodes"),
    "mode": ("", "lockstep or paced; empty: lockstep where the backend is simulated, else paced"),
    "backend": ("simulated", "simulated, daq, an entry point, or package.module:Class from PYTHONPATH"),
    "backend_options": ("", "YAML file with the options of the backend"),
    "seed": ("1", "of a simulated axis"),
    "axis_file": ("", "axis file; empty: the shipped one"),
    "controller": ("", "control law; empty: that of the axis file"),
    "record": ("", "folder of the bag; empty: do not record"),
}


def nodes(context):
    """The nodes, with what they must know of each other."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    backend = chosen_backend(SimpleNamespace(**{**value, "seed": int(value["seed"])}), load_axis(value["axis_file"] or config_file("axis.yaml")))
    mode, axis = backend.mode_or(value["mode"]), {"axis_file": value["axis_file"]}
    lockstep = mode == "lockstep"
    names = backend.nodes(name for name in NODES if value["record"] or name != "bag_recorder")
    parameters = started_parameters(names, {
        "str_controller": {**axis, "controller": value["controller"]}, "gms_observer": axis,
        "bag_recorder": {"directory": value["record"], "log_time": "stamp" if lockstep else "arrival",
                         **backend.recorder_parameters},
        "axis_driver": {**axis, **backend.driver_parameters, "mode": mode, "seed": int(value["seed"]), "activate": True,
                        "rate_limit": 1.0 if lockstep else 0.0}})
    cell = "/" + value["namespace"].strip("/")  # of a namespace without its slash too
    secure = os.environ.get("ROS_SECURITY_ENABLE") == "true"
    return [Node(package="microstage_ros", executable=name, name=name, namespace=value["namespace"],
                 ros_arguments=["--enclave", f"{cell}/{name}"] if secure else None,
                 parameters=[parameters[name]], output="screen") for name in names]


def generate_launch_description():
    """Called by the launch system."""
    profile = Path(get_package_share_directory("microstage_ros")) / "config" / "fastdds.xml"
    declared = [DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()]
    return LaunchDescription([
        *declared, SetEnvironmentVariable("FASTRTPS_DEFAULT_PROFILES_FILE", str(profile)),
        SetEnvironmentVariable("FASTDDS_DEFAULT_PROFILES_FILE", str(profile)),
        SetEnvironmentVariable("RMW_FASTRTPS_USE_QOS_FROM_XML", "1"),
        SetEnvironmentVariable("ROS_SECURITY_ENCLAVE_OVERRIDE", ""),  # each node has the enclave of its name
        SetEnvironmentVariable("ROS_AUTOMATIC_DISCOVERY_RANGE", os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")), OpaqueFunction(function=nodes)])
