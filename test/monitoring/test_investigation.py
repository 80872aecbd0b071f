"""The moves of an investigation stay within their limits."""

import itertools

import pytest

from microstage_ros.model.axis_file import load_axis
from microstage_ros.monitoring.investigation import LENGTHS, Limits, diagnose_windows, targets
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError


@pytest.fixture(scope="module")
def axis():
    return load_axis(config_file("axis.yaml"))


def test_moves_stay_between_the_limits_and_use_every_length_that_fits(axis):
    limits = Limits.of(axis, -1.0e-3, 1.0e-3, 0.0)
    assert limits.voltage == axis.value("drive.voltage_limit")
    moves = list(itertools.islice(targets(limits, seed=4), 90))
    places = [place for place, _ in moves]
    assert min(places) >= -1.0e-3 and max(places) <= 1.0e-3
    lengths = {round(abs(b - a), 9) for a, b in zip(places[::3], places[1::3])}
    assert lengths == {length for length in LENGTHS if length <= 2.0e-3}
    assert moves == list(itertools.islice(targets(limits, seed=4), 90))
    assert Limits.of(axis, 0.0, 0.0, 0.0) is None


@pytest.mark.parametrize(
    "low, high, voltage, words",
    [
        (-1.0, 0.0, 0.0, "travel"),
        (1e-3, -1e-3, 0.0, "travel"),
        (0.0, 1e-6, 0.0, "travel_max"),
        (0.0, 1e-3, 99.0, "voltage_max"),
    ],
)
def test_limits_beyond_the_axis_are_refused(axis, low, high, voltage, words):
    with pytest.raises(InputError, match=words):
        Limits.of(axis, low, high, voltage)


def test_too_few_windows_are_refused(axis, tmp_path):
    with pytest.raises(InputError, match="windows of motion"):
        diagnose_windows(axis, [], [], tmp_path, 0)
