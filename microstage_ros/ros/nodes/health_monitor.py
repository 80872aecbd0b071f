"""health_monitor: publishes `health` after each window of motion, and finds the cause of an alarm on request.

The mathematics is `monitoring` and, for the action ``investigate``, `diagnosis`; this node follows `state`, cuts it
into windows, and moves the axis through the move server where it is asked to.
"""

import queue
import sys
import threading
import time
from collections import deque
from pathlib import Path

import numpy as np
from builtin_interfaces.msg import Time
from microstage_msgs.action import Investigate, MoveTo
from microstage_msgs.msg import AxisState, Health
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from std_srvs.srv import Trigger

from microstage_ros.model.axis_file import load_axis
from microstage_ros.monitoring.health import Watch
from microstage_ros.monitoring.investigation import LEAST_WINDOWS, Limits, diagnose_windows, targets
from microstage_ros.monitoring.store import Store
from microstage_ros.monitoring.traits import Machine
from microstage_ros.monitoring.windows import LEAST_TRAVEL, travelled
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import Record
from microstage_ros.ros.launching.parameters import Parameters
from microstage_ros.ros.launching.process import run_node, running
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.blocks import Stream
from microstage_ros.ros.transport.calls import ASK_AGAIN, RESULT_AGAIN, CallsInTurn, RepeatedCall, new_goal_id
from microstage_ros.ros.transport.codec import Codec, stamps_ns
from microstage_ros.ros.transport.servo_path import make_servo_path

WAIT = 0.05  # s, longest sleep between two looks at the stream
LOOK = 0.5  # s, between two looks for senders without blocks
KEPT = 12  # windows kept as records for an investigation
SETTLING = 10.0  # s, for a move beyond its time at the speed that it is given
ANSWER = 30.0  # s, longest wait for a move's result beyond its own time-out
MADE = (MoveTo.Result.CODE_REACHED, MoveTo.Result.CODE_TIMEOUT)  # it moved, whether or not it settled


