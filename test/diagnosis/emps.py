"""The EMPS record as the tests use it, and a motion like it for a simulated axis."""

import pathlib

import numpy as np
import pytest

from microstage_ros.records import Record

ROOT = pathlib.Path(__file__).resolve().parents[2]
DATA = ROOT / "../shared/data/emps/DATA_EMPS.mat"
QUIET = {"encoder_m": 0.0, "voltage_V": 0.0, "current_A": 0.0, "interferometer_m": 0.0, "friction_relative": 0.0}


def emps_record():
    """The identification record of the EMPS benchmark (nonlinearbenchmark.org); skips where it is absent."""
    if not DATA.exists():
        pytest.skip(f"no EMPS data at {DATA}")
    from scipy.io import loadmat

    data = loadmat(DATA)
    columns = {"encoder_m": data["qm"].ravel(), "reference_m": data["qg"].ravel(), "voltage_V": data["vir"].ravel()}
    return Record(1e-3, columns, "DATA_EMPS.mat")


def there_and_back(cycles=3, period=1e-3):
    """Reference [m]: out at 50 and 120 mm/s, back at 80 and 40 mm/s, ramps of 1 m/s², repeated."""
    speeds = np.concatenate([np.full(rows, speed) for speed, rows in (
        (0.05, 300), (0.12, 500), (0.0, 100), (-0.08, 600), (-0.04, 675), (0.0, 100))])
    ramp = np.ones(80) / 80
    speed = np.convolve(np.tile(speeds, cycles), ramp)[: len(speeds) * cycles]
    return np.cumsum(speed) * period
