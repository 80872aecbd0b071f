"""Bias and 4s: the interval that the paper's ten repeats allow, and that intervals cover what they say."""

import numpy as np
import pytest

from microstage_ros.axis.errors import InputError
from microstage_ros.metrology.repeatability import repeatability


def test_ten_repeats_of_250_nm():
    """Four values of a table with n = 10 cannot be told apart: 250 nm may be 172 to 456 nm."""
    errors = np.random.default_rng(1).normal(size=10)
    errors = (errors - errors.mean()) / errors.std(ddof=1) * 62.5e-9 + 30e-9
    figures = repeatability(errors)
    assert figures.count == 10
    assert figures.four_sigma == pytest.approx(250e-9)
    assert [round(bound * 1e9) for bound in (figures.low, figures.high)] == [172, 456]
    assert figures.mean == pytest.approx(30e-9)
    assert figures.mean_high - figures.mean == pytest.approx(2.262157 * 62.5e-9 / np.sqrt(10), rel=1e-6)
    assert figures.mean - figures.mean_low == pytest.approx(figures.mean_high - figures.mean)


def test_intervals_cover_what_they_say():
    generator = np.random.default_rng(4)
    covered = np.zeros(2)
    for _ in range(2000):
        figures = repeatability(generator.normal(5.0, 2.0, size=8), confidence=0.9)
        covered += [figures.mean_low < 5.0 < figures.mean_high, figures.low < 8.0 < figures.high]
    assert (abs(covered / 2000 - 0.9) < 4 * np.sqrt(0.09 / 2000)).all()


def test_too_few_moves_have_no_spread():
    one = repeatability([3e-9])
    assert (one.count, one.mean) == (1, 3e-9)
    assert np.isnan([one.four_sigma, one.low, one.high, one.mean_low, one.mean_high]).all()
    assert np.isnan(repeatability([]).mean)


@pytest.mark.parametrize("errors", [[1.0, np.inf], [[1.0, 2.0]]])
def test_broken_errors_are_refused(errors):
    with pytest.raises(InputError, match="finite"):
        repeatability(errors)
