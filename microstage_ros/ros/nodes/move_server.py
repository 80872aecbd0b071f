"""move_server: the action `move_to`, the service `move`, and the statistics of the moves made.

It plans jerk-limited references (`control.trajectories.profiles`), hands them to the controller, tied to a control
period, and watches the encoder (`control.trajectories.move`). A new goal supersedes the one under way; a cancelled one
stops and holds. In lockstep it grants the driver credit, so that a cancel is heard within its window.
"""

import math
import sys
import time
import traceback

import numpy as np
from microstage_msgs.action import MoveTo
from microstage_msgs.msg import AxisState, CellStatus, ControllerState, DriverStatus
from microstage_msgs.srv import FollowReference, Statistics, Trip
from microstage_msgs.srv import Move as MoveService
from rclpy.action import ActionServer, CancelResponse, GoalResponse

from microstage_ros.control.trajectories.comparison import EncoderComparison
from microstage_ros.control.trajectories.move import Move, check_move
from microstage_ros.control.trajectories.profiles import MotionLimits, jerk_limited_move
from microstage_ros.quantities.errors import InputError
from microstage_ros.ros.launching.process import keep_memory_steady, run_node, running
from microstage_ros.ros.loops.move_calls import MoveCalls
from microstage_ros.ros.loops.move_requests import MoveRequests
from microstage_ros.ros.loops.move_results import RESULT_KEPT_S, MoveResults
from microstage_ros.ros.loops.move_state import RESULT, Refused
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.checked import MOST
from microstage_ros.ros.transport.codec import Codec
from microstage_ros.ros.transport.servo_path import RCLError

WAIT = 0.05
LOOK = 0.5
FEEDBACK = 0.1
TURN = 0.01  # s, between two looks of a goal that waits for the move under way
STATUS_WAIT = 0.5

NEEDED = ("axis_driver", "str_controller")
"""Without them no move goes on."""


