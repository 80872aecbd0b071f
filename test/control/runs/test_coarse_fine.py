"""A screw axis with a piezo stage on top: the coupled motion, what it gains, what is refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from microstage_ros.commands.__main__ import run as run_command
from microstage_ros.commands.analysis.diagnose import main as diagnose
from microstage_ros.commands.analysis.identify import main as identify
from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.runs.coarse_fine import TRACE, coarse_fine_record, make_piece, run_both
from microstage_ros.control.runs.components import component_records
from microstage_ros.control.runs.run_file import run_from_dict
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.coarse_fine import load_machine
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import read_record
from microstage_ros.records.csv_file import write_csv
from microstage_ros.solver.plant import NoiseSpec, new_readings, new_state, new_work

FILE = Path(__file__).resolve().parents[3] / "config" / "axes" / "coarse_fine.yaml"


@pytest.fixture(scope="module")
def record():
    run = run_from_dict({"program": [{"move_to_m": 2e-4, "dwell_s": 0.6}, {"move_to_m": 0.0, "dwell_s": 0.6}]})
    return coarse_fine_record(load_machine(FILE), run, seed=2)


def test_records_of_the_components_keep_the_remarks(record):
    parts = component_records(replace(record, remarks=("bag: 1 stop of the host",)), load_machine(FILE).fine)
    assert {part.remarks for part in parts.values()} == {("bag: 1 stop of the host",)}


@pytest.fixture(scope="module")
def both_records(tmp_path_factory):
    """Files of a healthy machine, and of one whose fine stage goes a tenth less far."""
    machine, folder = load_machine(FILE), tmp_path_factory.mktemp("both")
    return {"healthy": _written(folder, machine, 0), "hidden": _written(folder, _weak(machine), 10)}


def _weak(machine):
    return replace(machine, fine=machine.fine.with_effects({"piezo_gain": {"change": -0.1}}))


def _written(folder, machine, first):
    """Files of three records with the seeds from ``first`` on."""
    run = run_from_dict({"program": [{"move_to_m": target, "dwell_s": 0.6} for target in (2e-4, 2.1e-4, 1e-3, 0.0, -1e-3)]})
    files = [str(folder / f"{seed}.csv") for seed in range(first, first + 3)]
    for seed, file in enumerate(files, first):
        write_csv(coarse_fine_record(machine, run, seed=seed), file)
    return files


def test_the_top_rests_nearer_to_its_reference_than_the_coarse_stage(record, tmp_path):
    rest = slice(-1500, None)
    top = record["stage_m"][rest] - record["reference_m"][rest]
    coarse = top - (record["fine_position_m"][rest] - np.mean(record["fine_position_m"][rest]))
    assert np.sqrt(np.mean(top**2)) < 4e-9 and np.std(coarse) < 1e-7
    assert np.max(np.abs(record["fine_command_V"])) <= 60.0
    write_csv(record, tmp_path / "r.csv")
    assert np.allclose(read_record(tmp_path / "r.csv")["fine_command_V"], record["fine_command_V"], atol=1e-9)


def test_coupled_motion_is_that_of_both_masses():
    """Both drives linear (the coarse one a voice coil without friction): x_c and x_f against the matrix exponential."""
    machine = load_machine(FILE)
    coarse = load_axis(FILE.parent / "voice_coil.yaml").with_values({"drive.force_constant_curvature": 0.0, "stage.mass": 3.2})
    fine = machine.fine.with_values({f"drive.{key}": [] for key in ("hysteresis_radius", "hysteresis_weight", "creep_gain", "creep_time")})
    plants = [make_piece(each, NoiseSpec.none()) for each in (coarse, fine)]
    plants[0]["guideway"]["blocks"], plants[0]["guideway"]["stick_damping"], plants[0]["quantum"] = 0, 0.0, 0.0
    states = [new_state(plant) for plant in plants]
    states[1]["x"] = 1e-6                                   # the fine stage let go
    parts = []
    for plant, state, axis in zip(plants, states, (coarse, fine)):
        law = make_controller("none", axis)
        records = [plant, state, new_work(plant), new_readings(), law.parameters, law.memory]
        parts.append(tuple(np.ndarray((1,), r.dtype, r) for r in records))
    rows, m, mf, k, d, mc = 300, 3.2, 0.2, 3.3e7, 100.0, 3.0
    trace = np.empty((rows, len(TRACE)))
    run_both(*parts, np.zeros(rows), np.zeros(rows), mf, trace)
    # (m_c + m_f) a_c + m_f a_f = K i − c v_c ;  m_f a_c + m_f a_f = −k x_f − d v_f ;  L di/dt = −R i − K v_c
    mass = np.array([[m, mf], [mf, mf]])
    force = np.array([[-4.0, 0.0, 0.0, 0.0, 12.0], [0.0, -d, 0.0, -k, 0.0]])        # of v_c, v_f, x_c, x_f, i
    a = np.vstack([np.linalg.solve(mass, force), [[1, 0, 0, 0, 0], [0, 1, 0, 0, 0], [-12.0 / 1e-3, 0, 0, 0, -2.5 / 1e-3]]])
    z = np.array([0, 0, 0, 1e-6, 0.0])
    exact = np.array([expm(a * n * 1e-4) @ z for n in range(rows)])
    assert m - mf == pytest.approx(mc)
    assert np.max(np.abs(trace[:, 7] - exact[:, 2] - exact[:, 3])) < 0.06e-6
    assert np.max(np.abs(states[0]["x"] - (expm(a * rows * 1e-4) @ z)[2])) < 0.02 * np.max(np.abs(exact[:, 2]))


def test_files_that_do_not_fit_are_refused_in_one_line(tmp_path):
    with pytest.raises(InputError, match="components.*one component; simulate, identify and diagnose"):
        load_axis(FILE)
    coil = FILE.parent / "voice_coil.yaml"
    bad = tmp_path / "bad.yaml"
    bad.write_text(f"format: 1\ncomponents: {{coarse: {coil}, fine: {coil}}}\n")
    with pytest.raises(InputError, match="drive.type: got 'voice_coil'.*such as piezo"):
        load_machine(bad)
    bad.write_text(f"format: 1\ncomponents: {{coarse: {coil}}}\n")
    with pytest.raises(InputError, match="components.*coarse: FILE, fine: FILE"):
        load_machine(bad)


@pytest.mark.parametrize("command", ["cell", "commission", "tune", "compare", "robustness", "watch"])
def test_a_command_of_one_component_refuses_two_in_one_line(command, tmp_path, capfd):
    asked = {"commission": ["--out", str(tmp_path / "out")], "compare": ["--out", str(tmp_path / "out")],
             "watch": [str(tmp_path / "r.csv")]}
    (tmp_path / "r.csv").write_text("t_s\n0.0\n")
    assert run_command(command, ["--axis", str(FILE), *asked.get(command, [])]) == 2
    said = capfd.readouterr().err
    assert said.count("\n") == 1 and said.startswith(f"{FILE}: components: got 'coarse, fine', expected"), said
    assert not (tmp_path / "out").exists()


def test_each_component_is_identified_and_the_file_of_both_written(both_records, tmp_path):
    """Commands that are a tenth off: stroke per volt, back-EMF and resistance come back."""
    machine = load_machine(FILE)
    machine.coarse.with_values({"drive.resistance": 3.8}).save(tmp_path / "coarse.yaml")
    machine.fine.with_values({"drive.displacement_per_volt": 1.26e-7}).save(tmp_path / "fine.yaml")
    given = tmp_path / "given.yaml"
    given.write_text("format: 1\ncomponents: {coarse: coarse.yaml, fine: fine.yaml}\n")
    assert identify(["--axis", str(given), *both_records["healthy"][:2], "--out", str(tmp_path / "found.yaml")]) == 0
    found = load_machine(tmp_path / "found.yaml")
    for axis, key, within in ((found.coarse, "drive.resistance", 0.01), (found.fine, "drive.displacement_per_volt", 0.005)):
        truth = machine.coarse if axis is found.coarse else machine.fine
        assert axis.value(key) == pytest.approx(truth.value(key), rel=within) and axis.quantity(key).source == "identified"
    assert found.fine.quantity("drive.hysteresis_weight").source == "estimate"  # strokes below the least radius show no loop
    assert found.coarse.value("stage.mass") == machine.coarse.value("stage.mass")  # not that of both


def test_each_component_is_diagnosed(both_records, tmp_path):
    """The weak piezo is named alone in 32 of 33 cases (95 %: 84 to 100 %; none of five at 84 %: once in 10^4 times), else it is one of two rivals."""
    healthy, hidden = both_records["healthy"], both_records["hidden"]
    with pytest.raises(InputError, match="--baseline: got 'missing'"):
        diagnose(["--axis", str(FILE), *hidden, "--out", str(tmp_path / "none")])
    for first in (20, 30, 40, 50, 60):
        assert diagnose(["--axis", str(FILE), *hidden[:2], "--holdout", *hidden[2:], "--baseline", *healthy[:2],
                         "--out", str(tmp_path / "found"), "--force"]) == 0
        fine = json.loads((tmp_path / "found" / "fine" / "report.json").read_text())
        if fine["causes"]:
            break
        assert "piezo_gain" in fine["rivals"][0]["ids"]
        hidden = _written(tmp_path, _weak(load_machine(FILE)), first)
    cause = fine["causes"][0]
    assert cause["id"] == "piezo_gain" and cause["parameters"]["change"]["value"] == pytest.approx(-0.1, abs=0.01)
    summary = json.loads((tmp_path / "found" / "summary.json").read_text())
    assert [row["case"] for row in summary] == ["coarse", "fine"] and summary[0]["verdict"] == "agrees"
