"""How far the driver may run ahead in lockstep, and when simulated time stands still."""

import time

from microstage_ros.ros.loops.move_state import MoveState
from microstage_ros.ros.transport.credit import repeat_after

LOST_AFTER_S = 2.0
"""Silence [s] of an active driver after which it waits for us: it sends a block of at most 20 ms at a time."""

MOST_WINDOWS = 10
"""How far it may run ahead of the last state that came, in windows [1]."""


class MoveCredit(MoveState):
    """Flow control of `MoveServer`."""

    def _grant_at(self, sequence, before):
        """Credit for a window from ``sequence`` on, every half window; ``before``: the sequence heard last."""
        window = self._window
        half = window // 2
        if self._held_since is None and (sequence // half != before // half or window != self._granted_window):
            self._granted_window = window
            self._granter.until = max(self._granter.until, sequence + window)

    @property
    def _window(self):
        """How far the axis may run ahead now."""
        p = self.parameters
        idle = p.pause_s == 0.0 and not self._talking and (self._move is None or self._move.done)
        return p.idle_window if idle else p.window

    def _keep_credit_alive(self):
        """Repeat the last credit now and then; end a pause that has lasted too long."""
        with self._changed:
            if self._granter.until < 0:
                if self._inside.publishers and self._follow.service_is_ready():
                    self._held_since = time.monotonic() if self.parameters.pause_s > 0.0 else None
                    self._granter.grant(self.parameters.window)
            elif self._pause_is_over():
                self._let_go()
            elif (self._held_since is None and self._latest
                  and self._granter.until < self._latest[0] + self._window // 2):
                self._granter.grant(self._latest[0] + self._window)  # the window has grown while nothing came
            elif time.monotonic() - self._repeated > repeat_after(self._latest[0] if self._latest else -1):
                self._repeated = time.monotonic()
                self._granter.grant(self._granter.until + self._missed())

    def _missed(self):
        """One window more [control periods] where nothing has come for so long that what we wait for was lost.

        Blocks of a publisher that takes the place of one that refuses them (`blocks.Outlet`) are lost until we have
        found it. The driver then stands at the end of what we have granted, and we wait for what it has sent: for ever.
        Not in runs that pause between moves: there each move begins at a period that no wall clock decides.
        """
        active = self._status is not None and self._status.active
        if self._latest is None or self._held_since is not None or self.parameters.pause_s > 0.0 or not active:
            return 0
        lost = time.monotonic() - self._heard > LOST_AFTER_S
        return self._window if lost and self._granter.until < self._latest[0] + MOST_WINDOWS * self._window else 0

    def _pause_is_over(self):
        """Whether time has stood still for longer than it may without a request."""
        since = self._held_since
        return since is not None and not self._talking and time.monotonic() - since > self.parameters.pause_s

    def _let_go(self):
        """Time goes on."""
        self._held_since = None
        self._granter.grant(self._granter.until + self.parameters.window)

    def _hold(self, lockstep):
        """In lockstep time stands still while we talk with the controller, within the window."""
        self._talking, self._held_since = lockstep, time.monotonic() if lockstep else None

    def _go_on(self):
        """The talk is over."""
        with self._changed:
            if self._talking:
                self._talking = False
                self._let_go()
