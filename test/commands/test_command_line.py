"""Exit statuses, help, errors in one line; the environment's own text."""

import subprocess
import sys

import pytest

from microstage_ros.commands import COMMANDS
from microstage_ros.commands.__main__ import main, run
from microstage_ros.commands.project import environment
from microstage_ros.places import SOURCE, config_file
from microstage_ros.quantities.errors import InputError


def microstage(*arguments):
    """The command line in a process of its own."""
    return subprocess.run([sys.executable, "-m", "microstage_ros.commands", *arguments], capture_output=True, text=True,
                          cwd=SOURCE, timeout=300, check=False)


def test_help_lists_every_command(capsys):
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    assert all(f"  {name} " in shown and text in shown for name, text in COMMANDS.items()) and "ROS 2" in shown


def test_no_command_and_unknown_command_are_usage_errors(capsys):
    assert main([]) == 2
    assert main(["fly"]) == 2
    assert "'fly'" in capsys.readouterr().err


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help(name, capsys):
    try:
        assert main([name, "--help"]) == 0
    except SystemExit as ended:
        assert not ended.code
    assert "usage: microstage" in capsys.readouterr().out


@pytest.mark.parametrize("arguments, words", [
    (["simulate", "--axis", "nowhere.yaml", "--run", "r.yaml", "--out", "o.csv"], "nowhere.yaml"),
    (["replay", "nowhere"], "nowhere"),
    (["cell", "--namespace", "axis"], "begins with a slash"),
    (["cell", "--axis", "nowhere.yaml"], "nowhere.yaml"),
    (["demo", "--seed", "-1"], "--seed"),
    (["demo", "--axis", "nowhere.yaml"], "nowhere.yaml")])
def test_bad_input_is_one_line_and_status_2(arguments, words):
    done = microstage(*arguments)
    assert done.returncode == 2 and words in done.stderr and len(done.stderr.strip().splitlines()) == 1
    assert "Traceback" not in done.stderr


def test_usage_error_of_a_command():
    done = microstage("move", "--to", "far")
    assert done.returncode == 2 and "Traceback" not in done.stderr


def test_errors_of_many_lines_become_one(monkeypatch, capsys):
    import microstage_ros.commands.analysis.laws as command

    def bad(_):
        raise InputError("file.yaml", "two\nlines", "one")

    monkeypatch.setattr(command, "main", bad)
    assert run("laws", []) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_an_interruption_within_compiled_code_is_one_too(monkeypatch, capsys):
    """Compiled code returns with the KeyboardInterrupt set, and CPython makes a SystemError of that."""
    import microstage_ros.commands.analysis.laws as command

    def interrupted(_):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise SystemError("returned a result with an exception set") from error

    def broken(_):
        raise SystemError("of another kind")

    monkeypatch.setattr(command, "main", interrupted)
    assert run("laws", []) == 1  # "anything else" in the contract of exit statuses
    assert capsys.readouterr().err.strip() == "microstage laws: interrupted"
    monkeypatch.setattr(command, "main", broken)
    with pytest.raises(SystemError):
        run("laws", [])


def test_demo_keeps_earlier_runs(tmp_path, monkeypatch):
    from microstage_ros.commands.operation.demo import _place

    monkeypatch.chdir(tmp_path)
    assert str(_place(None, False)) == "demo"
    (tmp_path / "demo" / "bag").mkdir(parents=True)
    assert str(_place(None, False)) == "demo-2"
    with pytest.raises(InputError, match="--force"):
        _place("demo", False)


def test_demo_program_is_the_papers():
    from microstage_ros.commands.operation.demo import TARGETS, program

    moves = program(10)
    assert len(moves) == 2 * 10 * 2 * len(TARGETS) and [place for place, measured in moves if not measured] == [0.0] * 80
    assert sum(place == -1e-4 for place, _ in moves) == 10


def test_environment_says_which_python_it_needs(monkeypatch):
    monkeypatch.setattr(environment.sys, "version_info", (3, 9, 0))
    monkeypatch.setattr(environment.shutil, "which", lambda name: None)
    with pytest.raises(environment.Failure, match="3.10 to 3.14"):
        environment._python()


def test_environment_reads_the_lists_of_setup_cfg():
    wheels, sourced = (environment._requirements(SOURCE, name) for name in ("", "jazzy"))
    assert "ros-jazzy-rclpy[fastrtps]" in wheels and not any(line.startswith("ros-") for line in sourced)
    assert set(sourced) < set(wheels) and any(line.startswith("numba") for line in sourced)


def test_shipped_files_are_found():
    assert config_file("axis.yaml").is_file()
    with pytest.raises(InputError, match="axis.yaml"):
        config_file("nothing.yaml")


def test_the_hint_of_a_cell_moves_that_cell():
    from microstage_ros.commands.operation.cell import move_hint

    assert move_hint("/axis") == "./microstage move --to 1e-5"
    assert move_hint("/left") == "./microstage move --to 1e-5 --namespace /left"


def test_the_examples_of_the_shell_name_programs_that_are_there():
    import re
    import shutil

    from microstage_ros.commands.project.shell import USAGE

    programs = re.findall(r"microstage shell (\w+)", USAGE)
    assert programs and all(program.startswith("python") or shutil.which(program) for program in programs)
