"""The commands ``diagnose`` and ``campaign`` from the outside."""

import json

import numpy as np
import pytest

from microstage_ros.commands.__main__ import main
from microstage_ros.commands.analysis import campaign as campaign_command
from microstage_ros.control.runs.run_file import Run
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.diagnosis.validation import campaign
from microstage_ros.diagnosis.validation import fault_injection as hidden
from microstage_ros.diagnosis.validation.campaign import Outcome
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.effects import check_effects, effects_of
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import Record, write_record
from microstage_ros.solver.plant import make_plant
from test.diagnosis.emps import ROOT, there_and_back

AXIS = ROOT / "config/emps.yaml"
NOISE = {"encoder_m": 2e-8, "voltage_V": 2e-3, "current_A": 0.0, "interferometer_m": 0.0, "friction_relative": 0.0}


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    """Two folders with a record each of a healthy force-driven axis."""
    top = tmp_path_factory.mktemp("axes")
    for name, seed in (("one", 3), ("two", 4)):
        columns = simulate(load_axis(AXIS), Run(noise=NOISE, program=[{"reference": there_and_back(2)}]), seed=seed)
        record = Record(1e-3, {k: columns[k] for k in ("encoder_m", "reference_m", "voltage_V")})
        (top / name).mkdir()
        write_record(record, top / name / "rec.csv")
    return top


