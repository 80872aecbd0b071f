"""Rows before and after, missing samples, settled current and motor travel against closed forms of the winding."""

import types

import numpy as np
import pytest

from microstage_ros.signals.current import settled, settled_current
from microstage_ros.signals.rows import bridged, longest_gap, of_row_after, of_row_before
from microstage_ros.signals.travel import motor_travel

PERIOD, RESISTANCE, INDUCTANCE = 1e-4, 3.4, 1e-4
KEEP = np.exp(-PERIOD * RESISTANCE / INDUCTANCE)


def test_rows_before_and_after_are_inverse_inside():
    values = np.arange(5.0)
    assert of_row_before(values).tolist() == [0.0, 0.0, 1.0, 2.0, 3.0]
    assert of_row_after(of_row_before(values))[:-1].tolist() == values[:-1].tolist()


def test_missing_samples_lie_on_the_line_between_their_neighbours():
    values = np.array([0.0, np.nan, np.nan, 3.0, np.nan])
    assert bridged(values).tolist() == [0.0, 1.0, 2.0, 3.0, 3.0]
    assert longest_gap(values) == (1, 2)
    assert longest_gap(np.ones(3)) == (0, 0)


def test_settled_current_of_a_winding_at_standstill_is_the_voltage_over_the_resistance():
    """R i + L di/dt = u with a held u, solved period by period in closed form."""
    u = np.random.default_rng(1).normal(size=200)
    current = np.zeros(201)
    for n in range(200):
        current[n + 1] = KEEP * current[n] + (1.0 - KEEP) * u[n] / RESISTANCE
    assert settled_current(current, KEEP)[1:] == pytest.approx(u / RESISTANCE)


def test_compiled_and_array_forms_give_the_same_bits():
    current = np.random.default_rng(2).normal(size=50)
    row_by_row = [settled(now, before, KEEP) for now, before in zip(current, of_row_before(current))]
    assert settled_current(current, KEEP).tolist() == row_by_row


def test_motor_travel_of_a_motor_at_constant_speed():
    """Current and back-EMF stand still: K_E ω T per period, without a lead that would grow."""
    drive = types.SimpleNamespace(resistance=RESISTANCE, inductance=INDUCTANCE, back_emf=5e-3, lever=1e-4)
    speed = 40.0
    u = np.full(300, RESISTANCE * 0.2 + drive.back_emf * speed)
    travel = motor_travel(u, np.full(300, 0.2), drive, PERIOD)
    assert np.diff(travel)[5:] == pytest.approx(drive.lever * speed * PERIOD)
