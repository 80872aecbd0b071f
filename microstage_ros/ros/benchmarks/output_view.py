"""The shared output of a driver, seen from another process: for tests and for the fault campaign."""

import mmap
import os
import struct
import time

from microstage_ros.hardware import watchdog
from microstage_ros.hardware.watchdog import BEAT, DIED, TAKEN, VOLTS, ZEROED

NAME = "microstage_output"


class OutputView:
    """Reads what a driver puts out, also when it has been killed.

    Parameters
    ----------
    pid : of the driver's process, while it is there.

    Raises
    ------
    LookupError : that process has no shared output.

    Attributes
    ----------
    zero_ns : when the voltage went to zero, as `zero_after` found it last [ns of the monotonic clock].
    """

    def __init__(self, pid):
        self.zero_ns = 0
        for descriptor in os.listdir(f"/proc/{pid}/fd"):
            path = f"/proc/{pid}/fd/{descriptor}"
            try:
                if NAME in os.readlink(path):
                    with open(path, "r+b") as file:
                        self._map = mmap.mmap(file.fileno(), watchdog.BYTES, prot=mmap.PROT_READ)
                    return
            except OSError:
                continue
        raise LookupError(f"process {pid} has no shared output")

    @property
    def volts(self):
        """What is put out [V]."""
        return struct.unpack_from("<d", self._map, 8 * VOLTS)[0]

    def _word(self, place):
        return struct.unpack_from("<q", self._map, 8 * place)[0]

    @property
    def commanded_ns(self):
        """When the last valid command came [ns of the monotonic clock]."""
        return self._word(BEAT)

    @property
    def watchdog_died_ns(self):
        """When the watchdog heard of the driver's death, 0 if it did not [ns]."""
        return self._word(DIED)

    @property
    def by_watchdog(self):
        """True if the watchdog took the voltage away."""
        return self._word(TAKEN) > 0

    def zero_after(self, wait=5.0):
        """How long after the last valid command the voltage went to zero [s]; None if it has not within ``wait``
        [s]."""
        end = time.monotonic() + wait
        while self.volts != 0.0:
            if time.monotonic() > end:
                return None
            time.sleep(2e-4)
        moments = [self._word(place) for place in (TAKEN, DIED, ZEROED)]
        later = [moment for moment in moments if moment >= self.commanded_ns]
        self.zero_ns = min(later) if later else self.commanded_ns
        return (self.zero_ns - self.commanded_ns) * 1e-9
