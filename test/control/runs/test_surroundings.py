"""The surroundings are told in a record where they vary, and only there."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from microstage_ros.control.runs.closed_loop import SURROUNDINGS, TRACE, surroundings


@pytest.mark.parametrize("varies, told", [
    (None, ()), ("air_pressure_Pa", SURROUNDINGS[:3]), ("stage_temperature_K", SURROUNDINGS[3:])])
def test_columns_of_air_and_stage(varies, told):
    trace = np.full((50, len(TRACE)), 293.0)
    if varies:
        trace[:, TRACE.index(varies)] += np.arange(50)
    found = surroundings(trace)
    assert tuple(found) == tuple(told)
    if varies:
        assert_allclose(found[varies], 293.0 + np.arange(50))
