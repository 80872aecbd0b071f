"""What an estimate says to people: prefixes, and "determined" by one rule."""

import numpy as np
import pytest

from microstage_ros.identification.estimators.estimate import from_interval, in_short, narrow
from microstage_ros.identification.page import in_words
from microstage_ros.quantities.readable import interval


@pytest.mark.parametrize("low, high, unit, written", [
    (-6.78e-4, -5.02e-4, "H", "−678 … −502 µH"), (6.28e-3, 6.4e-3, "N m", "6.28 … 6.40 mN m"), (0.1, np.inf, "V", "above 100 mV"),
    (-np.inf, np.inf, "V", "anything"), (-np.inf, 2e-3, "m", "below 2.00 mm"), (0.2, 0.3, "1", "0.20 … 0.30"), (1e-7, 2e-7, "kg m^2", "1.0 … 2.0 g cm²"),
    (3.40983, 3.41037, "ohm", "3.40983 … 3.41037 Ω"), (3.41, 3.41, "ohm", "3.41 … 3.41 Ω")])
def test_interval_with_one_prefix(low, high, unit, written):
    assert interval(low, high, unit) == written


def test_an_interval_wider_than_the_value_is_not_determined():
    assert in_short(6.878e-6, 41e-6 / 1.96, "N m").startswith("not determined (95 %: −34 … 48 µN m")
    assert "±" in in_short(6.28e-3, 1e-4, "N m") and "e+" not in in_short(6.28e-3, 1e-4, "N m")


def test_half_of_the_value_is_the_limit_for_every_number_of_a_list():
    assert narrow([1.0, 2.0], [0.5, 1.0], [1.5, 3.0])
    assert not narrow([1.0, 2.0], [0.49, 1.0], [1.51, 3.0])
    assert not narrow(1.0, 0.9, np.inf) and narrow(0.0, -0.1, 0.1, floor=0.2)


def test_an_offset_too_small_to_matter_shows_no_number():
    estimate = from_interval("amplifier offset", 1e-5, 2e-5, "V", floor=1e-3)
    assert estimate.determined and in_words(estimate).startswith("indistinguishable from 0 (95 %: −29 … 49 µV)")
    assert "±" in in_words(from_interval("amplifier offset", 5e-3, 2e-5, "V", floor=1e-3))
