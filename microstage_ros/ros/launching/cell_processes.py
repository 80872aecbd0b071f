"""Starting and stopping the processes of one axis, where no ROS launch system is: one process per node.

with CellProcesses(namespace="/axis", parameters={"axis_driver": {"seed": 1}}) as cell:
    cell.activate(node)          # an rclpy node of the caller that nobody spins, for the driver's lifecycle
"""

import contextlib
import os
import signal
import subprocess
import tempfile
import time
from pathlib import Path

import yaml

from microstage_ros.ros.launching.forked import ForkedNodes
from microstage_ros.ros.launching.ownership import Ownership
from microstage_ros.ros.launching.shared_memory import remove_left_behind

NODES = ("axis_driver", "str_controller", "gms_observer", "interferometer_logger", "move_server", "bag_recorder")
"""All nodes of an axis, in the order in which they are started."""

READERS = {
    ("axis_driver", "expected_subscribers"): {"str_controller"},
    ("axis_driver", "expected_followers"): {"gms_observer", "bag_recorder"},
    ("str_controller", "expected_subscribers"): {"axis_driver"},
    ("str_controller", "expected_followers"): {"bag_recorder"},
    ("str_controller", "expected_state_followers"): {"move_server", "bag_recorder"},
    ("gms_observer", "expected_followers"): {"bag_recorder"},
    ("interferometer_logger", "expected_followers"): {"move_server", "bag_recorder"},
}
"""Node and parameter to the nodes that read what it publishes: they must be there before the first period."""

STOP_WAIT = 20.0
"""Longest wait [s] for each process to end by itself, where nothing may be lost."""

QUICK = 1.6
"""The same for all together where a person waits; a busy machine may need longer (`LAST_STATE`)."""

LAST_STATE = 4.0
"""Longest wait [s] there for the driver, and then for the recorder. Together less than `interruption.LAST_RESORT`."""

START_WAIT = 240.0
ASK_AGAIN, LONGEST_PATIENCE = 0.2, 0.4
"""A request that is not answered is made again after so long [s], then after twice as long, up to the second. The
middleware goes on showing the services of a cell that ended a moment ago, and what is sent to them is lost."""


class CellFailure(RuntimeError):
    """A process of the cell ended, or did not do what it was asked; the text says which."""


PAIR = ("axis_driver", "str_controller")
BYSTANDERS = ("health_monitor",)
"""Nodes that grant no credit: they take what they can get of the stream, and the axis does not wait for them."""
PATIENT = ("gms_observer", "interferometer_logger", "health_monitor")
"""Nodes that may be late, and give way to those that may not."""


CONTROLLER_PRIORITY = 19
"""Real-time priority, below that of the driver (its parameter ``real_time_priority``)."""


def places(nodes, mode):
    """Parameters ``cpus`` and ``scheduling``: driver and controller on one processor, the others on the rest.

    A message to a process on the same processor costs a switch, one to a sleeping processor its waking, which is
    several times as much; and nobody else disturbs the pair. With one processor: no places.
    """
    allowed = sorted(os.sched_getaffinity(0))
    if len(allowed) < 2 or not set(PAIR) <= set(nodes):
        return {name: {} for name in nodes}
    rest = ",".join(map(str, allowed[:-1]))
    hot = {"cpus": str(allowed[-1]), "scheduling": "batch" if mode == "lockstep" else "real_time"}
    lower = {"str_controller": {"real_time_priority": CONTROLLER_PRIORITY}}  # the driver keeps time although it hangs
    return {
        name: {**hot, **lower.get(name, {})}
        if name in PAIR
        else {"cpus": rest, **({"nice": 10} if name in PATIENT else {})}
        for name in nodes
    }


def started_parameters(nodes, given):
    """Parameters for each node: what they must know of each other, then what the caller gives.

    Parameters
    ----------
    nodes : names that are started. given : node name (or ``"*"`` for all that have it) to parameters.
    """
    followers = [name for name in nodes if name not in ("axis_driver", *BYSTANDERS)]
    own = places(nodes, given.get("axis_driver", {}).get("mode", "lockstep"))
    if "axis_driver" in own:
        own["axis_driver"]["followers"] = followers or [""]
    for (name, parameter), readers in READERS.items():
        if name in own:
            own[name][parameter] = len(readers & set(nodes))
    return {name: {**own[name], **given.get(name, {})} for name in nodes}


