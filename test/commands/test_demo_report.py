"""The demo's headline says what the interval allows; a move that did not settle counts."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from microstage_ros.commands.operation import demo, demo_report
from microstage_ros.commands.operation.demo_report import accuracy_rows, comparison, headline, table_cells
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.ros.launching import ownership


def moves(errors, target=1e-6, reached=True):
    return [{"target_m": target, "reached": reached, "interferometer_error_m": e, "final_error_m": e, "settling_time_s": 0.1,
             "overshoot_m": 0.0} for e in errors]


def test_two_repeats_never_say_that_the_paper_is_beaten():
    """4s of ±10 nm from n = 2 is 57 nm, but its 95 % interval reaches beyond 173 nm."""
    results = moves([1e-8, -1e-8])
    rows = accuracy_rows(results)
    assert rows[0]["repeatability"].four_s < rows[0]["paper"] < rows[0]["repeatability"].four_s_interval[1]
    assert comparison(rows[0]) == "open"
    text, sure = headline(rows, results)
    assert "below the paper's for 0 of 1 targets" in text and "cannot tell" in text and not sure


def test_many_repeats_say_it():
    results = moves(1e-8 * np.tile([1.0, -1.0, 0.5, -0.5], 10))
    text, sure = headline(accuracy_rows(results), results)
    assert sure and "below the paper's for 1 of 1 targets" in text and "cannot tell" not in text


def test_a_move_that_did_not_settle_counts():
    results = moves(1e-8 * np.tile([1.0, -1.0], 20)) + moves([5e-6], reached=False)
    rows = accuracy_rows(results)
    assert comparison(rows[0]) == "open" and table_cells(rows)[0][1] == "40 of 41"
    text, sure = headline(rows, results)
    assert text.startswith("40 of 41 moves settled") and not sure


@pytest.mark.parametrize("size", [1e-6])
def test_worse_is_said_too(size):
    results = moves(size * np.tile([1.0, -1.0], 20))
    assert comparison(accuracy_rows(results)[0]) == "above"
    assert "above for 1" in headline(accuracy_rows(results), results)[0]


def test_the_topics_of_the_axis_that_moved(monkeypatch):
    monkeypatch.setattr(demo_report, "read_bag", lambda bag: {"/axis/state": 1, "/demo/state": 2, "/demo/command": 3})
    assert demo_report._streams("bag", "/demo") == {"state": 2, "command": 3}


def test_a_report_that_fails_leaves_bag_and_moves(monkeypatch, tmp_path, capsys):
    """And no report of an earlier run beside them."""
    out = tmp_path / "out"
    out.mkdir()
    (out / "report.html").write_text("of an earlier run")

    def make_moves(arguments, axis, out, folder, *_):
        (folder / "bag").mkdir()
        return moves(1e-8 * np.array([1.0, -1.0]))

    def fail(*_):
        raise KeyError("state")

    monkeypatch.setattr(ownership, "free_namespace", lambda: "/demo")
    monkeypatch.setattr(demo, "_make_moves", make_moves)
    monkeypatch.setattr(demo_report, "write_report", fail)
    backend = SimpleNamespace(simulated=True, name="simulated", instruments=True, words=lambda *_: "")
    arguments = SimpleNamespace(quick=True, seed=1, controller=None)
    with pytest.raises(KeyError):
        demo._run(arguments, load_axis(config_file("axis.yaml")), out, backend)
    assert sorted(path.name for path in out.iterdir()) == ["bag", "moves.json"]
    assert json.loads((out / "moves.json").read_text())["run"]["namespace"] == "/demo"
    assert "could not be made" in capsys.readouterr().err


def stream(**fields):
    """Four control periods of a topic, fields that are not named zero."""
    made = np.zeros(4, [("sequence", "u8")] + [(name, "f8") for name in fields])
    made["sequence"] = range(4)
    for name, values in fields.items():
        made[name] = values
    return made


def test_the_command_of_another_drive_has_its_unit():
    axis = load_axis(config_file("axes/current_motor.yaml"))
    backend = SimpleNamespace(simulated=True, name="simulated", instruments=True)
    facts = demo._facts(SimpleNamespace(seed=1, controller="pid"), axis, backend, "/axis")
    command, torque = facts["command"], {"quantity": "torque", "unit": "N m"}
    assert torque.items() <= command.items()
    streams = {"state": stream(position=0.0), "command": stream(reference=0.0, voltage=0.0),
               "controller_state": stream(proportional_gain=1.0, integral_gain=1.0, derivative_gain=1.0)}
    figure = demo_report._move_figure(streams, {"start_sequence": 0, "end_sequence": 3}, 1e-3, command)
    assert figure.axes[-1].get_ylabel() == "torque [N m]"
    labels = [axes.get_ylabel() for axes in demo_report._gain_figure(streams, 1e-3, command["unit"]).axes]
    assert labels == ["K_P [N m/µm]", "K_I [N m/(µm s)]", "K_D [N m s/m]"]


def test_a_share_of_no_friction_is_left_out():
    """A drive whose model has no friction in its actuator; a run in which nothing moves."""
    true = {"simulation": stream(actuator_torque=0.0, guideway_force=[0.0, 1.0, 1.0, 1.0])}
    estimate = {"friction": stream(actuator_torque=[0.0, 1.0, 0.0, 0.0], guideway_force=[0.0, 1.0, 1.0, 1.3])}
    assert demo_report._friction_words(true | estimate).endswith("rms: guideways 17.3 %.")
    true["simulation"]["guideway_force"] = 0.0
    assert demo_report._friction_words(true | estimate) == ""
