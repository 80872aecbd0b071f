"""The nodes of one axis, for `ros2 launch microstage_ros cell.launch.py`, where the ROS launch system is installed.

    ros2 launch microstage_ros cell.launch.py namespace:=/left seed:=2 mode:=paced record:=runs/today
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from microstage_ros.ros.launching.cell_processes import NODES, started_parameters

ARGUMENTS = {
    "namespace": ("/axis", "namespace of the nodes"),
    "mode": ("lockstep", "lockstep or paced"),
    "seed": ("1", "of the simulated axis"),
    "axis_file": ("", "axis file; empty: the shipped one"),
    "controller": ("", "control law; empty: that of the axis file"),
    "record": ("", "folder of the bag; empty: do not record"),
}


def nodes(context):
    """The nodes, with what they must know of each other."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    lockstep, axis = value["mode"] == "lockstep", {"axis_file": value["axis_file"]}
    names = [name for name in NODES if value["record"] or name != "bag_recorder"]
    parameters = started_parameters(names, {
        "str_controller": {**axis, "controller": value["controller"]}, "gms_observer": axis,
        "bag_recorder": {"directory": value["record"], "log_time": "stamp" if lockstep else "arrival"},
        "axis_driver": {**axis, "mode": value["mode"], "seed": int(value["seed"]), "activate": True,
                        "rate_limit": 1.0 if lockstep else 0.0}})
    return [Node(package="microstage_ros", executable=name, name=name, namespace=value["namespace"],
                 parameters=[parameters[name]], output="screen") for name in names]


def generate_launch_description():
    """Called by the launch system."""
    profile = Path(get_package_share_directory("microstage_ros")) / "config" / "fastdds.xml"
    declared = [DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()]
    return LaunchDescription([
        *declared, SetEnvironmentVariable("FASTRTPS_DEFAULT_PROFILES_FILE", str(profile)),
        SetEnvironmentVariable("FASTDDS_DEFAULT_PROFILES_FILE", str(profile)),
        SetEnvironmentVariable("RMW_FASTRTPS_USE_QOS_FROM_XML", "1"), OpaqueFunction(function=nodes)])
