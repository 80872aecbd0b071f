"""Jitter and lost samples in whole records of the second world: sizes are those of the effect."""

import pytest

from microstage_ros.diagnosis.batch import diagnose_records
from microstage_ros.diagnosis.validation.second_world import make_case
from microstage_ros.diagnosis.validation.simulated_records import Hidden


@pytest.mark.parametrize("number, jitter, lost", [(0, 1e-5, 0.0), (4, 0.0, 0.04), (5, 2e-5, 0.05)])
def test_jitter_and_lost_samples_have_their_own_sizes(axis, number, jitter, lost):
    """9.8 us of 10, none of none (11 were stated) and 20.3 of 20 (16 were); a count of 50 nm makes them uncertain by some hundredths."""
    hidden = Hidden("late", ("sampling_jitter",), {"sampling_jitter": {"jitter_s": jitter, "lost_fraction": lost}})
    records, holdout, baseline = make_case(axis, hidden, 16400 + number, 0.03)
    answer = diagnose_records(axis, records, holdout, baseline, seed=0)
    assert answer.verdict == "explained" and [c.id for c in answer.causes] == ["sampling_jitter"]     # its scatter is no unknown noise
    cause = answer.causes[0]
    assert abs(cause.parameters["lost_fraction"].value - lost) < 0.1 * lost + 1e-4
    assert ("jitter_s" in cause.parameters) == (jitter > 0.0)
    if jitter:
        assert cause.parameters["jitter_s"].value == pytest.approx(jitter, rel=0.1) == cause.effect["jitter_s"]
        assert abs(cause.parameters["late_s"].value) < 1.5e-6       # of a mean lateness of 8 and 16 us
