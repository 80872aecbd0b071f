"""Messages that are looked at before they are used: whole, of the right kind, and from the process that may send them.

Each look costs the same whatever came. What fails is dropped and counted, `malformed` or `foreign`.
"""

import time

import numpy as np

from microstage_ros.numerics.compiled import kind_of
from microstage_ros.ros.transport.c_calls import INFO_WORDS, Space, load_libraries, take_from
from microstage_ros.ros.transport.identity import ANYBODY, process_of_message
from microstage_ros.ros.transport.servo_path import Reader

LOOK_AGAIN = 0.2
"""At most so often [s] the graph is asked who publishes, because of a message from somebody else."""

SILENT = 1.0
"""A holder that has sent nothing for so long [s] is given up for another that sends, where the topic may change
hands."""

MOST = 2**62
"""Numbers of control periods are smaller."""


def load_taking():
    """Load the compiled code that takes a message, before anybody waits for it, and with the first of it what numba
    loads once in a process: 0.1 s of processor time that a process which forks others takes once for all of them."""
    load_libraries()
    take_from.compile((kind_of(0), kind_of(0), kind_of(np.zeros(INFO_WORDS, np.int64))))


class CheckedReader:
    """A reader of whole messages from one process.

    Parameters
    ----------
    reader : of `servo_path`. size : fewest bytes of a message. holder : `identity.Holder`, None for anybody.
    largest : most bytes of a message, where it is not of one size. passes_on : another process may take the place of a
        holder that is silent; for the commander of an axis it may not.

    Attributes
    ----------
    malformed, foreign : counters of what was dropped.
    """

    def __init__(self, reader, size, holder=None, largest=None, passes_on=True):
        self.reader, self._size, self._holder, self._passes_on = reader, size, holder, passes_on
        self.malformed = self.foreign = 0
        self._direct = isinstance(reader, Reader)
        self._heard = self._looked = 0.0
        if self._direct:
            load_taking()
            self._space, self._info = Space(largest or size), np.zeros(INFO_WORDS, np.int64)

    @property
    def publishers(self):
        """Number of matched publishers."""
        return self.reader.publishers

    def take(self):
        """CDR bytes of the oldest good message that waits, None if none does."""
        while (raw := self._next()) is not None:
            if len(raw) < self._size:
                self.malformed += 1
            elif self._direct and self._holder is not None and not self._from_holder():
                self.foreign += 1
            else:
                self._heard = time.monotonic() if self._passes_on else 0.0
                return raw
        return None

    def _next(self):
        if not self._direct:
            return self.reader.take()
        return self._space.taken() if take_from(self.reader.address, self._space.address, self._info) else None

    def _from_holder(self):
        holder = self._holder
        if holder.words[0] and holder.is_of(self._info):
            return True
        now = time.monotonic()
        if not self._passes_on or now - self._looked < LOOK_AGAIN:
            return not self._passes_on and holder.is_of(self._info)
        self._looked = now
        if now - self._heard > SILENT:
            holder.look_beyond()
        else:
            holder.look()
        if holder.words[0]:
            return holder.is_of(self._info)
        return process_of_message(self._info) not in holder.publishers()  # the graph has not heard of the sender yet

    @property
    def sender(self):
        """Numbers of the process that sent what was taken last, as `identity.process_of` gives them."""
        return process_of_message(self._info) if self._direct else ANYBODY
