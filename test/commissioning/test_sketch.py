"""Sketches: what may be missing, what may not."""

import pytest
import yaml

from microstage_ros.commissioning.estimation.parameters import _widened, unseen
from microstage_ros.commissioning.sketch import UNKNOWN, USUAL, load_sketch, sketch_from_dict
from microstage_ros.identification.estimators.estimate import Estimate
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError

LEAST = """
format: 1
period: {value: 1.0e-4, unit: s}
travel:
  minimum: {value: -0.025, unit: m}
  maximum: {value: 0.025, unit: m}
drive: {type: voltage_motor, voltage_limit: {value: 6.0, unit: V}}
transmission:
  type: screw
  gear_ratio: {value: 19.0, unit: "1"}
  pitch: {value: 2.0e-3, unit: m}
sensors: {encoder: {resolution: {value: 25.0e-9, unit: m}}}
"""


def least():
    return yaml.safe_load(LEAST)


def test_the_least_that_must_be_given():
    sketch = sketch_from_dict(least())
    assert sketch.axis.value("drive.voltage_limit") == 6.0 and sketch.axis.value("drive.resistance") > 0.0
    assert sketch.tolerance["drive.resistance"] == UNKNOWN and sketch.tolerance["transmission.pitch"] == 0.0


@pytest.mark.parametrize("path", ["period", "travel.minimum", "drive.voltage_limit", "transmission.pitch", "sensors.encoder.resolution"])
def test_what_must_be_given(path):
    tree = least()
    *sections, last = path.split(".")
    inner = tree
    for section in sections:
        inner = inner[section]
    del inner[last]
    with pytest.raises(InputError, match=path.replace(".", r"\.")):
        sketch_from_dict(tree, "mine.yaml")


def test_tolerances():
    tree = least()
    tree["drive"]["resistance"] = {"value": 5.0, "unit": "ohm", "tolerance": 0.3}
    tree["drive"]["back_emf"] = {"value": 0.01, "unit": "V s/rad", "source": "datasheet"}
    sketch = sketch_from_dict(tree)
    assert sketch.tolerance["drive.resistance"] == 0.3 and sketch.tolerance["drive.back_emf"] == USUAL
    tree["drive"]["resistance"]["tolerance"] = -1
    with pytest.raises(InputError, match="drive.resistance.tolerance"):
        sketch_from_dict(tree)


def test_a_force_drive():
    tree = least()
    tree["drive"] = {"type": "force", "voltage_limit": {"value": 10.0, "unit": "V"}, "gain": {"value": 35.15, "unit": "N/V"}}
    tree["transmission"] = {"type": "rigid"}
    assert sketch_from_dict(tree).axis.value("stage.mass") > 0.0


def test_a_drive_that_cannot_be_commissioned_is_said():
    tree = least()
    tree["drive"]["type"] = "stepper"
    with pytest.raises(InputError, match="drive.type.*voltage_motor, force"):
        sketch_from_dict(tree)


def test_a_whole_axis_file_is_a_sketch():
    assert load_sketch(config_file("axis.yaml")).axis.controller == {"type": "self_tuning"}


def test_what_is_unlikely_in_a_sketch_is_said_and_nothing_of_what_was_filled_in(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(LEAST)
    assert load_sketch(path).unlikely == []
    path.write_text(LEAST.replace("25.0e-9", "25.0").replace("2.0e-3", "2.0"))
    said = load_sketch(path).unlikely
    assert len(said) == 2 and all(line.startswith(f"{path}: line ") and "unlikely" in line for line in said)
    assert "transmission.pitch: 2 m" in said[0] and "sensors.encoder.resolution: 25 m" in said[1]


@pytest.mark.parametrize("stderr, said", [(0.7, "within some 70 % only"), (2.2, "its standard uncertainty is its value or more")])
def test_an_uncertainty_beyond_the_value_is_no_share_of_it(stderr, said):
    why = unseen({"stage.mass": Estimate("stage.mass", 1.0, "kg", stderr=stderr)}, 1e-4)["stage.mass"]
    assert said.replace(" %", "%") in why


def test_the_interval_of_a_share_stays_one():
    share = _widened(Estimate("variability.travel_share", 0.9, "1", 0.1, 0.7, 1.1))
    assert share.low > 0.3 and share.high == 1.0
