"""The limit-cycle experiment, the search, and the comparison in its smallest form."""

import json
import pathlib
import sys

import numpy as np
import pytest

from microstage_ros.commands.analysis import compare as compare_command
from microstage_ros.commands.analysis import simulate as simulate_command
from microstage_ros.commands.analysis import tune as tune_command
from microstage_ros.control.evaluation import comparison
from microstage_ros.control.evaluation import reference_controllers as yardsticks
from microstage_ros.control.evaluation.limits import limits as what_not_knowing_costs
from microstage_ros.control.runs.trials import sine_trial
from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.tuning import tuning
from microstage_ros.control.tuning.margins import Margins
from microstage_ros.model.axis_file import load_axis
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import read_record
from microstage_ros.report.comparison import within_twice

ROOT = pathlib.Path(__file__).resolve().parents[2]

AXIS = str(ROOT / "config" / "axis.yaml")


def test_breakaway_voltage_is_that_of_both_contacts(axis):
    assert tuning.breakaway_voltage(axis) == pytest.approx(3.41 / 6.59e-3 * (219e-6 + 0.9 * 2e-3 / 2 / np.pi / 19), rel=1e-6)


def test_limit_cycle_swings_and_ziegler_nichols_follows(axis):
    cycle = tuning.limit_cycle(axis, duration=0.6)
    assert 0.005 < cycle.ultimate_period < 0.05 and 1e5 < cycle.ultimate_gain < 1e6
    gains = tuning.ziegler_nichols(cycle)
    assert gains["proportional"] == 0.6 * cycle.ultimate_gain
    assert gains["integral_time"] / gains["derivative_time"] == pytest.approx(4.0)
    trial = sine_trial(axis, "pid", gains, 1e-5, 0.5, seed=0)
    assert trial.peak < 2e-6  # rough, but it tracks


def test_relay_below_breakaway_is_refused(axis):
    with pytest.raises(InputError, match="breakaway"):
        tuning.limit_cycle(axis, relay=0.03, duration=0.5)


def test_search_finds_the_least_of_a_bowl():
    start = {"proportional": 1.0, "integral_time": 1.0, "derivative_time": 1.0, "filter_time": 1.0, "other": 5.0}

    def bowl(gains):
        return sum((np.log(gains[name]) - 0.4) ** 2 for name in tuning.SEARCHED)

    best, cost = tuning.search(bowl, start, 300, seed=1)
    assert cost < 0.02 and best["other"] == 5.0
    again, _ = tuning.search(bowl, start, 300, seed=1)
    assert again == best
    forbidden, _ = tuning.search(bowl, start, 20, accept=lambda gains: False)
    assert forbidden == start


def test_overshoot_costs(axis, monkeypatch):
    gains = {name: float(make_controller("pid", axis).parameters["pid"][name]) for name in
             ("proportional", "integral_time", "derivative_time", "filter_time", "derivative_on_reference")}
    assert tuning.allowed_overshoot(1e-6) == 50e-9 and tuning.allowed_overshoot(1e-5) == pytest.approx(5e-7)
    on_position = {**gains, "derivative_on_reference": 0.0}  # kicks the motor at the start of a move
    before = tuning.cost_of(axis, "pid", on_position, (0,))
    monkeypatch.setattr(tuning, "allowed_overshoot", lambda distance: 1.0)
    assert before > tuning.cost_of(axis, "pid", on_position, (0,)) + 100.0


def test_candidates_without_margin_are_not_simulated():
    good = Margins("pre-sliding", True, 40.0, 7.0, 1e9, 100.0, 2.0)
    assert tuning.guarded([good])
    assert not tuning.guarded([good._replace(gain_db=5.0)]) and not tuning.guarded([good._replace(phase_deg=25.0)])


def test_fine_tuning_improves_and_keeps_the_margins(axis):
    start = tuning.ziegler_nichols(tuning.limit_cycle(axis, duration=0.6))
    before = tuning.cost_of(axis, "pid", start, (0,))
    found = tuning.fine_tune(axis, "pid", start, seeds=(0,), evaluations=3)
    assert found.cost <= before and len(found.margins) == 3


def test_tune_command_writes_an_axis_file(tmp_path, capsys):
    out = tmp_path / "tuned.yaml"
    assert tune_command.main(["--axis", AXIS, "--out", str(out), "--evaluations", "0"]) == 0
    assert load_axis(out).controller["pid"]["proportional"] > 0.0
    assert "Ziegler-Nichols" in capsys.readouterr().out


