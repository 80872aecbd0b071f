"""Credit: a simulated axis in lockstep runs only as far as every follower allows.

A follower grants "you may begin control periods up to N" as it goes along. So nobody falls behind by more
than its window, however slow it is, and nothing is lost; and time stands still where a follower wants it to.
"""

import threading
import time

from microstage_msgs.msg import Credit
from rclpy.serialization import deserialize_message

from microstage_ros.ros.transport.topics import CREDIT, SLOW

UNLIMITED = 2**62


def repeat_after(last):
    """How long [s] to wait before a credit is sent once more; ``last``: period heard of last, -1 for none.

    The first may have been sent before the driver was there to hear it.
    """
    return 0.5 if last >= 0 else 0.1


class Granter:
    """The follower's side."""

    def __init__(self, node):
        self._name = node.get_name()
        self._publisher = node.create_publisher(Credit, CREDIT, SLOW)
        self.until = self.told = -1

    def forget(self):
        """The driver began anew: what was granted before counts no more."""
        self.until = self.told = -1

    def grant(self, until):
        """The driver may begin control periods up to ``until``; never less than before."""
        self.until = max(until, self.until)
        self.told = -1
        self.tell()

    def tell(self):
        """Send what has been granted, if it was not sent before."""
        if self.until >= 0 and self.until != self.told:
            self.told = self.until
            self._publisher.publish(Credit(follower=self._name, until=self.until))


class CreditReader:
    """Takes credits into a ledger; for two threads.

    Parameters
    ----------
    reader : of the topic. ledger : `Ledger`. raised : called with the limit when it has changed.
    """

    def __init__(self, reader, ledger, raised=lambda limit: None):
        self.reader, self._ledger, self._raised, self._lock = reader, ledger, raised, threading.Lock()

    def take(self):
        """Enter all credits that wait."""
        with self._lock:
            before = self._ledger.limit
            while (raw := self.reader.take()) is not None:
                self._ledger.add(deserialize_message(raw, Credit))
            if self._ledger.limit != before:
                self._raised(self._ledger.limit)

    def drop_silent(self, timeout):
        """`Ledger.drop_silent`."""
        with self._lock:
            return self._ledger.drop_silent(timeout)


class Ledger:
    """The driver's side: who has granted how much, and when."""

    def __init__(self, expected=()):
        self._until = {name: -1 for name in expected if name}
        self._heard = {name: time.monotonic() for name in self._until}
        self.limit = min(self._until.values(), default=UNLIMITED)

    def add(self, credit):
        """Enter one credit."""
        self._until[credit.follower] = max(credit.until, self._until.get(credit.follower, -1))
        self._heard[credit.follower] = time.monotonic()
        self.limit = min(self._until.values())

    def missing(self):
        """Names of followers that have granted nothing so far."""
        return [name for name, until in self._until.items() if until < 0]

    def drop_silent(self, timeout):
        """Forget those that hold the axis up and have been silent for ``timeout`` [s]; returns their names."""
        now = time.monotonic()
        silent = [name for name, until in self._until.items()
                  if until == self.limit and now - self._heard[name] > timeout]
        for name in silent:
            del self._until[name], self._heard[name]
        self.limit = min(self._until.values(), default=UNLIMITED)
        return silent
