"""Credit of the move server where what it waits for was lost."""

import threading
import time
from types import SimpleNamespace

import pytest

from microstage_ros.ros.loops.move_credit import LOST_AFTER_S, MOST_WINDOWS, MoveCredit

WINDOW, LATEST = 100, 5000


class Granted:
    """A `Granter` that sends nothing."""

    def __init__(self, until):
        self.until = until

    def grant(self, until):
        self.until = max(until, self.until)


class Server:
    """What `MoveCredit` needs of its node: the driver stands at the end of its credit, and nothing has come for ``silent_s``."""

    _window, _pause_is_over, _missed = WINDOW, lambda self: False, MoveCredit._missed
    _keep_credit_alive = MoveCredit._keep_credit_alive

    def __init__(self, silent_s, active=True, held=False, pause_s=0.0):
        self.parameters = SimpleNamespace(pause_s=pause_s)
        self._changed, self._granter, self._talking = threading.Condition(), Granted(LATEST + WINDOW), held
        self._latest, self._heard, self._repeated = (LATEST, 0.0, 0.0, 0), time.monotonic() - silent_s, 0.0
        self._held_since, self._status = (time.monotonic() if held else None), SimpleNamespace(active=active)

    def turn(self, times):
        """Go on with so many repetitions of the credit; what is granted beyond the last state, in windows."""
        for _ in range(times):
            self._repeated = 0.0
            self._keep_credit_alive()
        return (self._granter.until - LATEST) / WINDOW


def test_a_lost_block_does_not_stop_simulated_time_for_ever():
    """Ctrl-C of a program on a cell left it standing in three of some ten runs on a busy computer: the recorder had gone, the controller's blocks
    went through a new publisher, and the one that the move server waited for was sent before it had found that."""
    assert Server(LOST_AFTER_S + 0.1).turn(1) == 2
    assert Server(LOST_AFTER_S + 0.1).turn(50) == MOST_WINDOWS


@pytest.mark.parametrize("case", [{"silent_s": 0.0}, {"silent_s": 60.0, "active": False}, {"silent_s": 60.0, "held": True},
                                  {"silent_s": 60.0, "pause_s": 1.0}],
                         ids=["a moment ago", "an inactive driver", "a talk", "a run that has to repeat to the last bit"])
def test_no_more_is_granted_while_time_has_a_reason_to_stand_still(case):
    assert Server(**case).turn(5) == 1
