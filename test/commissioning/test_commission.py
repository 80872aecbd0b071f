"""The command from end to end, at 1 kHz: ready, refused, and an interrupted one that goes on."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
import types
from pathlib import Path

import numpy as np
import pytest
import yaml
from machines import random_axis

from microstage_ros.commands.operation import commission
from microstage_ros.commissioning import procedure, report
from microstage_ros.commissioning.estimation.parameters import with_errors_of
from microstage_ros.commissioning.store import Store
from microstage_ros.hardware.protocol import HardwareError
from microstage_ros.identification.estimators.estimate import Estimate
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import read_record

HERE = Path(__file__).parent


def sketch(folder):
    """The shipped axis at 1 kHz, with a machine within a factor of two of it."""
    axis = load_axis(config_file("axis.yaml")).with_values({"period": 1e-3}, source="derived").with_controller({"type": "self_tuning"})
    axis.save(folder / "sketch.yaml")
    random_axis(axis, 4).save(folder / "truth.yaml")
    return axis


def run(folder, out, fault="", seed=4, **more):
    """Run the command in this process. Returns the exit status."""
    (folder / "options.yaml").write_text(yaml.safe_dump({"truth": str(folder / "truth.yaml"), "fault": fault, **more}))
    return commission.main(["--axis", str(folder / "sketch.yaml"), "--backend", "machines:Machine", "--backend-options",
                            str(folder / "options.yaml"), "--out", str(out), "--seed", str(seed)])


@pytest.fixture(scope="module")
def ready(tmp_path_factory):
    folder = tmp_path_factory.mktemp("commission")
    axis = sketch(folder)
    # refused in 1 of 12 runs, though it is good, and without a word on Coulomb friction in 1 of 15; five in a row come once in 10^4 times
    for seed in range(4, 9):
        out = folder / f"out{seed}"
        if run(folder, out, seed=seed) == 0 and json.loads((out / "report.json").read_text())["parameters"]["contacts.actuator.coulomb"]["determined"]:
            return axis, out, load_axis(folder / "truth.yaml")
    raise AssertionError("refused, or friction not determined, on five seeds")


def test_report(ready):
    axis, out, truth = ready
    report = json.loads((out / "report.json").read_text())
    assert report["verdict"] == "ready" and report["format"] == 1 and report["axis"] == "axis.yaml"
    assert {"polarity", "encoder_dead", "encoder_scale", "stuck", "end_stop", "runaway", "delay", "resonance", "current_missing",
            "current_polarity"} == {check["id"] for check in report["checks"]} and all(check["passed"] for check in report["checks"])
    assert report["margins"]["measured"] and report["used"]["time_s"] < 300.0
    assert axis.value("travel.minimum") < report["used"]["travel_min_m"] < report["used"]["travel_max_m"] < axis.value("travel.maximum")
    assert report["used"]["voltage_max_V"] <= axis.value("drive.voltage_limit")
    assert [row["target_m"] for row in report["moves"]] == [1e-6, 1e-5, 1e-4, 1e-3] and all(row["n"] == 10 and row["n_down"] == 5 for row in report["moves"])
    worst = max(row["bidirectional_m"] for row in report["moves"])
    assert report["iso230"]["repeatability_m"] == pytest.approx(worst) and worst >= max(row["four_s_m"] for row in report["moves"]) - 1e-15
    assert report["iso230"]["reversal_m"] == pytest.approx(max(abs(row["reversal_m"]) for row in report["moves"]))
    # half the interval of Coulomb friction: 0.31 to 0.53 of it in 17 runs (seeds 100 to 115 and one more; 0.39, e^0.13 of scatter), beyond 0.7 once in 10^5
    for key, within in (("drive.resistance", 0.02), ("drive.back_emf", 0.01), ("drive.rotor_inertia", 0.1), ("contacts.actuator.coulomb", 0.7)):
        found = report["parameters"][key]  # twice the interval of 95 %: four standard uncertainties
        assert found["determined"] and found["high"] - found["low"] < 2.0 * within * truth.value(key), key
        assert abs(found["value"] - truth.value(key)) <= found["high"] - found["low"], key


def test_the_axis_file_is_one_like_any_other(ready):
    _, out, truth = ready
    axis = load_axis(out / "axis.yaml")
    # self_tuning_feedforward in 10 of 15 runs, the observer law in four, and in one pid_feedforward, which the other two follow (`law_choice`)
    assert axis.controller["type"] in ("self_tuning_observer", "self_tuning_feedforward", "pid_feedforward", "self_tuning")
    assert axis.quantity("drive.back_emf").stderr > 0.0 and axis.quantity("drive.back_emf").source == "identified"
    ratio = (axis.value("transmission.stiffness") / axis.value("stage.mass")) / (truth.value("transmission.stiffness") / truth.value("stage.mass"))
    assert ratio == pytest.approx(1.0, rel=0.1)


def test_axis_file_and_report_state_one_uncertainty_of_a_number(ready):
    """The file had 0.7 % of a stiffness where the report had 30, and 15 % of a length of which the report said 62 and not determined."""
    _, out, _ = ready
    axis, parameters = load_axis(out / "axis.yaml"), json.loads((out / "report.json").read_text())["parameters"]
    both = [key for key in parameters if axis.has(key) and axis.quantity(key).stderr is not None]
    assert {"transmission.stiffness", "transmission.damping", "drive.back_emf", "contacts.actuator.coulomb"} <= set(both)
    for key in both:
        assert axis.value(key) == parameters[key]["value"] and axis.quantity(key).stderr == parameters[key]["stderr"], key
    assert "for a stage of" in " ".join(json.loads((out / "report.json").read_text())["remarks"])


def test_what_the_systematic_part_takes_back_has_its_uncertainty_in_the_file_too():
    axis = load_axis(config_file("axis.yaml")).with_values({"variability.travel_length": 2e-4, "drive.resistance": 3.4}, source="identified",
                                                           stderr={"variability.travel_length": 3e-5, "drive.resistance": 1e-4})
    wide = Estimate("variability.travel_length", 2e-4, "m", 1.2e-4, -3.5e-5, 4.4e-4, False, "", "known within some 60% only")
    other = Estimate("drive.resistance", 3.5, "ohm", 0.02, 3.46, 3.54, False, "", "the file keeps another value")
    found = with_errors_of(axis, {wide.key: wide, other.key: other})
    assert found.quantity(wide.key).stderr == 1.2e-4 and found.quantity(other.key).stderr == 1e-4


def test_the_frequency_response(ready):
    _, out, _ = ready
    with open(out / "frequency_response.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {"frequency_Hz", "magnitude", "phase_deg", "coherence", "amplitude_m"} <= set(rows[0])
    assert {row["of"] for row in rows} == {"plant", "loop"} and {row["condition"] for row in rows} == {"rest", "sliding"}
    assert all(0.0 <= float(row["coherence"]) <= 1.0 and np.isfinite(float(row["magnitude"])) for row in rows)
    assert len(list((out / "records").iterdir())) >= 12
    assert "encoder_m" in read_record(sorted((out / "records").iterdir())[6])


def test_a_finished_one_is_not_overwritten(ready):
    _, out, _ = ready
    with pytest.raises(InputError, match="without a finished commissioning"):
        run(out.parent, out)


def test_a_refusal_has_status_3_and_says_why(tmp_path):
    sketch(tmp_path)
    assert run(tmp_path, tmp_path / "out", "motor_polarity") == 3
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    failed = [check for check in report["checks"] if not check["passed"]]
    assert report["verdict"] == "refused" and [check["id"] for check in failed] == ["polarity"] and "swap" in failed[0]["says"]
    assert (tmp_path / "out" / "report.html").exists() and not (tmp_path / "out" / "axis.yaml").exists()


def test_an_end_stop_inside_the_travel(tmp_path):
    sketch(tmp_path)
    assert run(tmp_path, tmp_path / "out", "end_stop") == 3
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    failed = [check for check in report["checks"] if not check["passed"]]
    assert [check["id"] for check in failed] == ["end_stop"] and failed[0]["value"] == pytest.approx(4e-3, abs=1e-4)
    names = sorted(path.name for path in (tmp_path / "out" / "records").iterdir())
    assert any("failed" in name for name in names) and any("strokes" in name for name in names)


def test_an_interrupted_one_goes_on(tmp_path, monkeypatch):
    sketch(tmp_path)

    def interrupted(*arguments, **named):
        os.kill(os.getpid(), signal.SIGTERM)  # as a closed terminal or a shutdown of the host does: like Ctrl-C
        time.sleep(10.0)

    with monkeypatch.context() as patch:
        patch.setattr(procedure, "identified", interrupted)
        assert run(tmp_path, tmp_path / "out") == 3
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["verdict"] == "stopped" and "goes on" in report["says"]
    seen = []
    monkeypatch.setattr(procedure, "identified", lambda records, *rest: seen.append(records) or interrupted())
    before = len(list((tmp_path / "out" / "records").iterdir()))
    assert run(tmp_path, tmp_path / "out") == 3
    assert len(seen[0]) == 2 and Store(tmp_path / "out", _identity(tmp_path)).resumed
    assert len(list((tmp_path / "out" / "records").iterdir())) - before <= 5  # neither stroke nor programme was made again


def test_a_killed_one_leaves_no_voltage(tmp_path, monkeypatch):
    """Where a backend says how, another process takes the voltage away when this one is gone."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")]))
    cut = tmp_path / "cut"
    told = types.SimpleNamespace(simulated=False, outside_stop=lambda: ("machines:cut_voltage", {"path": str(cut)}))
    guard = commission.watched(told)
    assert guard.watching and not cut.exists()
    guard.close()  # as the end of this process would: its end of the pipe is closed
    assert cut.exists()
    assert commission.watched(types.SimpleNamespace(simulated=False)) is None
    told.simulated = True
    assert commission.watched(told) is None