def test_simulate_command_writes_what_read_record_reads(tmp_path):
    (tmp_path / "run.yaml").write_text("controller: {type: pid}\nprogram:\n  - {move_to_m: 1.0e-6, dwell_s: 0.01}\n")
    for ending in ("csv", "csv.xz", "mcap"):
        out = tmp_path / f"a.{ending}"
        assert simulate_command.main(["--axis", AXIS, "--run", str(tmp_path / "run.yaml"), "--out", str(out), "--seed", "3"]) == 0
        record = read_record(out)
        assert record["reference_m"][-1] == pytest.approx(1e-6) and "voltage_V" in record
    (tmp_path / "bad.yaml").write_text("controller: {type: pid, proportional: -4}\nprogram:\n  - {move_to_m: 1.0e-6}\n")
    with pytest.raises(InputError, match="bad.yaml: controller.proportional"):
        simulate_command.main(["--axis", AXIS, "--run", str(tmp_path / "bad.yaml"), "--out", str(tmp_path / "b.csv")])
    with pytest.raises(InputError, match="csv"):
        simulate_command.main(["--axis", AXIS, "--run", str(tmp_path / "run.yaml"), "--out", str(tmp_path / "a.txt")])


def facts_of(folder):
    return json.loads((folder / "comparison.json").read_text())


def test_within_twice_the_nominal_peak_is_told_with_its_limit():
    stress = {"nominal": {"self_tuning": {"peak": 3e-8}}, "a": {"self_tuning": {"peak": 5e-8}},
              "b": {"self_tuning": {"peak": 9e-8}, "best_pid": {"peak": 7e-8}}, "c": {"self_tuning": {"peak": 9e-8}, "best_pid": {"peak": 5e-8}},
              "d": {"self_tuning": {"peak": 9e-8}, "best_pid": {"peak": 2e-7}}}
    told = [within_twice(stress, name, "self_tuning") for name in "abcd"]
    assert told == ["yes (1.7)", "no (3.0), limit 70.0", "no (3.0)", "no (3.0), limit 90.0"]


def test_searched_friction_share_and_fresh_seeds(axis):
    gains, peak = yardsticks.best_for_sine(axis, (100, 101), 1e-6, 1.0, 2, "pid_feedforward")
    assert 0.0 < gains["friction_share"] <= yardsticks.MOST_SHARE
    fresh = [sine_trial(axis, "pid_feedforward", gains, 1e-6, 1.0, seed).peak for seed in (100, 101)]
    assert peak == max(fresh)


def test_compare_command_makes_page_tables_and_data(tmp_path, monkeypatch, capsys):
    smallest = comparison.Extent(seeds=1, moves=2, searches=1, sines=((1e-5, 1.0),), stress_searches=1)
    monkeypatch.setattr(comparison, "QUICK", smallest)
    monkeypatch.setattr(comparison, "STRESS", {"nominal": {}, "delay": comparison.STRESS["delay of 1 sample"]})
    monkeypatch.setattr(comparison, "DISTANCES", (1e-6, 1e-4))
    monkeypatch.setattr(comparison, "TRACKING_SINE", (1e-5, 1.0))
    for name, fewer in (("GAIN_JUMPS", (0.5,)), ("DOUBTS", comparison.DOUBTS[1:3]), ("LEVEL_JUMPS", (0.85,)),
                        ("limits", lambda evaluation: what_not_knowing_costs(evaluation, (5e-4,)))):
        monkeypatch.setattr(comparison, name, fewer)
    document = tmp_path / "doc.md"
    document.write_text("before\n<!-- compare: Sines, worst peak (nm) -->\nold\n<!-- end -->\nafter\n")
    assert compare_command.main(["--out", str(tmp_path), "--quick", "--jobs", "1", "--update", str(document),
                                 "--controllers", "pid", "self_tuning_observer"]) == 0
    written = document.read_text()
    assert "old" not in written and "| 10 µm, 1 Hz |" in written and written.endswith("<!-- end -->\nafter\n")
    limits = facts_of(tmp_path)["stress"]["delay"]
    assert limits["perfect_observer"]["peak"] < limits["best_pid"]["peak"]
    facts = facts_of(tmp_path)
    assert facts["tracking"]["self_tuning_observer"]["worst"] < facts["tracking"]["pid"]["worst"]
    assert "4s" in (tmp_path / "tables.md").read_text()
    page = (tmp_path / "report.html").read_text()
    assert "self_tuning_observer" in page and "http" not in page.split("<body")[0]
    assert "report.html" in capsys.readouterr().out
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "report"))
    from browser import check_pages

    check_pages([tmp_path / "report.html"])
