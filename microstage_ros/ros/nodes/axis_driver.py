"""axis_driver: the only node that touches the hardware. Lifecycle; lockstep or paced; zero voltage on any fault.

lockstep   simulated time: period n begins when the command for n - 1 is in force and every follower has
           granted credit for it; stamps are n T. The run depends on seed and commands alone.
paced      wall clock: period n begins at its time whatever happens; the newest valid command is in force
           (`hardware.command_gate` says what happens to late, lost, repeated and bad ones).
"""

import sys
import threading
import time

from microstage_msgs.msg import AxisState
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.lifecycle import TransitionCallbackReturn

from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.protocol import HardwareError, Setup
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.ros.launching.process import on_stop, on_urgent, run_node, running
from microstage_ros.ros.loops.compiled_driver import QuickPeriods, Watch, load, timing
from microstage_ros.ros.loops.driver_periods import SLICE
from microstage_ros.ros.loops.driver_requests import DriverRequests
from microstage_ros.ros.transport.blocks import Sender

COUNTERS = ("answered", "late", "lost", "duplicated", "reordered", "zeroed")
"""Of the gate, in the timing message."""

QUICK_COUNTERS = ("answered", "late", "lost", "overruns", "zeroed", "foreign", "malformed", "host_stops")
"""Of the compiled loop, beside those of the gate."""


class AxisDriver(DriverRequests):
    """The driver's process: the servo loop has the hardware and the gate to itself, requests are handed to it."""

    def __init__(self):
        super().__init__()
        if self._compiled:
            self._quick = QuickPeriods(
                self._servo,
                self._commands,
                self._side.semaphore,
                self.topics,
                self.gate,
                self._requests.asked,
                self.responses,
                self.hardware,
                self._settings(),
                Watch(self.guard.words, self.guard.volts, self.holder.words, self.limits, self.memory),
            )
            self._sender = Sender(self.topics.outlets, self._side.semaphore, self._look_aside)
        on_stop(self._requests.interrupt)
        on_urgent(self.stop_now)
        self.serve_requests()
        self.create_timer(1.0, self._once_per_second, callback_group=MutuallyExclusiveCallbackGroup())
        if self.parameters.activate:
            self._starter = threading.Thread(target=self._start_alone, daemon=True)
            self._starter.start()

    def _settings(self):
        """What stays as it is in the compiled loop."""
        p = self.parameters
        return {"paced": not self._lockstep, "block": self.topics.block, "every": p.simulation_decimation,
                "status": self._constant_status | AxisState.STATUS_ACTIVE, "limit": self.gate.limit,
                "holds": self.gate.holds,
                "period": self.period, **timing(self.period, p.rate_limit, SLICE, not self._lockstep,
                                                 p.real_time_priority if p.scheduling == "real_time" else 0,
                                                 self._hold_s, p.command_timeout_s)}

    # --- requests from the other thread -------------------------------------------------------------------

    def on_configure(self, state):
        """Take hold of the hardware, and have the output watched."""
        done = self._in_loop(self._open)
        if done == TransitionCallbackReturn.SUCCESS:
            if not self.guard.start(self._stop_from_outside):
                self.get_logger().error("not configured: the watchdog's process does not start")
                self._in_loop(self._let_go)
                return TransitionCallbackReturn.FAILURE
            self._configured = True  # from now on it is looked after once per second
        return done

    def on_activate(self, state):
        """Begin; refused while a fault is latched, or readers or followers are missing."""
        missing = self._missing_readers() or self._await_commander()
        if missing:
            self.get_logger().error(f"not activated: {missing}")
            return TransitionCallbackReturn.FAILURE
        return self._in_loop(self._activate)

    def on_deactivate(self, state):
        """Zero voltage."""
        return self._in_loop(self._deactivate)

    def on_cleanup(self, state):
        """Let go of the hardware."""
        self._configured = False
        return self._in_loop(self._let_go)

    def on_shutdown(self, state):
        """Zero voltage, let go of the hardware."""
        return self._in_loop(self._shut)

    def _in_loop(self, action):
        """Have the servo loop do it between two periods. Returns the transition's result."""
        try:
            done = self._requests.ask(action) is not False
        except (HardwareError, InputError, TimeoutError) as error:
            self.get_logger().error(str(error))
            done = False
        return TransitionCallbackReturn.SUCCESS if done else TransitionCallbackReturn.FAILURE

    def _missing_readers(self):
        """What is missing for the first period, in words; waits a while for it."""
        until = time.monotonic() + self.parameters.ready_timeout_s
        while True:
            missing = self.topics.missing_readers(self.ledger.missing() if self._lockstep else [])
            if not missing or time.monotonic() > until or not running():
                return missing
            time.sleep(0.005)

    def _start_alone(self):
        """Without a lifecycle manager."""
        time.sleep(0.1)
        self.trigger_configure()
        self.trigger_activate()

    # --- for the other thread while the loop goes on ------------------------------------------------------

    def _look_aside(self):
        """What the sender's thread looks at beside the blocks."""
        self._credits.take()
        if self._quick is not None:
            self._quick.look_for_listeners()

    def _once_per_second(self):
        """Timing and diagnostics, read while the loop goes on: to stop it would cost it many periods."""
        self._watch_the_watchdog()
        if not self.holder.found:
            self._find_commander()
        self.holder.learn_name()
        counters = {name: getattr(self.gate, name) for name in COUNTERS} | {
            "overruns": self.overruns, "foreign": self._checked.foreign, "malformed": self._checked.malformed,
            "taken_away": self.guard.taken_count, "host_stops": self.host_stops, "host_stopped": self.host_stopped}
        time_ns, sequence, quick = self._time_ns, self.sequence, self._quick
        if quick is not None:
            time_ns, sequence = max(time_ns, quick.time_ns), max(sequence, quick.sequence)
            counters |= {name: counters[name] + getattr(quick, name) for name in QUICK_COUNTERS}
            counters["host_stopped"] += quick.host_stopped_ns * 1e-9
        self.topics.timing(time_ns, sequence, self.gate, counters, self.responses)

    def close(self):
        """Zero voltage, let go of the hardware, send what is left."""
        self._configured, was_active = False, self.gate.active
        self.gate.deactivate()
        self.guard.disarm()
        try:
            self._make_safe()
            self._enable(False)
            if was_active and not self._lockstep:  # a last state shows it; in lockstep no period lacks its command
                self._begin(time.time_ns())
                self.topics.rest(*self._begun)
                self.topics.flush()  # now: the rest of the end takes its time on a busy machine
        finally:
            try:
                self._let_go()
            finally:
                self.guard.close()
        self._requests.close()
        if self._quick is not None:
            self._sender.stop()
        self.topics.flush()
        self.topics.status(self._time_ns, self.sequence, self.gate, self.hardware.simulated)


def warm_up():
    """Load compiled code for who forks this node."""
    load(make_hardware("simulated", Setup(load_axis(config_file("axis.yaml")), 1, {})).own_arrays)


def main(arguments=None):
    """Run the node."""
    return run_node(AxisDriver, arguments, threads=3)


if __name__ == "__main__":
    sys.exit(main())
