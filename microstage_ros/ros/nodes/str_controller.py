"""str_controller: answers every `state` with a `command`; the law is `control.laws.controller`, by parameter.

Publishes `command` and, decimated, `controller_state`; serves `follow_reference`. Without a reference it
holds the place where it found the axis.
"""

import math
import sys
import time

from microstage_msgs.msg import AxisState, ControllerState, DriverStatus, VoltageCommand
from microstage_msgs.srv import FollowReference
from rclpy.node import Node

from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.laws.learned import resonance_remark
from microstage_ros.control.laws.supervision import REASONS
from microstage_ros.control.trajectories.reference_player import ReferencePlayer
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.top_speed import top_speed
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.ros.launching.parameters import Parameters, yaml_mapping
from microstage_ros.ros.launching.process import on_stop, run_node, running
from microstage_ros.ros.loops.controller_loop import CROWDED, NOTHING_CAME, STRANGE, QuickAnswers, load
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.abandoned_locks import AbandonedLocks
from microstage_ros.ros.transport.blocks import Outlet, Sender, periods_per_block
from microstage_ros.ros.transport.checked import MOST, SILENT, CheckedReader
from microstage_ros.ros.transport.codec import Codec
from microstage_ros.ros.transport.credit import UNLIMITED, Granter
from microstage_ros.ros.transport.identity import Holder
from microstage_ros.ros.transport.requests import Requests
from microstage_ros.ros.transport.servo_path import FastServoPath, Semaphore, make_servo_path, reader_qos

WAIT = 0.1
MOMENT = 0.01
"""How long [s] to wait for the next state before what waits for its block to be full is sent; longer than a scheduler's
tick (see `period_timing.SHORT_TIMER`)."""

_SENDER = VoltageCommand.SENDER_CONTROLLER


