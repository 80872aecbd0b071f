"""Shared pieces of the actuators' tests."""

import pathlib

import pytest

from microstage_ros.model.axis_file import load_axis
from microstage_ros.solver.plant import NoiseSpec, make_plant

AXES = pathlib.Path(__file__).resolve().parents[3] / "config" / "axes"


@pytest.fixture
def bare():
    """Function (name, values) -> plant of a shipped axis without noise, counts, converter and Coulomb friction."""
    def build(name, **values):
        axis = load_axis(AXES / f"{name}.yaml")
        own = {key: value for key, value in values.items() if not axis.has(key.replace("__", "."))}
        assert not own, own
        changes = {key.replace("__", "."): value for key, value in values.items()}
        for contact in ("actuator", "guideway"):
            if axis.has(f"contacts.{contact}.coulomb"):
                changes.setdefault(f"contacts.{contact}.coulomb", 0.0)
        plant = make_plant(axis.with_values(changes), NoiseSpec.none())
        plant["quantum"] = plant["encoder_count"] = 0.0
        for contact in ("actuator", "guideway"):           # a Coulomb level of zero: no contact at all
            plant[contact]["blocks"] = 0
            plant[contact]["stick_damping"] = 0.0
        return plant
    return build
