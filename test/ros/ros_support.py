"""What the ROS tests share: a domain of their own, waiting, asking."""

import fcntl
import os
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import microstage_ros.ros  # noqa: F401  (before rclpy loads the middleware)
import pytest

HIGHEST_DOMAIN = 100


@contextmanager
def own_domain():
    """A domain id that no other test has, in the environment for this process and its children."""
    folder = Path(tempfile.gettempdir()) / "microstage_test_domains"
    folder.mkdir(exist_ok=True)
    start = os.getpid() % HIGHEST_DOMAIN
    for offset in range(HIGHEST_DOMAIN):
        number = 1 + (start + offset) % HIGHEST_DOMAIN
        lock = open(folder / str(number), "w", encoding="ascii")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            continue
        before = os.environ.get("ROS_DOMAIN_ID")
        os.environ["ROS_DOMAIN_ID"] = str(number)
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        try:
            yield number
        finally:
            if before is None:
                del os.environ["ROS_DOMAIN_ID"]
            else:
                os.environ["ROS_DOMAIN_ID"] = before
            lock.close()
        return
    pytest.fail("no free ROS domain")


@contextmanager
def ros_node(name="tester", namespace="/axis"):
    """An rclpy node in a domain of its own."""
    import rclpy
    from rclpy.action import ActionClient, ActionServer

    with own_domain():
        rclpy.init()
        made = rclpy.create_node(name, namespace=namespace)
        try:
            yield made
        finally:
            for waitable in list(made.waitables):
                if isinstance(waitable, (ActionClient, ActionServer)):
                    waitable.destroy()  # destroy_node leaves them, and while one is there the participant is
            made.destroy_node()  # else its readers and writers go on to be there in this process
            rclpy.try_shutdown()


@contextmanager
def real_time_place():
    """The processor that paced cells pin their loops to: one test at a time, else two real-time loops starve each other."""
    with open(Path(tempfile.gettempdir()) / "microstage_test_real_time", "w", encoding="ascii") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


PATIENCE_S = 240.0
"""Longest wait [s] for what comes within seconds on a free machine: a hang ends there, a busy machine with two slow processors
does not."""


def spin_until(node, condition, seconds=PATIENCE_S):
    """Serve ``node`` until ``condition()``; fails after ``seconds``."""
    import rclpy

    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds} s"
        rclpy.spin_once(node, timeout_sec=0.05)


def ask(node, kind, name, request, seconds=PATIENCE_S):
    """Call a service; asked again where the answer was lost while processes discover each other."""
    client = node.create_client(kind, name)
    try:
        spin_until(node, client.service_is_ready, seconds)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            future = client.call_async(request)
            again = time.monotonic() + 4.0
            while not future.done() and time.monotonic() < again:
                import rclpy

                rclpy.spin_once(node, timeout_sec=0.05)
            if future.done():
                return future.result()
        pytest.fail(f"{name} does not answer")
    finally:
        node.destroy_client(client)


def shut_by_another_process(paths, which, then="os._exit(0)"):
    """A process that has shut lock number ``which`` of readers' segments and then does ``then``."""
    code = (f"import os, sys, signal, ctypes; from pathlib import Path\n"
            f"from microstage_ros.ros.transport.abandoned_locks import Segment\n"
            f"for path in sys.argv[1:]:\n    kept = Segment(Path(path))\n"
            f"    ctypes.CDLL(None).pthread_mutex_lock(kept.address({which}))\n"
            f"print(flush=True); {then}")
    command = [sys.executable, "-c", code, *map(str, paths)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout.readline() == b"\n"
    if then == "os._exit(0)":
        process.communicate()
    return process
