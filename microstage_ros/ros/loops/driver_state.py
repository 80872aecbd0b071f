"""What the parts of the axis driver share: the node with its parameters, the hardware and its safety chain, the gate,
paths of messages.

Each part (`driver_periods`, `driver_requests`) is a class over this one; `nodes.axis_driver` puts them together.
"""

from collections.abc import Callable

from microstage_msgs.msg import AxisState, Credit, VoltageCommand
from rclpy.lifecycle import LifecycleNode

from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.command_gate import CommandGate
from microstage_ros.hardware.limits import new_limits
from microstage_ros.hardware.output_guard import OutputGuard
from microstage_ros.hardware.protocol import Hardware, HardwareError, Setup, instruments, safety_members
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.ros.launching.ownership import Ownership
from microstage_ros.ros.launching.parameters import Parameters, yaml_mapping
from microstage_ros.ros.launching.process import running
from microstage_ros.ros.loops.compiled_driver import QuickPeriods
from microstage_ros.ros.loops.driver_topics import DriverTopics
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.abandoned_locks import AbandonedLocks
from microstage_ros.ros.transport.checked import CheckedReader
from microstage_ros.ros.transport.codec import Codec
from microstage_ros.ros.transport.credit import CreditReader, Ledger
from microstage_ros.ros.transport.identity import Holder, Names
from microstage_ros.ros.transport.requests import Requests
from microstage_ros.ros.transport.response_times import ResponseTimes
from microstage_ros.ros.transport.servo_path import FastServoPath, make_servo_path, reader_qos

TRAVEL_MARGIN = 1e-4
CREDIT_BYTES = 80
"""More than a `Credit` with the longest name."""

HOLD_PERIODS = 2.5
"""A command is in force for at least so many control periods."""

WATCHDOG_LATER_S = 5e-4
"""The watchdog acts so much later than the loop itself would [s]."""

LIMITS = ("velocity", "current", "following_error", "encoder_motor", "voltage_rate")


