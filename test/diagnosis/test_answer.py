"""The files of an answer: report.json as the contract has it, extended.yaml that runs, a page, experiments."""

import dataclasses
import json

import numpy as np
import pytest
import yaml

from microstage_ros.commands.operation.experiment import reference_of
from microstage_ros.control.runs.run_file import Run, load_run, run_from_dict
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.diagnosis.report.answer import write_answer
from microstage_ros.diagnosis.report.experiment import WHY, separating_run
from microstage_ros.diagnosis.report.page import headline
from microstage_ros.diagnosis.report.wording import TONES, worded
from microstage_ros.diagnosis.report.wording import VERDICTS as SENTENCES
from microstage_ros.diagnosis.result import (
    VERDICTS,
    Cause,
    Diagnosis,
    Finding,
    Improvement,
    OverallImprovement,
    Parameter,
    Picture,
    Rivals,
)
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.effects import REGISTRY
from microstage_ros.model.top_speed import top_speed
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError
from test.diagnosis.emps import ROOT

SOURCES = {"records": ["a<b>.csv"], "holdout": [], "baseline": []}


@pytest.fixture
def axis():
    return load_axis(ROOT / "config/axis.yaml")


@pytest.fixture
def diagnosis():
    cause = Cause("backlash", {"width_rad": Parameter(0.017, 0.001, "rad")}, {"width_rad": 0.017}, 0.99, 0.83,
                  Improvement(0.031, 0.012, "V"), "voltage", "The gearhead has 17 mrad of lost motion.")
    rivals = Rivals(("transport_delay", "actuator_lag"), "both shift the phase", {})
    gain = OverallImprovement("voltage", "V", ("hold.csv",), 0.031, 0.012, 0.01, (0.011, 0.013))
    x = np.linspace(0, 1, 50)
    picture = Picture("travel", "Lost motion", "position [m]", "voltage [V]", {"measured": (x, x), "model": (x, x**2, 0.1 * x)}, "backlash")
    findings = (Finding("voltage", "reversal", 9.0, 1.2, 0.8), Finding("voltage", "position", 1.0, 1.2, float("nan")))
    return Diagnosis("undetermined", (cause,), (rivals,), gain, findings, (picture,), ("a note & more",), 7,
                     {"stage.mass": Parameter(3.1, 0.02, "kg")}, {"transport_delay": {"delay_s": 1e-4}})


def test_report_has_the_fields_of_the_contract(diagnosis, axis, tmp_path):
    write_answer(diagnosis, axis, tmp_path / "deep" / "out", SOURCES)
    report = json.loads((tmp_path / "deep/out/report.json").read_text())
    assert report["format"] == 1 and report["verdict"] in VERDICTS and report["extended_axis"] == "extended.yaml"
    cause = report["causes"][0]
    assert cause["id"] == "backlash" and cause["parameters"]["width_rad"] == {"value": 0.017, "stderr": 0.001, "unit": "rad"}
    assert {"probability", "share"} <= cause.keys() and cause["gain"] == {"before": 0.031, "after": 0.012, "unit": "V"}
    assert set(report["rivals"][0]) == {"ids", "why", "experiment"}
    assert report["gain"] == {"metric": "voltage", "unit": "V", "records": ["hold.csv"], "before": 0.031, "after": 0.012,
                              "floor": 0.01, "ci95": [0.011, 0.013]}
    assert report["seed"] == 7 and report["version"]


def test_extended_axis_holds_causes_stand_ins_and_refitted_numbers_and_runs(diagnosis, axis, tmp_path):
    write_answer(diagnosis, axis, tmp_path, SOURCES)
    extended = load_axis(tmp_path / "extended.yaml")
    assert extended.effects["backlash"]["width_rad"] == 0.017 and extended.effects["transport_delay"]["delay_s"] == 1e-4
    assert extended.quantity("stage.mass").source == "identified" and extended.value("stage.mass") == 3.1
    assert extended.provenance["seed"] == 7 and extended.provenance["stand_ins"] == {"transport_delay": ["actuator_lag"]}
    columns = simulate(extended, Run(program=[{"move_to_m": 1e-5}]), seed=1)
    assert 1e-6 < columns["encoder_m"].max() < 5e-5


def test_the_experiment_is_a_run_file(diagnosis, axis, tmp_path):
    report = write_answer(diagnosis, axis, tmp_path, SOURCES)
    run = load_run(tmp_path / report["rivals"][0]["experiment"])
    assert run.program and run.period_s == axis.value("period")


@pytest.mark.parametrize("file", ["axis.yaml", "emps.yaml", "axes/current_motor.yaml", "axes/piezo.yaml", "axes/stepper.yaml", "axes/voice_coil.yaml"])
@pytest.mark.parametrize("ids", [sorted(name for name, effect in REGISTRY.items() if effect.separated_by == way) for way in WHY])
def test_every_experiment_is_one_that_a_cell_can_play(ids, file, tmp_path):
    """On the axis, and no longer than ``experiment`` takes: two of the five were, for every axis."""
    axis = load_axis(config_file(file))
    path = tmp_path / "run.yaml"
    path.write_text(yaml.safe_dump(separating_run(ids, axis)))
    reference = reference_of(load_run(path), axis)      # refuses what leaves the travel, and what is too long
    assert len(reference) * axis.value("period") > 5.0 and np.ptp(reference) > 10 * axis.value("sensors.encoder.resolution")


