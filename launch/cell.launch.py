"""The nodes of one axis, for `ros2 launch microstage_ros cell.launch.py`, where the ROS launch system is installed.

    ros2 launch microstage_ros cell.launch.py namespace:=/left seed:=2 mode:=paced record:=runs/today
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {
    "namespace": ("/axis", "namespace of the nodes"),
    "mode": ("lockstep", "lockstep or paced"),
    "seed": ("1", "of the simulated axis"),
    "axis_file": ("", "axis file; empty: the shipped one"),
    "controller": ("self_tuning", "control law"),
    "record": ("", "folder of the bag; empty: do not record"),
}


def nodes(context):
    """The nodes, with what they must know of each other."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    names = ["str_controller", "gms_observer", "interferometer_logger", "move_server"]
    names += ["bag_recorder"] if value["record"] else []
    axis = {"axis_file": value["axis_file"]}
    recorded = int(bool(value["record"]))
    parameters = {
        "str_controller": {**axis, "controller": value["controller"], "expected_subscribers": 1 + recorded,
                           "expected_state_subscribers": 1 + recorded},
        "gms_observer": {**axis, "expected_subscribers": recorded},
        "interferometer_logger": {"expected_subscribers": 1 + recorded}, "move_server": {},
        "bag_recorder": {"directory": value["record"],
                         "log_time": "stamp" if value["mode"] == "lockstep" else "arrival"},
        "axis_driver": {**axis, "mode": value["mode"], "seed": int(value["seed"]), "followers": names,
                        "expected_subscribers": 2 + recorded, "activate": True,
                        "rate_limit": 1.0 if value["mode"] == "lockstep" else 0.0},
    }
    return [Node(package="microstage_ros", executable=name, name=name, namespace=value["namespace"],
                 parameters=[parameters[name]], output="screen") for name in [*names, "axis_driver"]]


def generate_launch_description():
    """Called by the launch system."""
    profile = Path(get_package_share_directory("microstage_ros")) / "config" / "fastdds.xml"
    declared = [DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()]
    return LaunchDescription([
        *declared, SetEnvironmentVariable("FASTRTPS_DEFAULT_PROFILES_FILE", str(profile)),
        SetEnvironmentVariable("FASTDDS_DEFAULT_PROFILES_FILE", str(profile)),
        SetEnvironmentVariable("RMW_FASTRTPS_USE_QOS_FROM_XML", "1"), OpaqueFunction(function=nodes)])
