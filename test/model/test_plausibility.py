"""Unlikely numbers of an axis file are said with their line and a usual range; likely ones are not."""

import re

import pytest

from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.plausibility import implausible
from microstage_ros.places import config_file, share


@pytest.mark.parametrize("path", sorted(share().glob("config/*.yaml")) + sorted(share().glob("config/axes/*.yaml")), ids=lambda path: path.name)
def test_shipped_axes_are_likely(path):
    if "transmission:" in path.read_text(encoding="utf-8"):
        assert implausible(load_axis(path)) == []


@pytest.mark.parametrize("key, value, said", [
    (r"pitch: \{value: [^,]*", "pitch: {value: 2.0", "transmission.pitch: 2 m is unlikely; usual: 0.0001 … 0.1 m"),
    (r"stiffness: \{value: 1.2e\+7", "stiffness: {value: 200.0", "transmission.stiffness: 200 N/m is unlikely"),
    (r"mass: \{value: [^,]*", "mass: {value: 3060.0", "stage.mass: 3060 kg is unlikely"),
    (r"torque_constant: \{value: [^,]*", "torque_constant: {value: 0.69", "K_T = K_E"),
    (r"resolution: \{value: [^,]*", "resolution: {value: 0.025", "sensors.encoder.resolution: 0.025 m is unlikely")])
def test_a_slip_of_the_pen_is_said_with_its_line(tmp_path, key, value, said):
    text, count = re.subn(key, value, config_file("axis.yaml").read_text(encoding="utf-8"), count=1)
    assert count == 1
    path = tmp_path / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    found = [warning for warning in implausible(load_axis(path)) if said in warning]
    number = 1 + next(k for k, line in enumerate(text.splitlines()) if value in line)
    assert len(found) == 1 and f"mine.yaml: line {number}: " in found[0]


def test_commands_say_it_and_go_on(tmp_path, capsys):
    from microstage_ros.commands.axis import read_axis

    text = config_file("axis.yaml").read_text(encoding="utf-8")
    path = tmp_path / "mine.yaml"
    path.write_text(re.sub(r"pitch: \{value: [^,]*", "pitch: {value: 2.0", text), encoding="utf-8")
    assert read_axis(path).value("transmission.pitch") == 2.0
    assert capsys.readouterr().err.startswith("warning: ")
