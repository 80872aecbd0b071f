"""A client of one axis: three verbs for programs and tests.

with AxisClient("/axis") as axis:
    result = axis.move(1e-5)
    print(result.reached, result.final_error)
"""

import math
import os
import time

import rclpy
from action_msgs.msg import GoalStatus
from microstage_msgs.action import MoveTo
from microstage_msgs.msg import CellStatus, ControllerState
from microstage_msgs.srv import Statistics
from rclpy.action import ActionClient
from sensor_msgs.msg import JointState

from microstage_ros.ros.launching.ownership import owned_namespaces, starting_for
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.calls import ASK_AGAIN, RESULT_AGAIN, RepeatedCall, new_goal_id

MOVE_SERVER = "move_server"


class NoAnswer(RuntimeError):
    """Nobody answers at that name; the text says which."""


def live_axes(node):
    """Namespaces, sorted, of the axes whose move server is known to ``node``'s graph, or that are owned on this
    computer."""
    ending = f"/{topics.MOVE_TO}/_action/send_goal"
    found = {
        name.removesuffix(ending) or "/"
        for name, _ in node.get_service_names_and_types()
        if name.endswith(ending) and node.count_services(name)  # a client alone is in the graph too
    }
    return sorted(found | set(owned_namespaces()))


def no_axis(here, node):
    """What to say where nobody answers at ``here``."""
    found = live_axes(node)
    if here in found:
        return f"no axis at {here} that answers: its processes are starting, stopped or hung"
    return (
        f"no axis at {here}"
        f" ({'live axes: ' + ', '.join(found) if found else 'no axis is live; ./microstage cell starts one'})"
    )


SOUGHT_HERE, SOUGHT_ANYWHERE = 0.5, 1.5
"""Longest look for a sign of an axis [s]: where discovery keeps to this computer, and where others may answer."""

STARTING = 180.0
"""A cell that was started less than so long ago [s] may be compiling its loop (some 100 s beside other work on two
cores); calibrated by `./microstage cell` in a fresh clone with an empty cache."""

NEEDED = ("axis_driver", "str_controller")
"""Processes without which no move goes on."""

OVERDUE = 0.4
"""The move server says so long [s] after one of these has ended that the move has ended with it, at the latest."""

STARTING_SAID = 3.0
"""After so long [s] a person who waits for a cell that is starting is informed of it."""


def patience():
    """How long to look for any sign of an axis [s]; one that this user started on this computer is known at once, by
    its lock."""
    return SOUGHT_HERE if os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") == "LOCALHOST" else SOUGHT_ANYWHERE


