"""Healthy running: a real cell of six nodes that moves now and then, nothing injected: does it trip, does a process
grow.

Paced, the wall clock matters: time for which the host kept the driver from its processor is counted by the driver and
distinguished. In lockstep as many control periods go by as the machine can do. What every process holds (memory, open
files, threads) is read from ``/proc`` now and then; growth counts from `SETTLED` of the time on, since a process fills
its caches and its recorder its buffers at the beginning.
"""

import os
import random
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
from microstage_msgs.action import MoveTo
from microstage_msgs.msg import DriverStatus, ServoTiming

from microstage_ros.ros.benchmarks.trial_cell import NAMESPACE, cell_parameters
from microstage_ros.ros.client import AxisClient
from microstage_ros.ros.launching.cell_processes import NODES, CellFailure, CellProcesses
from microstage_ros.ros.launching.supervision import Supervisor
from microstage_ros.ros.transport import topics

SETTLED = 0.1
"""Share of the time that does not count for growth; at most `WARM_S`."""

WARM_S = 300.0
MOST_GROWTH = 1_000_000
"""Of the memory of a process [bytes]."""

MOVE_EVERY_S, LOOK_EVERY_S = 10.0, 5.0
FARTHEST = 2e-3
"""Targets lie so far from home at most [m]."""

PAGE = os.sysconf("SC_PAGE_SIZE")
HELD = ("memory_bytes", "files", "threads")


def held(pid):
    """What the process ``pid`` [1] holds: memory that is its own [byte], open files [1], threads [1]."""
    shared = Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()
    return (
        (int(shared[1]) - int(shared[2])) * PAGE,
        len(os.listdir(f"/proc/{pid}/fd")),
        len(os.listdir(f"/proc/{pid}/task")),
    )


def growth(rows):
    """How much each column of `held` grew: the median of the last fifth less that of the first fifth.

    Parameters
    ----------
    rows : array (looks, 3), without the time in which caches fill.
    """
    if len(rows) < 5:
        return dict.fromkeys(HELD, 0)
    fifth = max(len(rows) // 5, 1)
    return dict(zip(HELD, (np.median(rows[-fifth:], axis=0) - np.median(rows[:fifth], axis=0)).astype(int).tolist()))


class Healthy:
    """One such run.

    Parameters
    ----------
    seconds : of wall clock. mode : of `trial_cell.PERIODS`. seed : of the axis and of the targets. tell : called with
        the facts so far, now and then. most_periods : control periods after which it ends sooner (0: never).
    """

    def __init__(self, seconds, mode, seed, tell=lambda facts: None, most_periods=0):
        self._seconds, self._mode, self._chance, self._tell = seconds, mode, random.Random(seed), tell
        self._most_periods = most_periods or np.inf
        self._seed, self._faults, self._timing, self._looks = seed, [], [], {}
        self._codes, self._move, self._ended = {}, None, ""

    def run(self):
        """Run it; the facts as plain data."""
        with tempfile.TemporaryDirectory(prefix="microstage_healthy_") as folder:
            node = rclpy.create_node("healthy", namespace=NAMESPACE)
            try:
                node.create_subscription(DriverStatus, topics.DRIVER_STATUS, self._on_status, topics.LATCHED)
                node.create_subscription(ServoTiming, topics.TIMING, self._on_timing, 10)
                return self._watched(node, Path(folder))
            finally:
                node.destroy_node()

    def _on_status(self, status):
        if status.fault:
            self._faults.append(status.message)

    def _on_timing(self, timing):
        self._timing = [self._timing[0] if self._timing else timing, timing]

    def _watched(self, node, folder):
        parameters = cell_parameters(self._mode, folder, rate_limit=0.0, seed=self._seed, split_mb=50, keep_files=4)
        with CellProcesses(NAMESPACE, NODES, parameters, logs=folder / "logs") as cell:
            supervisor = Supervisor(cell, node, tell=lambda text: None)
            cell.activate(node)
            client = AxisClient(NAMESPACE, node, wait=60.0)
            pids = {name: process.pid for name, process in cell.processes.items()}
            began = time.monotonic()
            self._go_through(node, client, supervisor, pids, began)
            seconds = time.monotonic() - began
            noisy = [
                path.name
                for path in (folder / "logs").glob("*.log")
                if "Traceback" in path.read_text(encoding="utf-8", errors="replace")
            ]
        return self._facts(seconds, noisy)

    def _go_through(self, node, client, supervisor, pids, began):
        looked = moved = 0.0
        while time.monotonic() < began + self._seconds and self._periods < self._most_periods:
            if self._faults or self._ended:
                return
            rclpy.spin_once(node, timeout_sec=0.1)
            now = time.monotonic()
            try:
                supervisor.look()
            except CellFailure as failure:
                self._ended = str(failure)
                return
            if now - looked > LOOK_EVERY_S:
                looked = now
                for name, pid in pids.items():
                    self._looks.setdefault(name, []).append((now - began, *held(pid)))
                self._tell(
                    {
                        "seconds": round(now - began),
                        "periods": self._periods,
                        "moves": dict(self._codes),
                        "faults": self._faults,
                    }
                )
            if now - moved > MOVE_EVERY_S and self._move is None:
                moved = now
                self._move = client._action.send_goal_async(
                    MoveTo.Goal(target=self._chance.uniform(-FARTHEST, FARTHEST), tolerance=1e-6, timeout=20.0)
                )
            self._follow_move()

    def _follow_move(self):
        """The goal that was sent, then its result; nothing is left to be called later, when the client is gone."""
        if self._move is None or not self._move.done():
            return
        found = self._move.result()
        if hasattr(found, "get_result_async"):
            self._move = found.get_result_async()
            return
        code, self._move = int(found.result.code), None
        self._codes[code] = self._codes.get(code, 0) + 1

    @property
    def _periods(self):
        return self._timing[-1].periods - self._timing[0].periods if self._timing else 0

    def _facts(self, seconds, noisy):
        first, last = self._timing or (ServoTiming(), ServoTiming())
        counted = {
            name: getattr(last, name) - getattr(first, name)
            for name in (
                "answered",
                "late",
                "lost",
                "overruns",
                "zeroed",
                "taken_away",
                "host_stops",
                "host_stopped",
                "foreign",
                "malformed",
            )
        }
        grown = {}
        for name, rows in self._looks.items():
            table = np.array(rows)
            grown[name] = growth(table[table[:, 0] >= min(SETTLED * seconds, WARM_S), 1:]) | {
                "memory_at_the_end": int(table[-1, 1])
            }
        worst = {what: max((facts[what] for facts in grown.values()), default=0) for what in HELD}
        short = [
            text
            for text, bad in (
                (f"tripped: {self._faults[0] if self._faults else ''}", self._faults),
                (self._ended, self._ended),
                (f"a traceback of {', '.join(noisy)}", noisy),
                (f"memory grew by {worst['memory_bytes']} bytes", worst["memory_bytes"] > MOST_GROWTH),
                (
                    f"{worst['files']} files, {worst['threads']} threads more",
                    worst["files"] > 0 or worst["threads"] > 0,
                ),
            )
            if bad
        ]
        return {
            "mode": self._mode,
            "seconds": round(seconds, 1),
            "periods": self._periods,
            "trips": len(self._faults),
            **counted,
            "response_median_s": last.response_median,
            "response_p9999_s": last.response_p9999,
            "response_maximum_s": last.response_maximum,
            "moves_by_code": {str(code): count for code, count in sorted(self._codes.items())},
            "growth": grown,
            "worst_growth": worst,
            "fell_short": "; ".join(short),
        }
