"""The launch file, run against stand-ins of the launch system, which is not on the package index."""

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from microstage_ros.ros.launching.cell_processes import NODES
from microstage_ros.ros.launching.parameters import definitions, why_refused

ROOT = Path(__file__).parents[3]


class Made:
    """What the launch system would be told to make."""

    def __init__(self, *values, **named):
        self.values, self.named = values, named

    def perform(self, context):
        return context[self.values[0]]


@pytest.fixture
def launch_file(monkeypatch):
    """The names of the launch file."""
    names = {"ament_index_python.packages": ["get_package_share_directory"], "launch": ["LaunchDescription"],
             "launch.actions": ["DeclareLaunchArgument", "OpaqueFunction", "SetEnvironmentVariable"],
             "launch.substitutions": ["LaunchConfiguration"], "launch_ros.actions": ["Node"]}
    for module, members in names.items():
        stand_in = ModuleType(module)
        for member in members:
            setattr(stand_in, member, Made)
        monkeypatch.setitem(sys.modules, module, stand_in)
        monkeypatch.setitem(sys.modules, module.split(".")[0], sys.modules.get(module.split(".")[0]) or stand_in)
    sys.modules["ament_index_python.packages"].get_package_share_directory = lambda name: str(ROOT)
    return SimpleNamespace(**runpy.run_path(str(ROOT / "launch" / "cell.launch.py")))


@pytest.mark.parametrize("mode, record", [("lockstep", ""), ("paced", "runs/today")])
def test_every_node_is_started_with_parameters_it_has(launch_file, mode, record):
    context = {name: default for name, (default, _) in launch_file.ARGUMENTS.items()} | {"mode": mode, "record": record}
    started = {made.named["executable"]: made.named for made in launch_file.nodes(context)}
    assert set(started) == {name for name in NODES if record or name != "bag_recorder"}
    for name, made in started.items():
        entries = definitions(name)
        for parameter, value in made["parameters"][0].items():
            assert parameter in entries and not why_refused(parameter, entries[parameter], value), (name, parameter)
    driver = started["axis_driver"]["parameters"][0]
    assert set(driver["followers"]) == set(started) - {"axis_driver"} and driver["activate"]


@pytest.mark.parametrize("namespace", ["/left", "left"])
def test_a_secured_cell_has_the_enclaves_of_its_namespace(launch_file, monkeypatch, namespace):
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    context = {name: default for name, (default, _) in launch_file.ARGUMENTS.items()} | {"namespace": namespace}
    for made in launch_file.nodes(context):
        assert made.named["ros_arguments"] == ["--enclave", f"/left/{made.named['name']}"]


def test_the_description_applies_the_profile(launch_file):
    described = launch_file.generate_launch_description()
    texts = {made.values[0]: made.values[1] for made in described.values[0] if len(made.values) == 2}
    for name in ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE"):
        assert Path(texts[name]).is_file()
    assert texts["RMW_FASTRTPS_USE_QOS_FROM_XML"] == "1"


def test_discovery_keeps_to_this_computer_unless_told(launch_file, monkeypatch):
    for given in ("LOCALHOST", "SUBNET"):
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", given)
        texts = {made.values[0]: made.values[1] for made in launch_file.generate_launch_description().values[0] if len(made.values) == 2}
        assert texts["ROS_AUTOMATIC_DISCOVERY_RANGE"] == given
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE")
    texts = {made.values[0]: made.values[1] for made in launch_file.generate_launch_description().values[0] if len(made.values) == 2}
    assert texts["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
