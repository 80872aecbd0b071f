"""Calls of an action's or a service's client from a thread that is not the executor's.

rclpy's `ActionClient` notes who waits for an answer after it has sent the request (`send_goal_async`, Jazzy 7.1). With
an executor of several threads the answer may be taken before; it is dropped then, and nobody gets a result. So the
request is sent in a callback of the client's own mutually exclusive group: no answer is taken while it runs.
"""

import queue
from concurrent.futures import Future

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup

LONGEST_S = 30.0
"""Longest wait for the executor [s]; it waits for nobody else."""


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
