"""The fault campaign: a real cell, its processes killed and stopped at random, hostile messages, hostile files.

Every trial starts from a moving axis (paced: there is voltage), does one thing to one process, and looks from outside at the
shared output of the driver (`output_view`): did the voltage go to zero, and how long after the last valid command. Time for
which the host kept the campaign itself from its processor is measured beside it and told apart.
"""

import os
import random
import shutil
import signal
import tempfile
import time
from pathlib import Path

import rclpy
from microstage_msgs.action import MoveTo

from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.ros.benchmarks.output_view import OutputView
from microstage_ros.ros.client import AxisClient, NoAnswer
from microstage_ros.ros.launching.cell_processes import NODES, CellFailure, CellProcesses
from microstage_ros.ros.launching.supervision import Supervisor

BOUND_S = 5e-3
"""Zero volts so long after the last valid command, at most."""

ANSWER_S = 1.0
PERIODS = {"paced_1kHz": 1e-3, "paced_10kHz": 1e-4, "lockstep": 1e-4}
SIGNALS = {"kill": signal.SIGKILL, "stop": signal.SIGSTOP}
NEEDED = ("axis_driver", "str_controller")
STANDSTILL_M_S = 1e-5
QUIET_S = 0.4


class Trial:
    """One cell, one fault.

    Parameters
    ----------
    mode : of `PERIODS`. name : of the process that suffers. what : of `SIGNALS`. folder : for logs and the bag.
    """

    def __init__(self, mode, name, what, folder):
        self.mode, self.name, self.what, self.folder = mode, name, what, Path(folder)

    def run(self):
        """Run it; the facts as plain data."""
        period, lockstep = PERIODS[self.mode], self.mode == "lockstep"
        axis = self.folder / "axis.yaml"
        load_axis(config_file("axis.yaml")).with_values({"period": period}, source="estimate").save(axis)
        file = {"axis_file": str(axis)}
        parameters = {"axis_driver": {"mode": "lockstep" if lockstep else "paced", "rate_limit": 1.0 if lockstep else 0.0, **file},
                      "str_controller": file, "gms_observer": file,
                      "bag_recorder": {"directory": str(self.folder / "bag"), "log_time": "stamp" if lockstep else "arrival"}}
        node = rclpy.create_node("faults", namespace="/axis")
        facts = {"mode": self.mode, "process": self.name, "fault": self.what}
        cell = CellProcesses("/axis", NODES, parameters, logs=self.folder / "logs")
        pids = {}
        try:
            cell.start()
            supervisor = Supervisor(cell, node, tell=lambda text: None)
            cell.activate(node)
            client = AxisClient("/axis", node, wait=60.0)
            pids = {name: process.pid for name, process in cell.processes.items()}
            facts |= self._inject(cell, supervisor, client, node, pids)
        finally:
            began = time.monotonic()
            for pid in pids.values():
                _signal(pid, signal.SIGCONT)
            cell.stop(1.6)
            facts["stop_s"] = time.monotonic() - began
            node.destroy_node()
        facts["orphans"] = sum(_alive(pid) for pid in pids.values())
        facts["bag"] = self._bag()
        return facts

    def _inject(self, cell, supervisor, client, node, pids):
        view = OutputView(pids["axis_driver"])
        sent = client._action.send_goal_async(MoveTo.Goal(target=2e-2, max_velocity=1e-3, timeout=60.0))
        end = time.monotonic() + 20.0
        while not (sent.done() and abs(view.volts) > 0.01) and time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.01)
        if not sent.done():
            raise NoAnswer("the goal was not answered")
        result = sent.result().get_result_async()
        began = time.monotonic()
        _signal(pids[self.name], SIGNALS[self.what])
        stopped = self.name in NEEDED
        worst_gap, last, zero, answered, ended = 0.0, time.monotonic(), None, None, ""
        while time.monotonic() < began + (ANSWER_S if stopped else 3.0):
            now = time.monotonic()
            worst_gap, last = max(worst_gap, now - last), now
            rclpy.spin_once(node, timeout_sec=0.001)
            zero = zero if zero is not None or view.volts != 0.0 else now - began
            answered = answered if answered is not None or not result.done() else time.monotonic() - began
            if not ended:
                try:
                    supervisor.look()
                except CellFailure as failure:
                    ended = str(failure)
            if stopped and zero is not None and answered is not None:
                break
        facts = {"host_gap_s": worst_gap, "answered_s": answered, "says": ended}
        if stopped and self.mode != "lockstep":
            facts["zero_after_s"] = view.zero_after(1.0)
            facts["detected"] = facts["zero_after_s"] is not None and answered is not None
        elif stopped:  # simulated time stands still: no period is driven without its command
            facts["detected"] = answered is not None
        else:
            facts["detected"] = self.what == "stop" or cell.processes[self.name].returncode is None
        return facts

    def _bag(self):
        """Readable as it is, after recovery, or not at all; how many messages are missing at its end is not judged here."""
        from microstage_ros.quantities.errors import InputError
        from microstage_ros.records.bags.recovery import recover

        states = []
        for folder in sorted(self.folder.glob("bag*")):
            try:
                done = recover(folder)
                states.append("whole" if all(one.whole for one in done) else "recovered")
            except InputError as error:
                states.append(f"unreadable: {error}")
        return states or ["none"]