class AxisClient:
    """Moves one axis through its move server.

    Parameters
    ----------
    namespace : of the axis. node : to work through; None: one of its own. wait : longest wait [s] for the server.
    sought : longest wait [s] for any sign of an axis of that name; one that is starting has ``wait``.
    starting : None, or called once with a sentence while a cell that was started on this computer less than `STARTING`
        ago has not activated its axis yet; it is waited for.

    Raises
    ------
    NoAnswer : none answers; the text names the axes that are live.
    """

    def __init__(self, namespace="/axis", node=None, wait=15.0, sought=math.inf, starting=None):
        self._sought, self._starting = sought, starting
        self._own = node is None
        if self._own and not rclpy.ok():
            rclpy.init()
        self.node = rclpy.create_node("axis_client", namespace=namespace) if self._own else node
        self._prefix = namespace.rstrip("/") + "/"
        self._action = ActionClient(self.node, MoveTo, self._prefix + topics.MOVE_TO)
        self._statistics = self.node.create_client(Statistics, self._prefix + topics.STATISTICS)
        self._cell = self._gone = None
        self._processes = self.node.create_subscription(
            CellStatus, self._prefix + topics.CELL_STATUS, self._on_cell_status, topics.LATCHED
        )
        self.wait_for_server(wait)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()

    def _on_cell_status(self, status):
        self._cell = status
        gone = [name for name, state in zip(status.names, status.states)
                if name in NEEDED and state == CellStatus.STATE_ENDED]
        self._gone = (self._gone[0] if self._gone else time.monotonic(), " and ".join(gone)) if gone else None

    @property
    def server_started(self):
        """Number of the move server's process, how often it was started again, how it is; None where nobody tells."""
        if self._cell is None or MOVE_SERVER not in self._cell.names:
            return None
        place = list(self._cell.names).index(MOVE_SERVER)
        return int(self._cell.processes[place]), int(self._cell.restarts[place]), int(self._cell.states[place])

    def server_lost(self, before):
        """Why a goal that was sent when `server_started` was ``before`` [1] is not answered any more, in
        words; empty if it is."""
        now = self.server_started
        if (
            now is None
            or not before
            or not before[0]
            or (now[:2] == before[:2] and now[2] not in (CellStatus.STATE_STOPPED, CellStatus.STATE_ENDED))
        ):
            return ""
        how = "is stopped by a signal" if now[2] == CellStatus.STATE_STOPPED else "has ended"
        return (
            f"{self._prefix}{topics.MOVE_TO}: the move server {how}; the move's result is lost, and the axis stops and"
            " holds"
        )

    def lost(self, before):
        """As `server_lost` with ``before`` [1], or that driver or controller has ended and the move server has not
        said so within `OVERDUE`: the middleware may hold its answer up while it looks after a dead reader."""
        if self._gone and time.monotonic() - self._gone[0] > OVERDUE:
            return (
                f"{self._prefix}{topics.MOVE_TO}: {self._gone[1]}: the process has ended, the axis stands still at zero"
                " volts; the move server has not answered"
            )
        return self.server_lost(before)

    def wait_for_server(self, wait):
        """Until the server has answered once: then both sides know each other. Raises `NoAnswer`."""
        here = self._prefix.rstrip("/") or "/"
        self._await_start(here)
        began = time.monotonic()
        while not (self._action.server_is_ready() and self._statistics.service_is_ready()):
            rclpy.spin_once(self.node, timeout_sec=0.05)
            if self._await_start(here):  # a cell that was started after this client
                began = time.monotonic()
            waited = time.monotonic() - began
            if waited > wait or (waited > min(wait, self._sought) and here not in live_axes(self.node)):
                raise NoAnswer(no_axis(here, self.node))
        self._await_start(here)
        self.statistics()

    def _await_start(self, here):
        """Until a cell that is starting has activated its axis, or is as old as `STARTING`; returns whether it was."""
        began, waited = time.monotonic(), False
        while self._starting and starting_for(here) < STARTING:
            if time.monotonic() - began > STARTING_SAID:
                self._starting(f"the axis at {here} is starting (a first start compiles its loop); waiting for it")
                began = math.inf
            waited = True
            time.sleep(0.05)
        return waited

    def _answer(self, call, wait, lost=lambda: ""):
        """Answer to ``call``, which is made again while it has none. Raises `NoAnswer` after ``wait`` [s], and as soon
        as ``lost()`` says in words why there will be none."""
        end, asked = time.monotonic() + wait, RepeatedCall(call, ASK_AGAIN)
        while not asked.done():
            rclpy.spin_once(self.node, timeout_sec=0.05)
            if lost():
                raise NoAnswer(lost())
            if time.monotonic() > end:
                raise NoAnswer(f"{self._prefix}: no answer within {wait:.0f} s")
        return asked.result()

    def send(self, goal, feedback=None, goal_id=None):
        """Send a goal, `MoveTo.Goal`; the future of its handle.

        ``feedback``: called with each feedback. ``goal_id``: its `UUID` (`new_goal_id`); None: a new one.
        """
        return self._action.send_goal_async(
            goal, feedback_callback=lambda m: feedback and feedback(m.feedback), goal_uuid=goal_id
        )

    def move(self, target, feedback=None, cancel=None, wait=600.0, **options):
        """One move to ``target`` [m]. Returns the result of the action MoveTo.

        Parameters
        ----------
        feedback : called with each feedback. cancel : called without arguments; True cancels the move.
        wait : for the result [s].
        options : fields of the goal: max_velocity, tolerance, settle_time, timeout, ...

        Raises
        ------
        NoAnswer : the move server is lost or does not know the move, or no result came within ``wait``.
        """
        goal = MoveTo.Goal(target=float(target), **{name: float(value) for name, value in options.items()})
        before, goal_id = self.server_started, new_goal_id()
        handle = self._answer(lambda: self.send(goal, feedback, goal_id), 15.0, lambda: self.lost(before))
        result, cancelled = RepeatedCall(handle.get_result_async, RESULT_AGAIN), None
        end = time.monotonic() + wait
        while not result.done():
            rclpy.spin_once(self.node, timeout_sec=0.02)
            lost = self.lost(before)
            if lost and not result.done():
                raise NoAnswer(lost)
            if cancelled is not None:
                cancelled.done()  # asks again where the answer is lost
            elif cancel is not None and cancel():
                cancelled = RepeatedCall(handle.cancel_goal_async, ASK_AGAIN)
            if time.monotonic() > end:
                handle.cancel_goal_async()  # nobody waits for this motion any more
                rclpy.spin_once(self.node, timeout_sec=0.1)
                raise NoAnswer(f"{self._prefix}: no result within {wait:.0f} s; its cancel was asked for")
        answer = result.result()
        if answer.status == GoalStatus.STATUS_UNKNOWN:  # what it holds is no result
            raise NoAnswer(f"{self._prefix}: the move server does not know this move any more")
        return answer.result

    def reference(self, wait=5.0):
        """Where the set point of the axis stands [m]; its position where no controller state arrives. Raises
        `NoAnswer`."""
        heard = {}

        def hear_controller(state):
            heard.setdefault("reference", state.reference)

        def hear_joint(state):
            heard.setdefault("position", state.position[0])

        states = self.node.create_subscription(
            ControllerState, self._prefix + topics.CONTROLLER_STATE, hear_controller, 10
        )
        joints = self.node.create_subscription(JointState, self._prefix + topics.JOINT_STATES, hear_joint, 10)
        end = time.monotonic() + wait
        try:
            while "reference" not in heard and not ("position" in heard and time.monotonic() > end - 0.8 * wait):
                rclpy.spin_once(self.node, timeout_sec=0.05)
                if time.monotonic() > end:
                    raise NoAnswer(
                        f"{self._prefix}: no state within {wait:.0f} s, so a target relative to it has no meaning"
                    )
        finally:
            for reader in (states, joints):
                self.node.destroy_subscription(reader)
        return heard.get("reference", heard.get("position"))

    def statistics(self, reset=False):
        """Rows of `AccuracyRow` of the moves so far."""
        return self._answer(lambda: self._statistics.call_async(Statistics.Request(reset=reset)), 20.0).rows

    def wait_until_still(self, silence=0.5, wait=30.0):
        """Until simulated time stands still (`pause_s` of the move server): no state for ``silence`` [s]."""
        heard = [time.monotonic()]
        watch = self.node.create_subscription(
            ControllerState, self._prefix + topics.CONTROLLER_STATE, lambda _: heard.append(time.monotonic()), 10
        )
        end = time.monotonic() + wait
        while time.monotonic() - heard[-1] < silence and time.monotonic() < end:
            rclpy.spin_once(self.node, timeout_sec=0.05)
        self.node.destroy_subscription(watch)

    def close(self):
        """Let go of the server."""
        self._action.destroy()
        self.node.destroy_client(self._statistics)
        self.node.destroy_subscription(self._processes)
        if self._own:
            self.node.destroy_node()
