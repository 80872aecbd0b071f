"""Calls of an action's or a service's client: from a thread that is not the executor's, and until there is an answer.

rclpy's `ActionClient` notes who waits for an answer after it has sent the request (`send_goal_async`, Jazzy 7.1). With
an executor of several threads the answer may be taken before; it is dropped then, and nobody gets a result. So the
request is sent in a callback of the client's own mutually exclusive group: no answer is taken while it runs.

The middleware may lose a request or an answer, too. Both travel reliably between two processes that know each other,
but an answer whose reader the writer does not know yet is dropped (rmw_fastrtps: after 0.1 s), and rclpy tells nobody.
"""

import queue
import time
import uuid
from concurrent.futures import Future

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from unique_identifier_msgs.msg import UUID

LONGEST_S = 30.0
"""Longest wait for the executor [s]; it waits for nobody else."""

ASK_AGAIN, RESULT_AGAIN = 2.0, 5.0
"""What has no answer is asked again so often [s]; the result of a move, which may take minutes, less often."""


class CallsInTurn:
    """Runs calls between the other callbacks of one group.

    Parameters
    ----------
    node : rclpy node, in an executor of more than one thread.

    Attributes
    ----------
    group : callback group to make the clients with.
    """

    def __init__(self, node):
        self.group, self._calls = MutuallyExclusiveCallbackGroup(), queue.SimpleQueue()
        self._guard = node.create_guard_condition(self._run, callback_group=self.group)

    def call(self, what):
        """What ``what()`` returns or raises, called in the group; TimeoutError after `LONGEST_S`. Not to be called from
        a callback of the group."""
        done = Future()
        self._calls.put((what, done))
        self._guard.trigger()
        return done.result(LONGEST_S)

    def _run(self):
        while not self._calls.empty():
            what, done = self._calls.get()
            try:
                done.set_result(what())
            except Exception as error:  # noqa: BLE001 - it is raised where the call was asked for
                done.set_exception(error)


def new_goal_id():
    """A `UUID` for a goal that may be sent again: of one identity an action's server accepts one goal; a second is
    answered as if it were refused."""
    return UUID(uuid=list(uuid.uuid4().bytes))


class RepeatedCall:
    """A call whose answer is waited for.

    Parameters
    ----------
    call : called without arguments; returns a future. It may be called again: what it asks for must be done once only,
        however often it is asked for.
    every : time without an answer after which it is called again [s].
    """

    def __init__(self, call, every):
        self._call, self._every, self._futures = call, every, []
        self._again()

    def _again(self):
        self._futures.append(self._call())
        self._next = time.monotonic() + self._every

    def done(self):
        """Whether one of the calls has an answer. Calls again if it is time."""
        answered = any(future.done() for future in self._futures)
        if not answered and time.monotonic() > self._next:
            self._again()
        return answered

    def result(self):
        """The answer; ``None`` while there is none."""
        return next((future.result() for future in self._futures if future.done()), None)