class StrController(Node):
    """The controller's process."""

    def __init__(self):
        super().__init__("str_controller")
        p = self.parameters = Parameters(self, "str_controller", self._parameter_changed)
        AbandonedLocks().keep_looking(running, self.get_logger())
        self.axis = load_axis(p.axis_file or config_file("axis.yaml"))
        law = p.controller or self.axis.controller.get("type", "none")
        self.controller = make_controller(law, self.axis, **_gains(p.gains))
        _load(self.controller)
        if self.controller.start_remark:
            self.get_logger().warning(self.controller.start_remark)
        self.player = ReferencePlayer(self.axis.value("period"), p.stop_time_s, top_speed(self.axis))
        self._unpack_state = Codec("AxisState").unpack
        self._pack_command, self._pack_inside = Codec("VoltageCommand").pack_as, Codec("ControllerState").pack_as
        self._servo = make_servo_path(self)
        states = self._servo.reader(AxisState, topics.STATE, reader_qos(topics.DEPTH, reliable=False))
        self._holder = Holder(self, topics.STATE, topics.SENDERS[topics.STATE])
        self._holder.be_strict()  # until the graph names the driver, nobody's state is answered
        self._reader = CheckedReader(states, Codec("AxisState").size, self._holder)
        self._malformed, self._heard = 0, (0.0, -1)
        self._commands = Outlet(self, self._servo, VoltageCommand, topics.COMMAND, always=True)
        self._insides = Outlet(self, self._servo, ControllerState, topics.CONTROLLER_STATE)
        self._block, self._every = periods_per_block(self.axis.value("period")), p.state_decimation
        self.create_service(FollowReference, topics.FOLLOW_REFERENCE, self._follow_reference)
        self._granter = Granter(self)
        self._ready = self.create_timer(0.05, self._grant_when_ready)
        self._again = self.create_timer(0.2, self._grant_again)
        self._again.cancel()
        self._last, self._answer, self._left_at, self._patience = -1, None, -1, WAIT
        self._requests, self._quick = Requests(), None
        if p.compiled_loop and isinstance(self._servo, FastServoPath):
            self._requests, full = Requests(self._servo.semaphore.post_now), Semaphore()
            self._sender = Sender((self._commands, self._insides), full, self._look_for_listeners)
            self._quick = QuickAnswers(self._servo, states, full, self._commands, self._insides, self.controller,
                                       self.player, self._requests, self._every, self._block, MOMENT,
                                       self._holder.words)
        on_stop(self._requests.interrupt)
        self.create_subscription(DriverStatus, topics.DRIVER_STATUS, self._on_status, topics.LATCHED)
        self._said, self._resonance = 0, 0.0
        self.create_timer(0.5, self._say_changes)

    def loop(self):
        """The servo loop: plain states in compiled code, all others here."""
        while running():
            self._requests.serve()
            if self._last > self._left_at:
                self._left_at = -1
            quick = self._quick if self._left_at < 0 else None
            raw = self._answer_quickly(quick) if quick is not None and quick.ready else self._next_state()
            if raw is not None:
                self._answer_state(raw)

    def _next_state(self):
        """The next state, None if none comes."""
        self._servo.wait((self._reader.reader,), self._patience)
        raw = self._reader.take()
        if raw is None:  # the axis stands still
            self._flush()
        self._patience = WAIT if raw is None else MOMENT
        return raw

    def _answer_quickly(self, quick):
        """Answer in compiled code; returns a state that it leaves to us, or None."""
        before = self._last
        why, self._last = quick.run(before, self._patience)
        if self._last != before:
            self._answer = quick.command.bytes
        if why == NOTHING_CAME:
            self._flush()
        elif why == CROWDED:
            lockstep = bool(quick.state.message["status"][0] & AxisState.STATUS_LOCKSTEP)
            # paced, the loop waits for nobody: messages that find no place are missing
            self._commands.send_closed(lockstep)
            self._insides.send_closed(lockstep)
        self._patience = WAIT if why == NOTHING_CAME else MOMENT
        return quick.state.bytes if why == STRANGE else None

    def _flush(self):
        """Send what waits for its block to be full."""
        self._commands.flush()
        self._insides.flush()

    def _answer_state(self, raw):
        sequence, position, _, current, _, _, fault = self._unpack_state(raw)
        if sequence > MOST or not (fault or math.isfinite(position)):
            self._malformed += 1
            return
        if sequence == self._last:  # sent once more: the answer was lost
            self._commands.send_single(self._answer)
            return
        if fault or sequence < self._last or self._last <= self._left_at < sequence:
            self._begin_anew()
        if fault:
            return
        reference, mode = self.player.at(sequence, position)
        voltage = self.controller.step(reference, position, current)
        self._last = sequence
        self._answer = answer = self._pack_command(raw, sequence, voltage, reference, 0.0, _SENDER)
        self._commands.send_single(answer)
        self._commands.keep(sequence, answer)
        if sequence % self._every == 0:
            s = self.controller.state
            self._insides.send(sequence, self._pack_inside(
                raw, sequence, position, reference, s.error, s.proportional_gain, s.integral_gain,
                s.derivative_gain, s.proportional_term, s.integral_term, s.derivative_term, s.feed_forward_term,
                s.voltage, mode, s.saturated, s.law, s.law_reason, s.handovers))
        if (sequence + 1) % max(self._block // 2, 1) == 0:
            self._insides.flush()
        if (sequence + 1) % self._block == 0:
            self._commands.flush()

    def _look_for_listeners(self):
        if self._quick is not None:
            self._quick.look_for_listeners()

    def _grant_again(self):
        """Say it once more, and see that the driver is the one that we follow."""
        self._granter.grant(UNLIMITED)
        last, now = max(self._last, self._quick.last if self._quick is not None else -1), time.monotonic()
        if last != self._heard[1]:
            self._heard = now, last
        if now - self._heard[0] > SILENT:
            self._holder.look_beyond()
        else:
            self._holder.look_for_expected()

    def _say_changes(self):
        """One line in the log for every hand-over of the observer law, and for a resonance that is not the file's."""
        state = self.controller.state
        if state.handovers != self._said:
            self._said = state.handovers
            self.get_logger().warning(
                f"the encoder-only law took over ({REASONS[state.law_reason]}), {state.handovers} times since the start"
            )
        learned = self.controller.learned
        remark = resonance_remark(learned, self._resonance)
        if remark:
            self._resonance = learned["resonance"].value
            self.get_logger().info(remark)

    def _in_loop(self, action):
        """Do something to player or law between two periods."""
        return action() if self._quick is None else self._requests.ask(action)

    def _begin_anew(self):
        """The axis was not in our hands: hold where it is found, without a jump of the voltage."""
        self._left_at = -1
        self.player.forget()
        self.controller.reset()

    def _on_status(self, status):
        if not status.active and 0 < status.sequence <= MOST:
            left_at = status.sequence
            self._in_loop(lambda: setattr(self, "_left_at", left_at))

    def _grant_when_ready(self):
        """Credit without limit as long as all readers of the command are there."""
        p = self.parameters
        self._holder.look_for_expected()
        if (
            self._holder.found
            and self._commands.listeners >= p.expected_subscribers
            and self._commands.followers >= p.expected_followers
            and self._insides.followers >= p.expected_state_followers
            and self._reader.publishers
        ):
            self._granter.grant(UNLIMITED)
            self._ready.cancel()
            self._again.reset()  # the driver may not have heard the first one

    def _follow_reference(self, request, response):
        try:
            player = self.player
            positions = player.checked(request.positions) if len(request.positions) else None
            result = self._in_loop(player.stop if positions is None else
                                   lambda: player.follow(request.start_sequence, positions))
        except (InputError, TimeoutError) as error:
            response.message = str(error)
            return response
        response.accepted = True
        response.start_sequence, response.rest_sequence, response.rest_position = result
        return response

    def _parameter_changed(self, name, value):
        if name == "gains":
            gains = _gains(value)
            self._in_loop(lambda: self.controller.change(**gains))

    def close(self):
        """Send what is left; the driver stops the axis when commands end."""
        self._requests.close()
        if self._quick is not None:
            self._sender.stop()


NO_GAINS = ("type_name", "axis", "period")
"""What else a controller is made with: of the axis, not of a law."""


def _gains(text):
    """The mapping in parameter ``gains``. Raises `InputError` for a name that is none of a gain."""
    gains = yaml_mapping("str_controller: gains", text, "{proportional: 4.0e5}")
    for name in gains:
        if not isinstance(name, str) or name in NO_GAINS:
            raise InputError("str_controller: gains", name, "names of gains, such as proportional")
    return {name: _number(value) for name, value in gains.items()}


def _number(value):
    """YAML takes 4.0e5, which has no sign in its exponent, for a text."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _load(controller):
    """Compiled before anybody waits for an answer."""
    controller.step(0.0, 0.0, 0.0)
    controller.reset()


def warm_up():
    """Load compiled code for who forks this node."""
    controller = make_controller("self_tuning", load_axis(config_file("axis.yaml")))
    _load(controller)
    load(controller.arrays)


def main(arguments=None):
    """Run the node."""
    return run_node(StrController, arguments)


if __name__ == "__main__":
    sys.exit(main())
