"""Options as people type them, the nearest right word, and the answer as JSON."""

import argparse
import importlib
import json

import pytest

from microstage_ros.commands import COMMANDS, answer, module_of, units
from microstage_ros.commands.__main__ import main
from microstage_ros.commands.parser import NEGATIVE, Parser
from microstage_ros.commands.project.completion import bash, fish, options
from microstage_ros.quantities.errors import InputError


@pytest.mark.parametrize("text, metres", [
    ("1e-5", 1e-5), ("10um", 1e-5), ("10 µm", 1e-5), ("-1e-6", -1e-6), ("-50nm", -5e-8), (".5mm", 5e-4), ("0", 0.0), ("2cm", 0.02)])
def test_lengths_as_people_type_them(text, metres):
    assert units.length(text) == pytest.approx(metres, rel=1e-12)


@pytest.mark.parametrize("text", ["far", "10xm", "nan", "inf", "1e999", "10 um um", "1,5um", "", "1_0"])
def test_no_length(text):
    with pytest.raises(argparse.ArgumentTypeError, match="expected a length"):
        units.length(text)


def test_a_target_with_plus_is_relative():
    assert units.target("+50nm") == (pytest.approx(5e-8), True)
    assert units.target("-50nm") == (pytest.approx(-5e-8), False)


@pytest.mark.parametrize("kind, text", [(units.duration, "0s"), (units.duration, "-1"), (units.speed, "3mm"), (units.positive_length, "0nm")])
def test_other_quantities_are_refused_in_words(kind, text):
    with pytest.raises(argparse.ArgumentTypeError, match="such as"):
        kind(text)


def test_negative_numbers_are_values():
    parser = Parser(prog="p")
    parser.add_argument("--to", nargs="+", type=units.length)
    parser.add_argument("--shift", type=int)
    found = parser.parse_args(["--to", "-1e-6", "-50nm", "3um", "--shift", "-2"])
    assert found.to == pytest.approx([-1e-6, -5e-8, 3e-6]) and found.shift == -2
    assert not NEGATIVE.fullmatch("--to") and not NEGATIVE.fullmatch("-n") and not NEGATIVE.fullmatch("-1.csv")


@pytest.mark.parametrize("words, said", [
    (["simualte"], "did you mean simulate?"),
    (["demo", "--seeed", "3"], "did you mean --seed?"),
    (["move", "--too=1e-5"], "did you mean --to?"),
    (["tune", "--axis", "a.yaml", "--type", "pidd"], "did you mean pid?"),
    (["move", "--to", "10xm"], "expected a length such as"),
    (["replay", "a", "b"], "unexpected words: b")])
def test_the_nearest_right_word(words, said, capsys):
    assert main(words) == 2
    told = capsys.readouterr().err
    assert said in told and len(told.splitlines()) == 1


OWN = [name for name in COMMANDS if name not in ("test", "cell", "demo", "move", "replay", "experiment")]


@pytest.mark.parametrize("name", OWN)
def test_usage_error_is_one_line(name, capsys):
    with pytest.raises(SystemExit) as stop:
        importlib.import_module(module_of(name)).main(["--no-such-option", "x"])
    said = capsys.readouterr().err
    assert stop.value.code == 2 and len(said.splitlines()) == 1
    assert f"microstage {name}" in said and "--help" in said


def test_bad_input_as_json(capsys):
    assert main(["simulate", "--axis", "nowhere.yaml", "--run", "r.yaml", "--out", "o.csv", "--json"]) == 2
    shown = capsys.readouterr()
    found = json.loads(shown.out)
    assert found["status"] == 2 and found["error"]["place"] == "nowhere.yaml" and "file not found" in found["error"]["says"]
    assert main(["simulate", "--axs", "x", "--json"]) == 2
    assert "did you mean --axis?" in json.loads(capsys.readouterr().out)["error"]["says"]


def test_json_holds_the_facts_alone(monkeypatch, capsys):
    import microstage_ros.commands.analysis.laws as command

    def good(argv):
        Parser(prog="microstage laws").parse_args(argv)
        print("for people")
        answer.state(number=float("nan"), text="µm", folder=InputError)
        return 0

    monkeypatch.setattr(command, "main", good)
    assert main(["laws", "--json"]) == 0
    shown = capsys.readouterr()
    found = json.loads(shown.out)
    assert found["number"] is None and found["text"] == "µm" and found["command"] == "laws" and "for people" in shown.err
    assert main(["laws"]) == 0
    assert capsys.readouterr().out == "for people\n"


def test_every_command_has_json_and_completes():
    words = options()
    assert set(words) == set(COMMANDS) and all("--json" in known for name, known in words.items() if name not in ("test", "shell"))
    assert words["cell"]["--mode"] == ["lockstep", "paced"] and words["demo"]["--quick"] is None
    for script in (bash(words), bash(words, zsh=True), fish(words)):
        assert all(name in script for name in COMMANDS) and "lockstep paced" in script


def test_the_bash_completion_completes(tmp_path):
    import subprocess
    script = tmp_path / "completion"
    script.write_text(bash(options()), encoding="utf-8")

    def complete(*words):
        line = f'source {script}; COMP_WORDS=({" ".join(words)}); COMP_CWORD={len(words) - 1}; _microstage; echo "${{COMPREPLY[*]}}"'
        return subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=True).stdout.split()

    assert complete("microstage", "simu") == ["simulate"]
    assert complete("microstage", "simulate", "--fo") == ["--force"]
    assert complete("microstage", "cell", "--mode", "''") == ["lockstep", "paced"]


def test_modules_exist_for_every_command():
    assert all(module_of(name).endswith(name) for name in COMMANDS)


def test_targets_from_a_file(tmp_path):
    from microstage_ros.commands.operation.move import read_targets

    file = tmp_path / "targets.txt"
    file.write_text("10um   # out\n\n-1e-6\n+50nm\n", encoding="utf-8")
    assert [target.value for target in read_targets(file)] == pytest.approx([1e-5, -1e-6, 5e-8])
    file.write_text("10um\nten\n", encoding="utf-8")
    with pytest.raises(InputError, match="line 2: got 'ten'"):
        read_targets(file)
    with pytest.raises(InputError, match="file not found.*did you mean"):
        read_targets(tmp_path / "target.txt")


@pytest.mark.parametrize("words", [
    ["diagnose", "--axis", "a.yaml", "one.csv", "--out", ""], ["diagnose", "--axis", "a.yaml", "one.csv", "", "--out", "x"],
    ["watch", "--axis", "a.yaml", "--store", "", "one.csv"], ["diagnose", "--axis", "", "one.csv", "--out", "x"],
    ["diagnose", "--axis", "a.yaml", "one.csv", "--baseline", "", "--out", "x"], ["watch", "--axis", "a.yaml", "--baseline", "", "one.csv"]])
def test_a_place_without_a_name_is_refused(words, capsys, tmp_path, monkeypatch):
    """``--out "$DIR"`` of an unset variable wrote the answer into the folder of the shell, ``--store ""`` kept nothing."""
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    said = capsys.readouterr().err.strip()
    assert said.endswith("got '', expected the name of a file or folder") and len(said.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_namespace_that_ros_does_not_allow_is_refused(capsys, tmp_path):
    """`experiment` ended in an error of Python, after the nodes' environment was there."""
    assert main(["experiment", "--run", "run.yaml", "--out", str(tmp_path / "out"), "--namespace", "/bad name"]) == 2
    assert "expected a name that begins with a slash" in capsys.readouterr().err