class MoveServer(MoveCalls, MoveRequests, MoveResults):
    """The process that turns goals into references."""

    def __init__(self):
        super().__init__()
        self._stale = -1
        self._comparison = EncoderComparison(self.parameters.limit_interferometer)
        self._inherited = False
        self._numbers = {}
        self._inside_codec, self._reading_codec = Codec("ControllerState"), Codec("InterferometerReading")
        group = self._group
        self.create_subscription(DriverStatus, topics.DRIVER_STATUS, self._on_status, topics.LATCHED)
        self._action = ActionServer(self, MoveTo, topics.MOVE_TO, self._execute, callback_group=group,
                                    goal_callback=self._number_goal, cancel_callback=lambda goal: CancelResponse.ACCEPT,
                                    result_timeout=RESULT_KEPT_S)
        self.create_service(MoveService, topics.MOVE, self._serve_move, callback_group=group)
        self.create_service(Statistics, topics.STATISTICS, self._serve_statistics, callback_group=group)
        self.create_subscription(CellStatus, topics.CELL_STATUS, self._on_cell_status, topics.LATCHED)
        self._trip = self.create_client(Trip, topics.TRIP, callback_group=group)
        self.serve_requests(group)

    # --- the stream of states -------------------------------------------------------------------------------

    def loop(self):
        """Follow the controller's states and the interferometer."""
        looked = 0.0
        while running():
            self._servo.wait(self._inside.readers + self._interferometer.readers, WAIT)
            while (rows := self._interferometer.take()) is not None:
                readings = self._reading_codec.array(rows)
                sequence = readings["sequence"].astype(np.int64)
                self._readings.extend(sequence, readings["position"])
                self._comparison.add_interferometer(sequence, readings["position"])
            while (rows := self._inside.take()) is not None:
                states = self._inside_codec.array(rows)
                states = states[states["sequence"] < MOST]
                with self._changed:
                    self._heard = time.monotonic()
                    self._on_block(states)
                    self._granter.tell()
                    self._changed.notify_all()
                self._comparison.add_encoder(states["sequence"].astype(np.int64), states["position"])
            self._keep_credit_alive()
            self._end_inherited_move()
            self._compare()
            if time.monotonic() - looked > LOOK:
                looked = time.monotonic()
                self._inside.look()
                self._interferometer.look()

    def _compare(self):
        """Encoder against interferometer: if they part, the driver is to take the voltage away."""
        says = self._comparison.breach()
        if says:
            self.get_logger().error(says)
            self._trip.call_async(Trip.Request(fault=AxisState.FAULT_ENCODER_INTERFEROMETER, message=says))

    def _end_inherited_move(self):
        """Stop a reference that moves when this process begins: it belongs to a process that has ended."""
        if self._inherited and self._follow.service_is_ready():
            self._inherited = False
            self.get_logger().warning("the axis was moving for a move server that is gone: it stops and holds")
            self._follow.call_async(FollowReference.Request())

    def _on_cell_status(self, status):
        """Who started the processes says which of them are missing."""
        with self._changed:
            gone = [name for name, state in zip(status.names, status.states)
                    if name in NEEDED and state in (CellStatus.STATE_ENDED, CellStatus.STATE_STOPPED)]
            have = "has" if len(gone) == 1 else "have"
            self._cell_says = f"{' and '.join(gone)}: the process {have} ended or stand still" if gone else ""
            self._changed.notify_all()

    def _on_block(self, states):
        """The controller's ``states``, (n,), in order: each of them while a move is watched, else the last one."""
        watched = self._move is not None and not self._move.done
        for state in states[["sequence", "position", "reference", "mode"]][0 if watched else -1:].tolist():
            self._on_inside(*state)

    def _on_inside(self, sequence, position, reference, mode):
        before = self._latest[0] if self._latest else -1
        if sequence < before:  # the driver began anew
            self._granter.forget()
        elif before < 0 and self._granter.until >= 0 and sequence > self._granter.until:  # this process began anew
            self._granter.until = sequence + 2 * self.parameters.window + 2
        self._inherited = self._inherited or (before < 0 and mode == ControllerState.MODE_MOVING)
        self._latest = (sequence, position, reference, mode)
        if self._move is not None and not self._move.done:
            self._move.update(sequence, position)
            if self._move.done and self.parameters.pause_s > 0.0:
                self._held_since = time.monotonic()
        self._grant_at(sequence, before)

    def _on_status(self, status):
        if status.sequence > MOST:  # no driver counts so far, and such a credit would end all others
            return
        with self._changed:
            if status.active and not (self._status and self._status.active):
                # where the reference stands now is known from the first period after this
                self._stale = status.sequence if status.sequence > 0 else -1
                # a driver with a fault went on counting without credit, perhaps past all that was granted
                if self._granter.until >= 0:
                    self._granter.grant(max(self._granter.until, self._stale) + self.parameters.window)
            self._status = status
            self._changed.notify_all()

    # --- one move -------------------------------------------------------------------------------------------

    def _number_goal(self, request):
        """Accept a goal. Who sent it hears of that later, so no goal that is sent then has a smaller number."""
        self._numbers[id(request)] = self._number()
        return GoalResponse.ACCEPT

    def _execute(self, goal):
        def feedback(position, error, phase):
            try:
                goal.publish_feedback(MoveTo.Feedback(position=position, error=error, phase=phase))
            except RCLError as error_of_it:     # nobody has to hear it, and the move goes on
                self.get_logger().warning(f"feedback was not sent: {error_of_it}")

        number = self._numbers.pop(id(goal.request))
        result = self._make_move(number, goal.request, lambda: goal.is_cancel_requested, feedback)
        if result.code == RESULT.CODE_REACHED:
            goal.succeed()
        elif result.code == RESULT.CODE_CANCELLED:
            goal.canceled()
        else:
            goal.abort()
        return result

    def _serve_move(self, request, response):
        result = self._make_move(self._number(), request, lambda: False, lambda *_: None)
        for name in response.get_fields_and_field_types():
            setattr(response, name, getattr(result, name))
        return response

    def _make_move(self, mine, request, cancelled, feedback):
        """One move from request to result; ``mine``: its number."""
        result, move = RESULT(final_error=math.nan, interferometer_error=math.nan, settling_time=math.nan), None
        try:
            self._check(request)
            with self._changed:
                self._newest_goal = max(self._newest_goal, mine)
                self._changed.notify_all()
            self._take_turn(mine)  # the move under way sees the newer goal, stops and gives the turn away
            try:
                move = self._begin(request)
                self._watch(move, mine, cancelled, feedback)
            finally:
                self._turn.release()
            self._fill(result, move)
        except Refused as refusal:
            result.code, result.message = refusal.code, str(refusal)
            if move is not None and refusal.code == RESULT.CODE_FAULT:  # the axis may be well, and only not heard
                self._follow.call_async(FollowReference.Request())      # stop and hold
        except InputError as error:
            result.code, result.message = RESULT.CODE_REFUSED, str(error)
        except Exception as error:      # noqa: BLE001 - left to rclpy it would be a result whose code says "reached"
            result.code, result.message = RESULT.CODE_FAULT, f"the move server failed: {error!r}"
            self.get_logger().error(f"{result.message}\n{traceback.format_exc()}")
            self._follow.call_async(FollowReference.Request())      # stop and hold
        if move is not None:  # its own: a goal that never began ends nobody else's
            with self._changed:
                move.done = True
        return result

    def _take_turn(self, mine):
        """Wait for the move under way to end, and no longer than there is a newer goal: a thread of the executor that
        waits takes no answer of the controller. Raises `Refused`."""
        while not self._turn.acquire(timeout=TURN):
            if self._newest_goal > mine:
                raise Refused(RESULT.CODE_SUPERSEDED, "a newer goal came before this one began")
        if self._newest_goal > mine:
            self._turn.release()
            raise Refused(RESULT.CODE_SUPERSEDED, "a newer goal came before this one began")

    def _check(self, request):
        with self._changed:  # a driver that was activated a moment ago may not have been heard yet
            self._changed.wait_for(lambda: self._status is not None and self._status.active, timeout=STATUS_WAIT)
            status = self._status
        if status is None:
            raise Refused(RESULT.CODE_REFUSED, "no driver: nobody publishes driver_status")
        if not status.active:
            if status.fault:  # also where it came between the goal's acceptance and its begin
                raise Refused(RESULT.CODE_FAULT, f"the driver is not active (fault: {status.message})")
            raise Refused(RESULT.CODE_REFUSED, "the driver is not active (its lifecycle state)")
        check_move(request.target, request.tolerance, request.settle_time, request.timeout,
                   (status.minimum, status.maximum))
        for name in ("max_velocity", "max_acceleration", "max_jerk"):
            value = getattr(request, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"move: {name}", value, "0 (the server's parameter) or a finite limit above 0")

    def _begin(self, request):
        """Plan the reference, hand it over, return the `Move` that watches it."""
        p = self.parameters
        limits = MotionLimits(request.max_velocity or p.max_velocity, request.max_acceleration or p.max_acceleration,
                              request.max_jerk or p.max_jerk)
        with self._changed:
            if not self._changed.wait_for(
                    lambda: self._cell_says or self._latest is not None and self._latest[0] > self._stale,
                    timeout=self._patience):
                raise Refused(RESULT.CODE_REFUSED, "no controller: nobody publishes controller_state")
            self._check_alive()
            latest = self._latest
            moving = latest is not None and latest[3] in (ControllerState.MODE_MOVING, ControllerState.MODE_STOPPING)
        if moving:  # of somebody who is not there any more, or of another program: the newer goal counts
            self._stop(lambda *_: None)
        elif not self._introduced:  # the middleware may lose the first answers to a process that it has just found
            self._ask(FollowReference.Request())
        answer = self._hand_over(request, limits)
        if not answer.accepted:
            self._stop(lambda *_: None)
            answer = self._hand_over(request, limits, self._rest)  # the controller's own word: blocks may be late
        if not answer.accepted:
            raise Refused(RESULT.CODE_REFUSED, f"the controller refused: {answer.message}")
        return self._move

    def _hand_over(self, request, limits, here=None):
        """Plan from where the reference stands, hand the plan to the controller, return its answer; sets `_move`."""
        with self._changed:
            status, latest = self._heard_so_far()
            lockstep = status.lockstep
            self._hold(lockstep)
            here = latest[2] if here is None else here
        try:
            positions = jerk_limited_move(here, request.target, status.period, limits)
            answer = self._ask(FollowReference.Request(
                start_sequence=self._granter.until + 1 if lockstep else 0, positions=positions))
            if not answer.accepted:
                return answer
            move = Move(here, request.target, request.tolerance, request.settle_time, request.timeout,
                        answer.start_sequence, answer.rest_sequence, status.period)
            with self._changed:
                self._move, self._heard = move, time.monotonic()
            return answer
        finally:
            self._go_on()

    def _watch(self, move, mine, cancelled, feedback):
        """Wait for the end of the move, with feedback; stop it for a cancel, a newer goal or a fault."""
        published = 0.0
        while True:
            with self._changed:
                self._changed.wait(timeout=0.02)
                status, (sequence, position, _, _) = self._heard_so_far()
                self._check_alive()
            if status.fault or not status.active:
                raise Refused(RESULT.CODE_FAULT, f"the driver stopped the axis: {status.message or 'not active'}")
            if move.done:
                if not move.reached and sequence < move.rest_sequence:
                    move.stopped = self._stop(feedback)
                return
            if cancelled():
                raise Refused(RESULT.CODE_CANCELLED, f"cancelled {self._stop(feedback)}")
            if self._newest_goal > mine:
                raise Refused(RESULT.CODE_SUPERSEDED, f"a newer goal came {self._stop(feedback)}")
            if time.monotonic() - published > FEEDBACK:
                published = time.monotonic()
                feedback(position, move.target - position, move.phase(sequence))

    def close(self):
        """The controller holds its reference."""
        self._action.destroy()


def main(arguments=None):
    """Run the node."""
    keep_memory_steady()
    return run_node(MoveServer, arguments, threads=6)


if __name__ == "__main__":
    sys.exit(main())