def test_a_drive_that_cannot_be_disabled_is_closed_all_the_same(monkeypatch, tmp_path):
    calls = []

    class Card:
        simulated = True

        def open(self):
            calls.append("open")

        def enable(self, on):
            calls.append(f"enable {on}")
            raise HardwareError("bus busy")

        def close(self):
            calls.append("close")

    monkeypatch.setattr(procedure, "commission", lambda *_: procedure.Outcome(says="done"))
    monkeypatch.setattr(report, "write_answer", lambda *_: None)
    monkeypatch.setattr(report, "report_tree", lambda *_: {})
    monkeypatch.setattr(commission, "_tell", lambda *_: None)
    arguments = types.SimpleNamespace(axis="a.yaml", backend="card", seed=1, out=str(tmp_path))
    sketched = types.SimpleNamespace(axis=sketch(tmp_path))
    assert commission._run(arguments, sketched, Card(), types.SimpleNamespace(resumed=False)) == 3
    assert calls == ["open", "enable False", "close"]


def _identity(folder):
    text = (folder / "sketch.yaml").read_text(encoding="utf-8")
    options = yaml.safe_dump(yaml.safe_load((folder / "options.yaml").read_text()))
    return f"{text}\nmachines:Machine\n{options}\n4"


def test_from_the_shell_nothing_is_asked_of_a_simulated_machine(tmp_path):
    """One line and status 2 for a sketch that lacks what must be given."""
    axis = sketch(tmp_path).as_dict()
    del axis["drive"]["voltage_limit"]
    (tmp_path / "sketch.yaml").write_text(yaml.safe_dump(axis))
    done = subprocess.run([sys.executable, "-m", "microstage_ros.commands", "commission", "--axis", str(tmp_path / "sketch.yaml"), "--out",
                           str(tmp_path / "out")], capture_output=True, text=True, check=False, env=os.environ)
    assert done.returncode == 2 and "drive.voltage_limit" in done.stderr and len(done.stderr.strip().splitlines()) == 1
