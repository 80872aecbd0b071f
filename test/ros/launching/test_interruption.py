"""Ctrl-C of a cell: not lost whatever the main thread does, and an end whatever the middleware does."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from microstage_ros.ros.launching import supervision

BEGIN = """
import ctypes, sys, time
from microstage_ros.ros.launching import interruption
interruption.LAST_RESORT = 0.5
heard = interruption.Interruption()
"""

IN_A_DESTRUCTOR = BEGIN + """
class Slow:
    def __del__(self):
        print("ready", flush=True)
        while True:  # as long as it takes: an exception would end it
            try:
                heard.check()
            except KeyboardInterrupt:
                return
            time.sleep(0.01)

Slow()
try:
    heard.check()
    print("lost")
except KeyboardInterrupt:
    print("heard")
"""

IN_THE_MIDDLEWARE = BEGIN + """
print("ready", flush=True)
ctypes.CDLL(None).sleep(30)
ctypes.CDLL(None).sleep(30)  # the signal ends the first
"""


def interrupted(program, number):
    """Exit status and what was printed by a program that gets a signal once it says that it is ready."""
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    time.sleep(0.1)
    os.kill(process.pid, number)
    out, err = process.communicate(timeout=20)
    return process.returncode, out, err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_an_object_is_deleted_is_not_lost(number):
    status, out, err = interrupted(IN_A_DESTRUCTOR, number)
    assert status == 0 and out == "heard\n" and not err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_process_that_waits_for_ever_ends_and_says_where_it_stood(number):
    status, _, err = interrupted(IN_THE_MIDDLEWARE, number)
    assert status == 1 and "Timeout" in err and 'File "<string>"' in err


def test_a_node_that_does_not_leave_is_left_behind(monkeypatch):
    held = threading.Event()

    class Stuck:
        def destroy_node(self):
            held.wait(20)

    monkeypatch.setattr("rclpy.try_shutdown", lambda: None)
    assert not supervision.leave_graph(Stuck(), within=0.2)
    held.set()
    assert supervision.leave_graph(Stuck(), within=5)
