"""One running cell under faults: a process is killed or stopped while the axis moves, and everybody is watched.

A cell lives through many faults, as a real one has to: what may be started again is, a latched fault is reset, and the
next fault comes. It ends where the axis cannot go on (driver, controller or the process that starts the nodes killed).
"""

import contextlib
import os
import resource
import signal
import time
from pathlib import Path

import rclpy
from microstage_msgs.action import MoveTo
from microstage_msgs.msg import DriverStatus

from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags.bag_reader import Bag
from microstage_ros.records.bags.recovery import recover
from microstage_ros.ros.benchmarks.output_view import OutputView
from microstage_ros.ros.benchmarks.trial_cell import NAMESPACE, cell_parameters
from microstage_ros.ros.client import AxisClient, NoAnswer
from microstage_ros.ros.launching.cell_processes import NODES, QUICK, CellFailure, CellProcesses
from microstage_ros.ros.launching.supervision import RESTARTED, STOPPED_S, Supervisor
from microstage_ros.ros.operator import Operator
from microstage_ros.ros.transport import topics

SPARE_BYTES = 30_000
"""Bytes that a bag may still grow when the disk is full: files of the recorder can then be no longer."""

SIGNALS = {"kill": signal.SIGKILL, "stop": signal.SIGSTOP}
PROCESSES = (*NODES, "watchdog", "fork_server")
"""All processes of a cell: its nodes, the driver's watchdog, the process that starts the nodes."""

ENDING = (("axis_driver", "kill"), ("str_controller", "kill"), ("fork_server", "kill"))
"""After these the axis cannot go on; a person decides."""

STILL = (*ENDING, ("axis_driver", "stop"), ("str_controller", "stop"))
"""After these the axis has to stand still."""

ANSWER_S, REPAIR_S, STOPPED_FOR_S, LOOK_S = 1.0, 15.0, 0.6, 0.05
ENOUGH_V = 0.01
FARTHEST = 4e-3


