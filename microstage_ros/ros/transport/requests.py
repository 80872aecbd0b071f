"""What other threads ask of a servo loop, done by the loop between two control periods."""

import queue
import threading

import numpy as np

ENDED = "the servo loop has ended"


class _Request:
    """One action; whoever takes it first decides whether it is done: the loop, or the asker who waits no longer."""

    def __init__(self, action, withdraw):
        self.action, self.withdraw, self.done, self.result, self.error = action, withdraw, threading.Event(), None, None
        self._free = threading.Lock()

    def claim(self):
        """True for the first who asks."""
        return self._free.acquire(blocking=False)


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
        self._ended = False

    def ask(self, action, timeout=5.0, withdraw=True):
        """Have the loop do it; returns or raises what ``action`` does. Raises `TimeoutError`, at once if the loop has
        ended.

        An action that has not begun within ``timeout`` [s] is withdrawn: whoever asked has been informed that it was
        not done. Without ``withdraw`` it is done late rather than never, as a stop must be.
        """
        request = _Request(action, withdraw)
        self._queue.put(request)
        self.asked[0] = 1
        self._wake()
        if self._ended and request.claim():
            raise TimeoutError(ENDED)
        if not request.done.wait(timeout):
            withdrawn = withdraw and request.claim()
            raise TimeoutError(
                f"the servo loop did not answer within {timeout} s"
                + ("; the request is withdrawn" if withdrawn else "; it is done as soon as the loop goes on")
            )
        if request.error is not None:
            raise request.error
        return request.result

    def interrupt(self):
        """End compiled code and the loop's sleep: somebody has to look, now."""
        self.asked[0] = 1
        self._wake()

    def serve(self):
        """Do all that waits and was not withdrawn; called by the loop."""
        if not self.asked[0]:
            return
        self.asked[0] = 0
        while not self._queue.empty():
            request = self._queue.get()
            if not request.claim():
                continue
            self._do(request)
            request.done.set()

    @staticmethod
    def _do(request):
        try:
            request.result, request.error = request.action(), None
        except Exception as error:  # noqa: BLE001 - it belongs to who asked
            request.error = error

    def close(self):
        """The loop has ended: do what must not be withdrawn, and refuse all else, now and from now on.

        A callback that waited for a loop that had ended kept its process for 2 s, and with it the end of the cell.
        """
        self._ended = True
        while not self._queue.empty():
            request = self._queue.get()
            if not request.claim():
                continue
            request.error = TimeoutError(ENDED)
            if not request.withdraw:
                self._do(request)
            request.done.set()