class HealthMonitor(Node):
    """The monitor's process."""

    def __init__(self):
        super().__init__("health_monitor")
        p = self.parameters = Parameters(self, "health_monitor")
        self._axis = load_axis(p.axis_file or config_file("axis.yaml"))
        self._machine, self._period = Machine(self._axis), self._axis.value("period")
        self._stroke = self._axis.value("travel.maximum") - self._axis.value("travel.minimum")
        self._store = Store(
            p.store or ":memory:", self._axis.name, p.window
        )  # used by the judging thread alone, once it runs
        self._store.close()
        self._rows, self._codec = round(p.window / self._period) + 1, Codec("AxisState")
        servo = self._servo = make_servo_path(self)
        self._stream = Stream(self, servo, AxisState, topics.STATE)
        self._pending, self._count = [], 0
        self._windows, self._kept = queue.Queue(), deque(maxlen=KEPT)
        self._largest, self._busy = 0.0, threading.Lock()
        self._watch = None
        group = ReentrantCallbackGroup()
        self._health = self.create_publisher(Health, topics.HEALTH, topics.LATCHED)
        self.create_service(Trigger, topics.RESET_HEALTH, self._reset, callback_group=group)
        self._in_turn = CallsInTurn(self)
        self._move = ActionClient(self, MoveTo, topics.MOVE_TO, callback_group=self._in_turn.group)
        self._action = ActionServer(
            self,
            Investigate,
            topics.INVESTIGATE,
            self._investigate,
            callback_group=group,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
        )
        self._judging = threading.Thread(target=self._judge_all, name="judging", daemon=True)
        self._judging.start()

    # --- windows of the stream ------------------------------------------------------------------------------

    def loop(self):
        """Follow the states and cut them into windows."""
        looked = 0.0
        while running():
            self._servo.wait(self._stream.readers, WAIT)
            while (rows := self._stream.take_all()) is not None:
                self._add(self._codec.array(rows))
            if time.monotonic() - looked > LOOK:
                looked = time.monotonic()
                self._stream.look()

    def _add(self, states):
        """Add states to the window; one that is interrupted or not active begins anew."""
        sequence = states["sequence"].astype(np.int64)
        before = np.concatenate(
            (
                [self._pending[-1]["sequence"][-1].astype(np.int64) if self._pending else sequence[0] - 1],
                sequence[:-1],
            )
        )
        active = (states["status"] & AxisState.STATUS_ACTIVE) > 0
        if not (active.all() and (sequence == before + 1).all()):
            self._pending, self._count = [], 0
            return
        self._largest = max(self._largest, float(np.abs(states["applied_voltage"]).max()))
        self._pending.append(states.copy())
        self._count += len(states)
        if self._count >= self._rows:
            every = np.concatenate(self._pending)
            self._windows.put((int(stamps_ns(every[self._rows - 1 : self._rows])[0]), every[: self._rows]))
            self._pending, self._count = (
                ([every[self._rows :]], self._count - self._rows) if self._count > self._rows else ([], 0)
            )

    def _record(self, states):
        """The record of one window: the command of a row is what the next state says was held."""
        columns = {"encoder_m": states["position"][:-1], "voltage_V": states["applied_voltage"][1:]}
        if not np.isnan(states["current"]).all():
            columns["current_A"] = states["current"][:-1]
        return Record(self._period, columns, f"state from period {int(states['sequence'][0])} on")

    # --- judging --------------------------------------------------------------------------------------------

    def _judge_all(self):
        """Judge windows as they come, in a thread of its own (SQLite likes one thread)."""
        p = self.parameters
        with Store(p.store or ":memory:", self._axis.name, p.window) as store:
            store.hold(self._machine)
            if len(store.healthy()) >= p.healthy_windows:
                self._watch = Watch(store.reference(), p.false_alarms_per_month)
            while running():
                try:
                    stamp, states = self._windows.get(timeout=0.2)
                except queue.Empty:
                    continue
                try:
                    self._judge(store, stamp, self._record(states))
                except Exception as error:  # noqa: BLE001 - one bad window must not end the watch
                    self.get_logger().error(f"a window could not be judged: {' '.join(str(error).split())}")

    def _judge(self, store, stamp, record):
        if travelled(record) < LEAST_TRAVEL:
            return
        self._kept.append(record)
        traits, p = self._machine.traits(record), self.parameters
        begins, health = stamp * 1e-9 - p.window, {}
        if self._watch is None:
            store.hold(self._machine)
            store.add_healthy(begins, record.source, traits)
            if len(store.healthy()) >= p.healthy_windows:
                self._watch = Watch(store.reference(), p.false_alarms_per_month)
        else:
            health = self._watch.judge(begins, traits)
            store.add_health(begins, record.source, health)
        self._publish(stamp, health, len(store.healthy()))

    def _publish(self, stamp, health, healthy):
        p, names = self.parameters, sorted(health)
        message = Health(
            healthy_windows=healthy,
            window=p.window,
            false_alarms_per_month=p.false_alarms_per_month,
            channel=names,
            trait=[health[n].trait for n in names],
            score=[health[n].score for n in names],
            alarm=[health[n].alarm for n in names],
            since=[health[n].since for n in names],
        )
        message.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
        message.state = (
            Health.STATE_LEARNING
            if not names
            else Health.STATE_ALARM
            if any(message.alarm)
            else Health.STATE_WATCHING
        )
        self._health.publish(message)
        self._say(message)

    def _say(self, message):
        """One line of the log for each window; an alarm as a warning."""
        if not message.channel:
            self.get_logger().info(f"healthy window {message.healthy_windows} of {self.parameters.healthy_windows}")
            return
        score, channel, trait = max(zip(message.score, message.channel, message.trait))
        said = f"largest score {score:.2f} (1 is the threshold): {channel}, {trait}"
        if any(message.alarm):  # a line of code has one severity in rclpy's log
            self.get_logger().warning(f"ALARM, {said}")
        else:
            self.get_logger().info(said)

    def _reset(self, _, response):
        """Service reset_health: the machine was put right."""
        if self._watch is not None:
            self._watch.reset()
        response.success, response.message = True, "alarms forgotten"
        return response

    # --- finding the cause ----------------------------------------------------------------------------------

    def _investigate(self, goal):
        """Action investigate: moves if asked, then the diagnosis of the windows."""
        result = Investigate.Result()
        if not self._busy.acquire(blocking=False):
            result.message = "an investigation is under way"
            goal.abort()
            return result
        try:
            result.message = self._find_cause(goal, result)
        except InputError as error:
            result.message = " ".join(str(error).split())
        finally:
            self._busy.release()
        result.done = bool(result.verdict)
        if goal.is_cancel_requested:
            goal.canceled()
        else:
            (goal.succeed if result.done else goal.abort)()
        return result

    def _find_cause(self, goal, result):
        """Fill in the result. Returns what was done, in words."""
        request = goal.request
        limits = Limits.of(self._axis, request.travel_min, request.travel_max, request.voltage_max)
        said, before = "diagnosed the windows of the last motion", list(self._kept)
        if limits is not None:
            self._kept.clear()
            said = self._make_moves(goal, limits, request)
        if goal.is_cancel_requested:
            return "cancelled"
        self._tell(goal, "diagnosing", 0.0)
        out = Path(request.directory or Path(self.parameters.directory) / time.strftime("%Y%m%d-%H%M%S"))
        baseline = [name for name in self.parameters.baseline.split(",") if name]
        windows = list(self._kept)
        if len(windows) < LEAST_WINDOWS:  # a limit ended the moves: what was seen before is not lost
            windows = before + windows if limits is not None else windows
        try:
            report = diagnose_windows(self._axis, windows, baseline, out, request.seed)
        except InputError as error:
            raise InputError(error.place, error.value, f"{error.expected} ({said})") from error
        result.verdict, result.report = report["verdict"], str(out / "report.json")
        result.cause = [cause["id"] for cause in report["causes"]]
        return said

    def _make_moves(self, goal, limits, request):
        """Moves within the limits until the time is over, or a move ends otherwise than by itself: an operator's stop
        or hold ends them all. Returns what was done, in words; raises InputError where no move server answers."""
        if not self._move.wait_for_server(5.0):
            raise InputError(
                "investigate",
                "no move server answers",
                "a running cell, or no limits of travel: then the last windows are used",
            )
        self._largest, made, began = 0.0, 0, time.monotonic()
        place = None  # where the axis is, once it has moved
        for target, velocity in targets(limits, request.seed):
            spent = time.monotonic() - began
            if spent > request.duration or goal.is_cancel_requested:
                break
            self._tell(goal, "moving", min(spent / request.duration, 1.0))
            length = self._stroke if place is None else abs(target - place)
            if why := self._one_move(goal, target, velocity, SETTLING + 2.0 * length / velocity, limits):
                return f"{made} moves; ended: {why}"
            made, place = made + 1, target
        return f"{made} moves between {limits.low:g} m and {limits.high:g} m, largest command {self._largest:.3g} V"

    def _one_move(self, goal, target, velocity, timeout, limits):
        """One move; ``timeout`` [s]. Returns why there must be no further one, in words: the voltage passed its limit
        or the investigation was cancelled, whereupon the move is, or it ended otherwise. Empty: it was made."""
        wanted, goal_id = MoveTo.Goal(target=target, max_velocity=velocity, timeout=timeout), new_goal_id()

        def send():
            return self._in_turn.call(lambda: self._move.send_goal_async(wanted, goal_uuid=goal_id))

        sent = RepeatedCall(send, ASK_AGAIN)
        end, handle, result = time.monotonic() + timeout + ANSWER, None, None
        while time.monotonic() < end:
            if handle is None and sent.done():
                handle = sent.result()
                result = RepeatedCall(lambda: self._in_turn.call(handle.get_result_async), RESULT_AGAIN)
            if self._largest > limits.voltage or goal.is_cancel_requested:
                if handle is not None:
                    self._in_turn.call(handle.cancel_goal_async)
                return ("cancelled" if goal.is_cancel_requested else
                        f"the command reached {self._largest:.3g} V, more than {limits.voltage:.3g} V")
            if result is not None and result.done():
                ended = result.result().result
                return "" if ended.code in MADE else f"the move to {target:g} m was not made ({ended.message})"
            time.sleep(0.005)
        raise InputError("investigate", f"no result of the move to {target:g} m", f"one within {timeout + ANSWER:g} s")

    @staticmethod
    def _tell(goal, stage, progress):
        goal.publish_feedback(Investigate.Feedback(stage=stage, progress=float(progress)))

    def close(self):
        """Let the judging thread end."""
        self._judging.join(2.0)


def main(arguments=None):
    """Run the node until it is asked to stop. Returns the exit status."""
    return run_node(HealthMonitor, arguments, threads=4)


if __name__ == "__main__":
    sys.exit(main())
