"""Credit: a simulated axis in lockstep runs only as far as every follower allows.

A follower grants "you may begin control periods up to N" as it goes along. So nobody falls behind by more
than its window, however slow it is, and nothing is lost; and time stands still where a follower wants it to.
"""

import threading
import time

from microstage_msgs.msg import Credit
from rclpy.serialization import deserialize_message

from microstage_ros.ros.transport.servo_path import never_raising
from microstage_ros.ros.transport.topics import CREDIT, SLOW

UNLIMITED = 2**62

TAKES_OVER = 0.7
"""A follower's process that has been silent for so long [s] may be followed by another of its name; credits are
repeated at least every 0.5 s."""


def repeat_after(last):
    """How long [s] to wait before a credit is sent once more; ``last``: number of the period heard of last [1], -1
    for none.

    The first may have been sent before the driver was there to hear it.
    """
    return 0.5 if last >= 0 else 0.1


class Granter:
    """The follower's side."""

    def __init__(self, node):
        self._name = node.get_name()
        self._publish = never_raising(node.create_publisher(Credit, CREDIT, SLOW).publish)
        self.until = self.published = -1

    def forget(self):
        """The driver began anew: what was granted before counts no more."""
        self.until = self.published = -1

    def grant(self, until):
        """The driver may begin control periods up to number ``until`` [1]; never less than before."""
        self.until = max(until, self.until)
        self.published = -1
        self.tell()

    def tell(self):
        """Send what has been granted, if it was not sent before."""
        if self.until >= 0 and self.until != self.published:
            self.published = self.until
            self._publish(Credit(follower=self._name, until=self.until))


class CreditReader:
    """Takes credits into a ledger; for two threads.

    Parameters
    ----------
    reader : `checked.CheckedReader` of the topic. ledger : `Ledger`. raised : called with the limit when it has
        changed. present : called for the number of the present control period. named : called with a name and the
        numbers of a process (`identity.process_of`): is it that of the node of this name.
    """

    def __init__(
        self, reader, ledger, raised=lambda limit: None, present=lambda: -1, named=lambda name, sender: True
    ):
        ledger.named = named
        self.reader, self._ledger, self._raised, self._present = reader, ledger, raised, present
        self._lock, self.malformed = threading.Lock(), 0

    def take(self):
        """Enter all credits that wait."""
        with self._lock:
            before = self._ledger.limit
            while (raw := self.reader.take()) is not None:
                try:
                    credit = deserialize_message(raw, Credit)
                except Exception:  # noqa: BLE001 - whatever the bytes were, they were no credit
                    self.malformed += 1
                    continue
                self._ledger.add(credit, self.reader.sender, self._present())
            if self._ledger.limit != before:
                self._raised(self._ledger.limit)

    def drop_silent(self, timeout):
        """`Ledger.drop_silent` for who was silent for ``timeout`` [s]."""
        with self._lock:
            return self._ledger.drop_silent(timeout)


class Ledger:
    """The driver's side: who has granted how much, and when.

    Only those who are expected may grant, each from one process. A follower that has been started again begins with its
    window, counted from the present control period; what the process before it had granted counts no more.

    Attributes
    ----------
    limit : last control period that may begin. foreign : credits of others, not entered.
    """

    def __init__(self, expected=()):
        self._expected = {name for name in expected if name}
        self._until = {name: -1 for name in self._expected}
        self._heard = {name: time.monotonic() for name in self._until}
        self._sender = {}
        self.named = lambda name, sender: True
        self.foreign = 0
        self.limit = min(self._until.values(), default=UNLIMITED)

    def add(self, credit, sender=(0, 0), present=-1):
        """Enter one ``credit``, `Credit`, from the process ``sender``, two numbers [1], in control period ``present``
        [1]."""
        name, until, now = credit.follower, credit.until, time.monotonic()
        if name not in self._expected or not 0 <= until <= UNLIMITED:
            self.foreign += 1
            return
        if self._sender.get(name) != sender and not self.named(name, sender):
            self.foreign += 1
            return
        before = self._sender.get(name, sender)
        if before != sender:
            if now - self._heard[name] < TAKES_OVER and name in self._until:
                self.foreign += 1
                return
            self._until[name] = -1  # started again: it counts from now on
        if self._until.get(name, -1) < 0 <= present:
            until = min(present + until + 1, UNLIMITED)
        self._sender[name], self._heard[name] = sender, now
        self._until[name] = max(until, self._until.get(name, -1))
        self.limit = min(self._until.values())

    def missing(self):
        """Names of followers that have granted nothing so far."""
        return [name for name, until in self._until.items() if until < 0]

    def drop(self, name):
        """Wait for a follower no more."""
        self._until.pop(name, None)
        self.limit = min(self._until.values(), default=UNLIMITED)

    def drop_silent(self, timeout):
        """Forget those that hold the axis up and have been silent for ``timeout`` [s]; returns their names."""
        now = time.monotonic()
        silent = [
            name for name, until in self._until.items() if until == self.limit and now - self._heard[name] > timeout
        ]
        for name in silent:
            self.drop(name)
        return silent
