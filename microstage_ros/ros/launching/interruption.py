"""Ctrl-C and SIGTERM for the process that a person starts a cell with: never lost, and never without an end."""

import faulthandler
import signal
import socket
import threading

STOPPING = (signal.SIGINT, signal.SIGTERM)
LAST_RESORT = 10.0
"""A process that is still there so long [s] after it was asked to stop ends at once, whatever it waits for."""


class Interruption:
    """SIGINT and SIGTERM, heard by a thread of its own, whatever the main thread does.

    They raise nothing in the main thread: an exception that comes while Python deletes an object is lost, and one that
    comes inside a library may leave a lock of it shut. A process that is still there `LAST_RESORT` seconds after the
    first signal prints where each of its threads stands and ends with status 1; the system then stops its nodes.
    """

    def __init__(self):
        self._came = threading.Event()
        self._ours, self._theirs = socket.socketpair()
        self._theirs.setblocking(False)
        signal.set_wakeup_fd(self._theirs.fileno(), warn_on_full_buffer=False)
        for number in STOPPING:
            signal.signal(number, lambda *_: self._came.set())
        threading.Thread(target=self._wait, name="signals", daemon=True).start()

    def _wait(self):
        while not set(self._ours.recv(64)) & set(STOPPING):
            pass
        self._came.set()
        faulthandler.dump_traceback_later(LAST_RESORT, exit=True)  # needs no lock of the interpreter

    def check(self):
        """Raise KeyboardInterrupt if one has come."""
        if self._came.is_set():
            raise KeyboardInterrupt
