"""Scores and alarms against what statistics says of them."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.stats import norm

from microstage_ros.metrology.rates import rate
from microstage_ros.monitoring.health import MONTH, Reference, Watch
from microstage_ros.quantities.errors import InputError

KEYS = [("torque", "level"), ("torque", "scatter"), ("windup", "offset")]


def gaussian_windows(generator, count, shift=0.0):
    """Windows of independent normal traits; ``shift`` [standard deviations] on the first."""
    sizes = generator.normal(0.0, [1.0, 3.0, 1e-9], (count, 3)) + [shift, 5.0, 2e-6]
    return [dict(zip(KEYS, row)) for row in sizes]


def test_quantiles_are_standard_normal_whatever_the_number_of_healthy_windows(seed=11):
    """The prediction interval allows for a mean and a spread that are themselves estimates."""
    generator = np.random.default_rng(seed)
    for count in (8, 40):
        found = []
        for _ in range(400):
            reference = Reference.of(gaussian_windows(generator, count), 20.0)
            found += list(reference.quantiles(gaussian_windows(generator, 1)[0]).values())
        beyond = rate(int((np.abs(found) > norm.isf(0.025)).sum()), len(found), level=0.9999)
        assert beyond.low < 0.05 < beyond.high


def test_the_limit_spends_the_accepted_false_alarms_on_all_tests_of_a_month():
    reference = Reference.of(gaussian_windows(np.random.default_rng(1), 10), 20.0)
    tests = MONTH / 20.0 * 3
    assert 2.0 * norm.sf(reference.limit(1.0)) * tests == pytest.approx(1.0, rel=1e-6)
    assert reference.limit(0.01) > reference.limit(1.0) > reference.limit(100.0)


def test_an_alarm_takes_two_windows_in_a_row_and_stays_until_reset():
    generator = np.random.default_rng(2)
    watch = Watch(Reference.of(gaussian_windows(generator, 60), 20.0))
    bad, good = gaussian_windows(generator, 1, shift=30.0)[0], gaussian_windows(generator, 1)[0]
    assert not watch.judge(0.0, bad)["torque"].alarm
    assert not watch.judge(20.0, good)["torque"].alarm
    assert not watch.judge(40.0, bad)["torque"].alarm
    found = watch.judge(60.0, bad)
    assert found["torque"].alarm and found["torque"].since == 40.0 and found["torque"].trait == "level"
    assert not found["windup"].alarm and math.isnan(found["windup"].since)
    assert watch.judge(80.0, good)["torque"].alarm
    watch.reset()
    assert not watch.judge(20.0, bad, "monday")["torque"].alarm
    assert watch.judge(0.0, bad, "tuesday")["torque"] == dataclasses.replace(found["torque"], since=20.0, record="monday")  # times are a record's own
    watch.reset()
    assert not watch.judge(100.0, good)["torque"].alarm


def test_far_beyond_what_a_probability_can_hold_the_score_still_grows():
    reference = Reference.of(gaussian_windows(np.random.default_rng(3), 500), 20.0)
    scores = [abs(reference.quantiles({KEYS[0]: size})[KEYS[0]]) for size in (10.0, 50.0, 1e3, 1e6)]
    assert np.isfinite(scores).all() and (np.diff(scores) > 0.0).all()


@pytest.mark.parametrize(
    "windows, words", [([{}] * 7, "healthy windows"), ([{("a", "b"): 1.0}] * 8 + [{("c", "d"): 1.0}], "in common")]
)
def test_too_little_to_learn_from_is_refused(windows, words):
    with pytest.raises(InputError, match=words):
        Reference.of(windows, 20.0)
