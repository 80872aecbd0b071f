"""Other trajectories: last bits drawn anew change a state by no more than that, and the command hands the choice on."""

import inspect
import subprocess
import sys

import numpy as np
import pytest

from microstage_ros.commands.project import test as command
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import SOURCE, config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.plant import make_plant, new_state
from test.commit_set import LEFT_OUT
from test.last_bits import FLAGS, RELATIVE, USUAL, wrapped


def test_last_bits_differ_and_nothing_else():
    plant = make_plant(load_axis(config_file("axis.yaml")))
    unwrapped = inspect.unwrap(new_state)
    plain, again, other = (make(plant, 3, 1e-3, "random") for make in (unwrapped, wrapped(unwrapped, False, 0), wrapped(unwrapped, True, 0)))
    assert plain == again and plain != other
    for name, usual in USUAL.items():
        assert plain[name] != other[name]
        assert abs(plain[name] - other[name]) <= 2.0 * RELATIVE * max(abs(plain[name]), usual)
    np.testing.assert_array_equal(plain["random"], other["random"])
    for name in FLAGS:
        np.testing.assert_array_equal(plain["guideway"][name], other["guideway"][name])
    assert not np.array_equal(plain["random"], wrapped(unwrapped, False, 1)(plant, 3)["random"])


def test_options_of_the_command_become_the_plugins():
    arguments = ["--last-bits", "-n", "0", "--seeds", "2", "test/control"]
    assert command._other_trajectories(arguments) == {"MICROSTAGE_LAST_BITS": "1", "MICROSTAGE_SEEDS": "2"}
    assert arguments == ["-n", "0", "test/control", "-p", "test.last_bits"]
    assert command._other_trajectories(arguments := ["-k", "x"]) == {} and arguments == ["-k", "x"]
    with pytest.raises(InputError, match="whole number"):
        command._other_trajectories(["--seeds", "few"])


@pytest.mark.parametrize("arguments, left_out", [
    ([], True), (["-x"], True), (["-n", "2"], True), (["--all"], False), (["-k", "gap"], False), (["--seeds", "2"], False),
    (["test/control"], False), (["test/test_last_bits.py::test_last_bits_differ_and_nothing_else"], False),
])
def test_a_commit_waits_for_no_long_test_and_a_choice_runs_all_it_names(arguments, left_out):
    assert (command._commit_set(arguments) == ["-p", "test.commit_set"]) == left_out
    assert "--all" not in arguments


def test_what_a_commit_leaves_out_is_there():
    """A test that was renamed would be run at every commit again; few are left out, and none of a whole file."""
    listed = [f"test/{file}::{name}" for file, names in LEFT_OUT.items() for name in names]
    assert len(listed) < 100
    files = [f"test/{file}" for file in LEFT_OUT]
    answer = subprocess.run([sys.executable, "-m", "pytest", "--collect-only", "-p", "no:cacheprovider", *files], cwd=SOURCE, text=True,
                            capture_output=True, timeout=300)
    there = answer.stdout.splitlines()
    assert not set(listed) - set(there)
    for file, names in LEFT_OUT.items():
        assert len(names) < sum(line.startswith(f"test/{file}::") for line in there)


def test_modules_that_conftest_imports_get_the_other_trajectories(monkeypatch):
    monkeypatch.setenv("MICROSTAGE_LAST_BITS", "1")
    code = "import test.last_bits, test.conftest; import microstage_ros.control.runs.simulate as s; import microstage_ros.solver.plant as p; import sys; " \
           "names = [m for m in sys.modules.values() if hasattr(m, 'new_state')]; assert s in names and p in names; assert all(hasattr(m.new_state, '__wrapped__') for m in names)"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=300)