def campaign(trials, seed, tell=lambda facts: None):
    """Random kills and stops over all processes and modes.

    Parameters
    ----------
    trials : how many. seed : of the choice. tell : called with the facts of each trial.

    Returns
    -------
    list of dict
        Facts of every trial.
    """
    chance, done = random.Random(seed), []
    plan = [(mode, name, what) for mode in PERIODS for name in NODES for what in SIGNALS]
    while len(plan) < trials:
        plan += plan
    chance.shuffle(plan)
    for mode, name, what in plan[:trials]:
        folder = tempfile.mkdtemp(prefix="microstage_faults_")
        try:
            facts = Trial(mode, name, what, folder).run()
        except (CellFailure, NoAnswer, LookupError) as error:
            facts = {"mode": mode, "process": name, "fault": what, "not_run": " ".join(str(error).split())[:200]}
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        done.append(facts)
        tell(facts)
    return done


def judged(done):
    """Figures of a campaign and what falls short of them.

    Parameters
    ----------
    done : facts of `campaign`.

    Returns
    -------
    figures : dict
    short : list of str, empty if nothing falls short.
    """
    run = [facts for facts in done if "not_run" not in facts]
    times = sorted(facts["zero_after_s"] for facts in run if facts.get("zero_after_s") is not None)
    needed = [facts for facts in run if facts["process"] in NEEDED]
    late = [facts for facts in run if (facts.get("zero_after_s") or 0.0) > BOUND_S]
    by_host = [facts for facts in late if facts["host_gap_s"] > (facts["zero_after_s"] or 0.0) - BOUND_S]
    figures = {
        "injected": len(run), "not_run": len(done) - len(run), "detected": sum(facts["detected"] for facts in run),
        "time_to_zero_median_s": times[len(times) // 2] if times else None, "time_to_zero_worst_s": times[-1] if times else None,
        "later_than_bound": len(late), "of_these_while_the_host_stopped_us": len(by_host),
        "answered_within_1s": sum(facts["answered_s"] is not None and facts["answered_s"] <= ANSWER_S for facts in needed),
        "to_be_answered": len(needed), "orphans": sum(facts["orphans"] for facts in run),
        "stop_worst_s": max((facts["stop_s"] for facts in run), default=None),
        "bags_unreadable": sum(state.startswith("unreadable") for facts in run for state in facts["bag"])}
    short = []
    if figures["detected"] < figures["injected"]:
        short.append(f"{figures['injected'] - figures['detected']} of {figures['injected']} not detected")
    if len(late) > len(by_host):
        short.append(f"{len(late) - len(by_host)} later than {BOUND_S * 1e3:g} ms at zero volts")
    if figures["answered_within_1s"] < figures["to_be_answered"]:
        short.append(f"{figures['to_be_answered'] - figures['answered_within_1s']} actions not answered within {ANSWER_S:g} s")
    for name in ("orphans", "bags_unreadable", "not_run"):
        if figures[name]:
            short.append(f"{figures[name]} {name}")
    return figures, short


def _signal(pid, number):
    try:
        os.kill(pid, number)
    except (OSError, TypeError):
        pass


def _alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rsplit(")", 1)[1].split()[0] not in "ZX"
    except OSError:
        return False
