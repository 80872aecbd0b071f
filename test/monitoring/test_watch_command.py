"""The watch from end to end on simulated records: silent on a healthy axis, an alarm where friction rises."""

import dataclasses
import json

import numpy as np
import pytest

from microstage_ros.commands.__main__ import run
from microstage_ros.diagnosis.validation.simulated_records import Hidden, make_case
from microstage_ros.model.axis_file import load_axis
from microstage_ros.monitoring.store import Store
from microstage_ros.monitoring.traits import Machine
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import read_record, write_record

AXIS = str(config_file("axis.yaml"))


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    """{name: file}: two healthy records, one more, and one of the axis with half as much friction again."""
    folder, axis = tmp_path_factory.mktemp("watch"), load_axis(AXIS)
    worn = Hidden("worn", ("friction_level_change",), {"friction_level_change": {"factor": 1.5}})
    made = {
        "one": make_case(axis, Hidden("healthy"), 31)[2][0],
        "two": make_case(axis, Hidden("healthy"), 32)[2][0],
        "three": make_case(axis, Hidden("healthy"), 33)[2][0],
        "worn": make_case(axis, worn, 34)[0][0],
    }
    for name, record in made.items():
        write_record(record, folder / f"{name}.csv")
    return {name: str(folder / f"{name}.csv") for name in made}


def answer_of(capsys, *arguments):
    """Status and JSON of the command."""
    capsys.readouterr()
    status = run("watch", ["--axis", AXIS, "--window", "5s", "--json", *arguments])
    return status, json.loads(capsys.readouterr().out)


def test_friction_that_rose_is_an_alarm_and_health_is_none(records, capsys, tmp_path):
    base = ["--baseline", records["one"], "--baseline", records["two"]]
    status, quiet = answer_of(capsys, *base, records["three"])
    assert status == 0 and quiet["alarms"] == [] and quiet["windows"] >= 4 and quiet["healthy_windows"] >= 8
    store = tmp_path / "history.sqlite"
    status, found = answer_of(capsys, *base, "--store", str(store), records["three"], records["worn"])
    assert status == 0 and "torque" in {alarm["channel"] for alarm in found["alarms"]}
    alarm = next(alarm for alarm in found["alarms"] if alarm["channel"] == "torque")
    assert alarm["record"] == records["worn"] and alarm["trait"] in ("friction_level_change", "viscous_change")
    with Store(store, load_axis(AXIS).name, 5.0) as history:
        assert len(history.healthy()) == found["healthy_windows"] and len(history.history("torque")) == found["windows"]


def test_bad_input_is_one_line_with_status_2(records, capsys, tmp_path):
    for arguments, words in (
        (["nowhere.csv"], "nowhere.csv"),
        (["--healthy", "3", records["one"]], "--healthy"),
        ([records["one"]], "windows"),
        (["--window", "1us", records["one"]], "--window: got 1e-06, expected 0.5 s or more"),
        (["--window", "1h", records["one"]], "--window: got 3600.0, expected at most"),
        (["--false-alarms", "0", records["one"]], "--false-alarms: got 0.0"),
        (["--false-alarms", "2e3", records["one"]], "--false-alarms: got 2000.0"),
        (
            ["--false-alarms", "0", "--baseline", records["one"], "--baseline", records["two"], records["three"]],
            "false alarms",
        ),
    ):
        assert run("watch", ["--axis", AXIS, "--window", "5s", *arguments]) == 2
        said = capsys.readouterr().err
        assert words in said and len(said.strip().splitlines()) == 1


def test_a_sensor_that_reads_in_few_rows_is_not_used_and_said_once(records, capsys):
    """As in a lockstep cell, whose interferometer is read at every tenth period."""
    whole = read_record(records["one"]).rows(0, 30_000)
    few = np.where(np.arange(len(whole)) % 10, np.nan, whole["interferometer_m"])
    sparse = dataclasses.replace(whole, columns={**whole.columns, "interferometer_m": few})
    without = dataclasses.replace(whole, columns={n: v for n, v in whole.columns.items() if n != "interferometer_m"})
    machine = Machine(load_axis(AXIS))
    found = machine.traits(sparse)
    assert machine.traits(whole) == machine.traits(sparse) == machine.traits(without) == found
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1 and "interferometer_m is not used" in said[0] and "10%" in said[0]
    used = Machine(load_axis(AXIS))
    assert used.traits(whole).keys() >= found.keys()
    with pytest.raises(InputError, match="interferometer_m.*as in the first window"):
        used.traits(sparse)