class DriverState(LifecycleNode):
    """The node ``axis_driver`` and what its parts work on; the servo loop has the hardware and the gate to itself.

    Attributes
    ----------
    parameters : of ``config/axis_driver.yaml``. axis : `Axis`. period : T [s].
    hardware : the backend. gate : which command is in force. guard : the output as the watchdog sees it.
    limits, memory : arrays of one, see `hardware.limits.new_limits`.
    ledger : credit granted. holder : whom to obey. topics : what is published. responses : times to a command.
    sequence : number of the control period. overruns, host_stops, host_stopped : counted, and how long [s].
    _quick : the compiled loop, None without one. _side : servo path of its sender's thread.
    _due : when the next period begins, by the performance counter [s]. _time_ns : stamp of the present one.
    _begun : stamp, number, raw state and hardware of the present period.
    """

    def __init__(self):
        super().__init__("axis_driver")
        p = self.parameters = Parameters(self, "axis_driver")
        self._owned = Ownership("driver", self.get_namespace())
        AbandonedLocks().keep_looking(running, self.get_logger())
        self.axis = load_axis(p.axis_file or config_file("axis.yaml"))
        self.period = self.axis.value("period")
        self._lockstep = p.mode == "lockstep"
        actuator = actuator_of(self.axis)
        self.gate = CommandGate(actuator.command_limit(self.axis), unit=actuator.command.unit,
                                holds=actuator.holds_on_fault)
        self._disables = actuator.disables_on_fault
        self._hold_s = max(p.command_hold_s, HOLD_PERIODS * self.period)
        travel = self.axis.value("travel.minimum") - TRAVEL_MARGIN, self.axis.value("travel.maximum") + TRAVEL_MARGIN
        self.limits, self.memory = new_limits(self.axis, travel, {name: getattr(p, f"limit_{name}") for name in LIMITS})
        self.guard = OutputGuard(0.0 if self._lockstep else self._hold_s + WATCHDOG_LATER_S, actuator.holds_on_fault)
        self.ledger = Ledger(p.followers)
        self.responses = ResponseTimes()
        self._stop_from_outside: tuple | None = None
        self._configured = False
        self.host_stops, self.host_stopped = 0, 0.0
        self.sequence, self.overruns, self._time_ns = -1, 0, 0
        self._due: float | None = None
        self._reported: tuple | None = None
        self._begun: tuple = ()
        options = yaml_mapping("axis_driver: backend_options", p.backend_options, "{position: 0.0}")
        self._card_watchdog_s = options.get("watchdog_s", self._hold_s + WATCHDOG_LATER_S)
        self.hardware: Hardware = make_hardware(p.backend, Setup(self.axis, p.seed, options))
        if self._lockstep and not self.hardware.simulated:
            raise InputError("axis_driver: parameter mode", p.mode, f"paced: backend {p.backend} has its own time")
        self._safety: dict[str, Callable] = safety_members(self.hardware)
        self._instruments: dict[str, Callable] = instruments(self.hardware)
        self._opened, self._written = False, 0.0
        self._enabled: bool | None = False  # None: the hardware did not say that it is as asked
        self._switches = False, False
        self._open_paths()

    def _open_paths(self):
        """Commands, credit and requests in, everything else out."""
        servo = self._servo = self._side = make_servo_path(self)
        self.holder = Holder(self, topics.COMMAND, ("str_controller",))
        self._quick: QuickPeriods | None = None
        self._wake: Callable[[], None] = lambda: None
        self._compiled = False
        if self.parameters.compiled_loop and isinstance(servo, FastServoPath) and hasattr(self.hardware, "arrays"):
            self._side, self._wake, self._compiled = make_servo_path(self), servo.semaphore.post_now, True
        self._requests = Requests(self._wake)
        granted = CheckedReader(self._side.reader(Credit, topics.CREDIT, reader_qos(1000, reliable=True)), 8,
                                largest=CREDIT_BYTES)
        self._credits = CreditReader(granted, self.ledger, self._on_credit, self._present, Names(self, topics.CREDIT))
        self._commands = servo.reader(VoltageCommand, topics.COMMAND, reader_qos(100, reliable=False))
        self._checked = CheckedReader(self._commands, Codec("VoltageCommand").size, self.holder, passes_on=False)
        self._command_readers = (self._commands,)
        self._idle_readers = (self._commands,) if self._compiled else (granted.reader, self._commands)
        self._unpack_command = Codec("VoltageCommand").unpack
        self._constant_status = (AxisState.STATUS_SIMULATED if self.hardware.simulated else 0) | (
            AxisState.STATUS_LOCKSTEP if self._lockstep else 0)
        self.topics = DriverTopics(self, servo, self.axis, getattr(self.hardware, "has_truth", self.hardware.simulated))

    def _present(self):
        """Number of the present control period, whoever counts it."""
        return self.sequence if self._quick is None else max(self.sequence, self._quick.sequence)

    def _on_credit(self, limit):
        if self._quick is not None and self._lockstep:
            self._quick.grant(limit)
            self._wake()

    def _enable(self, on):
        """The drive's enable output, where the backend has one; set only when it changes, and again where it is not
        known to be set."""
        if "enable" in self._safety and on != self._enabled:
            self._enabled = None
            try:
                self._safety["enable"](on)
                self._enabled = on
            except HardwareError as error:
                self.gate.trip("hardware", str(error))

    def _arm_card(self, on):
        """The card's own watchdog, where the backend has one: armed while the driver is active and writes in every
        period. It puts the output to zero, so not for a drive that holds a position."""
        if "watchdog" in self._safety and not self.gate.holds:
            try:
                self._safety["watchdog"](self._card_watchdog_s if on else 0.0)
            except HardwareError as error:
                self.gate.trip("hardware", str(error))

    def _look_at_signals(self):
        """Emergency stop and limit switches, where the backend has them."""
        if not (self._safety and self._opened):
            return
        try:
            if "e_stop" in self._safety and self._safety["e_stop"]():
                self.gate.trip("e_stop", "the emergency stop is pressed, or its circuit is open")
            if "limit_switches" in self._safety:
                self._switches = self._safety["limit_switches"]()
        except HardwareError as error:
            self.gate.trip("hardware", str(error))
