"""What an operator asks of an axis, as calls: status, stop, hold, reset, home, jog.

    with Operator("/axis") as axis:
        print(axis.status().summary)
        axis.stop()
"""

import math
import time

import rclpy
from microstage_msgs.msg import CellStatus
from microstage_msgs.srv import GetStatus, Jog
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from microstage_ros.ros.client import NoAnswer, live_axes, no_axis, patience
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.calls import RepeatedCall

ASK_AGAIN = 0.5
ASKED_ONCE = (Jog,)
"""A second one, where the answer to the first was lost, would go on from where the axis is by then."""
WAIT_S = 3.0
"""Longest wait for each answer, where the caller says nothing else [s]."""
FOUND_S = 12.0
"""Longest wait for the service of an axis that is live [s]: on a busy computer it is found late."""


class Operator:
    """Calls of the services of one axis.

    Parameters
    ----------
    namespace : of the axis. node : to work through; None: one of its own.
    wait : longest wait [s] for each answer once the service is found (`FOUND_S`); None: `WAIT_S`.

    Attributes
    ----------
    took : from the request to the answer of the last call [s], once the service was found.
    """

    def __init__(self, namespace="/axis", node=None, wait=None):
        self._own, self._wait, self.took = node is None, WAIT_S if wait is None else wait, 0.0
        if self._own and not rclpy.ok():
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._prefix = namespace.rstrip("/") + "/"
        self.node = rclpy.create_node("operator", namespace=namespace) if self._own else node
        self._cell, self._clients = None, {}
        self._subscription = self.node.create_subscription(
            CellStatus, self._prefix + topics.CELL_STATUS, self._hear, topics.LATCHED
        )

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()

    def _hear(self, status):
        self._cell = status

    def _ask(self, kind, name, request):
        """The answer of a service. Raises `NoAnswer`."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, self._prefix + name)
        client, end = self._clients[name], time.monotonic() + max(self._wait, FOUND_S)
        here, sought = self._prefix.rstrip("/") or "/", time.monotonic() + patience()
        while not client.service_is_ready():
            rclpy.spin_once(self.node, timeout_sec=0.01)
            if time.monotonic() > end or (time.monotonic() > sought and here not in live_axes(self.node)):
                raise NoAnswer(no_axis(here, self.node))
        began = time.monotonic()
        answer = RepeatedCall(lambda: client.call_async(request), math.inf if kind in ASKED_ONCE else ASK_AGAIN)
        while not answer.done():
            self._turn(began + self._wait, f"{self._prefix}{name}: no answer within {self._wait:g} s")
        self.took = time.monotonic() - began
        return answer.result()

    def _turn(self, end, complaint):
        if time.monotonic() > end:
            raise NoAnswer(complaint)
        rclpy.spin_once(self.node, timeout_sec=0.01)

    def status(self):
        """`GetStatus.Response` of the driver."""
        return self._ask(GetStatus, topics.STATUS, GetStatus.Request())

    def processes(self, wait=0.3):
        """`CellStatus` of whoever started the processes, None if nobody tells within ``wait`` [s]."""
        end = time.monotonic() + wait
        while self._cell is None and time.monotonic() < end:
            rclpy.spin_once(self.node, timeout_sec=0.01)
        return self._cell

    def stop(self):
        """Zero voltage now, latched; (success, message)."""
        return self._trigger(topics.STOP)

    def reset(self):
        """Forget the fault; (success, message)."""
        return self._trigger(topics.RESET)

    def hold(self):
        """Ramp the reference to rest and hold; (success, message)."""
        return self._trigger(topics.HOLD)

    def home(self):
        """Go to 0; answers when it begins; (success, message)."""
        return self._trigger(topics.HOME)

    def jog(self, velocity, duration):
        """Move at a constant velocity [m/s] for a duration [s]; answers when it begins: `Jog.Response`."""
        return self._ask(Jog, topics.JOG, Jog.Request(velocity=float(velocity), duration=float(duration)))

    def _trigger(self, name):
        answer = self._ask(Trigger, name, Trigger.Request())
        return answer.success, answer.message

    def close(self):
        """Let go."""
        for client in self._clients.values():
            self.node.destroy_client(client)
        self._clients = {}
        self.node.destroy_subscription(self._subscription)
        if self._own:
            self.node.destroy_node()
            rclpy.try_shutdown()