def test_records_of_unlike_sensors_are_judged_by_what_all_have(records, capsys, tmp_path):
    """One bag with the interferometer and one without, in either order: refused before, the position's channel is left out now."""
    whole = read_record(records["three"])
    without = tmp_path / "without.csv"
    write_record(dataclasses.replace(whole, columns={n: v for n, v in whole.columns.items() if n != "interferometer_m"}), without)
    base = ["--baseline", records["one"], "--baseline", records["two"]]
    for judged in ([records["three"], str(without)], [str(without), records["three"]]):
        capsys.readouterr()
        assert run("watch", ["--axis", AXIS, "--window", "5s", "--json", *base, *judged]) == 0
        shown = capsys.readouterr()
        found = json.loads(shown.out)
        assert "torque" in found["channels"] and "position" not in found["channels"] and found["alarms"] == []
        said = [line for line in shown.err.splitlines() if "interferometer_m" in line]
        assert len(said) == 1 and "is not used" in said[0] and "0%" in said[0], shown.err


def without_interferometer(name, path):
    """The record ``name``, written to ``path`` without that column."""
    record = read_record(name)
    write_record(dataclasses.replace(record, columns={n: v for n, v in record.columns.items() if n != "interferometer_m"}), path)
    return str(path)


def test_a_history_that_was_begun_with_other_sensors_says_so(records, capsys, tmp_path):
    """Another sensor has another noise: its windows were judged by the spread of the first one, without a word."""
    few = without_interferometer(records["three"], tmp_path / "few.csv")
    base = ["--baseline", records["one"], "--baseline", records["two"]]
    store = ["--store", str(tmp_path / "whole.sqlite")]
    assert answer_of(capsys, *base, *store, records["three"])[0] == 0
    assert run("watch", ["--axis", AXIS, "--window", "5s", *store, few]) == 2
    said = capsys.readouterr().err.strip()
    assert "whole.sqlite: sensors: got 'current_A', expected current_A, interferometer_m, with which the history was begun" in said
    assert len(said.splitlines()) == 1
    store = ["--store", str(tmp_path / "few.sqlite")]
    assert answer_of(capsys, *base, *store, few)[0] == 0
    assert run("watch", ["--axis", AXIS, "--window", "5s", *store, records["three"]]) == 0
    assert f"interferometer_m is not used: the history {tmp_path / 'few.sqlite'} lacks it." in capsys.readouterr().err


def test_no_window_judges_itself(records, capsys, tmp_path):
    """A record given as baseline and to judge was judged by its own windows, and one of the history on the next day, too."""
    for words, said in ((["--baseline", records["one"], records["one"]], "a record that is given as RECORD too"),
                        ([records["one"], records["one"]], "a record that is given twice")):
        assert run("watch", ["--axis", AXIS, "--window", "5s", *words]) == 2
        assert said in capsys.readouterr().err
    words = ["--healthy", "8", "--store", str(tmp_path / "history.sqlite"), records["one"], records["two"], records["three"]]
    status, first = answer_of(capsys, *words)
    again, second = answer_of(capsys, *words)
    assert (status, again) == (0, 0) and second == first and first["windows"] > 0


@pytest.mark.parametrize("words, said", [
    (["--window", "1s"], "--window: got 1.0, expected 2 … 600 s"), (["--window", "1h"], "--window: got 3600.0, expected 2 … 600 s"),
    (["--healthy", "200000"], "--healthy: got 200000, expected 8 … 100000"), (["--false-alarms", "1e-5"], "--false-alarms: got 1e-05, expected 0.001 … 1000"),
    (["--baseline", "nowhere.csv"], "nowhere.csv: file not found"), (["--baseline", "a,b.csv"], "--baseline: got 'a,b.csv'"),
    (["--store", "/nowhere/history.sqlite"], "/nowhere/history.sqlite: got"), (["--axis", str(config_file("axes/voice_coil.yaml"))], "drive.type: got 'voice_coil'"),
])
def test_beside_a_running_cell_a_wrong_value_is_one_line_before_the_node_starts(monkeypatch, capsys, words, said):
    monkeypatch.setattr("microstage_ros.commands.operation.watch._live", lambda arguments: pytest.fail("the node is started"))
    assert run("watch", ["--axis", AXIS, *words]) == 2
    shown = capsys.readouterr()
    assert said in shown.err and len(shown.err.strip().splitlines()) == 1 and shown.out == ""
