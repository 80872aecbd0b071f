"""What the parts of the move server share: the node with its parameters, what it has heard, the move under way.

Each part (`move_credit`, `move_calls`, `move_requests`, `move_results`) is a class over this one; `nodes.move_server`
puts them together.
"""

import threading
import time

from microstage_msgs.action import MoveTo
from microstage_msgs.msg import ControllerState, DriverStatus, InterferometerReading
from microstage_msgs.srv import FollowReference
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from microstage_ros.control.trajectories.move import Move
from microstage_ros.ros.launching.parameters import Parameters
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.blocks import Stream
from microstage_ros.ros.transport.credit import Granter
from microstage_ros.ros.transport.servo_path import make_servo_path

RESULT = MoveTo.Result


class Refused(Exception):
    """Why a move ended without reaching its target: code and message of the result."""

    def __init__(self, code, message):
        super().__init__(message)
        self.code = code


class MoveState(Node):
    """The node ``move_server`` and what it knows; everything that more than one thread sets is set under ``_changed``.

    Attributes
    ----------
    parameters : of ``config/move_server.yaml``.
    _changed : condition, told whenever something below changes. _turn : lock that the move under way holds.
    _status : last status of the driver, None before the first. _cell_says : which processes are missing, in words.
    _latest : sequence, position [m], reference [m] and mode of the last state inside the controller, None before it.
    _heard : when that state came, by the monotonic clock [s].
    _move : the move that was begun last. _newest_goal : number of the newest goal. _introduced : whether the controller
        has answered this process.
    _held_since : since when simulated time stands still [s], None while it goes on.
    _talking : whether it does for a talk.
    _granted_window, _repeated : window of the last credit [periods], and when it was repeated last [s].
    """

    def __init__(self):
        super().__init__("move_server")
        self.parameters = Parameters(self, "move_server")
        self._changed = threading.Condition()
        self._turn = threading.Lock()
        self._status: DriverStatus | None = None
        self._latest: tuple[int, float, float, int] | None = None
        self._heard = time.monotonic()
        self._cell_says = ""
        self._move: Move | None = None
        self._numbered = self._newest_goal = 0
        self._introduced = False
        self._held_since: float | None = None
        self._talking = False
        self._granted_window, self._repeated = 0, 0.0
        self._granter = Granter(self)
        self._servo = make_servo_path(self)
        self._inside = Stream(self, self._servo, ControllerState, topics.CONTROLLER_STATE)
        self._interferometer = Stream(self, self._servo, InterferometerReading, topics.INTERFEROMETER)
        self._group = ReentrantCallbackGroup()
        self._follow = self.create_client(FollowReference, topics.FOLLOW_REFERENCE, callback_group=self._group)

    def _number(self):
        """The number of a request: the later one counts, whichever of them a thread comes to first."""
        with self._changed:
            self._numbered += 1
            return self._numbered

    def _heard_so_far(self):
        """(last status of the driver, last state inside the controller); raises `Refused` before the first of each."""
        status, latest = self._status, self._latest
        if status is None or latest is None:
            raise Refused(RESULT.CODE_REFUSED, "no driver, or no controller, so far")
        return status, latest

    def _make_move(self, mine, request, cancelled, feedback):
        """One move from request to result, by the node."""
        raise NotImplementedError
