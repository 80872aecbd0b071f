"""What other threads ask of a servo loop, done by the loop between two control periods."""

import queue
import threading

import numpy as np


class Requests:
    """Actions for the loop of a process.

    Parameters
    ----------
    wake : called without arguments after every request, to end the loop's sleep.

    Attributes
    ----------
    asked : int64 of shape (1,), 1 while something waits; compiled code looks at it.
    """

    def __init__(self, wake=lambda: None):
        self._queue, self._wake = queue.SimpleQueue(), wake
        self.asked = np.zeros(1, np.int64)

    def ask(self, action, timeout=5.0):
        """Have the loop do it; returns or raises what ``action`` does. Raises `TimeoutError`."""
        done, outcome = threading.Event(), []
        self._queue.put((action, done, outcome))
        self.asked[0] = 1
        self._wake()
        if not done.wait(timeout):
            raise TimeoutError(f"the servo loop did not answer within {timeout} s")
        result, error = outcome
        if error is not None:
            raise error
        return result

    def interrupt(self):
        """End compiled code and the loop's sleep: somebody has to look, now."""
        self.asked[0] = 1
        self._wake()

    def serve(self):
        """Do all that waits; called by the loop."""
        if not self.asked[0]:
            return
        self.asked[0] = 0
        while not self._queue.empty():
            action, done, outcome = self._queue.get()
            try:
                outcome += [action(), None]
            except Exception as error:  # noqa: BLE001 - it belongs to who asked
                outcome += [None, error]
            done.set()
