"""Shared pieces of the axis tests."""

import pathlib

import pytest

from microstage_ros.model.axis_file import load_axis
from microstage_ros.solver.plant import NoiseSpec, make_plant

CONFIG = pathlib.Path(__file__).resolve().parents[2] / "config"


@pytest.fixture(scope="session")
def axis():
    """The shipped paper axis."""
    return load_axis(CONFIG / "axis.yaml")


@pytest.fixture
def quiet(axis):
    """Function (effects) -> plant without noise, random friction, converter steps or interpolation error."""
    def build(**effects):
        plant = make_plant(axis, NoiseSpec.none(), effects)
        plant["quantum"] = 0.0
        plant["encoder_count"] = 0.0
        plant["interpolates"] = 0
        return plant
    return build
