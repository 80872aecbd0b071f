"""Maintenance tasks: each kind of part is added in a copy by one new file and at most two of ours, and works everywhere."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from patches import TASKS

ROOT = Path(__file__).resolve().parents[2]
MOST_EDITED = 2


def apply(patch, package):
    """Write a patch into a copy of the package; every place that it edits has to be there once."""
    for path, text in patch["new"].items():
        target = package / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text.lstrip("\n"), encoding="utf-8")
    for path, edits in patch["edits"].items():
        text = (package / path).read_text(encoding="utf-8")
        for old, new in edits:
            assert text.count(old) == 1, f"{path}: {old!r} stands there {text.count(old)} times"
            text = text.replace(old, new)
        (package / path).write_text(text, encoding="utf-8")


@pytest.mark.parametrize("task", TASKS)
def test_a_part_is_one_new_file_and_at_most_two_of_ours(task):
    assert len(TASKS[task]["new"]) == 1
    assert len(TASKS[task]["edits"]) <= MOST_EDITED


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What the session in the patched copy says."""
    copy, work = tmp_path_factory.mktemp("copy"), tmp_path_factory.mktemp("work")
    shutil.copytree(ROOT / "microstage_ros", copy / "microstage_ros", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "config", copy / "config")
    for patch in TASKS.values():
        apply(patch, copy / "microstage_ros")
    environment = {**os.environ, "PYTHONPATH": str(copy)}
    done = subprocess.run([sys.executable, str(Path(__file__).with_name("session.py")), str(work)], cwd=copy, env=environment,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("task", ["friction_law", "effect", "actuator", "sensor", "controller"])
def test_it_is_simulated_commanded_recorded_and_plotted(found, task):
    assert abs(found[task]["end_m"] - 2.0e-5) < 2.0e-6
    assert {"t_s", "encoder_m", "reference_m"} <= set(found[task]["columns"])
    assert found[task]["plot"] > 5000


def test_the_law_follows_its_closed_form_and_is_in_the_table(found):
    assert found["friction_law"]["error"] < 1e-9
    assert found["friction_law"]["hysteresis"] and found["friction_law"]["in_table"] == "exponential"


def test_the_actuator_is_recorded_in_its_own_unit(found):
    assert "force_N" in found["actuator"]["columns"] and "voltage_V" not in found["actuator"]["columns"]


def test_the_sensor_reads_whole_turns(found):
    assert found["sensor"]["off_a_turn"] < 1e-6


def test_the_backend_is_driven(found):
    assert found["backend"]["moved_m"] > 1.0e-6


def test_the_effect_is_found_by_diagnose(found):
    effect = found["effect"]
    assert effect["causes"][0] == "magnet_pull", effect
    assert effect["fitted"]["size_N"] == pytest.approx(effect["hidden"]["size_N"], rel=0.2)
    assert effect["label_on_page"]
    assert any("magnet_pull" in title for title in effect["pictures"])
