"""The reference as it is played to a controller: one position per control period, tied to period numbers.

A plan begins at a stated control period, so the reference of every period is settled before the period
begins and does not depend on when a message came. Between plans the reference stands still.
"""

import threading

import numpy as np

from microstage_ros.quantities.errors import InputError

IDLE, HOLDING, MOVING, STOPPING = 0, 1, 2, 3
JOINT = 1e-9
"""Largest step [m] between where the reference stands and where a plan begins."""


def check_speed(positions, period, fastest, place):
    """Raise `InputError` where a reference moves faster than ``fastest`` [m/s] from one control period to the next.

    ``positions`` [m], shape (n,), one per ``period`` [s]; ``place``: whose they are, for the message.
    """
    steps = np.abs(np.diff(positions))
    if len(steps) and steps.max() > fastest * period:
        bad = int(steps.argmax())
        raise InputError(
            f"{place}, positions {bad} and {bad + 1}",
            f"{float(steps[bad]) / period:.3g} m/s",
            f"at most {fastest:.3g} m/s, which the axis can follow",
        )


class ReferencePlayer:
    """Plays plans and stops them; safe to use from two threads.

    Parameters
    ----------
    period : control period [s].
    stop_time : from a stop to rest [s]; the velocity falls as (1 - s)^2 (1 + 2 s), s in 0..1, without a jump.
    fastest : a reference that is faster than this [m/s] in any period is refused.
    """

    def __init__(self, period, stop_time, fastest=np.inf):
        self.period, self.fastest = float(period), float(fastest)
        self.stop_time = float(stop_time)
        self._lock = threading.Lock()
        self._positions = None
        self._start = 0
        self._stopping = False
        self._last = -1

    def forget(self):
        """Drop the plan; the next call of `at` holds where the encoder is then."""
        with self._lock:
            self._positions, self._stopping, self._last = None, False, -1

    def at(self, sequence, encoder):
        """(reference [m], mode) of control period ``sequence`` [1]; the first call ever holds ``encoder`` [m]."""
        with self._lock:
            positions = self._positions
            if positions is None:
                positions = self._positions = np.array([encoder])
                self._start = sequence
            self._last = sequence
            return self._value(positions, sequence), self._mode(positions, sequence)

    @property
    def plan(self):
        """Positions [m], the control period of the first, and whether they are a stop; (None, ...) before the first
        `at`."""
        with self._lock:
            return self._positions, self._start, self._stopping

    def passed(self, sequence):
        """Control periods up to number ``sequence`` [1] have been played by somebody who has the `plan`."""
        with self._lock:
            self._last = sequence

    def _value(self, positions, sequence):
        index = sequence - self._start
        size = len(positions)
        return float(positions[0 if index < 0 else index if index < size else size - 1])

    def _mode(self, positions, sequence):
        if not 0 <= sequence - self._start < len(positions) - 1:
            return HOLDING
        return STOPPING if self._stopping else MOVING

    def checked(self, positions):
        """``positions`` [m] as an array that `follow` takes; a long one takes a millisecond, so not in a servo loop.

        Raises InputError: no position, positions not finite, too fast.
        """
        positions = np.asarray(positions, float)
        if not len(positions):
            raise InputError("reference", "no position", "one position per control period")
        if not np.isfinite(positions).all():
            bad = int(np.flatnonzero(~np.isfinite(positions))[0])
            raise InputError(f"reference, position {bad}", float(positions[bad]), "finite positions in m")
        check_speed(positions, self.period, self.fastest, "reference")
        return positions

    def follow(self, start, positions):
        """Play ``positions`` [m], `checked`, from control period number ``start`` [1] on (0: the next one).

        The plan under way, sent once more because its answer was lost, is answered as it was the first time.

        Returns
        -------
        (start, rest sequence, rest position).

        Raises
        ------
        InputError : a step at the joint, another plan under way, a period that has passed.
        """
        with self._lock:
            before = self._positions
            if before is None:
                raise InputError("reference", "no state so far", "a driver that is active")
            end = self._start + len(before) - 1
            if self._last < end and self._repeats(start, before, positions):
                return self._start, self._start + len(positions) - 1, float(positions[-1])
            start = start or self._last + 1
            if start <= self._last:
                raise InputError("reference: start_sequence", start, f"a period after {self._last}, which has begun")
            if start < end:
                raise InputError(
                    "reference: start_sequence", start, "the end of the motion under way, or a stop before"
                )
            here = self._value(before, start)
            if abs(positions[0] - here) > JOINT:
                raise InputError("reference: first position", float(positions[0]), f"{here!r} m, where it stands")
            self._positions, self._start, self._stopping = positions, start, False
            return start, start + len(positions) - 1, float(positions[-1])

    def _repeats(self, start, before, positions):
        """True for the plan ``before``, under way, once more."""
        return not self._stopping and start in (0, self._start) and np.array_equal(positions, before)

    def stop(self):
        """Ramp to rest from the next period on. Returns what `follow` returns.

        Raises InputError: no state has been heard of so far.
        """
        with self._lock:
            positions = self._positions
            if positions is None:
                raise InputError("reference", "no state so far", "a driver that is active")
            start = self._last + 1
            here, before = self._value(positions, start), self._value(positions, self._last)
            count = max(round(self.stop_time / self.period), 1)
            s = np.arange(count + 1) / count
            # integral of (1 - s)^2 (1 + 2 s) = 1 - 3 s^2 + 2 s^3
            ramp = here + (here - before) * count * (s - s**3 + s**4 / 2) if here != before else np.array([here])
            self._positions, self._start, self._stopping = ramp, start, True
            return start, start + len(ramp) - 1, float(ramp[-1])