def test_one_axis(healthy, tmp_path, capsys):
    assert main(["diagnose", "--axis", str(AXIS), str(healthy / "one/rec.csv"), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr()
    assert "agrees" in printed.out and "held back by the program" in printed.out and printed.err == ""
    report = json.loads((tmp_path / "out/report.json").read_text())
    assert (report["verdict"], report["causes"]) == ("agrees", [])
    assert {"report.html", "extended.yaml", "report.json"} <= {path.name for path in (tmp_path / "out").iterdir()}
    assert load_axis(tmp_path / "out/extended.yaml").effects == {}


def test_many_axes_on_two_processes(healthy, tmp_path, capsys):
    bad = healthy / "bad"
    bad.mkdir(exist_ok=True)
    (bad / "rec.csv").write_text("t_s,encoder_m,reference_m,voltage_V\n0,0,0,x\n")
    folders = [str(healthy / name) for name in ("one", "two", "bad")]
    status = main(["diagnose", "--axis", str(AXIS), *folders, "--each", "--jobs", "2", "--out", str(tmp_path)])
    rows = json.loads((tmp_path / "summary.json").read_text())
    assert status == 1 and [row["case"] for row in rows] == ["bad", "one", "two"]
    assert "field voltage_V" in rows[0]["error"] and [row["verdict"] for row in rows[1:]] == ["agrees", "agrees"]
    assert (tmp_path / "two/report.html").exists() and "field voltage_V" in capsys.readouterr().out


def test_the_same_work_on_a_dask_cluster(healthy, tmp_path):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:
        status = main(["diagnose", "--axis", str(AXIS), str(healthy / "one"), "--each", "--scheduler", cluster.scheduler_address,
                       "--out", str(tmp_path)])
    assert status == 0 and json.loads((tmp_path / "one/report.json").read_text())["verdict"] == "agrees"


@pytest.mark.parametrize("arguments, told", [
    (["--axis", "none.yaml", "r.csv"], "none.yaml"),
    (["--axis", str(AXIS), "none.csv"], "none.csv"),
    (["--axis", str(AXIS), "r.csv", "--jobs", "0"], "--jobs"),
    (["--axis", str(AXIS), ".", "--each"], "no records"),
    (["--axis", str(AXIS), "none.csv", "--each"], "not a folder"),
    (["--axis", str(AXIS), ".", "--each", "--baseline", "b.csv"], "--baseline: got 'b.csv', expected nothing beside --each: files base*"),
    (["--axis", str(AXIS), ".", "--each", "--holdout", "h.csv"], "--holdout: got 'h.csv', expected nothing beside --each: files hold*"),
])
def test_bad_input_is_one_line_and_status_2(arguments, told, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["diagnose", *arguments, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert told in error and error.count("\n") == 1 and "Traceback" not in error


def test_a_scheduler_that_is_not_there_is_told(healthy, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("microstage_ros.diagnosis.fleet.PATIENCE", "1s")
    status = main(["diagnose", "--axis", str(AXIS), str(healthy / "one"), "--each", "--scheduler", "tcp://127.0.0.1:9",
                   "--out", str(tmp_path)])
    assert status == 2 and "--scheduler" in capsys.readouterr().err


def test_a_campaign_goes_through_the_catalogue_and_every_draw_is_an_effect():
    names = effects_of(load_axis(ROOT / "config/axis.yaml"))
    examined = campaign.examinations(len(names), 5, str(ROOT / "config/axis.yaml"), "single")
    drawn = [campaign.draw(one)[0] for one in examined]
    assert {what.ids[0] for what in drawn} == set(names)
    for what in drawn:
        check_effects(what.effects)
    again = campaign.draw(examined[3])[0]
    assert again.effects == drawn[3].effects
    assert campaign.draw(campaign.examinations(4, 6, str(ROOT / "config/axis.yaml"), "single")[3])[0].effects != drawn[3].effects


@pytest.mark.parametrize("kind", sorted(hidden.OUTSIDE))
def test_what_is_outside_the_catalogue_moves_the_plant_or_a_reading(kind):
    what, plant = hidden.outside(kind, np.random.default_rng(3)), make_plant(load_axis(ROOT / "config/axis.yaml"))
    assert what.outside and not what.ids and (what.change is None) != (what.after is None)
    t = np.arange(0.0, 3.0, 1e-3)
    path = 1e-3 * np.sin(2.0 * t)
    if what.after:
        columns = {"t_s": t, "encoder_m": path, "interferometer_m": path.copy()}
        what.after(columns, np.random.default_rng(4))
        assert 2e-8 < np.std(columns["interferometer_m"] - path) < 1e-6
        return
    before, seen = plant.copy(), set()
    for time, x in zip(t, path):
        what.change(plant, {"x": x}, time)
        seen |= {name for name in plant.dtype.names if not np.array_equal(plant[name], before[name])}
    assert len(seen - {"smooth"}) == 1


def test_a_drift_of_its_own_differs_from_record_to_record():
    draws = [hidden.one("thermal_drift", np.random.default_rng(seed)) for seed in range(12)]
    own = next(what for what in draws if what.after)
    assert own.ids == ("thermal_drift",) and not own.effects and any(what.effects for what in draws)
    t = np.arange(0.0, 20.0, 0.01)
    first, second = ({"t_s": t, "interferometer_m": np.zeros(len(t))} for _ in range(2))
    generator = np.random.default_rng(5)
    own.after(first, generator)
    own.after(second, generator)
    courses = np.corrcoef(first["interferometer_m"], second["interferometer_m"])[0, 1]
    assert np.std(first["interferometer_m"]) > 3e-8 and abs(courses) < 0.99


def _outcome(kind, ids, named, verdict="explained", rivals=(), covers=(), after=0.1):
    name = "+".join(ids) or kind
    return Outcome(0, kind, tuple(ids), name, verdict, tuple(named), rivals, covers, 1.0, after, 0.1, 2.0, {})


def test_scores_count_what_they_say():
    outcomes = [
        _outcome("single", ["backlash"], ["backlash"], covers=(("backlash.width_rad", True),)),
        _outcome("single", ["backlash"], ["cable_spring"], after=0.9),
        _outcome("single", ["backlash"], [], "undetermined", (("backlash", "drive_compliance"),)),
        _outcome("two", ["backlash", "gravity_tilt"], ["gravity_tilt"], covers=(("gravity_tilt.angle_rad", False),)),
        _outcome("healthy", [], [], "agrees"), _outcome("healthy", [], ["backlash"]), _outcome("healthy", [], [], "unexplained"),
        _outcome("outside", [], [], "unexplained"), _outcome("outside", [], [], "agrees"),
    ]
    counts, medians = campaign.scores(outcomes)
    assert counts["single: right name first"] == (1, 3) and counts["single: undetermined"] == (1, 3)
    assert counts["single: a wrong name first"] == (1, 3)
    assert counts["two: both named"] == (0, 1) and counts["two: at least one named"] == (1, 1)
    assert counts["healthy: something named"] == counts["healthy: unexplained"] == (1, 3) and counts["healthy: false alarms"] == (2, 3)
    assert counts["outside: a wrong name"] == (0, 2) and counts["outside: seen, and not explained away"] == (1, 2)
    assert counts["sizes inside their 95 % interval"] == (1, 2)
    assert counts["right and 90 % of the way to the noise"] == (1, 1) and medians["seconds per case, median"] == 2.0
    table = campaign.confusion(outcomes)
    assert table["backlash"] == {"backlash": 1, "cable_spring": 1, "undetermined, right one among them": 1}


def test_the_campaign_command_writes_what_it_prints(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(campaign, "examine", lambda examination: _outcome("single", ["backlash"], ["backlash"]))
    assert main(["campaign", "--cases", "3", "--json", str(tmp_path / "c.json")]) == 0
    tree = json.loads((tmp_path / "c.json").read_text())
    assert tree["figures"]["single: right name first"] == [3, 3] and len(tree["cases"]) == 3
    assert "3 of 3" in capsys.readouterr().out


def test_the_campaign_command_refuses_what_is_not_right(capsys):
    for arguments in (["--cases", "0"], ["--effect", "gremlins"], ["--strength", "-1"]):
        with pytest.raises(InputError):
            campaign_command.main(arguments)
    assert np.isnan(_outcome("healthy", [], [], after=0.1).removed) is np.False_


def test_a_long_series_is_diagnosed_in_groups(healthy, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("microstage_ros.diagnosis.batch.LARGEST", 1)
    monkeypatch.setattr("microstage_ros.diagnosis.pooling.GROUP", 1)
    monkeypatch.setattr("microstage_ros.diagnosis.pooling.groups_of.__defaults__", (1,))
    records = [str(healthy / name / "rec.csv") for name in ("one", "two")]
    assert main(["diagnose", "--axis", str(AXIS), *records, "--out", str(tmp_path)]) == 0
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["verdict"] == "agrees" and "2 groups" in report["notes"][0]
    assert (tmp_path / "groups/0002/report.html").exists() and len(report["gain"]["records"]) == 2
