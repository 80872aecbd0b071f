"""Keeping time: a sleep that spins its last stretch, and real-time scheduling where it is permitted."""

import ctypes
import faulthandler
import os
import resource
import signal
import time
from pathlib import Path

from microstage_ros.quantities.errors import InputError

SPIN = 40e-6
"""Last stretch before a deadline that is spent spinning [s]: to sleep and be woken takes about as long."""

PR_SET_TIMERSLACK = 29
_ALLOWED = os.sched_getaffinity(0)


def sleep_precisely():
    """Ask the kernel for sleeps of this thread without its 50 µs of slack; where it refuses, sleeps are later."""
    try:
        ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0)
    except (OSError, AttributeError):
        pass


def sleep_until(deadline):
    """Return at ``deadline`` [s], by time.perf_counter, sleeping first and spinning at the end."""
    rest = deadline - time.perf_counter()
    if rest > SPIN:
        time.sleep(rest - SPIN)
    while time.perf_counter() < deadline:
        pass


def processors(text):
    """Numbers of processors from text such as ``1`` or ``0,2-3``; empty: None, all of them.

    Raises
    ------
    InputError : not such a text, or a processor that this process may not use.
    """
    if not text.strip():
        return None
    try:
        ranges = [[int(end) for end in part.split("-")] for part in text.split(",")]
        found = {number for ends in ranges for number in range(ends[0], ends[-1] + 1)}
    except ValueError:
        found = set()
    allowed = os.sched_getaffinity(0)
    if not found or not found <= allowed:
        raise InputError("parameter cpus", text, f"some of {sorted(allowed)}, such as 1 or 0,2-3; empty for all")
    return found


POLICIES = {"normal": os.SCHED_OTHER, "batch": os.SCHED_BATCH, "real_time": os.SCHED_FIFO}
HIGHEST = -20
"""Rank among normal threads."""

DELIVERY_PRIORITY = 10
"""Highest real-time priority of the middleware's threads, below that of every servo loop: such a thread turns while a
message is half written. If it ranked as high as the loop that writes the message, on the same processor, neither would
ever go on."""

LONGEST_UNBROKEN_S = 1.0
"""Longest processor time [s] that a real-time thread may take without waiting for anything; then the kernel ends the
process (SIGXCPU, and SIGKILL after as long again). The watchdog takes the voltage away long before.

A thread of the middleware that reads shared memory can turn for ever after the writer was killed in the middle of a
write. At a real-time priority it would starve the servo loop of its own process, which then could not even be asked to
stop, and everything else on that processor. A loop that works waits in every period, and loading compiled code takes
tenths of a second.
"""


def take_place(logger, cpus, scheduling="normal", priority=0):
    """Put the servo loop on ``cpus`` (None: anywhere), under a scheduling of `POLICIES`; ``priority`` [1] under
    real_time.

    That is the main thread and those of the middleware that bring it messages. Under `batch` and `real_time` they have
    ``cpus`` to themselves: all other threads of the process (services, discovery, who sends blocks) go to the other
    processors, if there are any; and a thread that is woken does not take the processor from the one that woke it in
    the middle of its work. Under `normal` the whole process keeps to ``cpus``.
    """
    if scheduling == "real_time":
        bound_real_time()
    rest = set() if cpus is None else cpus if scheduling == "normal" else _ALLOWED - cpus
    own = priority if scheduling == "real_time" else 0
    for thread in map(int, os.listdir("/proc/self/task")):
        try:
            hot = thread == os.getpid() or _carries_messages(thread)
            if cpus is not None and (hot or rest):
                os.sched_setaffinity(thread, cpus if hot else rest)
            if not hot:
                continue
            if scheduling != "normal":
                rank = own if thread == os.getpid() else min(own, DELIVERY_PRIORITY)
                os.sched_setscheduler(thread, POLICIES[scheduling], os.sched_param(rank))
            if scheduling == "real_time":  # for the moments when it is a normal thread
                os.setpriority(os.PRIO_PROCESS, thread, HIGHEST)
        except PermissionError:
            logger.warning(f"real-time priority {priority} is not permitted here (ulimit -r): normal scheduling")
            return
        except ProcessLookupError:  # a thread that ended meanwhile
            continue


def bound_real_time(seconds=LONGEST_UNBROKEN_S):
    """Have the kernel end this process once a real-time thread of it has run for ``seconds`` [s] without a wait
    (RLIMIT_RTTIME). Where each thread of Python stood then goes to the standard error first."""
    faulthandler.register(signal.SIGXCPU, chain=True)
    soft = int(seconds * 1e6)
    _, most = resource.getrlimit(resource.RLIMIT_RTTIME)
    hard = 2 * soft if most == resource.RLIM_INFINITY else min(2 * soft, most)
    resource.setrlimit(resource.RLIMIT_RTTIME, (min(soft, hard), hard))


def _carries_messages(thread):
    """True for a thread of Fast DDS that waits for messages in shared memory."""
    try:
        return Path(f"/proc/self/task/{thread}/comm").read_text(encoding="utf-8").startswith("dds.dsha")
    except OSError:
        return False
