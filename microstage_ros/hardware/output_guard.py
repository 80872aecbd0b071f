"""The watch over the output: the voltage goes to zero although the driver's loop stands still or its process is gone.

Driver and watchdog share 64 bytes of memory that belong to no process alone. The driver writes there what it last put
out and when the last valid command came; a small process of its own (`hardware.watchdog`) sleeps until that is too long
ago, and then takes the voltage away: in the simulation by writing zero into the shared output, which is then the latch
of the simulated card; of a machine, by the backend's `outside_stop`. It hears of the driver's death through a pipe that
the operating system closes, at once.

What it cannot do: it runs on the same computer. If that stands still, only the card's own watchdog and the drive's
enable circuit help (docs/safety.md).
"""

import json
import mmap
import os
import subprocess
import sys
import threading
import time

import numpy as np

from microstage_ros.hardware import watchdog
from microstage_ros.hardware.watchdog import BEAT, DOG, HOLDS, LIMIT, TAKEN, TAKEN_COUNT, VOLTS, ZEROED

SILENT = 2.0
"""A watchdog that has not looked for so long [s] does not watch: it is replaced."""

START_S, RENEW_S = 120.0, 5.0
"""Longest wait [s] for a watchdog to begin: before anything is energised, where a busy host may take its time, and in
place of one that has ended."""


class OutputGuard:
    """The driver's side.

    Parameters
    ----------
    limit : longest time [s] without a valid command before the watchdog acts; 0: only when the driver dies.
    holds : the output keeps its value whatever happens; the watchdog has nothing to take away.

    Attributes
    ----------
    words, volts : the shared memory as int64 and as float64, shape (`watchdog.WORDS`,); places as there.
    pid : of the watchdog's process, None while there is none.
    restarts : how often it had to be started again.
    """

    def __init__(self, limit=0.0, holds=False):
        self._limit_ns = 0 if holds else round(limit * 1e9)
        self._memory = os.memfd_create("microstage_output", 0)
        os.ftruncate(self._memory, watchdog.BYTES)
        self._map = mmap.mmap(self._memory, watchdog.BYTES)
        self.words, self.volts = np.frombuffer(self._map, np.int64), np.frombuffer(self._map, np.float64)
        self.words[HOLDS] = holds
        self._process, self._alive, self.restarts = None, None, 0
        self._starting, self._closed = threading.Lock(), False

    @property
    def pid(self):
        """Of the watchdog's process."""
        return None if self._process is None else self._process.pid

    def start(self, outside_stop=None, wait=START_S):
        """Start the watchdog and wait until it watches; one thread at a time.

        Parameters
        ----------
        outside_stop : what `SafetyMembers.outside_stop` gives, None for the shared output alone.
        wait : longest wait [s]; nothing is energised before it watches, so a busy host may take its time.

        Returns
        -------
        bool
            True if it watches.
        """
        with self._starting:
            return self._start(outside_stop, wait)

    def _start(self, outside_stop, wait):
        self._end()
        ours, self._alive = os.pipe()
        self.words[DOG] = 0
        command = [
            sys.executable,
            "-S",
            "-E",
            watchdog.__file__,
            str(self._memory),
            str(ours),
            json.dumps(outside_stop),
        ]
        if outside_stop:  # it needs the package
            command = [sys.executable, "-m", watchdog.__name__, *command[4:]]
        self._process = subprocess.Popen(command, pass_fds=[self._memory, ours], stdin=subprocess.DEVNULL,
                                         start_new_session=True)
        os.close(ours)
        end = time.monotonic() + wait
        while self.words[DOG] == 0 and time.monotonic() < end and self._process.poll() is None and not self._closed:
            time.sleep(0.002)
        return self.words[DOG] != 0 and self._process.poll() is None

    @property
    def watching(self):
        """True while the watchdog's process is there and has looked lately."""
        process = self._process
        return process is not None and process.poll() is None and (
            time.monotonic_ns() - int(self.words[DOG]) < SILENT * 1e9)

    def renew(self, outside_stop=None):
        """Start the watchdog again if it does not watch. True if it watches now, or another thread is starting it."""
        if self.watching or not self._starting.acquire(blocking=False):
            return True
        try:
            self.restarts += 1
            return self._start(outside_stop, RENEW_S)
        finally:
            self._starting.release()

    def arm(self):
        """Commands are expected from now on."""
        self.words[BEAT] = time.monotonic_ns()
        self.words[TAKEN] = 0
        self.words[LIMIT] = self._limit_ns

    def disarm(self):
        """No commands are expected; the driver's death still takes the voltage away."""
        self.words[LIMIT] = 0

    def put(self, voltage):
        """The driver has put out ``voltage`` [V]."""
        if voltage == 0.0 and self.volts[VOLTS] != 0.0:
            self.words[ZEROED] = time.monotonic_ns()
        self.volts[VOLTS] = voltage

    def commanded(self, time_ns):
        """A valid command came at ``time_ns`` [ns of the monotonic clock]."""
        self.words[BEAT] = time_ns

    @property
    def taken(self):
        """When the watchdog took the voltage away [ns of the monotonic clock], 0 if it did not."""
        return int(self.words[TAKEN])

    @property
    def taken_after(self):
        """How long after the last valid command that was [s]."""
        return (self.taken - int(self.words[BEAT])) * 1e-9

    @property
    def taken_count(self):
        """How often it did."""
        return int(self.words[TAKEN_COUNT])

    def hand_back(self):
        """The loop goes on."""
        self.words[TAKEN] = 0

    def close(self):
        """End the watchdog; the voltage is zero before, where it does not hold."""
        self._closed = True
        self.disarm()
        if not self.words[HOLDS]:
            self.put(0.0)
        with self._starting:
            self._end()

    def _end(self):
        if self._alive is not None:
            os.close(self._alive)
            self._alive = None
        if self._process is not None:
            try:
                self._process.wait(0.5)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._process = None
