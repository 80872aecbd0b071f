"""Simulated time at a rate: in steps, no faster than asked, and without making up for what was missed."""

import numpy as np
import pytest

from microstage_ros.ros.loops.driver_loop import COUNTS
from microstage_ros.ros.loops.period_timing import BURST_NS, due_next, too_early
from microstage_ros.ros.transport.c_calls import MONOTONIC, load_libraries, now

BURST = BURST_NS * 1e-9


def begun(period, seconds, work=0.0, stop=(1e9, 0.0)):
    """Times at which periods begin on a clock made by hand, each of which takes ``work`` [s]; at ``stop`` (time, length)
    the processor is taken away."""
    clock, due, times, (at, length) = 0.0, None, [], stop
    while clock < seconds:
        due, rest = due_next(due, clock, period)
        if rest > 0.0:
            clock += rest
            continue
        times.append(clock)
        clock += work
        if clock > at:
            clock, at = clock + length, 1e9
    return np.array(times)


@pytest.mark.parametrize("period", [1e-4, 1e-3, 3e-3, 0.1])
def test_no_faster_than_asked_and_no_slower(period):
    times = begun(period, 20.0, work=min(1e-5, 0.1 * period))
    assert len(times) == pytest.approx(20.0 / period, abs=2.0 + BURST / period)
    late = times - times[0] - period * np.arange(len(times))
    assert np.abs(late).max() < BURST + period


def test_it_sleeps_a_step_and_not_before_each_period():
    times = begun(1e-4, 1.0, work=1e-5)
    assert np.count_nonzero(np.diff(times) > 1e-3) == pytest.approx(1.0 / BURST, rel=0.2)


def test_a_stop_is_not_made_up_for():
    times = begun(1e-4, 2.0, work=1e-5, stop=(1.0, 0.5))
    assert len(times) == pytest.approx(1.5 / 1e-4, rel=0.01)
    after = times[times > 1.5]
    assert np.count_nonzero(after < after[0] + 0.1) < 0.1 / 1e-4 + 2.0 * BURST / 1e-4


def test_who_is_slower_than_asked_never_sleeps():
    assert np.diff(begun(1e-4, 0.5, work=2e-4)).max() < 2.1e-4


def test_the_compiled_rule_is_the_same():
    load_libraries()
    times, counts = np.zeros(2, np.int64), np.zeros(1, COUNTS)
    c = counts[0]
    for ahead in (None, 0, BURST_NS // 2, BURST_NS - 1_000_000, BURST_NS + 50_000_000, -BURST_NS // 2, -BURST_NS - 50_000_000):
        present = int(now(MONOTONIC, times))
        c["pace_ns"], c["due_ns"] = 100_000, 0 if ahead is None else present + ahead
        due, rest = due_next(None if ahead is None else (present + ahead) * 1e-9, present * 1e-9, 1e-4)
        assert too_early(c, times) == (rest > 0.0)
        # what takes the present time for its own reads the clock a little later
        assert 0 <= int(c["due_ns"]) - round(due * 1e9) + 1000 < 20_000_000
