"""move_server: the action `move_to`, the service `move`, and the statistics of the moves made.

It plans jerk-limited references (`control.trajectories.profiles`), hands them to the controller, tied to a control
period, and watches the encoder (`control.trajectories.move`). A new goal supersedes the one under way; a cancelled one
stops and holds. In lockstep it grants the driver credit, so that a cancel is heard within its window.
"""

import math
import sys
import threading
import time
from collections import deque

import numpy as np
from microstage_msgs.action import MoveTo
from microstage_msgs.msg import AccuracyRow, ControllerState, DriverStatus, InterferometerReading
from microstage_msgs.srv import FollowReference, Statistics
from microstage_msgs.srv import Move as MoveService
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from microstage_ros.control.trajectories.move import Move, check_move
from microstage_ros.control.trajectories.profiles import MotionLimits, jerk_limited_move
from microstage_ros.quantities.errors import InputError
from microstage_ros.ros.launching.parameters import Parameters
from microstage_ros.ros.launching.process import run_node, running
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.blocks import Stream
from microstage_ros.ros.transport.codec import Codec
from microstage_ros.ros.transport.credit import Granter, repeat_after
from microstage_ros.ros.transport.servo_path import make_servo_path

WAIT = 0.05
LOOK = 0.5
FEEDBACK = 0.1
STATUS_WAIT = 0.5
INTERFEROMETER_WAIT = 2.0
RESULT = MoveTo.Result


class Refused(Exception):
    """Why a move ended without reaching its target: code and message of the result."""

    def __init__(self, code, message):
        super().__init__(message)
        self.code = code


