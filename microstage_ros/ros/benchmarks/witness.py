"""A witness of what the host does: when did it keep each processor from everybody.

One small process per processor, above the driver and its watchdog in rank, sleeps a millisecond again and again and
writes down when it woke too late. Nothing in this computer can keep it from its processor, apart from the host of a
virtual machine (and the limit of 95 % that Linux sets to real-time threads), so a late zero voltage while a witness was
late too is none of this project's. Without the right to real-time priority it sees this computer's own load as well,
and says so.
"""

import gc
import mmap
import os
import struct
import subprocess
import sys
import time

PRIORITY = 45
SLEEP_S, LATE_NS = 1e-3, 500_000
"""It sleeps so long [s]; a waking so much too late [ns] is written down."""

ROWS = 4096
BYTES = 16 + 16 * ROWS
"""Words of the shared memory: number of gaps so far, 1 with real-time priority; then begin and end of each gap [ns], in
a ring."""


def watch(descriptor, processor):
    """Write down gaps until killed, into the file ``descriptor`` [1], from the ``processor`` of that number [1]."""
    memory = mmap.mmap(descriptor, BYTES)
    os.sched_setaffinity(0, {processor})
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        struct.pack_into("<q", memory, 8, 1)
    except OSError:
        pass
    gc.disable()
    count, last, parent = 0, time.monotonic_ns(), os.getppid()
    while count % 256 or os.getppid() == parent:
        time.sleep(SLEEP_S)
        now = time.monotonic_ns()
        if now - last > SLEEP_S * 1e9 + LATE_NS:
            struct.pack_into("<qq", memory, 16 + 16 * (count % ROWS), last + round(SLEEP_S * 1e9), now)
            count += 1
            struct.pack_into("<q", memory, 0, count)
        last = now


class Witness:
    """The witnesses of all processors."""

    def __init__(self):
        self._all = []
        for processor in sorted(os.sched_getaffinity(0)):
            descriptor = os.memfd_create("microstage_witness", 0)
            os.ftruncate(descriptor, BYTES)
            process = subprocess.Popen(
                [sys.executable, "-S", "-E", __file__, str(descriptor), str(processor)],
                pass_fds=[descriptor],
                stdin=subprocess.DEVNULL,
            )
            self._all.append((process, mmap.mmap(descriptor, BYTES, prot=mmap.PROT_READ)))
            os.close(descriptor)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        for process, _ in self._all:
            process.kill()
            process.wait()

    @property
    def real_time(self):
        """True if the witnesses have real-time priority."""
        return all(struct.unpack_from("<q", memory, 8)[0] for _, memory in self._all)

    def kept_away(self, begin_ns, end_ns):
        """How long the host kept the worst-off processor away between two moments of the monotonic clock [s]."""
        return max(_overlap(memory, begin_ns, end_ns) for _, memory in self._all) * 1e-9


def _overlap(memory, begin, end):
    count = struct.unpack_from("<q", memory, 0)[0]
    found = 0
    for k in range(min(count, ROWS)):
        first, last = struct.unpack_from("<qq", memory, 16 + 16 * k)
        found += max(min(last, end) - max(first, begin), 0)
    return found


if __name__ == "__main__":
    watch(int(sys.argv[1]), int(sys.argv[2]))
