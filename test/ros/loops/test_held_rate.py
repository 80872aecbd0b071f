"""Simulated time at a rate: in steps, no faster than asked, and without making up for what was missed; on a clock made
by hand."""

import numpy as np
import pytest

from microstage_ros.ros.loops.period_timing import BURST_NS, next_due

NS = 1_000_000_000


def begun(pace, seconds, work=0, stop=None):
    """Times at which periods of ``pace`` [ns] begin within ``seconds`` [s], each of which takes ``work`` [ns]; at ``stop``
    (time, length) [ns] the processor is taken away. In ns after the first."""
    start = clock = 7 * NS
    due, times, (at, length) = 0, [], stop or (10**12, 0)
    while clock < start + seconds * NS:
        due, rest = next_due(due, clock, pace)
        clock += rest
        if rest:
            continue
        times.append(clock - start)
        clock += work
        if clock > start + at:
            clock, at = clock + length, 10**12
    return np.array(times)


@pytest.mark.parametrize("pace", [100_000, 1_000_000, 3_000_000, 100_000_000])
def test_no_faster_than_asked_and_no_slower(pace):
    times = begun(pace, 20, work=min(10_000, pace // 10))
    assert len(times) == pytest.approx(20 * NS / pace, abs=2 + BURST_NS / pace)
    assert np.abs(times - pace * np.arange(len(times))).max() <= BURST_NS + pace


def test_it_sleeps_a_step_and_not_before_each_period():
    times = begun(100_000, 1, work=10_000)
    assert np.count_nonzero(np.diff(times) > 1_000_000) == pytest.approx(NS / BURST_NS, rel=0.2)


def test_a_stop_is_not_made_up_for():
    times = begun(100_000, 2, work=10_000, stop=(NS, NS // 2))
    assert len(times) == pytest.approx(15_000, rel=0.01)
    after = times[times > 3 * NS // 2]
    assert np.count_nonzero(after < after[0] + NS // 10) < 1000 + 2 * BURST_NS / 100_000


def test_who_is_slower_than_asked_never_sleeps():
    assert np.diff(begun(100_000, 1, work=200_000)).max() == 200_000
