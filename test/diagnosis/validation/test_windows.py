"""What a campaign knows of what it hid, and windows against the simulated speeds."""

import numpy as np
import pytest

from microstage_ros.diagnosis.preprocessing import preparation
from microstage_ros.diagnosis.validation import fault_injection, simulated_records, windows


def test_speeds_are_compared_with_those_that_were_simulated(axis):
    """0.64 um/s of the motor's and 2.9 of the stage's on healthy records; half as long a window lets the reading's noise in."""
    records, drive = windows.examples(simulated_records, axis, "healthy", [1])
    assert windows.TRUE[0] not in simulated_records.SEEN and "current_A" not in windows.without_current(records[0]).columns
    motor, stage = windows.errors(records[0], drive, 0.0)
    assert 4e-7 < motor < 1e-6 and 2e-6 < stage < 4e-6
    before = preparation.STAGE_FUSION
    with windows.window("STAGE_FUSION", 0.5) as periods:
        assert periods == preparation.STAGE_FUSION == 7 and windows.errors(records[0], drive, 0.0)[1] > 2.0 * stage
    assert preparation.STAGE_FUSION == before


def test_a_soft_drive_is_one_that_is_known(axis, drive):
    records, soft = windows.examples(simulated_records, axis, "soft drive", [1])
    assert soft.stiffness == pytest.approx(0.1 * drive.stiffness) and windows.errors(records[0], soft, 0.0)[1] < 5e-5


def test_a_hidden_profile_spreads_where_one_was_found():
    """A straight line over ±6 mm, found from −2 to 1 mm: the standard deviation of a line of 3 mm, not of 12."""
    hidden = {"positions_m": np.linspace(-6e-3, 6e-3, 41).tolist(), "factors": np.linspace(0.7, 1.3, 41).tolist()}
    at = np.linspace(-3e-3, 2e-3, 51)
    found = {"positions_m": at.tolist(), "factors": np.interp(at, [-2e-3, 1e-3], [0.9, 1.05]).tolist()}
    assert fault_injection.rms_along(hidden, found) == pytest.approx(50.0 * 3e-3 / np.sqrt(12.0), rel=0.05)
    flat = {"positions_m": at.tolist(), "factors": np.ones(51).tolist()}
    assert fault_injection.rms_along(hidden, flat) == pytest.approx(50.0 * 5e-3 / np.sqrt(12.0), rel=0.05)


def test_half_of_late_readings_are_so_at_random_too():
    drawn = [fault_injection.one("sampling_jitter", np.random.default_rng(n), 0.5).effects["sampling_jitter"] for n in range(200)]
    random = [one["jitter_s"] for one in drawn if one["jitter_s"] > 0.0]
    assert 70 < len(random) < 130 and min(random) >= 5e-6 and max(random) <= 2.5e-5 and all(one["late_s"] <= 3e-4 for one in drawn)
