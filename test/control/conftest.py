"""The shipped axis, and short runs of it."""

import pathlib

import pytest

from microstage_ros.control.runs.run_file import run_from_dict
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.model.axis_file import load_axis

ROOT = pathlib.Path(__file__).resolve().parents[2]
QUIET = dict(encoder_m=0.0, voltage_V=0.0, current_A=0.0, interferometer_m=0.0, friction_relative=0.0)


@pytest.fixture(scope="session")
def axis():
    return load_axis(ROOT / "config" / "axis.yaml")


@pytest.fixture(scope="session")
def ideal(axis):
    """The shipped axis with a perfect current sensor and an encoder that interpolates without error: for closed forms."""
    current = {f"sensors.current.{name}": 0.0 for name in ("noise", "offset", "range", "bits", "bandwidth", "skew")}
    return axis.with_values({**current, "sensors.encoder.interpolation_error": [0.0, 0.0]}, source="derived")


@pytest.fixture(scope="session")
def emps():
    return load_axis(ROOT / "config" / "emps.yaml")


@pytest.fixture(scope="session")
def run(axis):
    """run(type, program, seed=0, noise=None, effects=None, period_s=None, **gains) -> columns."""

    def simulated(kind, program, seed=0, noise=None, effects=None, period_s=None, machine=None, **gains):
        tree = {"controller": {"type": kind, **gains}, "noise": noise or {}, "effects": effects or {}, "program": program,
                "start": {"friction": "relaxed"}}
        if period_s:
            tree["period_s"] = period_s
        return simulate(machine or axis, run_from_dict(tree), seed)

    return simulated
