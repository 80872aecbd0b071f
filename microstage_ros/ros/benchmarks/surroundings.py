"""What else may go wrong around a cell: the clock of the day set back, a second owner."""

import mmap
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import rclpy
from microstage_msgs.msg import AxisState, DriverStatus

from microstage_ros.records.bags.bag_reader import Bag
from microstage_ros.ros.benchmarks.trial_cell import NAMESPACE, cell_parameters
from microstage_ros.ros.client import AxisClient
from microstage_ros.ros.launching.cell_processes import NODES, CellProcesses
from microstage_ros.ros.transport import topics

SHIFT_S = -3600
SOURCE = Path(__file__).with_name("clock_shift.c")


@contextmanager
def shiftable_clock(folder):
    """Processes started in here have a clock of the day that can be set: yields a function of the shift [s], None
    without a C compiler."""
    compiler, library, word = shutil.which("cc"), Path(folder) / "clock_shift.so", Path(folder) / "clock_shift"
    if compiler is None:
        yield None
        return
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", str(library), str(SOURCE), "-ldl"], check=True)
    word.write_bytes(bytes(8))
    with open(word, "r+b") as file, mmap.mmap(file.fileno(), 8) as memory:
        before = {name: os.environ.get(name) for name in ("LD_PRELOAD", "MICROSTAGE_CLOCK_SHIFT")}
        os.environ |= {"LD_PRELOAD": str(library), "MICROSTAGE_CLOCK_SHIFT": str(word)}
        try:
            yield lambda seconds: struct.pack_into("<q", memory, 0, int(seconds))
        finally:
            for name, value in before.items():
                os.environ.pop(name) if value is None else os.environ.__setitem__(name, value)


def surround(mode="paced_1kHz"):
    """A second owner, and the clock set back by an hour, during moves of one cell; the facts as plain data."""
    facts, short, statuses, stamps = {"mode": mode}, [], [], []

    def keep_stamp(state):
        stamps.append(state.header.stamp.sec)

    with tempfile.TemporaryDirectory(prefix="microstage_around_") as folder, shiftable_clock(folder) as set_clock:
        node = rclpy.create_node("around", namespace=NAMESPACE)
        try:
            node.create_subscription(DriverStatus, topics.DRIVER_STATUS, statuses.append, topics.LATCHED)
            node.create_subscription(AxisState, topics.STATE, keep_stamp, 10)
            with CellProcesses(NAMESPACE, NODES, cell_parameters(mode, folder), logs=Path(folder) / "logs") as cell:
                cell.activate(node)
                client = AxisClient(NAMESPACE, node, wait=60.0)
                facts["moved_before"] = bool(client.move(1e-5, timeout=20.0, tolerance=1e-6).reached)
                facts["second_owner"] = _second_owner(short)
                if set_clock:
                    first = stamps[-1]
                    set_clock(SHIFT_S)
                    facts["moved_while_set_back"] = bool(client.move(-1e-5, timeout=20.0, tolerance=1e-6).reached)
                    facts["clock_went_s"] = stamps[-1] - first
                    set_clock(0)
                facts["moved_after"] = bool(client.move(1e-5, timeout=20.0, tolerance=1e-6).reached)
                cell.check()
            facts["messages"] = sum(1 for _ in Bag(Path(folder) / "bag").raw_messages([f"{NAMESPACE}/state"]))
            facts["tracebacks"] = [
                path.name
                for path in (Path(folder) / "logs").glob("*.log")
                if "Traceback" in path.read_text(encoding="utf-8", errors="replace")
            ]
        finally:
            node.destroy_node()
    facts["faults"] = [status.message for status in statuses if status.fault]
    short += [name for name in ("moved_before", "moved_while_set_back", "moved_after") if facts.get(name) is False]
    short += [f"a traceback of {name}" for name in facts["tracebacks"]] + facts["faults"]
    if set_clock and mode != "lockstep" and abs(facts["clock_went_s"] - SHIFT_S) > 600:
        short.append(f"the clock was to go by {SHIFT_S} s and went by {facts['clock_went_s']}")
    return facts | {"fell_short": "; ".join(short)}


def _second_owner(short):
    """A second start on the same namespace; what it says."""
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "microstage_ros.commands", "cell", "--namespace", NAMESPACE],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    says = (done.stderr.strip().splitlines() or [""])[-1]
    if done.returncode != 2 or f"process {os.getpid()}" not in says or "Traceback" in done.stderr:
        short.append(f"a second owner was not refused: {says}")
    return {"status": done.returncode, "says": says, "seconds": round(time.monotonic() - began, 2)}
