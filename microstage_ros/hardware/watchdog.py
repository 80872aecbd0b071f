"""The watchdog's process: sleeps until the last valid command is too long ago, then takes the voltage away.

Run by `output_guard`, as a file and without any library where the output is the shared memory alone, so that it is
there within 30 ms and never waits for anything else. Arguments: descriptor of the shared memory, descriptor of a pipe
that is closed when the driver dies, and what `SafetyMembers.outside_stop` gives, as JSON.
"""

import gc
import json
import mmap
import os
import select
import signal
import struct
import sys
import time

VOLTS, BEAT, LIMIT, TAKEN, DOG, TAKEN_COUNT, DIED, ZEROED, HOLDS = range(9)
"""Words of the shared memory: what is put out [V, float64]; when the last valid command came, the longest time without
one (0: not watched), when the watchdog acted (0: it did not), when it last looked [all ns of the monotonic clock]; how
often it acted; when it heard of the driver's death, when the driver itself last went to zero [ns]; 1: the
output keeps its value, since zero would be a move (`Actuator.holds_on_fault`)."""

WORDS = 9
BYTES = 8 * WORDS

LONGEST = 0.1
"""It looks at least so often [s]."""

PRIORITY = 40
"""Real-time priority, above that of the servo loop, where it is permitted."""

TRIES_S, AGAIN = 60.0, 0.01
"""After the driver's death a stop that does not succeed is tried for so long, and so often [s]."""


class Watch:
    """What the watchdog does at each look.

    Parameters
    ----------
    memory : mutable buffer of `BYTES`. stop : called to take the voltage of a machine away; False where it did not
        succeed: it is called again at the next look.
    """

    def __init__(self, memory, stop=lambda: True):
        self._memory, self._stop, self._undone = memory, stop, False

    def word(self, place):
        """One of the words above, by its ``place`` [1]."""
        return struct.unpack_from("<q", self._memory, 8 * place)[0]

    def set(self, place, value):
        """Write ``value``, int64 [unit of the word], to the word at ``place`` [1]."""
        struct.pack_into("<q", self._memory, 8 * place, value)

    def look(self):
        """Act if it is time to; how long to sleep until the next look [s]."""
        now = time.monotonic_ns()
        self.set(DOG, now)
        limit = self.word(LIMIT)
        if not limit:
            return LONGEST
        rest = self.word(BEAT) + limit - now
        if rest > 0:
            return min(rest * 1e-9, LONGEST)
        taken = self.word(TAKEN)
        volts = struct.unpack_from("<d", self._memory, 8 * VOLTS)[0]
        if volts != 0.0 and (not taken or now - taken >= limit):  # put out again by a loop that then stood still
            self.take(now)  # else the loop itself has done it in time
        elif taken and self._undone:
            self._take_from_machine()
        return limit * 1e-9

    def take(self, now):
        """Take the voltage away; ``now``: monotonic time [ns]."""
        if not self.word(HOLDS):
            struct.pack_into("<d", self._memory, 8 * VOLTS, 0.0)
        self.set(TAKEN, now)
        self.set(TAKEN_COUNT, self.word(TAKEN_COUNT) + 1)
        self._take_from_machine()

    def _take_from_machine(self):
        self._undone = self._stop() is False

    def died(self):
        """The driver is gone. Returns whether the machine's voltage was taken away."""
        now = time.monotonic_ns()
        self.set(DIED, now)
        if self.word(TAKEN):  # taken before, and when is worth keeping
            self._take_from_machine()
        else:
            self.take(now)
        while self._undone and time.monotonic_ns() - now < TRIES_S * 1e9:
            time.sleep(AGAIN)
            self._take_from_machine()
        return not self._undone


def outside_stop(text):
    """The function of a backend that takes the voltage away, from JSON; nothing to do for ``null``. It returns whether
    it succeeded; what it could not do is told once."""
    instruction = json.loads(text)
    if not instruction:
        return lambda: True
    import importlib

    module, _, name = instruction[0].partition(":")
    function, said = getattr(importlib.import_module(module), name), set()

    def stop():
        try:
            function(**instruction[1])
        except Exception as error:  # noqa: BLE001 - it is tried again, and the driver's end must still be heard
            words = f"watchdog: {instruction[0]}: {type(error).__name__}: {error}"
            if words not in said:
                print(words, file=sys.stderr, flush=True)
            said.add(words)
            return False
        return True

    return stop


def main(arguments):
    """Watch until the driver is gone. Returns 0; 1 where the voltage could not be taken away then."""
    memory, alive = int(arguments[0]), int(arguments[1])
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):  # it ends with the driver and not before
        signal.signal(number, signal.SIG_IGN)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        pass  # later by what the machine is busy with
    watch = Watch(mmap.mmap(memory, BYTES), outside_stop(arguments[2]))
    gc.freeze()
    gc.disable()
    alive = os.dup(alive)  # the lowest free number: select, which alone waits less than 1 ms, takes none from 1024 on
    sleep = 0.0
    while not select.select([alive], [], [], sleep)[0]:
        sleep = watch.look()
    return 0 if watch.died() else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