class CellProcesses:
    """The processes of one axis.

    Parameters
    ----------
    namespace : of the axis, beginning with a slash. nodes : which to start. parameters : node name to parameters.
    logs : folder for what the processes print, one file each; None: to this process's own output.
    beside : they join a cell that another process owns, under names that begin with this word and an underscore.
    """

    def __init__(self, namespace="/axis", nodes=NODES, parameters=None, logs=None, beside=""):
        self.namespace, self.nodes, self._beside = namespace, nodes, beside
        self._parameters = started_parameters(nodes, parameters or {})
        self._logs = None if logs is None else Path(logs)
        self._directory = self._parameters.get("bag_recorder", {}).get("directory", "")
        self.processes = {}
        self._folder = self._forked = self._owned = None
        self._again, self._meanwhile = {}, lambda: None

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *error):
        self.stop()

    def start(self):
        """Start every node. Raises `InputError` if another process owns an axis of this name."""
        if not self._beside:
            self._owned = Ownership("cell", self.namespace, ("driver",) if "axis_driver" in self.nodes else ())
        remove_left_behind()
        self._folder = tempfile.TemporaryDirectory(prefix="microstage_")
        if self._logs:
            self._logs.mkdir(parents=True, exist_ok=True)
            for name in self.nodes:  # of an earlier cell; a process that is started again adds to its own
                Path(self._log(name)).unlink(missing_ok=True)
        folder = self._folder.name
        self._forked = ForkedNodes([self._node(name, folder) for name in self.nodes], self._log("fork_server"), folder)
        self.processes = dict(self._forked.processes)

    def _log(self, name):
        return str(self._logs.resolve() / f"{name}.log") if self._logs else None

    def _started(self):
        """(the fork server, folder of the parameters); raises CellFailure before `start`."""
        if self._forked is None or self._folder is None:
            raise CellFailure("the cell has not been started")
        return self._forked, self._folder.name

    def _node(self, name, folder):
        """What the fork server must know of a node, whose parameters stand in the ``folder``."""
        arguments = ["--ros-args", "-r", f"__ns:={self.namespace}"] + (
            ["-r", f"__node:={self._beside}_{name}"] if self._beside else []
        )
        if os.environ.get("ROS_SECURITY_ENABLE") == "true":
            arguments += ["--enclave", f"{self.namespace}/{name}"]
        if self._parameters[name]:
            path = Path(folder) / f"{name}.yaml"
            path.write_text(yaml.safe_dump({"/**": {"ros__parameters": self._parameters[name]}}), encoding="utf-8")
            arguments += ["--params-file", str(path)]
        return {"name": name, "arguments": arguments, "log": self._log(name)}

    @property
    def server_pid(self):
        """Number of the process that starts the nodes."""
        return self._started()[0].server_pid

    @property
    def server_status(self):
        """Exit status of the process that starts the nodes, None while it runs."""
        return self._started()[0].server_status

    def check(self):
        """Raise `CellFailure` if a process has ended."""
        for name, process in self.processes.items():
            if process.poll() is not None:
                raise CellFailure(f"{name} ended with status {process.returncode}{self.last_words(name)}")

    def restart(self, name):
        """Start a process that has ended once more; a recorder begins another bag."""
        self._again[name] = self._again.get(name, 1) + 1
        if self._parameters[name].get("directory"):
            self._parameters[name] = {**self._parameters[name], "directory": f"{self._directory}_{self._again[name]}"}
        forked, folder = self._started()
        self.processes[name] = forked.start_again(self._node(name, folder))

    def last_words(self, name):
        """The last error in a process's log, or else its last line, after a colon; empty if there is none. A warning of
        a library that comes after the error, such as of an answer that nobody waited for, says nothing of it."""
        log = self._log(name)
        if log is None:
            return ""
        if not Path(log).exists():  # the server failed before it began any node
            log = self._log("fork_server")
        lines = Path(log).read_text(encoding="utf-8", errors="replace").strip().splitlines()
        # of a warning or a traceback the line that says what it is
        lines = [line for line in lines if not line.startswith(" ")]
        lines = [line for line in lines if "Warning: " not in line]  # of Python's libraries
        errors = [line for line in lines if line.startswith(("[ERROR]", "[FATAL]"))]
        return f": {(errors or lines)[-1]}" if lines else ""

    def activate(self, node, meanwhile=None):
        """Configure and activate the driver, through ``node``; the function ``meanwhile`` is called, without
        arguments, again and again. Raises `CellFailure`, and what ``meanwhile`` raises."""
        from lifecycle_msgs.msg import State, Transition

        self._meanwhile = meanwhile or self._meanwhile
        self._transition(node, Transition.TRANSITION_CONFIGURE, State.PRIMARY_STATE_INACTIVE, "configured")
        self._transition(node, Transition.TRANSITION_ACTIVATE, State.PRIMARY_STATE_ACTIVE, "activated")
        if self._owned is not None:
            self._owned.activated()

    def deactivate(self, node):
        """Deactivate the driver: zero voltage."""
        from lifecycle_msgs.msg import State, Transition

        self._transition(node, Transition.TRANSITION_DEACTIVATE, State.PRIMARY_STATE_INACTIVE, "deactivated")

    def _transition(self, node, transition, wanted, done):
        """One lifecycle transition, asked for again if the answer was lost while processes discover each other."""
        from lifecycle_msgs.msg import Transition
        from lifecycle_msgs.srv import ChangeState, GetState

        change = node.create_client(ChangeState, f"{self.namespace}/axis_driver/change_state")
        look = node.create_client(GetState, f"{self.namespace}/axis_driver/get_state")
        request = ChangeState.Request(transition=Transition(id=transition))
        end, patience = time.monotonic() + START_WAIT, ASK_AGAIN
        try:
            while not (change.service_is_ready() and look.service_is_ready()):
                self._turn(node, end, "the driver does not come up")
            looked_after = False  # that all were refused
            asked = [change.call_async(request)]
            seen, again = look.call_async(GetState.Request()), time.monotonic() + patience
            while not any(answer.done() and answer.result().success for answer in asked):
                self._turn(node, end, f"the driver was not {done}")
                refused = all(answer.done() for answer in asked)
                if seen.done() and seen.result().current_state.id == wanted:
                    return
                if refused and seen.done() and looked_after:
                    raise CellFailure(f"the driver was not {done}{self.last_words('axis_driver')}")
                if time.monotonic() > again or refused and seen.done():
                    if seen.done() and not refused:  # it answers, and has not done it
                        asked.append(change.call_async(request))
                    patience = min(2.0 * patience, LONGEST_PATIENCE)
                    seen, again, looked_after = (
                        look.call_async(GetState.Request()),
                        time.monotonic() + patience,
                        refused,
                    )
        finally:
            node.destroy_client(change)
            node.destroy_client(look)

    def _turn(self, node, end, complaint):
        """A moment for ``node``; raises `CellFailure` after ``end`` or if a process has ended."""
        self._meanwhile()
        self.check()
        if time.monotonic() > end:
            raise CellFailure(f"{complaint} within {START_WAIT:.0f} s")
        import rclpy

        rclpy.spin_once(node, timeout_sec=0.02)

    def stop(self, within=None):
        """Ask every process to stop, the driver first and the recorder last; end those that do not.

        Parameters
        ----------
        within : longest time [s] for all together; None: `STOP_WAIT` for each.
        """
        if self._forked:
            self._forked.go_on()
        if within is None:
            for rank in range(3):
                names = [name for name in self.processes if _rank(name) == rank]
                for name in names:
                    self._ask_to_stop(self.processes[name], signal.SIGINT)
                for name in names:
                    self._await(self.processes.pop(name), STOP_WAIT)
        else:
            self._stop_quickly(within)
        if self._forked:
            self._forked.close()
        if self._folder:
            self._folder.cleanup()
        if self._owned:
            self._owned.release()

    def _stop_quickly(self, within):
        """Ask the driver, then all others; end those that are still there after ``within`` [s].

        The others are asked when the driver has ended, or half of the time has passed. Driver and recorder have longer
        on a busy machine (`LAST_STATE`), each in its turn: the bag is to show that the voltage is zero, and a recorder
        that is asked before the driver's last state has come hears nothing for `bag_recorder.DRAIN` and leaves.
        """
        began = time.monotonic()
        driver, others, recorder = ([self.processes[name] for name in self.processes if _rank(name) == rank]
                                    for rank in range(3))
        self.processes.clear()
        self._ask_all(driver)
        _wait_until(driver, began + within / 2)
        self._ask_all(others)
        _end(driver, began + LAST_STATE)
        self._ask_all(recorder)
        _end(others, began + within)
        _end(recorder, time.monotonic() + LAST_STATE)

    def stop_one(self, name):
        """Ask one process to stop and wait for it. Returns its exit status."""
        self._ask_to_stop(self.processes[name], signal.SIGINT)
        return self._await(self.processes.pop(name), STOP_WAIT)

    def _ask_all(self, processes):
        for process in processes:
            self._ask_to_stop(process, signal.SIGTERM)

    @staticmethod
    def _ask_to_stop(process, number):
        if process.poll() is None:
            process.send_signal(number)
            process.send_signal(signal.SIGCONT)  # to one that is stopped by a signal

    @staticmethod
    def _await(process, seconds):
        """Wait for the end of a process that was asked to stop; end it after so long. Its exit status."""
        try:
            return process.wait(seconds)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()


def _rank(name):
    """Place in the order in which processes stop: driver, others, recorder, which waits until nothing comes."""
    return {"axis_driver": 0, "bag_recorder": 2}.get(name, 1)


def _wait_until(processes, end):
    """Wait for the end of ``processes``, until the time ``end`` [s] of `time.monotonic` at the longest."""
    for process in processes:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(max(end - time.monotonic(), 0.0))


def _end(processes, end):
    """Wait as `_wait_until`, then kill those that are still there."""
    _wait_until(processes, end)
    for process in processes:
        if process.poll() is None:
            process.kill()
    for process in processes:
        process.wait()
