"""One point-to-point move as it happens: is it there, since when, how far beyond, how exactly."""

import math
from collections import deque

import numpy as np

from microstage_ros.quantities.errors import InputError

MOVING, SETTLING = 1, 2
LONGEST = 86_400.0
"""Longest timeout [s]: a day."""


def check_move(target, tolerance, settle_time, timeout, travel, place="move"):
    """Refuse what cannot be a move. Raises `InputError` with field, value and what would be right.

    ``target`` [m], ``tolerance`` [m], ``settle_time`` [s], ``timeout`` [s]; ``travel``: (minimum, maximum) [m].
    """
    low, high = travel
    if not (math.isfinite(target) and low <= target <= high):
        raise InputError(f"{place}: target", target, f"a position from {low} to {high} m")
    for name, value in (("tolerance", tolerance), ("timeout", timeout)):
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(
                f"{place}: {name}", value, f"a finite {'width in m' if name == 'tolerance' else 'time in s'} above 0"
            )
    if not (math.isfinite(settle_time) and 0.0 <= settle_time <= timeout):
        raise InputError(f"{place}: settle_time", settle_time, f"a time in s from 0 to the timeout, {timeout:g} s")
    if timeout > LONGEST:
        raise InputError(f"{place}: timeout", timeout, f"at most {LONGEST:g} s")


class Move:
    """Watches one move.

    Parameters
    ----------
    start, target : [m]. tolerance : half width of the band around the target [m]. settle_time, timeout : [s].
    start_sequence, rest_sequence : control periods in which the reference begins and ends to move.
    period : control period [s].

    Attributes
    ----------
    done, reached : it is over; it was within the tolerance for the settle time.
    phase : `MOVING` or `SETTLING`. end_sequence : control period in which it was over.
    overshoot : beyond the target in the direction of the move [m], 0 or more. stopped : where and when it was stopped
    after
        its timeout, in words.
    """

    def __init__(self, start, target, tolerance, settle_time, timeout, start_sequence, rest_sequence, period):
        self.start, self.target = start, target
        self.tolerance, self.settle_time = tolerance, settle_time
        self.start_sequence, self.rest_sequence, self.period = start_sequence, rest_sequence, period
        self.end_sequence = None
        self.done = self.reached = False
        self.stopped = ""
        self.overshoot = 0.0
        self._direction = math.copysign(1.0, target - start)
        self._last_sequence = start_sequence + timeout / period
        self._entered = None
        self._within = deque()

    def update(self, sequence, position):
        """The encoder read ``position`` [m] in period number ``sequence`` [1]."""
        if self.done or sequence < self.start_sequence:
            return
        error = position - self.target
        self.overshoot = max(self.overshoot, self._direction * error)
        if abs(error) > self.tolerance:
            self._entered = None
            self._within.clear()
        else:
            self._entered = sequence if self._entered is None else self._entered
            self._within.append((sequence, error))
            since = max(self._entered, self.rest_sequence)
            if (sequence - since) * self.period >= self.settle_time * (1 - 1e-9):
                self.done = self.reached = True
                self.end_sequence = sequence
        if not self.done and sequence > self._last_sequence:
            self.done, self.end_sequence = True, sequence

    def phase(self, sequence):
        """`MOVING` while the reference moves, `SETTLING` afterwards; ``sequence``: number of the control period [1]."""
        return MOVING if sequence < self.rest_sequence else SETTLING

    @property
    def settling_time(self):
        """From the start of the move to the last entry into the tolerance [s]; NaN while outside."""
        if self._entered is None:
            return math.nan
        return (self._entered - self.start_sequence) * self.period

    @property
    def window(self):
        """First and last control period over which the final error is taken: the settle time."""
        end = self.end_sequence
        return end - round(self.settle_time / self.period), end

    @property
    def final_error(self):
        """Mean of encoder - target over the settle time [m]; NaN if it was never within the tolerance."""
        first, _ = self.window
        errors = [error for sequence, error in self._within if sequence >= first]
        return float(np.mean(errors)) if errors else math.nan
