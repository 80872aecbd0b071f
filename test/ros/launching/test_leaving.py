"""A participant takes its listener away by a wait that sleeps, not by Fast DDS's own, which can spin for ever."""

import subprocess
import sys

PROGRAM = """
import ctypes
import microstage_ros.ros
import rclpy

rclpy.init()
library = ctypes.CDLL("libmicrostage_set_listener.so")
count = ctypes.c_uint.in_dll(library, "microstage_listeners_set")
node = rclpy.create_node("leaving", namespace="/leaving")
before = count.value
node.destroy_node()
rclpy.try_shutdown()
print(count.value - before)
"""


def test_the_middleware_calls_the_wait_that_sleeps(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "231")
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) >= 1
