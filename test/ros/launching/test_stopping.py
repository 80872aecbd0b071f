"""The end of a cell where a person waits: the driver, the others, the recorder last, and nobody for ever."""

import subprocess
import sys
import time

from microstage_ros.ros.launching.cell_processes import CellProcesses

PROCESS = """
import signal, sys, threading, time
asked = threading.Event()
signal.signal(signal.SIGTERM, lambda *_: asked.set())
print("ready", flush=True)
while not asked.wait(0.02):
    pass
print(time.monotonic(), flush=True)
time.sleep(float(sys.argv[1]))
print(time.monotonic(), flush=True)
"""


def process(seconds):
    """One that ends so long after SIGTERM; it tells when it was asked and when it ended."""
    one = subprocess.Popen([sys.executable, "-c", PROCESS, str(seconds)], stdout=subprocess.PIPE, text=True)
    assert one.stdout.readline() == "ready\n"
    return one


def stopped(seconds, within):
    """Statuses of the processes of a cell that is stopped ``within``, what they told, and how long it took."""
    cell = CellProcesses.__new__(CellProcesses)
    own = {name: process(each) for name, each in seconds.items()}
    cell.processes = dict(own)
    began = time.monotonic()
    cell._stop_quickly(within)
    took = time.monotonic() - began
    told = {name: [float(line) for line in one.communicate()[0].split()] for name, one in own.items()}
    return {name: one.returncode for name, one in own.items()}, told, took


def test_a_slow_driver_and_a_slow_recorder_end_by_themselves_one_after_the_other(monkeypatch):
    """Both take longer than everything is meant to take: the driver's last state is to be in the bag."""
    monkeypatch.setattr("microstage_ros.ros.launching.cell_processes.LAST_STATE", 60.0)  # on a machine as busy as can be
    status, told, _ = stopped({"bag_recorder": 0.8, "axis_driver": 1.0, "gms_observer": 0.0, "move_server": 60.0}, 0.4)
    assert (status["axis_driver"], status["bag_recorder"], status["gms_observer"]) == (0, 0, 0)
    assert status["move_server"] == -9
    assert told["bag_recorder"][0] >= told["axis_driver"][1] > told["gms_observer"][0]


def test_who_hangs_is_ended(monkeypatch):
    monkeypatch.setattr("microstage_ros.ros.launching.cell_processes.LAST_STATE", 0.6)
    status, told, took = stopped({"axis_driver": 60.0, "bag_recorder": 60.0, "str_controller": 60.0}, 0.2)
    assert set(status.values()) == {-9} and all(len(times) == 1 for times in told.values())
    assert took < 30.0
