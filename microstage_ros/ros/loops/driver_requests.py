"""What people and other processes may ask of the driver: status, stop, reset, taking over; answered in any mode at
once.

The services belong to a group of callbacks of their own, so that a lifecycle transition that waits for readers holds
nobody up.
"""

import os
import socket
import time

from microstage_msgs.msg import DriverStatus
from microstage_msgs.srv import GetStatus, TakeOver, Trip
from rclpy.callback_groups import ReentrantCallbackGroup
from std_srvs.srv import Trigger

from microstage_ros.hardware.command_gate import FAULTS
from microstage_ros.model.actuators import actuator_of
from microstage_ros.ros.launching.process import running
from microstage_ros.ros.loops.driver_periods import DriverPeriods
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.identity import ANYBODY

AT_REST_V = 1e-9
MOVING_M_S = 1e-6

HERE = {"host": socket.gethostname(), "process": os.getpid()}


def _answering(answer):
    """``answer``, which also answers when the servo loop does not: not done, and why."""

    def answered(request, response):
        try:
            return answer(request, response)
        except TimeoutError as error:
            for name in ("success", "accepted"):
                if hasattr(response, name):
                    setattr(response, name, False)
            response.message = str(error)
            return response

    return answered


class DriverRequests(DriverPeriods):
    """Services of `AxisDriver`."""

    def serve_requests(self):
        """Offer the services."""
        group = ReentrantCallbackGroup()
        self._since = time.time_ns()
        for kind, name, answer in (
            (Trigger, topics.STOP, self._serve_stop),
            (Trigger, topics.RESET_FAULT, self._serve_reset),
            (Trigger, topics.RESET, self._serve_reset),
            (Trip, topics.TRIP, self._serve_trip),
            (GetStatus, topics.STATUS, self._serve_status),
            (TakeOver, topics.TAKE_OVER, self._serve_take_over),
        ):
            self.create_service(kind, name, _answering(answer), callback_group=group)
        self._answer_bad_transitions()

    def _answer_bad_transitions(self):
        """A transition that does not exist from here is refused; rclpy's own service leaves whoever asks without an
        answer."""
        for service in self.services:
            if service.srv_name.endswith("/change_state"):
                service.callback = self._guarded(service.callback)

    def _guarded(self, answer):
        def answer_always(request, response):
            try:
                return answer(request, response)
            except Exception as error:  # noqa: BLE001 - rclpy's own class of error is private
                self.get_logger().error(
                    f"lifecycle transition {request.transition.label or request.transition.id} refused: {error}"
                )
                response.success = False
                return response

        return answer_always

    def identity(self):
        """Fields of `DriverStatus` that say who drives and who commands."""
        seconds, nanoseconds = divmod(self._since, 1_000_000_000)
        found = dict(HERE, process=os.getpid(), commander=self.holder.name, watched=self.guard.watching)
        return found | {"since": type(DriverStatus().since)(sec=seconds, nanosec=nanoseconds)}

    def stop_now(self):
        """The safe command, latched. False if another fault was latched before. It is done even if it comes late."""
        if not self.gate.holds:
            self.guard.put(0.0)
        return self._requests.ask(lambda: self._trip("stopped", "stopped by an operator or a program (stop)"),
                                  withdraw=False)

    def _serve_stop(self, request, response):
        first = self.stop_now() or self.gate.fault == "stopped"
        response.success = True
        response.message = (
            self.gate.safe_words
            + ("" if first else f"; fault {self.gate.fault} was latched before")
            + "; reset lets the axis go on"
        )
        return response

    def _serve_trip(self, request, response):
        name = FAULTS[request.fault] if 0 < request.fault < len(FAULTS) else ""
        response.success = bool(name) and self._requests.ask(
            lambda: self._trip(name, request.message[:500]), withdraw=False
        )
        response.message = (
            "" if response.success else f"fault {self.gate.fault} was latched before" if name else "no such fault"
        )
        return response

    def _serve_reset(self, request, response):
        fault, message = self.gate.fault, self.gate.message
        self._find_commander()
        self._requests.ask(self._forget_fault)
        response.success = True
        response.message = f"was: {fault}" + (f" ({message})" if message else "")
        if not self.gate.active:
            response.message += "; the driver is not active: a lifecycle transition (activate) lets it command again"
        return response

    def _find_commander(self):
        """Whom to obey from now on; why nobody, in words, empty if somebody is there."""
        if self.gate.fault == "command_timeout" or self.gate.fault == "process":
            others = self.holder.look_beyond()
        else:
            others = self.holder.look()
        if others and not self.holder.name:
            return f"several publish on {topics.COMMAND}, one must: {', '.join(sorted(others.values()))}"
        return ""

    def _await_commander(self):
        """As `_find_commander`, with a wait: the graph of a busy machine may learn late who publishes. Until it has,
        a command could be anybody's."""
        until = time.monotonic() + self.parameters.ready_timeout_s
        while not (why := self._find_commander()) and not self.holder.found:
            if time.monotonic() > until or not running():
                return f"nobody publishes on {topics.COMMAND}"
            time.sleep(0.01)
        self.holder.be_strict()
        return why

    def _serve_take_over(self, request, response):
        found = self.holder.publishers()
        wanted = [numbers for numbers, name in found.items() if name == request.node and numbers != ANYBODY]
        moving = abs(float(self.memory["velocity"][0])) > MOVING_M_S or self._pushes()
        if self.gate.active and self.gate.fault == "none" and moving:
            response.message = (
                f"refused: the axis moves ({float(self.memory['velocity'][0]):.3g} m/s) or is commanded "
                f"({self.gate.voltage:.3g} {self.gate.unit}); stop it first"
            )
        elif len(wanted) != 1:
            response.message = (
                f"node: got {request.node!r}, expected one of {', '.join(sorted(found.values())) or 'nobody publishes'}"
            )
        else:
            self._requests.ask(lambda: self.holder.take(found, wanted[0]))
            response.accepted, response.message = True, f"{request.node} commands from now on"
        return response

    def _pushes(self):
        """Whether the command in force moves a stage that stands still; one that sets a position does not."""
        return not actuator_of(self.axis).holds_position and abs(self.gate.voltage) > AT_REST_V

    def _serve_status(self, request, response):
        gate, quick = self.gate, self._quick
        response.driver = self.topics.status_message(
            self._time_ns, max(self.sequence, quick.sequence if quick else 0), gate, self.hardware.simulated
        )
        response.position = float(self.memory["position"][0])
        response.voltage = float(self.guard.volts[0])
        response.lifecycle = self._state_machine.current_state[1]
        response.summary = (
            f"fault {gate.fault}: {gate.message}; {gate.safe_words}"
            if gate.fault != "none"
            else f"active, commanded by {self.holder.name or 'nobody'}"
            if gate.active
            else f"{response.lifecycle}, {gate.safe_words}"
        )
        return response

    def _watch_the_watchdog(self):
        """A watchdog that ended or hangs is replaced; without one nothing may move."""
        if self._configured and not self.guard.renew(self._stop_from_outside) and self.gate.active:
            self._requests.ask(lambda: self._trip("watchdog", "there is no watchdog: its process does not start"),
                               withdraw=False)
