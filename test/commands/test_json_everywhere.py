"""``--json`` on every command: standard output is one object, with its promised fields, whatever happens."""

import json
import sys
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest

from microstage_ros.commands import COMMANDS
from microstage_ros.commands.__main__ import main
from microstage_ros.places import config_file

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "ros"))

from ros_support import own_domain  # noqa: E402

from microstage_ros.ros import client, operator  # noqa: E402
from microstage_ros.ros.loops.move_requests import MoveRequests  # noqa: E402

AXIS = str(config_file("axis.yaml"))
RUN = "controller: {type: pid}\nprogram:\n  - {move_to_m: 1.0e-5, dwell_s: 0.01}\n"
PASSES_ON = ("shell", "test")
"""They hand their words to another program, which answers for itself."""

ANSWERING = sorted(set(COMMANDS) - set(PASSES_ON))


def object_of(capsys, words):
    """Status and the object on standard output; text for people is on standard error."""
    status = main([words[0], *words[1:], "--json"])
    out = capsys.readouterr().out
    assert out.count("\n") == 1 and out.endswith("\n"), out
    found = json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert (found["command"], found["status"]) == (words[0], status) and isinstance(found["version"], str)
    return status, found


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with a run file and a record, the current one."""
    monkeypatch.chdir(tmp_path)
    Path("run.yaml").write_text(RUN)
    return tmp_path


@pytest.mark.parametrize("name", ANSWERING)
def test_an_option_that_there_is_not(capsys, here, name):
    status, found = object_of(capsys, [name, "--nonsense"])
    assert status == 2 and "--nonsense" in found["error"]["says"] and "\n" not in found["error"]["says"]
    assert sorted(path.name for path in here.iterdir()) == ["run.yaml"]


@pytest.mark.parametrize("words", [
    ["simulate", "--axis", "axs.yaml", "--run", "run.yaml", "--out", "o.csv"], ["identify", "--axis", AXIS, "no.csv", "--out", "o.yaml"],
    ["diagnose", "--axis", AXIS, "no.csv", "--out", "o"], ["log", "no.csv", "--out", "o"], ["replay", "no"], ["recover", "no.mcap"], ["cut", "no.mcap", "--out", "o.csv"],
    ["tune", "--axis", "no.yaml", "--out", "o.yaml"], ["cell", "--axis", "no.yaml"], ["demo", "--axis", "no.yaml"],
    ["experiment", "--run", "no.yaml", "--out", "o"], ["watch", "--axis", AXIS, "no.csv"]], ids=lambda words: words[0])
def test_a_file_that_is_not_there(capsys, here, words):
    status, found = object_of(capsys, words)
    assert status == 2 and {"place", "says"} <= set(found["error"])
    assert "not found" in found["error"]["says"]


def test_what_a_simulation_answers(capsys, here):
    status, found = object_of(capsys, ["simulate", "--axis", AXIS, "--run", "run.yaml", "--out", "o.csv"])
    assert status == 0 and {"record", "rows", "period_s", "columns", "seed"} <= set(found)
    assert Path(found["record"]).exists() and found["rows"] > 0
    status, again = object_of(capsys, ["simulate", "--axis", AXIS, "--run", "run.yaml", "--out", "o.csv"])
    assert status == 2 and "--force" in again["error"]["expected"]


@pytest.mark.parametrize("name", ["status", "stop", "hold", "reset", "home", "jog", "move"])
def test_no_axis_is_an_answer_too(capsys, monkeypatch, name):
    """How long they wait for one is the same for all of them: one does, the others say it sooner."""
    if name != "status":
        monkeypatch.setattr(operator, "WAIT_S", 0.3)
        monkeypatch.setattr(client, "SOUGHT_HERE", 0.3)
        monkeypatch.setattr(client, "SOUGHT_ANYWHERE", 0.3)
    with own_domain():
        words = {"jog": ["jog", "--speed", "1mm/s"], "move": ["move", "--to", "1um"]}.get(name, [name])
        status, found = object_of(capsys, words)
    assert status == 1 and "no axis" in (found.get("message") or found.get("error", {}).get("says", "")), found


@pytest.mark.parametrize("unit, key", [("V", "voltage_V"), ("N m", "torque_Nm")])
def test_the_command_in_the_status_of_an_axis(capsys, monkeypatch, unit, key):
    """Its key says the unit; ``command`` is the name of the command line's command, as in every answer."""
    driver = SimpleNamespace(active=True, fault=0, message="", command_unit=unit, lockstep=True, simulated=True, backend="simulated",
                             host="here", process=1, commander="/axis/str_controller", watched=True, since=SimpleNamespace(sec=0))
    found = SimpleNamespace(driver=driver, lifecycle="active", position=0.0, voltage=0.25, summary="active")
    axis = SimpleNamespace(status=lambda: found, processes=lambda: None, took=0.0)
    monkeypatch.setattr(operator, "Operator", lambda namespace: nullcontext(axis))
    status, found = object_of(capsys, ["status"])
    assert status == 0 and found[key] == 0.25 and found["command_unit"] == unit


def test_a_jog_above_the_speed_of_the_axis(capsys, monkeypatch):
    """Bad input, under the name of the option."""
    server = SimpleNamespace(_why_not=lambda: "", _status=None, _latest=None, parameters=SimpleNamespace(max_velocity=5e-3))
    axis = SimpleNamespace(took=0.0, jog=lambda velocity, duration: MoveRequests._serve_jog(
        server, SimpleNamespace(velocity=velocity, duration=duration), SimpleNamespace(accepted=False)))
    monkeypatch.setattr(operator, "Operator", lambda namespace: nullcontext(axis))
    status, found = object_of(capsys, ["jog", "--speed", "10m/s", "--back"])
    assert status == 2 and found["error"]["place"] == "--speed" and "at most 0.005 m/s" in found["error"]["says"]
