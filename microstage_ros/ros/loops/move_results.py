"""What the move server tells of its moves: the result of each, and the statistics of all."""

import math
import threading
import time

import numpy as np
from microstage_msgs.msg import AccuracyRow

from microstage_ros.ros.loops.move_state import RESULT, MoveState

INTERFEROMETER_WAIT = 2.0
"""Lockstep: longest wait [s] for the interferometer's readings of a settle time."""
PACED_WAIT = 0.4
"""The same where time is the wall clock's."""

UNNUMBERED = 0
"""Of readings of an instrument of its own (`instrument_topic`), which knows no control periods."""

MOST_RESULTS = 10_000
"""Statistics are of so many moves, the newest: a move every second for three hours."""

RESULT_KEPT_S = 60.0
"""How long [s] a client can ask for the result of a goal that has ended. The action server keeps all of them so long,
and by itself for 900 s, in which a busy client fills memory."""


class Readings:
    """The last readings of the interferometer; written by one thread, read by others. All memory is taken at the start.

    Parameters
    ----------
    most : so many are kept.

    Attributes
    ----------
    latest : control period of the last one, -1 before the first.
    """

    def __init__(self, most=100_000):
        self._sequence, self._position = np.full(most, -1), np.full(most, np.nan)
        self._next, self.latest = 0, -1

    def extend(self, sequences, positions):
        """Add readings: ``sequences`` of control periods [1] and ``positions`` [m], each of shape (n,)."""
        if not len(sequences):
            return
        sequences, positions = sequences[-len(self._sequence):], positions[-len(self._sequence):]
        if sequences[0] < self.latest:  # the driver began anew
            self._sequence[:] = -1
        places = (self._next + np.arange(len(sequences))) % len(self._sequence)
        self._position[places], self._sequence[places] = positions, sequences
        self._next, self.latest = int(places[-1]) + 1, int(sequences[-1])

    def between(self, first, last):
        """Positions [m], shape (n,), read in the periods from number ``first`` to ``last`` [1]."""
        return self._position[(self._sequence >= first) & (self._sequence <= last)]


class Results:
    """What the statistics need of the newest moves that reached their target. All memory is taken at the start.

    Parameters
    ----------
    most : so many are kept.
    """

    def __init__(self, most=MOST_RESULTS):
        self._table, self._count, self._lock = np.full((most, 4), np.nan), 0, threading.Lock()

    def add(self, distance, final_error, interferometer_error, settling_time):
        """Add a move.

        Parameters
        ----------
        distance : how far it went [m]. final_error, interferometer_error : encoder and interferometer less the target
            [m]. settling_time : until it stays within the tolerance [s].
        """
        with self._lock:
            self._table[self._count % len(self._table)] = distance, final_error, interferometer_error, settling_time
            self._count += 1

    def clear(self):
        """Begin anew."""
        with self._lock:
            self._count = 0

    def by_distance(self):
        """Distance [m], to a nanometre, to the other three columns of its moves, shape (n, 3)."""
        with self._lock:
            table = self._table[:self._count].copy()
        distances = np.round(table[:, 0], 9)
        return {float(each): table[distances == each, 1:] for each in dict.fromkeys(distances.tolist())}


class MoveResults(MoveState):
    """Results of `MoveServer`: ``_readings`` of the interferometer, ``_results`` of the newest moves."""

    def __init__(self):
        super().__init__()
        self._readings, self._results = Readings(), Results()

    def _fill(self, result, move):
        result.reached, result.final_error, result.overshoot = move.reached, move.final_error, move.overshoot
        result.settling_time = move.settling_time
        result.start_sequence, result.end_sequence = move.start_sequence, move.end_sequence
        result.code = RESULT.CODE_REACHED if move.reached else RESULT.CODE_TIMEOUT
        result.message = "reached" if move.reached else (
            f"not within {move.tolerance} m of the target for {move.settle_time} s before the timeout"
            + (f"; stopped {move.stopped}" if move.stopped else ""))
        if move.reached:
            result.interferometer_error = self._interferometer_error(move)
            self._results.add(move.target - move.start, result.final_error, result.interferometer_error,
                              result.settling_time)

    def _interferometer_error(self, move):
        """Mean of interferometer - target over the settle time [m]; NaN without an interferometer, and with one whose
        readings have no control periods."""
        if not self._interferometer.publishers or self._readings.latest == UNNUMBERED:
            return math.nan
        first, last = move.window
        lockstep = self._status is not None and self._status.lockstep
        until = time.monotonic() + (INTERFEROMETER_WAIT if lockstep else PACED_WAIT)
        while self._readings.latest < last and time.monotonic() < until:
            time.sleep(0.002)
        found = self._readings.between(first, last)
        return float(np.mean(found)) - move.target if len(found) else math.nan

    def _serve_statistics(self, request, response):
        from microstage_ros.metrology.repeatability import repeatability  # scipy.stats takes a second to load

        for distance, table in self._results.by_distance().items():
            interferometer = bool(np.isfinite(table[:, 1]).all())
            errors = table[:, 1 if interferometer else 0]
            row = AccuracyRow(target=distance, count=len(errors), mean_error=float(errors.mean()), four_sigma=math.nan,
                              four_sigma_low=math.nan, four_sigma_high=math.nan, interferometer=interferometer,
                              settling_time_median=float(np.median(table[:, 2])))
            if len(errors) > 1:
                r = repeatability(errors)
                row.four_sigma, (row.four_sigma_low, row.four_sigma_high) = r.four_s, r.four_s_interval
            response.rows.append(row)
        if request.reset:
            self._results.clear()
        return response
