"""What the move server asks of the controller: a plan or a stop, and when nobody waits for the answer any longer."""

import threading
import time

from microstage_msgs.action import MoveTo
from microstage_msgs.srv import FollowReference

from microstage_ros.ros.launching.process import running
from microstage_ros.ros.loops.move_credit import MoveCredit
from microstage_ros.ros.loops.move_state import RESULT, Refused

ASK_AGAIN = 0.1
"""A stop that nobody has answered for so long [s] is asked for again."""
PLAN_AGAIN = 0.5
"""A plan, which may be megabytes long, is sent again after so long [s]."""


class MoveCalls(MoveCredit):
    """Calls of the controller by `MoveServer`."""

    @property
    def _patience(self):
        """Longest wait for a sign of life [s]: simulated time may stand still for a while, the wall clock does not."""
        p = self.parameters
        paced = self._status is not None and not self._status.lockstep
        return min(p.driver_timeout_s, p.silence_timeout_s) if paced else p.driver_timeout_s

    def _check_alive(self):
        """Raise `Refused` if the move cannot go on: a process is missing or has been silent for too long."""
        if self._cell_says:
            raise Refused(RESULT.CODE_FAULT, self._cell_says)
        silent = time.monotonic() - self._heard
        if self._move is not None and not self._move.done and silent > self._patience and self._held_since is None:
            raise Refused(RESULT.CODE_FAULT, f"nothing has been heard of driver and controller for {silent:.1f} s")
        if not running():
            raise Refused(RESULT.CODE_FAULT, "the move server was asked to end")

    def _stop(self, feedback):
        """Ramp the reference to rest and wait until it is there. Returns when that was, in words."""
        with self._changed:
            status, (asked, *_) = self._heard_so_far()
            self._hold(status.lockstep)
        try:
            answer = self._ask(FollowReference.Request())
        finally:
            self._go_on()
        with self._changed:
            self._rest = answer.rest_position
            if self._move is not None:
                self._move.done = True
            self._changed.wait_for(lambda: self._cell_says or self._heard_so_far()[1][0] > answer.rest_sequence,
                                   timeout=self._patience)
            position = self._heard_so_far()[1][1]
        feedback(position, answer.rest_position - position, MoveTo.Feedback.PHASE_STOPPING)
        return (f"in period {asked}; the reference rests at {answer.rest_position:.9f} m "
                f"from period {answer.rest_sequence} on")

    def _ask(self, request):
        """Call the controller. Raises `Refused` if it does not answer.

        If no state of it comes for `_patience`, it is gone. While they come it may take longer, up to
        `driver_timeout_s`, as it serves requests in a thread beside its loop, and is asked again: the middleware may
        have lost the answer, and a plan that it plays already is answered again. If nobody answers a plan, a stop
        follows: it may have been heard.
        """
        answered, plan, futures, began = threading.Event(), len(request.positions) > 0, [], time.monotonic()
        while not answered.is_set():
            end = min(max(began, self._heard) + self._patience, began + self.parameters.driver_timeout_s)
            why = self._why_no_answer(began, len(futures), end)
            if why:
                for future in futures:
                    self._follow.remove_pending_request(future)
                if plan:
                    self._follow.call_async(FollowReference.Request())
                raise Refused(RESULT.CODE_FAULT, why)
            futures.append(self._follow.call_async(request))
            futures[-1].add_done_callback(lambda _: answered.set())
            again = time.monotonic() + (PLAN_AGAIN if plan else ASK_AGAIN)
            while not answered.wait(0.05) and time.monotonic() < min(again, end) and not self._cell_says:
                pass
        self._introduced = True
        return next(future.result() for future in futures if future.done())

    def _why_no_answer(self, began, asked, end):
        """Why nobody waits any longer for an answer of the controller, in words; empty before ``end``."""
        now = time.monotonic()
        if self._cell_says:
            return self._cell_says
        status = self._status
        if status is not None and status.fault and asked:
            return f"the driver stopped the axis: {status.message}"
        if now > end or not running():
            return (f"the controller does not answer: asked {asked} times in {now - began:.1f} s, its last state came"
                    f" {now - self._heard:.1f} s ago")
        return ""
