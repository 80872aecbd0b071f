"""Axis files: what is read, what is refused, and with which words."""

import numpy as np
import pytest
import yaml

from microstage_ros.model.axis_file import axis_from_dict, load_axis
from microstage_ros.model.friction.contact import blocks_of
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.plant import make_plant
from test.solver.conftest import CONFIG


@pytest.mark.parametrize("name", ["axis.yaml", "emps.yaml"])
def test_shipped_files_survive_a_round_trip(name, tmp_path):
    axis = load_axis(CONFIG / name)
    axis.save(tmp_path / "copy.yaml")
    assert load_axis(tmp_path / "copy.yaml").as_dict() == axis.as_dict()


def test_segment_slopes_reproduce_the_guideway_curve_of_the_notes(axis):
    k, alpha = blocks_of(axis, "guideway")
    np.testing.assert_allclose(k, [343522, 65487, 29199, 9503, 2604, 4295], rtol=1e-5)
    np.testing.assert_allclose(alpha, [0.286, 0.136, 0.155, 0.153, 0.084, 0.185], atol=6e-4)
    np.testing.assert_allclose(alpha * 0.9 / k * 1e6, [0.75, 1.87, 4.79, 14.5, 29.1, 38.75], rtol=5e-3)
    assert np.sum(k * np.minimum(1e-6, alpha * 0.9 / k)) == pytest.approx(0.37, abs=0.005)


def test_blocks_reading_of_the_guideways(axis):
    tree = axis.as_dict()
    tree["contacts"]["guideway"]["reading"] = "blocks"
    k, alpha = blocks_of(axis_from_dict(tree), "guideway")
    np.testing.assert_allclose(alpha * 0.9 / k * 1e6, [0.75, 1.12, 2.92, 9.71, 14.6, 9.64], rtol=5e-3)
    assert np.sum(k * np.minimum(1e-6, alpha * 0.9 / k)) == pytest.approx(0.52, abs=0.005)


def broken(axis, change):
    tree = yaml.safe_load(yaml.safe_dump(axis.as_dict()))
    change(tree)
    return tree


@pytest.mark.parametrize("change, words", [
    (lambda t: t["drive"].pop("resistance"), ["drive.resistance", "ohm"]),
    (lambda t: t["drive"]["resistance"].update(unit="kohm"), ["drive.resistance", "kohm", "ohm"]),
    (lambda t: t["drive"]["resistance"].pop("unit"), ["drive.resistance", "unit", "ohm"]),
    (lambda t: t["drive"]["resistance"].update(value=-1), ["drive.resistance", "-1"]),
    (lambda t: t["drive"]["resistance"].update(value="much"), ["drive.resistance", "much"]),
    (lambda t: t["drive"]["resistance"].update(value=float("nan")), ["drive.resistance", "nan"]),
    (lambda t: t["drive"].update(resistence=dict(value=1, unit="ohm", source="paper")), ["resistence", "drive.resistance"]),
    (lambda t: t["drive"].update(type="steam"), ["drive.type", "steam", "voltage_motor"]),
    (lambda t: t["contacts"]["guideway"].update(law="magic"), ["guideway.law", "magic", "maxwell_slip"]),
    (lambda t: t["contacts"]["guideway"]["stiffness"].update(value=[1.0]), ["guideway"]),
    (lambda t: t.update(effects={"gremlin": {}}), ["effects", "gremlin", "backlash"]),
    (lambda t: t.update(effects={"backlash": {"width": 1}}), ["backlash.width", "width_rad"]),
    (lambda t: t.update(effects={"backlash": {}}), ["backlash.width_rad", "rad"]),
    (lambda t: t.update(effects={"backlash": {"width_rad": 7}}), ["backlash.width_rad", "7"]),
    (lambda t: t.update(format=9), ["format", "9"]),
    (lambda t: t["travel"]["minimum"].update(value=1.0), ["travel.maximum"]),
])
def test_bad_files_are_refused_with_place_and_value(axis, change, words):
    with pytest.raises(InputError) as error:
        axis_from_dict(broken(axis, change), "my.yaml")
    text = str(error.value)
    assert "my.yaml" in text and "\n" not in text
    assert all(word in text for word in words), text


def test_unreadable_files(tmp_path):
    with pytest.raises(InputError, match="readable"):
        load_axis(tmp_path / "none.yaml")
    (tmp_path / "bad.yaml").write_text("a: [1, 2\n b")
    with pytest.raises(InputError, match="valid YAML"):
        load_axis(tmp_path / "bad.yaml")
    (tmp_path / "list.yaml").write_text("- 1")
    with pytest.raises(InputError, match="mapping"):
        load_axis(tmp_path / "list.yaml")


def test_with_values_keeps_unit_and_takes_uncertainty(axis):
    other = axis.with_values({"drive.resistance": 3.6}, stderr={"drive.resistance": 0.02})
    quantity = other.quantity("drive.resistance")
    assert (quantity.value, quantity.unit, quantity.source, quantity.stderr) == (3.6, "ohm", "identified", 0.02)
    assert axis.value("drive.resistance") == 3.41
    with pytest.raises(InputError, match="drive.resistance"):
        axis.with_values({"drive.resistance": 0.0})


def test_run_effects_override_those_of_the_axis_file(axis):
    both = axis.with_effects({"amplifier_offset": {"offset_V": 0.1}})
    assert make_plant(both)["amplifier_offset"] == 0.1
    assert make_plant(both, effects={"amplifier_offset": {"offset_V": 0.2}})["amplifier_offset"] == 0.2
