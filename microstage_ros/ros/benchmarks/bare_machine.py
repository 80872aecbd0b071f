"""How well this machine alone keeps time: the loop's periods with looking at the clock in place of ROS.

A virtual machine stops whenever its host takes a processor from it, and no program on it can do better than this.
Run as a process of its own, since it takes a processor for itself; prints one JSON object.
"""

import json
import os
import subprocess
import sys

import numpy as np

from microstage_ros.numerics.compiled import compiled
from microstage_ros.ros.loops.compiled_driver import timing
from microstage_ros.ros.loops.driver_loop import COUNTS
from microstage_ros.ros.loops.period_timing import hold_back
from microstage_ros.ros.transport.c_calls import MONOTONIC, load_libraries, now

WORK_NS = 50_000
"""What a state and its command take on the way [ns]."""

STEP_NS = 2_000
"""Longer between two looks at the clock than so [ns]: the processor was taken away."""

PRIORITY = 20
BUSY = "while True: pass"


@compiled
def keep_time(c, work_ns, until_ns, counts, times):
    """Periods of so much work until the monotonic clock says ``until_ns``; ``counts``: all, in time, within two."""
    while now(MONOTONIC, times) < until_ns:
        hold_back(c, times)
        c.sequence += 1
        last, done = now(MONOTONIC, times), 0
        while done < work_ns:
            present = now(MONOTONIC, times)
            done += min(present - last, STEP_NS)
            last = present
        counts[0] += 1
        counts[1] += last <= c.due_ns + c.pace_ns
        counts[2] += last <= c.due_ns + 2 * c.pace_ns


def measured(seconds, period=1e-4):
    """Periods per second and shares answered in time and within two periods, all other processors busy.

    ``seconds``: how long [s]; ``period``: of control [s].
    """
    load_libraries()
    allowed = sorted(os.sched_getaffinity(0))
    c, times, counts = np.zeros(1, COUNTS), np.zeros(2, np.int64), np.zeros(3, np.int64)
    for name, value in timing(period, 0.0, 0.0, True, PRIORITY).items():
        c[name] = value
    keep_time(c[0], WORK_NS, 0, counts, times)  # compiled now
    busy = [subprocess.Popen([sys.executable, "-c", f"import os; os.sched_setaffinity(0, {{{number}}})\n{BUSY}"])
            for number in allowed[:-1]]
    try:
        os.sched_setaffinity(0, {allowed[-1]})
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        except PermissionError:
            c["priority"] = 0
        begin = now(MONOTONIC, times)
        keep_time(c[0], WORK_NS, begin + round(seconds * 1e9), counts, times)
        wall = (now(MONOTONIC, times) - begin) * 1e-9
    finally:
        for process in busy:
            process.kill()
    periods, in_time, within_two = counts.tolist()
    return {"rate": periods / wall, "in_time": in_time / periods, "within_two": within_two / periods}


if __name__ == "__main__":
    print(json.dumps(measured(float(sys.argv[1]))))
