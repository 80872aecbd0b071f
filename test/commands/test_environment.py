"""What ./microstage writes for the shell, with the wheels and with a sourced ROS 2."""

import subprocess

import pytest

from microstage_ros.commands.project.environment import _exports


@pytest.mark.parametrize("sourced", ["", "jazzy"])
def test_the_environment_is_a_shell_text_that_keeps_a_sourced_ros(tmp_path, sourced):
    prefix, venv = tmp_path / "interfaces", tmp_path / "venv"
    (prefix / "lib" / "python3.12" / "site-packages").mkdir(parents=True)
    (tmp_path / "environment.sh").write_text(_exports(tmp_path, venv, prefix, sourced), encoding="utf-8")
    asked = 'set -eu; source environment.sh; echo "$PATH"; echo "$AMENT_PREFIX_PATH"; echo "$PYTHONPATH"; echo "$MICROSTAGE_ROS"'
    done = subprocess.run(["bash", "-c", asked], cwd=tmp_path, capture_output=True, text=True, check=True, env={
        "PATH": "/opt/ros/bin:/usr/bin:/bin", "AMENT_PREFIX_PATH": "/opt/ros", "PYTHONPATH": "/opt/ros/python"})
    path, prefixes, python, which = done.stdout.splitlines()
    assert path.startswith(f"{venv}/bin:") and "/opt/ros/bin" in path
    assert python.split(":")[0] == str(tmp_path) and python.endswith("/opt/ros/python")
    assert prefixes.startswith(str(prefix)) and ("/opt/ros" in prefixes) == bool(sourced)
    assert ("sourced" in which) and (sourced in which)
