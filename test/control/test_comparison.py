"""Encoder against interferometer: readings of the same period, in blocks that come as they come."""

import numpy as np
import pytest

from microstage_ros.control.trajectories.comparison import IN_A_ROW, KEPT, EncoderComparison

BOUND = 1e-6


def fed(comparison, first, encoder, light):
    """What it says after a block of readings, ``encoder`` and ``light`` [m] from period ``first`` on."""
    comparison.add_encoder(first + np.arange(len(encoder)), np.asarray(encoder, float))
    comparison.add_interferometer(first + np.arange(len(light)), np.asarray(light, float))
    return comparison.breach()


def test_what_stays_together_is_left_alone_wherever_the_two_have_their_zero():
    comparison, way = EncoderComparison(BOUND), np.linspace(0.0, 1e-3, 500)
    assert fed(comparison, 0, way, way + 3e-3) == ""
    assert fed(comparison, 500, way[::-1], way[::-1] + 3e-3 + 0.9 * BOUND) == ""


@pytest.mark.parametrize("beyond", [1.1 * BOUND, -1.1 * BOUND, np.nan])
@pytest.mark.parametrize("rows", [1, 3, 100])
def test_parted_for_some_periods_in_a_row_is_said_once(beyond, rows):
    comparison = EncoderComparison(BOUND)
    fed(comparison, 0, np.zeros(10), np.zeros(10))
    said = [fed(comparison, 10 + k, np.full(rows, beyond), np.zeros(rows)) for k in range(0, 10 * rows, rows)]
    blocks = -(-IN_A_ROW // rows)
    assert [bool(words) for words in said] == [k == blocks - 1 for k in range(10)]


def test_single_readings_beyond_the_bound_are_no_breach():
    comparison, encoder = EncoderComparison(BOUND), np.zeros(1000)
    encoder[np.arange(1000) % IN_A_ROW != 0] = 2.0 * BOUND
    assert fed(comparison, 0, encoder, np.zeros(1000)) == ""


def test_late_partners_are_waited_for_and_a_driver_that_begins_anew_is_noticed():
    comparison = EncoderComparison(BOUND)
    assert fed(comparison, 0, np.zeros(100), []) == ""
    comparison.add_encoder(100 + np.arange(100), np.full(100, 5.0 * BOUND))
    comparison.add_interferometer(np.arange(200), np.zeros(200))
    assert "apart" in comparison.breach()
    comparison.add_encoder(np.arange(50), np.full(50, 7.0 * BOUND))  # from period 0 on: another zero
    comparison.add_interferometer(np.arange(200, 250), np.zeros(50))  # late, of the run before
    assert comparison.breach() == ""
    assert fed(comparison, 50, np.full(50, 7.0 * BOUND), []) == ""
    comparison.add_interferometer(np.arange(100), np.zeros(100))
    assert fed(comparison, 100, np.full(50, 7.0 * BOUND), np.zeros(50)) == ""
    assert "apart" in fed(comparison, 150, np.zeros(50), np.zeros(50))


def test_readings_without_partner_do_not_pile_up():
    comparison = EncoderComparison(BOUND)
    for first in range(0, 10 * KEPT, 100):
        fed(comparison, first, np.zeros(100), [])
    assert len(comparison._encoder) == KEPT


def test_bound_zero_watches_nothing():
    comparison = EncoderComparison(0.0)
    assert fed(comparison, 0, np.zeros(50), np.linspace(0.0, 1.0, 50)) == "" and not comparison._encoder
