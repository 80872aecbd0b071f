"""Decimation keeps every peak; quantities read as people write them."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microstage_ros.quantities.readable import quantity
from microstage_ros.report.plots import decimate, scale_of


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 3000), st.integers(1, 40), st.floats(0, 0.9))
def test_every_stretch_keeps_its_extremes(seed, n, points, missing):
    generator = np.random.default_rng(seed)
    y = generator.normal(size=n)
    y[generator.uniform(size=n) < missing] = np.nan
    x = np.arange(n)
    kept_x, kept_y = decimate(x, y, points)
    assert len(kept_x) <= max(3 * points, n if n <= 2 * points else 0)
    assert (np.diff(kept_x) > 0).all()
    np.testing.assert_array_equal(kept_y, y[kept_x])
    if n > 2 * points:
        edges = np.linspace(0, n, points + 1).astype(int)
        for start, stop in pairwise(edges):
            part, left = y[start:stop], kept_y[(kept_x >= start) & (kept_x < stop)]
            assert len(left) >= 1
            if np.isfinite(part).any():
                assert (np.nanmin(left), np.nanmax(left)) == (np.nanmin(part), np.nanmax(part))


def test_short_signals_stay_as_they_are():
    x, y = decimate([0, 1, 2], [1.0, 2.0, 3.0], points=2)
    assert x.tolist() == [0, 1, 2] and y.tolist() == [1, 2, 3]


@pytest.mark.parametrize("value, unit, stderr, written", [
    (160e-9, "m", None, "160 nm"), (0.017, "rad", 5e-4, "17.00 ± 0.50 mrad"), (0.017, "rad", 1.1e-3, "17.0 ± 1.1 mrad"),
    (-2.5e-3, "V", None, "−2.50 mV"), (0.0, "m", None, "0 m"), (350.0, "N/m", 12.0, "350 ± 12 N/m"), (0.83, "1", None, "0.830"),
    (1234.5, "", None, "1234"), (float("nan"), "m", None, "–"), (None, "m", None, "–"), (999.9999999999, "m", None, "1.00 km"),
    (3.41, "ohm", 0.0, "3.41 Ω"), (2500.0, "ohm", None, "2.50 kΩ"), (1e-7, "kg m^2", None, "1.00 g cm²"), (4.5e5, "N/m", None, "450 kN/m"),
    (2e-6, "m^2", None, "0.00000200 m²"), (1e-7, "kg m^2", 1e-9, "1.000 ± 0.010 g cm²"), (5.0, "%", None, "5.00 %")])
def test_quantities_as_people_write_them(value, unit, stderr, written):
    assert quantity(value, unit, stderr=stderr) == written


def test_scale_of_an_axis():
    assert scale_of([1e-5, np.nan, -3e-6], "m") == (pytest.approx(1e6), "µm")
    assert scale_of([0.0], "V") == (1.0, "V")
    assert scale_of([], "V") == (1.0, "V")
