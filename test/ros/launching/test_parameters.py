"""Every parameter has type, unit, range, description; bad values are refused with the reason."""

import subprocess
import sys

import pytest
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.parameter import Parameter
from ros_support import ask, own_domain

from microstage_ros.ros.launching.cell_processes import NODES, CellProcesses
from microstage_ros.ros.launching.parameters import TYPES, definitions, why_refused


@pytest.mark.parametrize("name", NODES)
def test_files_are_complete(name):
    for key, entry in definitions(name).items():
        assert entry["type"] in TYPES and entry["description"], key
        assert set(entry) <= {"type", "default", "fixed", "description", "unit", "minimum", "maximum", "one_of"}, key
        if entry["type"] in ("integer", "double"):
            assert "unit" in entry and entry["minimum"] <= entry["default"] <= entry["maximum"], key
        assert not why_refused(key, entry, entry["default"]), key


@pytest.mark.parametrize("value, words", [
    (-1, "expected integer from 0 to 10"), (11, "got 11"), (True, "got True"), (1.0, "got 1.0"), ("a", "got 'a'")])
def test_reasons(value, words):
    entry = {"type": "integer", "default": 1, "minimum": 0, "maximum": 10, "description": "x"}
    assert words in why_refused("count", entry, value)


def test_not_finite_is_refused():
    assert "nan" in why_refused("x", {"type": "double", "default": 0.0, "description": "x"}, float("nan"))


@pytest.mark.parametrize("node_name, setting, words", [
    ("axis_driver", "mode:=sideways", "one of lockstep, paced"),
    ("axis_driver", "seed:=-1", "seed"),
    ("axis_driver", "backend_options:='{colour: red}'", "colour"),
    ("str_controller", "controller:=guess", "controller"),
    ("str_controller", "gains:='{proportional: -1.0}'", "proportional"),
    ("str_controller", "gains:='{period: 1.0e-3}'", "names of gains"),
    ("str_controller", "gains:='{1: 2.0}'", "names of gains"),
    ("gms_observer", "gains:='{encoder_noise: -1.0}'", "encoder_noise"),
    ("gms_observer", "gains:='{loudness: 1.0}'", "loudness"),
    ("str_controller", "axis_file:=/nowhere.yaml", "/nowhere.yaml")])
def test_bad_start_values_end_with_status_2_and_one_line(node_name, setting, words):
    with own_domain():
        done = subprocess.run([sys.executable, "-m", f"microstage_ros.ros.nodes.{node_name}", "--ros-args", "-p", setting],
                              capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 2 and words in done.stderr and "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_changes_at_run_time(node, tmp_path):
    with CellProcesses("/axis", ("str_controller",), logs=tmp_path):
        def change(name, value):
            request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
            return ask(node, SetParameters, "/axis/str_controller/set_parameters", request).results[0]

        assert change("gains", "{proportional: 2.0e5}").successful
        refused = change("gains", "{proportional: -2.0e5}")
        assert not refused.successful and "proportional" in refused.reason
        assert not change("gains", "{loudness: 1.0}").successful
        assert "names of gains" in change("gains", "{1: 2.0}").reason
        refused = change("controller", "pid")
        assert not refused.successful and "restart" in refused.reason
        refused = change("stop_time_s", 5.0)
        assert not refused.successful
        described = ask(node, DescribeParameters, "/axis/str_controller/describe_parameters",
                        DescribeParameters.Request(names=["stop_time_s"])).descriptors[0]
        assert "[s]" in described.description and described.floating_point_range[0].to_value == 0.015
