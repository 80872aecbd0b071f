"""Readings that are late by much of the time in which the stage turns round."""

import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue import measuring

PERIOD, LATE, FREQUENCY = 1e-4, 5e-4, 250.0      # s, s, Hz
TIME = np.arange(20000) * PERIOD
OMEGA = 2.0 * np.pi * FREQUENCY
POSITION, LATER = (1e-6 * np.sin(OMEGA * t) for t in (TIME, TIME + LATE))
RATE = OMEGA * 1e-6 * np.cos(OMEGA * TIME)


class Rows:
    """A record's difference of the readings, a row per period."""

    prepared = types.SimpleNamespace(time=TIME, stage_position=POSITION)
    speed = RATE

    @staticmethod
    def mean(values):
        return values


def lateness_by(form):
    """Lateness [s] of the least squares with a form's column, but for the last rows, which nothing follows."""
    column, residual = form.columns(Rows, None)[:-10, 0], (POSITION - LATER)[:-10]
    return float(column @ residual / (column @ column))


def test_lateness_in_a_swing_is_that_of_what_the_reading_shows_later():
    first = lateness_by(measuring.LATE)
    assert first == pytest.approx(LATE * np.sinc(OMEGA * LATE / np.pi), rel=1e-3) and first < 0.92 * LATE
    form = measuring.LATE
    for _ in range(6):
        form = form.about(np.array([lateness_by(form)]))
    assert lateness_by(form) == pytest.approx(LATE, rel=0.01)
    assert form.about(np.array([0.0])).variant == "about 1e-06"
    exact = measuring.lateness_of(LATE)(Rows, None)[:-10, 0]
    assert np.allclose(LATE * exact, (POSITION - LATER)[:-10], atol=5e-9)
