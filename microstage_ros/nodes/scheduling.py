"""Keeping time: a sleep that spins its last stretch, and real-time scheduling where it is permitted."""

import ctypes
import os
import time

SPIN = 30e-6
"""Last stretch before a deadline that is spent spinning [s]; a sleep with no timer slack is later by less."""

PR_SET_TIMERSLACK = 29


def sleep_precisely():
    """Ask the kernel for sleeps of this thread without its 50 µs of slack; where it refuses, sleeps are later."""
    try:
        ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0)
    except (OSError, AttributeError):
        pass


def sleep_until(deadline):
    """Return at ``deadline`` [s of time.perf_counter], sleeping first and spinning at the end."""
    rest = deadline - time.perf_counter()
    if rest > SPIN:
        time.sleep(rest - SPIN)
    while time.perf_counter() < deadline:
        pass


def ask_for_priority(logger, priority):
    """SCHED_FIFO at ``priority`` for this process if above 0; says so where it is not permitted."""
    if priority <= 0:
        return
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        logger.warning(f"real-time priority {priority} is not permitted here (ulimit -r): normal scheduling")