class FaultCell:
    """One cell.

    Parameters
    ----------
    mode : of `trial_cell.PERIODS`. folder : for logs and bags, empty. chance : `random.Random`. witness :
        `witness.Witness`.

    Attributes
    ----------
    usable : another fault may be injected.
    """

    def __init__(self, mode, folder, chance, witness):
        self.mode, self._folder, self._chance, self._witness = mode, Path(folder), chance, witness
        self._paced, self.usable, self._statuses = mode != "lockstep", False, []
        self._node = rclpy.create_node("faults", namespace=NAMESPACE)
        self._node.create_subscription(DriverStatus, topics.DRIVER_STATUS, self._statuses.append, topics.LATCHED)
        self._pids, self._killed_recorders, self._direction, self._looked = set(), {}, 1.0, 0.0
        self._says = ""
        self._client: AxisClient  # these two once it is started
        self._operator: Operator
        self._closing = contextlib.ExitStack()
        self._cell = CellProcesses(NAMESPACE, NODES, cell_parameters(mode, folder), logs=self._folder / "logs")

    def start(self):
        """Start it. Raises `CellFailure`, `NoAnswer`."""
        self._cell.start()
        self._supervisor = Supervisor(self._cell, self._node, tell=lambda text: None)
        self._cell.activate(self._node)
        self._client = AxisClient(NAMESPACE, self._node, wait=60.0)
        self._closing.callback(self._client.close)
        self._operator = Operator(NAMESPACE, self._node)
        self._closing.callback(self._operator.close)
        self._view = OutputView(self._cell.processes["axis_driver"].pid)
        self.usable = True

    # --- one fault ---------------------------------------------------------------------------------------------

    def inject(self, name, what):
        """One fault; the facts as plain data. Raises `NoAnswer` if the axis does not begin to move."""
        facts = {"mode": self.mode, "process": name, "fault": what}
        self._remember_processes()
        result = self._set_moving()
        self._pass_time(self._chance.uniform(0.0, 0.2))
        if self._paced:
            self._await(lambda: abs(self._view.volts) > ENOUGH_V, 5.0)
        pid, before = self._pid(name), self._view.commanded_ns
        heard, lost_before, self._says = len(self._statuses), self._client.server_started, ""
        if name == "bag_recorder" and what == "kill" and self._bag_folders():
            self._killed_recorders[self._bag_folders()[-1]] = time.time()
        began, began_ns = time.monotonic(), time.monotonic_ns()
        self._do(pid, what)
        still = (name, what) in STILL
        answered = self._await(
            lambda: result.done() or self._client.lost(lost_before),
            ANSWER_S + 0.5,
            stop=lambda: not still and name != "move_server",
        )  # a dead server's client has to notice
        facts["answered_s"] = round(answered, 4) if answered is not None else None
        facts["by_the_client"] = answered is not None and not result.done()
        if still:
            facts |= self._rested(began_ns)
        elif what == "stop":
            self._pass_time(max(began + STOPPED_FOR_S - time.monotonic(), 0.0))
        facts |= self._repaired(name, what, pid)
        facts["says"] = self._says
        if not still:
            facts["faulted"] = next((status.message for status in self._statuses[heard:] if status.fault), "")
            # in lockstep time stands still while a follower that was stopped holds its credit back
            self._await(lambda: self._view.commanded_ns > before, ANSWER_S, stop=lambda: self._paced)
            facts["went_on"] = not facts["faulted"] and self._view.commanded_ns > before
        facts["must_answer"] = still or name == "move_server"
        return facts

    def _do(self, pid, what):
        """The fault itself."""
        if what in SIGNALS:
            os.kill(pid, SIGNALS[what])
            return
        largest = max((path.stat().st_size for path in self._bag_folders()[-1].glob("*.mcap")), default=0)
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (largest + SPARE_BYTES, resource.RLIM_INFINITY))

    def _rested(self, began_ns):
        """Zero volts, when, and that they stay."""
        if not self._paced:  # simulated time stands still: no period is driven without its command
            return {"zero_after_s": None, "kept_away_s": 0.0, "stays": True}
        after = self._view.zero_after(2.0)
        kept = (
            self._witness.kept_away(min(self._view.commanded_ns, began_ns), max(self._view.zero_ns, began_ns))
            if after
            else 0.0
        )
        end, stays = time.monotonic() + 0.15, after is not None
        while time.monotonic() < end and stays:
            stays = self._view.volts == 0.0
            rclpy.spin_once(self._node, timeout_sec=0.005)
        return {"zero_after_s": after, "kept_away_s": round(kept, 6), "stays": stays}

    def _repaired(self, name, what, pid):
        """Let a stopped process go on, or see it started again; what is usable afterwards."""
        if (name, what) in ENDING:
            ended = self._await(lambda: bool(self._says), 5.0)
            self.usable = False
            return {"noticed": ended is not None}
        if what == "stop":
            noticed = self._noticed(name)
            left = name in RESTARTED and self._chance.random() < 0.15  # the supervisor ends and restarts it
            if name == "watchdog" or left:
                return {"noticed": noticed} | self._replaced(name, pid, STOPPED_S + REPAIR_S)
            if name == "fork_server" and self._chance.random() < 0.34:
                self.usable = False  # the cell has to end although nobody passes its signals on
                return {"noticed": noticed}
            os.kill(pid, signal.SIGCONT)
            return {"noticed": noticed, "repaired": self._usable_again()}
        return {"noticed": True} | self._replaced(name, pid, REPAIR_S)

    def _noticed(self, name):
        """True if the supervisor sees that a process is stopped; the watchdog is the driver's own affair."""
        if name in ("watchdog", "fork_server"):
            return True
        return self._await(lambda: self._cell.processes[name].stopped, 1.0) is not None

    def _replaced(self, name, pid, seconds):
        took = self._await(lambda: self._pid(name) not in (None, pid), seconds)
        again = took is not None and self._usable_again()
        return {"restarted_s": None if took is None else round(took, 3), "repaired": again}

    def _usable_again(self):
        """The axis is active, without fault, and its move server answers. False, and `usable` too, if that does not
        come."""
        try:
            end = time.monotonic() + REPAIR_S
            while time.monotonic() < end and not self._says:
                driver = self._operator.status().driver
                if driver.active and not driver.fault and driver.watched:
                    self._client.wait_for_server(REPAIR_S)
                    return True
                if driver.fault:
                    self._operator.reset()
                self._pass_time(0.05)
            self._says = self._says or f"not usable within {REPAIR_S:g} s"
        except NoAnswer as error:
            self._says = self._says or str(error)
        self.usable = False
        return False

    def _set_moving(self):
        """A long move has begun; the future of its result."""
        self._direction = -self._direction
        begun = []
        for _ in range(3):  # a move server that has just begun may refuse: the driver is not heard yet
            begun.clear()
            sent, result = (
                self._client.send(
                    MoveTo.Goal(target=self._direction * FARTHEST, max_velocity=1e-3, timeout=60.0), begun.append
                ),
                None,
            )
            self._await(sent.done, 10.0)
            if sent.done():
                result = sent.result().get_result_async()
                self._await(lambda result=result: begun or result.done(), 10.0)
                if begun and not result.done():
                    return result
            self._pass_time(0.2)
        raise NoAnswer(
            "no move begins" + (f": {result.result().result.message}" if result is not None and result.done() else "")
        )

    # --- waiting, as the process that started the cell does ------------------------------------------------------

    def _await(self, condition, seconds, stop=lambda: False):
        """Until ``condition()``; how long it took [s], None if it did not come, or ``stop()``."""
        began = time.monotonic()
        while not condition():
            if time.monotonic() > began + seconds or stop():
                return None
            self._turn()
        return time.monotonic() - began

    def _pass_time(self, seconds):
        self._await(lambda: False, seconds)

    def _turn(self):
        rclpy.spin_once(self._node, timeout_sec=0.002)
        if time.monotonic() - self._looked > LOOK_S and not self._says:
            self._looked = time.monotonic()
            try:
                self._supervisor.look()
            except CellFailure as failure:
                self._says = str(failure)

    # --- processes -----------------------------------------------------------------------------------------------

    def _pid(self, name):
        if name == "fork_server":
            return self._cell.server_pid
        if name == "watchdog":
            return next(iter(children(self._cell.processes["axis_driver"].pid, "watchdog")), None)
        return self._cell.processes[name].reported_pid

    def _remember_processes(self):
        for name in PROCESSES:
            pid = self._pid(name)
            self._pids |= {pid} if pid else set()

    def close(self):
        """End the cell; how long that took, what is left, whether its bags open."""
        self._remember_processes()
        began = time.monotonic()
        self._cell.stop(QUICK)
        took = time.monotonic() - began
        for pid in self._pids:  # only what should have ended is meant to be there no more
            if alive(pid):
                _signal(pid, signal.SIGCONT)
        end = time.monotonic() + 1.0
        while any(map(alive, self._pids)) and time.monotonic() < end:
            time.sleep(0.02)
        orphans = [pid for pid in self._pids if alive(pid)]
        for pid in orphans:
            _signal(pid, signal.SIGKILL)
        self._closing.close()
        self._node.destroy_node()
        return {
            "mode": self.mode,
            "stop_s": round(took, 3),
            "orphans": len(orphans),
            **self._bags(),
            "tracebacks": [
                path.name
                for path in (self._folder / "logs").glob("*.log")
                if "Traceback" in path.read_text(encoding="utf-8", errors="replace")
            ],
        }

    def _bag_folders(self):
        return sorted(self._folder.glob("bag*"), key=lambda path: path.stat().st_mtime)

    def _bags(self):
        """How many bags are whole, recovered, unreadable; how old the last state was when a recorder was killed [s]."""
        found = {"bags_whole": 0, "bags_recovered": 0, "bags_unreadable": 0, "messages": 0}
        ages, says = [], []
        for folder in self._bag_folders():
            try:
                done = recover(folder)
                bag = Bag(folder)
                found["messages"] += sum(one.messages for one in done)
                found["bags_whole" if all(one.whole for one in done) else "bags_recovered"] += 1
            except InputError as error:
                empty = not any(path.stat().st_size > 100 for path in folder.glob("*.mcap*"))
                found["bags_unreadable"] += not empty  # one that was killed before its first message holds none
                says.append(" ".join(str(error).split())[:200])
                continue
            if folder in self._killed_recorders and self._paced:
                last = max(
                    (
                        time_ns
                        for _, time_ns, _ in bag.raw_messages(
                            [f"{NAMESPACE}/state"], start=round((self._killed_recorders[folder] - 1.0) * 1e9)
                        )
                    ),
                    default=None,
                )
                if last is not None:  # else it was killed before its first state
                    ages.append(round(self._killed_recorders[folder] - last * 1e-9, 4))
        return {**found, "last_state_age_s": ages, **({"says": says} if says else {})}


def children(pid, word):
    """Numbers of the processes directly below ``pid`` [1] whose command line has a ``word``."""
    found = []
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            parent = int((entry / "stat").read_text(errors="replace").rsplit(")", 1)[1].split()[1])
            if parent == pid and alive(int(entry.name)) and word in (entry / "cmdline").read_text(errors="replace"):
                found.append(int(entry.name))
        except OSError:
            continue
    return found


def alive(pid):
    """True while the process ``pid`` [1] is there."""
    try:
        return (
            Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rsplit(")", 1)[1].split()[0]
            not in "ZX"
        )
    except OSError:
        return False


def _signal(pid, number):
    try:
        os.kill(pid, number)
    except OSError:
        pass
