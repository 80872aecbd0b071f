"""Axes, and measured data where it lies beside the repository."""

import gzip
import json
import pathlib

import numpy as np
import pytest
import scipy.io

from microstage_ros.model.axis_file import load_axis
from microstage_ros.records import Record

ROOT = pathlib.Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared" / "data"


def measured(path):
    """Path of a measured file; the test is skipped where it is absent."""
    if not (DATA / path).exists():
        pytest.skip(f"measured data {path} is not in ../shared/data")
    return DATA / path


@pytest.fixture(scope="session")
def paper_axis():
    return load_axis(ROOT / "config" / "axis.yaml")


@pytest.fixture(scope="session")
def emps_axis():
    return load_axis(ROOT / "config" / "emps.yaml")


@pytest.fixture(scope="session")
def actuator_bench():
    return load_axis(ROOT / "config" / "experiments" / "actuator_bench.yaml")


@pytest.fixture(scope="session")
def guideway_bench():
    return load_axis(ROOT / "config" / "experiments" / "guideway_bench.yaml")


@pytest.fixture(scope="session")
def emps_record():
    data = scipy.io.loadmat(measured("emps/DATA_EMPS.mat"))
    columns = {"encoder_m": data["qm"], "reference_m": data["qg"], "voltage_V": data["vir"]}
    return Record(1e-3, {name: values.ravel() for name, values in columns.items()}, "DATA_EMPS.mat")


@pytest.fixture(scope="session")
def damper():
    """{amplitude [in]: (displacement [m], velocity [m/s], friction force [N])}"""
    found = {}
    for amplitude in ("0.5", "1.5"):
        with gzip.open(measured(f"friction_damper/d2_0.25Hz_30lb_{amplitude}in.json.gz")) as file:
            rows = np.array(json.load(file)["data"], float)
        found[amplitude] = rows[:, 1] * 0.0254, rows[:, 3] * 0.0254, rows[:, 2] * 4448.2216
    return found
