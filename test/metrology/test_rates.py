"""Rates against closed forms of the exact interval."""

import math

import pytest

from microstage_ros.metrology.rates import rate


def test_none_of_n_has_the_closed_form_upper_limit():
    for cases in (1, 10, 300):
        found = rate(0, cases)
        assert found.low == 0.0 and found.high == pytest.approx(1.0 - 0.025 ** (1.0 / cases), rel=1e-9)


def test_hits_and_misses_mirror_each_other():
    a, b = rate(7, 40), rate(33, 40)
    assert a.low == pytest.approx(1.0 - b.high) and a.high == pytest.approx(1.0 - b.low)
    assert str(rate(19, 20)).startswith("19 of 20 (75")


def test_no_cases_tell_nothing_and_bad_counts_are_refused():
    empty = rate(0, 0)
    assert math.isnan(empty.value) and (empty.low, empty.high) == (0.0, 1.0)
    with pytest.raises(ValueError):
        rate(5, 4)
