"""str_controller: answers every `state` with a `command`; the law is `control.controller`, by parameter.

Publishes `command` and, decimated, `controller_state`; serves `follow_reference`. Without a reference it
holds the place where it found the axis.
"""

import sys

import yaml
from rclpy.node import Node

from microstage_msgs.msg import AxisState, ControllerState, DriverStatus, VoltageCommand
from microstage_msgs.srv import FollowReference
from microstage_ros.axis.axis_file import load_axis
from microstage_ros.axis.errors import InputError
from microstage_ros.control.controller import make_controller
from microstage_ros.control.reference_player import ReferencePlayer
from microstage_ros.nodes import topics
from microstage_ros.nodes.codec import STAMP, STAMP_AT, Codec
from microstage_ros.nodes.credit import UNLIMITED, Granter
from microstage_ros.nodes.parameters import Parameters
from microstage_ros.nodes.process import run_node, running
from microstage_ros.nodes.scheduling import ask_for_priority
from microstage_ros.nodes.servo_path import make_servo_path, reader_qos
from microstage_ros.places import config_file

WAIT = 0.1


class StrController(Node):
    """The controller's process."""

    def __init__(self):
        super().__init__("str_controller")
        p = self.parameters = Parameters(self, "str_controller", self._parameter_changed)
        self.axis = load_axis(p.axis_file or config_file("axis.yaml"))
        self.controller = make_controller(p.controller, self.axis, **_gains(p.gains))
        self.controller.step(0.0, 0.0, 0.0)  # compiled before anybody waits for an answer
        self.controller.reset()
        self.player = ReferencePlayer(self.axis.value("period"), p.stop_time_s)
        self._state = Codec("AxisState", p.frame_id)
        self._command = Codec("VoltageCommand", p.frame_id)
        self._inside = Codec("ControllerState", p.frame_id)
        self._servo = make_servo_path(self)
        self._reader = self._servo.reader(AxisState, topics.STATE, reader_qos(topics.DEPTH, reliable=False))
        self._command_publisher = self.create_publisher(VoltageCommand, topics.COMMAND, topics.SERVO)
        inside = self._inside_publisher = self.create_publisher(ControllerState, topics.CONTROLLER_STATE, topics.SERVO)
        self._send_command = self._servo.writer(self._command_publisher)
        self._send_inside = self._servo.writer(inside)
        self.create_service(FollowReference, topics.FOLLOW_REFERENCE, self._follow_reference)
        self._granter = Granter(self)
        self._ready = self.create_timer(0.05, self._grant_when_ready)
        self._last, self._answer, self._left_at = -1, None, -1
        self.create_subscription(DriverStatus, topics.DRIVER_STATUS, self._on_status, topics.LATCHED)
        ask_for_priority(self.get_logger(), p.real_time_priority)

    def loop(self):
        """The servo loop."""
        readers = (self._reader,)
        take, wait = self._reader.take, self._servo.wait
        while running():
            raw = take()
            if raw is None:
                wait(readers, WAIT)
            else:
                self._answer_state(raw)

    def _answer_state(self, raw):
        sequence, position, _, current, _, _, fault = self._state.unpack(raw)
        if sequence == self._last:  # sent once more: the answer was lost
            self._send_command(self._answer)
            return
        if fault or sequence < self._last or self._last <= self._left_at < sequence:
            self._begin_anew()
        if fault:
            return
        reference, mode = self.player.at(sequence, position)
        voltage = self.controller.step(reference, position, current)
        seconds, nanoseconds = STAMP.unpack_from(raw, STAMP_AT)
        time_ns = seconds * 1_000_000_000 + nanoseconds
        self._last = sequence
        self._answer = self._command.pack(time_ns, sequence, voltage, reference, 0.0, VoltageCommand.SENDER_CONTROLLER)
        self._send_command(self._answer)
        if sequence % self.parameters.state_decimation == 0:
            s = self.controller.state
            self._send_inside(self._inside.pack(
                time_ns, sequence, position, reference, s.error, s.proportional_gain, s.integral_gain,
                s.derivative_gain, s.proportional_term, s.integral_term, s.derivative_term, s.feed_forward_term,
                s.voltage, mode, s.saturated))

    def _begin_anew(self):
        """The axis was not in our hands: hold where it is found, without a jump of the voltage."""
        self._left_at = -1
        self.player.forget()
        self.controller.reset()

    def _on_status(self, status):
        if not status.active and status.sequence > 0:
            self._left_at = status.sequence

    def _grant_when_ready(self):
        """Credit without limit once all readers of the command are there."""
        if self._command_publisher.get_subscription_count() >= self.parameters.expected_subscribers \
                and self._inside_publisher.get_subscription_count() >= self.parameters.expected_state_subscribers \
                and self._reader.publishers:
            self._granter.grant(UNLIMITED)
            self._ready.cancel()

    def _follow_reference(self, request, response):
        try:
            player = self.player
            result = player.follow(request.start_sequence, request.positions) if len(request.positions) else player.stop()
        except InputError as error:
            response.message = str(error)
            return response
        response.accepted = True
        response.start_sequence, response.rest_sequence, response.rest_position = result
        return response

    def _parameter_changed(self, name, value):
        if name == "gains":
            self.controller.change(**_gains(value))

    def close(self):
        """Nothing to hold on to: the driver stops the axis when commands end."""


def _gains(text):
    """The mapping in parameter ``gains``."""
    try:
        gains = yaml.safe_load(text) or {}
    except yaml.YAMLError as error:
        raise InputError("str_controller: gains", text, f"YAML such as {{proportional: 4.0e5}} ({error})") from None
    if not isinstance(gains, dict):
        raise InputError("str_controller: gains", text, "YAML such as {proportional: 4.0e5}")
    return {name: _number(value) for name, value in gains.items()}


def _number(value):
    """YAML takes 4.0e5, which has no sign in its exponent, for a text."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def main(arguments=None):
    """Run the node."""
    return run_node(StrController, arguments)


if __name__ == "__main__":
    sys.exit(main())
