"""What an operator may ask of the move server: hold, jog, home; each is answered when it begins."""

import math
import threading

from microstage_msgs.action import MoveTo
from microstage_msgs.srv import FollowReference, Jog
from std_srvs.srv import Trigger

from microstage_ros.control.trajectories.profiles import MotionLimits, move_duration
from microstage_ros.ros.loops.move_state import MoveState
from microstage_ros.ros.transport import topics

LONGEST_JOG_S = 10.0
JOG_TOLERANCE = 1e-6
SETTLED_AFTER_S = 5.0
HEARD_S = 0.05
"""Wait for the driver's word that it is active [s]: who has just reset a fault may ask before it is heard here."""


class MoveRequests(MoveState):
    """Services of `MoveServer`."""

    def serve_requests(self, group):
        """Offer the services."""
        for kind, name, answer in ((Trigger, topics.HOLD, self._serve_hold), (Trigger, topics.HOME, self._serve_home),
                                   (Jog, topics.JOG, self._serve_jog)):
            self.create_service(kind, name, answer, callback_group=group)

    def _why_not(self):
        """Why nothing can move, in words; empty if it can."""
        with self._changed:
            if self._cell_says:
                return self._cell_says
            self._changed.wait_for(lambda: self._status is not None and self._status.active, timeout=HEARD_S)
            status = self._status
        if status is None:
            return "no driver: nobody publishes driver_status"
        if not status.active:
            return f"the driver is not active ({f'fault: {status.message}' if status.fault else 'its lifecycle state'})"
        return "" if self._latest is not None else "no controller: nobody publishes controller_state"

    def _serve_hold(self, request, response):
        why = self._why_not()
        if not why:
            number = self._number()
            with self._changed:
                self._newest_goal = max(self._newest_goal, number)
                self._changed.notify_all()
            if not self._turn.locked():  # else the move under way sees it and stops
                self._follow.call_async(FollowReference.Request())
        response.success, response.message = not why, why or "stopping, then holding"
        return response

    def _serve_home(self, request, response):
        why, status, latest = self._why_not(), self._status, self._latest
        if status is not None and not why and not status.minimum <= 0.0 <= status.maximum:
            why = f"0 m is out of the travel, {status.minimum} to {status.maximum} m"
        if latest is not None and not why:
            p = self.parameters
            takes = move_duration(latest[2], MotionLimits(p.max_velocity, p.max_acceleration, p.max_jerk))
            self._move_aside(MoveTo.Goal(target=0.0, timeout=2.0 * takes + SETTLED_AFTER_S))
        response.success, response.message = not why, why or "on the way to 0 m"
        return response

    def _serve_jog(self, request, response):
        response.message = self._why_not()
        velocity, duration, status, latest = request.velocity, request.duration, self._status, self._latest
        if not response.message and not (math.isfinite(velocity) and abs(velocity) <= self.parameters.max_velocity):
            response.message = (
                f"velocity: got {velocity!r}, expected a number from {-self.parameters.max_velocity} to"
                f" {self.parameters.max_velocity} m/s"
            )
        if not response.message and not 0.0 <= duration <= LONGEST_JOG_S:
            response.message = f"duration: got {duration!r}, expected 0 to {LONGEST_JOG_S} s"
        if response.message or status is None or latest is None:
            return response
        if velocity == 0.0 or duration == 0.0:
            held = self._serve_hold(Trigger.Request(), Trigger.Response())
            response.accepted, response.message = held.success, held.message
            response.target = self._heard_so_far()[1][2]    # as it is now: asking may have taken a while
            return response
        response.target = min(max(latest[2] + velocity * duration, status.minimum), status.maximum)
        response.accepted = True
        response.message = f"on the way to {response.target:.9f} m"
        self._move_aside(MoveTo.Goal(target=response.target, max_velocity=abs(velocity), tolerance=JOG_TOLERANCE,
                                     timeout=2.0 * duration + SETTLED_AFTER_S))
        return response

    def _move_aside(self, goal):
        """Make a move whose result nobody waits for; it supersedes the one under way."""
        number = self._number()

        def move():
            result = self._make_move(number, goal, lambda: False, lambda *_: None)
            if not result.reached:
                self.get_logger().warning(result.message)

        threading.Thread(target=move, daemon=True).start()
