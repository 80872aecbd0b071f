"""Samples of the current that were lost: made up for by the voltage, as the winding answers it."""

import numpy as np
import pytest

from microstage_ros.diagnosis.preprocessing.preparation import _as_driven, _lost_rows, prepare
from microstage_ros.diagnosis.residuals.command import Command
from microstage_ros.diagnosis.residuals.transmission_deflection import Windup
from microstage_ros.diagnosis.validation.second_world import make_case
from microstage_ros.diagnosis.validation.simulated_records import Hidden
from microstage_ros.signals.rows import bridged

PERIOD, ROWS, NOISE = 1e-4, 20_000, 1e-3


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_lost_current_is_what_the_voltage_drives(drive, seed):
    """R i_s = u − e of a back-EMF e that changes slowly, u another in each period by 20 mV: to the amplifier's noise of 1 mV, where
    a line between the neighbours is off by all of the voltage's changes."""
    generator = np.random.default_rng(seed)
    share, voltage = drive.current_transient(PERIOD), generator.normal(0.0, 0.02, ROWS)
    settled = (voltage + generator.normal(0.0, NOISE, ROWS) - np.sin(np.arange(ROWS) / 500.0)) / drive.resistance
    current = np.zeros(ROWS)
    for n in range(1, ROWS):
        current[n] = share * current[n - 1] + (1.0 - share) * settled[n]
    lost = generator.uniform(size=ROWS) < 0.05
    lost[0] = False
    held = current[np.maximum.accumulate(np.where(lost, 0, np.arange(ROWS)))]
    found = _as_driven(held, lost, voltage, drive, PERIOD)
    off, line = (np.std((values - current)[lost]) * drive.resistance for values in (found, bridged(np.where(lost, np.nan, current))))
    assert (found[~lost] == current[~lost]).all()
    assert off < 1.5 * NOISE and line > 20.0 * NOISE


def test_three_alike_are_lost_and_four_a_rest():
    assert np.flatnonzero(_lost_rows(np.array([0, 1, 1, 1, 0, 1, 1, 1, 1, 0, 1], bool))).tolist() == [1, 2, 3, 10]


def test_the_motors_angle_walks_no_further_with_a_twentieth_lost(axis, drive):
    """With a line between neighbouring currents it walked 3.5 to 8 times as far as the healthy axis's (1 mV), which was named a warm
    winding."""
    hidden = Hidden("late", ("sampling_jitter",), {"sampling_jitter": {"jitter_s": 2e-5, "lost_fraction": 0.05}})
    learn, _, base = make_case(axis, hidden, 16503, 0.03)
    prepared, usual = (prepare(records[0], drive) for records in (learn, base))
    assert Windup(prepared, drive).amplifier_noise < 1.3 * Windup(usual, drive).amplifier_noise
    assert 0.04 < prepared.unread.mean() < 0.07
    fast = Command(prepared, drive).whiten(np.random.default_rng(0).normal(size=(len(prepared.time), 1)))[0][:, 0]
    assert ((fast == 0.0) == prepared.unread).all()     # made of the command, they say nothing of it