def test_the_page_says_what_the_report_says_and_needs_nothing_beside_it(diagnosis, axis, tmp_path):
    report = write_answer(diagnosis, axis, tmp_path, SOURCES)
    text = (tmp_path / "report.html").read_text()
    assert "17 mrad of lost motion" in text and "Lost motion at reversal" in text and "separate_1.yaml" in text
    assert report["consequences"] and "What it means for the work" in text
    assert all(f">{cause['probability']:.2f}</td>" in text for cause in report["causes"]) and report["causes"]
    assert "a&lt;b&gt;.csv" in text and "a note &amp; more" in text
    assert "http://" not in text.replace("http://www.w3.org", "") and "https://" not in text


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict_has_a_page(verdict, axis, tmp_path):
    report = write_answer(Diagnosis(verdict), axis, tmp_path, SOURCES)
    assert set(report["gain"]) == {"metric", "unit", "records", "before", "after", "floor", "ci95"}      # of every verdict
    assert report["gain"]["records"] == SOURCES["records"] and report["gain"]["ci95"] == [None, None]
    assert "not measured" in report["gain"]["metric"] and SENTENCES[verdict] in (tmp_path / "report.html").read_text()
    assert verdict in TONES


def test_every_effect_has_words():
    assert all(effect.label and effect.remedy and effect.__doc__ for effect in REGISTRY.values())


def test_a_folder_that_cannot_be_written_is_told(diagnosis, axis, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file: not a directory"):
        write_answer(diagnosis, axis, tmp_path / "file", SOURCES)


def test_a_sure_cause_is_not_said_to_be_untold():
    """"Something is there, but these records cannot tell what: lost motion" stood above a sure lost motion."""
    report = {"verdict": "undetermined", "causes": [{"id": "backlash"}], "rivals": [{"ids": ["transport_delay", "actuator_lag"]}]}
    said = headline(report)
    assert said.startswith("Found: ") and "cannot tell what: " not in said and " Open: " in said
    assert headline(report | {"causes": []}).startswith(SENTENCES["undetermined"])


def test_the_page_calls_effects_by_their_names():
    """Their ids are report.json's: a sentence that explains rivals had them, and a caption."""
    said = worded("transport_delay and actuator_lag leave the same trace", ("transport_delay", "actuator_lag"))
    assert said == "“the command arrives late” and “the amplifier follows with a lag” leave the same trace"
    assert worded("backlash is not asked", ()) == "backlash is not asked"


def test_a_picture_is_called_by_its_cause_once(diagnosis, axis, tmp_path):
    x = np.linspace(0.0, 1.0, 50)
    gap = Picture("gap", "backlash: stage against motor", "time [s]", "stage [m]", {"measured": (x, x), "model": (x, x**2)}, "backlash")
    write_answer(dataclasses.replace(diagnosis, pictures=(gap,)), axis, tmp_path / "out", SOURCES)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "<figcaption>Lost motion at reversal: stage against motor</figcaption>" in page and "backlash: stage" not in page


@pytest.mark.parametrize("half, count", [(7.5e-3, 5e-6), (15e-3, 1e-5), (1e-3, 1e-6), (5e-2, 25e-9), (1e-1, 25e-9)])
@pytest.mark.parametrize("way", WHY)
def test_an_experiment_fits_any_travel_and_leaves_the_drive_room(way, half, count):
    """A coarse encoder's amplitudes went beyond the travel, and a long axis's speeds to the voltage limit."""
    axis = load_axis(config_file("axis.yaml")).with_values(
        {"travel.minimum": -half, "travel.maximum": half, "sensors.encoder.resolution": count, "period": 1e-3}, source="estimate")
    ids = sorted(name for name, effect in REGISTRY.items() if effect.separated_by == way)
    run = run_from_dict(separating_run(ids, axis), "separate_1.yaml")
    reference = reference_of(run, axis)
    assert np.abs(np.diff(reference)).max() / 1e-3 < 0.5 * top_speed(axis) and np.abs(reference).max() <= half


def test_effects_of_the_axis_file_are_said_not_to_be_compared(diagnosis, axis, tmp_path):
    report = write_answer(diagnosis, axis, tmp_path / "bare", SOURCES)
    assert not any("effects of the axis file" in note for note in report["notes"])
    worn = axis.with_effects({"backlash": {"width_rad": 0.01}})
    report = write_answer(diagnosis, worn, tmp_path / "worn", SOURCES)
    assert any(note.startswith("The effects of the axis file (backlash) are not in the model") for note in report["notes"])
