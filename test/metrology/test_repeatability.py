"""Bias and 4s: the interval that the paper's ten repeats allow, and that intervals cover what they say."""

import numpy as np
import pytest
from scipy import stats

from microstage_ros.metrology.repeatability import chi_square, repeatability
from microstage_ros.quantities.errors import InputError


def test_ten_repeats_of_250_nm():
    """Four values of a table with n = 10 cannot be told apart: 250 nm may be 172 to 456 nm."""
    errors = np.random.default_rng(1).normal(size=10)
    errors = (errors - errors.mean()) / errors.std(ddof=1) * 62.5e-9 + 30e-9
    figures = repeatability(errors)
    assert figures.four_s == pytest.approx(250e-9)
    assert [round(bound * 1e9) for bound in figures.four_s_interval] == [172, 456]
    assert figures.bias == pytest.approx(30e-9)
    assert figures.bias_interval[1] - figures.bias == pytest.approx(2.262157 * 62.5e-9 / np.sqrt(10), rel=1e-6)


def test_intervals_cover_what_they_say():
    generator = np.random.default_rng(4)
    covered = np.zeros(2)
    for _ in range(2000):
        figures = repeatability(generator.normal(5.0, 2.0, size=8), confidence=0.9)
        covered += [figures.bias_interval[0] < 5.0 < figures.bias_interval[1],
                    figures.four_s_interval[0] < 8.0 < figures.four_s_interval[1]]
    assert (abs(covered / 2000 - 0.9) < 4 * np.sqrt(0.09 / 2000)).all()


@pytest.mark.parametrize("errors", [[1.0], [], [1.0, np.inf], [[1.0, 2.0]]])
def test_too_few_or_broken_errors_are_refused(errors):
    with pytest.raises(InputError, match="at least 2"):
        repeatability(errors)


def test_quantiles_are_those_of_scipy():
    for freedom in (1, 9, 79):
        assert chi_square(freedom, 0.975) == pytest.approx(stats.chi2.ppf(0.975, freedom))