class MoveServer(Node):
    """The process that turns goals into references."""

    def __init__(self):
        super().__init__("move_server")
        self.parameters = Parameters(self, "move_server")
        self._changed = threading.Condition()
        self._turn = threading.Lock()
        self._status = None
        self._latest, self._stale = None, -1
        self._move, self._repeated = None, 0.0
        self._numbered = self._newest_goal = 0
        self._numbers = {}
        self._held_since, self._talking = None, False
        self._readings = deque(maxlen=100_000)
        self._errors = {}
        self._granter = Granter(self)
        servo = self._servo = make_servo_path(self)
        self._inside = Stream(self, servo, ControllerState, topics.CONTROLLER_STATE)
        self._interferometer = Stream(self, servo, InterferometerReading, topics.INTERFEROMETER)
        self._inside_codec, self._reading_codec = Codec("ControllerState"), Codec("InterferometerReading")
        group = ReentrantCallbackGroup()
        self.create_subscription(DriverStatus, topics.DRIVER_STATUS, self._on_status, topics.LATCHED)
        self._follow = self.create_client(FollowReference, topics.FOLLOW_REFERENCE, callback_group=group)
        self._action = ActionServer(self, MoveTo, topics.MOVE_TO, self._execute, callback_group=group,
                                    goal_callback=self._number_goal, cancel_callback=lambda goal: CancelResponse.ACCEPT)
        self.create_service(MoveService, topics.MOVE, self._serve_move, callback_group=group)
        self.create_service(Statistics, topics.STATISTICS, self._serve_statistics, callback_group=group)

    # --- the stream of states -------------------------------------------------------------------------------

    def loop(self):
        """Follow the controller's states and the interferometer."""
        looked = 0.0
        while running():
            self._servo.wait(self._inside.readers + self._interferometer.readers, WAIT)
            while (rows := self._interferometer.take()) is not None:
                self._readings.extend(self._reading_codec.array(rows)[["sequence", "position"]].tolist())
            while (rows := self._inside.take()) is not None:
                with self._changed:
                    for state in self._inside_codec.array(rows)[["sequence", "position", "reference"]].tolist():
                        self._on_inside(*state)
                    self._granter.tell()
                    self._changed.notify_all()
            self._keep_credit_alive()
            if time.monotonic() - looked > LOOK:
                looked = time.monotonic()
                self._inside.look()
                self._interferometer.look()

    def _on_inside(self, sequence, position, reference):
        before = self._latest[0] if self._latest else -1
        if sequence < before:  # the driver began anew
            self._granter.forget()
        self._latest = (sequence, position, reference)
        if self._move is not None and not self._move.done:
            self._move.update(sequence, position)
            if self._move.done and self.parameters.pause_s > 0.0:
                self._held_since = time.monotonic()
        window = self._window
        if self._held_since is None and sequence // (window // 2) != before // (window // 2):
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
            elif self._held_since is not None and not self._talking and time.monotonic() - self._held_since > self.parameters.pause_s:
                self._let_go()
            elif time.monotonic() - self._repeated > repeat_after(self._latest[0] if self._latest else -1):
                self._repeated = time.monotonic()
                self._granter.grant(self._granter.until)

    def _let_go(self):
        """Time goes on."""
        self._held_since = None
        self._granter.grant(self._granter.until + self.parameters.window)

    def _on_status(self, status):
        with self._changed:
            if status.active and not (self._status and self._status.active):
                # where the reference stands now is known from the first period after this
                self._stale = status.sequence if status.sequence > 0 else -1
                if self._granter.until >= 0:
                    self._granter.grant(self._granter.until + self.parameters.window)
            self._status = status
            self._changed.notify_all()

    # --- one move -------------------------------------------------------------------------------------------

    def _number(self):
        """The number of a request: the later one counts, whichever of them a thread comes to first."""
        with self._changed:
            self._numbered += 1
            return self._numbered

    def _number_goal(self, request):
        """Accept a goal. Who sent it hears of that later, so no goal that is sent then has a smaller number."""
        self._numbers[id(request)] = self._number()
        return GoalResponse.ACCEPT

    def _execute(self, goal):
        def feedback(position, error, phase):
            goal.publish_feedback(MoveTo.Feedback(position=position, error=error, phase=phase))

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
        result = RESULT(final_error=math.nan, interferometer_error=math.nan, settling_time=math.nan)
        try:
            self._check(request)
            with self._changed:
                self._newest_goal = max(self._newest_goal, mine)
                self._changed.notify_all()
            with self._turn:  # the move under way sees the newer goal, stops and gives the turn away
                if self._newest_goal > mine:
                    raise Refused(RESULT.CODE_SUPERSEDED, "a newer goal came before this one began")
                move = self._begin(request)
                self._watch(move, mine, cancelled, feedback)
            self._fill(result, move)
        except Refused as refusal:
            result.code, result.message = refusal.code, str(refusal)
        except InputError as error:
            result.code, result.message = RESULT.CODE_REFUSED, str(error)
        return result

    def _check(self, request):
        with self._changed:  # a driver that was activated a moment ago may not have told yet
            self._changed.wait_for(lambda: self._status is not None and self._status.active, timeout=STATUS_WAIT)
            status = self._status
        if status is None:
            raise Refused(RESULT.CODE_REFUSED, "no driver: nobody publishes driver_status")
        if not status.active:
            why = f"fault: {status.message}" if status.fault else "its lifecycle state"
            raise Refused(RESULT.CODE_REFUSED, f"the driver is not active ({why})")
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
            if not self._changed.wait_for(lambda: self._latest is not None and self._latest[0] > self._stale,
                                          timeout=p.driver_timeout_s):
                raise Refused(RESULT.CODE_REFUSED, "no controller: nobody publishes controller_state")
            lockstep = self._status.lockstep
            self._hold(lockstep)
            here = self._latest[2]
        try:
            positions = jerk_limited_move(here, request.target, self._status.period, limits)
            answer = self._ask(FollowReference.Request(
                start_sequence=self._granter.until + 1 if lockstep else 0, positions=positions))
            if not answer.accepted:
                raise Refused(RESULT.CODE_REFUSED, f"the controller refused: {answer.message}")
            move = Move(here, request.target, request.tolerance, request.settle_time, request.timeout,
                        answer.start_sequence, answer.rest_sequence, self._status.period)
            with self._changed:
                self._move = move
            return move
        finally:
            self._go_on()

    def _hold(self, lockstep):
        """In lockstep time stands still while we talk with the controller, within the window."""
        self._talking, self._held_since = lockstep, time.monotonic() if lockstep else None

    def _go_on(self):
        """The talk is over."""
        with self._changed:
            if self._talking:
                self._talking = False
                self._let_go()

    def _watch(self, move, mine, cancelled, feedback):
        """Wait for the end of the move, with feedback; stop it for a cancel, a newer goal or a fault."""
        told = 0.0
        while True:
            with self._changed:
                self._changed.wait(timeout=0.02)
                sequence, position, _ = self._latest
                status = self._status
            if status.fault or not status.active:
                raise Refused(RESULT.CODE_FAULT, f"the driver stopped the axis: {status.message or 'not active'}")
            if move.done:
                return
            if cancelled():
                raise Refused(RESULT.CODE_CANCELLED, f"cancelled {self._stop(feedback)}")
            if self._newest_goal > mine:
                raise Refused(RESULT.CODE_SUPERSEDED, f"a newer goal came {self._stop(feedback)}")
            if time.monotonic() - told > FEEDBACK:
                told = time.monotonic()
                feedback(position, move.target - position, move.phase(sequence))

    def _stop(self, feedback):
        """Ramp the reference to rest and wait until it is there. Returns when that was, in words."""
        with self._changed:
            asked = self._latest[0]
            self._hold(self._status.lockstep)
        try:
            answer = self._ask(FollowReference.Request())
        finally:
            self._go_on()
        with self._changed:
            if self._move is not None:
                self._move.done = True
            self._changed.wait_for(lambda: self._latest[0] > answer.rest_sequence,
                                   timeout=self.parameters.driver_timeout_s)
            position = self._latest[1]
        feedback(position, answer.rest_position - position, MoveTo.Feedback.PHASE_STOPPING)
        return (f"in period {asked}; the reference rests at {answer.rest_position:.9f} m "
                f"from period {answer.rest_sequence} on")

    def _ask(self, request):
        """Call the controller. Raises `Refused` if it does not answer."""
        answered = threading.Event()
        future = self._follow.call_async(request)
        future.add_done_callback(lambda _: answered.set())
        if not answered.wait(self.parameters.driver_timeout_s):
            self._follow.remove_pending_request(future)
            raise Refused(RESULT.CODE_FAULT, "the controller does not answer")
        return future.result()

    # --- results --------------------------------------------------------------------------------------------

    def _fill(self, result, move):
        result.reached, result.final_error, result.overshoot = move.reached, move.final_error, move.overshoot
        result.settling_time = move.settling_time
        result.start_sequence, result.end_sequence = move.start_sequence, move.end_sequence
        result.code = RESULT.CODE_REACHED if move.reached else RESULT.CODE_TIMEOUT
        result.message = "reached" if move.reached else (
            f"not within {move.tolerance} m of the target for {move.settle_time} s before the timeout")
        if move.reached:
            result.interferometer_error = self._interferometer_error(move)
            self._errors.setdefault(round(move.target - move.start, 9), []).append(
                (result.final_error, result.interferometer_error, result.settling_time))

    def _interferometer_error(self, move):
        """Mean of interferometer - target over the settle time [m]; NaN without an interferometer."""
        if not self._interferometer.publishers:
            return math.nan
        first, last = move.window
        until = time.monotonic() + INTERFEROMETER_WAIT
        while (not self._readings or self._readings[-1][0] < last) and time.monotonic() < until:
            time.sleep(0.002)
        found = [position for sequence, position in list(self._readings) if first <= sequence <= last]
        return float(np.mean(found)) - move.target if found else math.nan

    def _serve_statistics(self, request, response):
        from microstage_ros.metrology.repeatability import repeatability  # scipy.stats takes a second to load

        for distance, results in self._errors.items():
            table = np.array(results)
            interferometer = bool(np.isfinite(table[:, 1]).all())
            errors = table[:, 1 if interferometer else 0]
            row = AccuracyRow(target=distance, count=len(errors), mean_error=float(errors.mean()), four_sigma=math.nan,
                              four_sigma_low=math.nan, four_sigma_high=math.nan, interferometer=interferometer,
                              settling_time_median=float(np.median(table[:, 2])))
            if len(errors) > 1:
                r = repeatability(errors)
                row.four_sigma, (row.four_sigma_low, row.four_sigma_high) = r.four_s, r.four_s_interval
            response.rows.append(row)
        if request.reset:
            self._errors = {}
        return response

    def close(self):
        """The controller holds its reference."""
        self._action.destroy()


def main(arguments=None):
    """Run the node."""
    return run_node(MoveServer, arguments, threads=6)


if __name__ == "__main__":
    sys.exit(main())
