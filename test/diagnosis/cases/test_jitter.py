"""Jitter and lost samples in whole records of the second world: sizes are those of the effect."""

import pytest

from microstage_ros.diagnosis.batch import diagnose_records
from microstage_ros.diagnosis.preprocessing.preparation import prepare
from microstage_ros.diagnosis.prerequisites.timing import readings_late
from microstage_ros.diagnosis.validation.second_world import make_case
from microstage_ros.diagnosis.validation.simulated_records import Hidden


def late(axis, number, jitter, lost):
    """Records to learn from, held out and of before, the first ones read late by ``jitter`` [s], a share ``lost`` [1] not at all."""
    hidden = Hidden("late", ("sampling_jitter",), {"sampling_jitter": {"jitter_s": jitter, "lost_fraction": lost}})
    return make_case(axis, hidden, 16400 + number, 0.03)


def test_lost_samples_have_no_jitter(axis, drive):
    """11 us were stated of none."""
    groups = [[prepare(record, drive) for record in group] for group in late(axis, 4, 0.0, 0.04)]
    taught, _ = readings_late(*groups)
    assert taught.jitter == 0.0 and abs(taught.lost - 0.04) < 0.1 * 0.04


@pytest.mark.parametrize("number, jitter, lost", [(0, 1e-5, 0.0), (5, 2e-5, 0.05)])
def test_jitter_and_lost_samples_have_their_own_sizes(axis, number, jitter, lost):
    """9.8 us of 10, and 20.3 of 20 (16 were stated); a count of 50 nm makes them uncertain by some hundredths."""
    records, holdout, baseline = late(axis, number, jitter, lost)
    answer = diagnose_records(axis, records, holdout, baseline, seed=0)
    assert answer.verdict == "explained" and [c.id for c in answer.causes] == ["sampling_jitter"]     # its scatter is no unknown noise
    cause = answer.causes[0]
    assert abs(cause.parameters["lost_fraction"].value - lost) < 0.1 * lost + 1e-4
    assert cause.parameters["jitter_s"].value == pytest.approx(jitter, rel=0.1) == cause.effect["jitter_s"]
    assert abs(cause.parameters["late_s"].value) < 1.5e-6       # of a mean lateness of 8 and 16 us
