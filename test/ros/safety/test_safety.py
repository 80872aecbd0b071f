"""Processes killed and stopped under a real cell: the voltage goes to zero, says why, and nothing is left behind."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from microstage_msgs.action import MoveTo
from microstage_msgs.msg import AxisState
from ros_support import PATIENCE_S, own_domain, ros_node, shut_by_another_process, spin_until
from running_cell import TRIP_S, running_cell
from sensor_msgs.msg import JointState

from microstage_ros.records.bags.bag import read_bag
from microstage_ros.ros.benchmarks.output_view import OutputView
from microstage_ros.ros.client import AxisClient
from microstage_ros.ros.launching.cell_processes import NODES, CellFailure
from microstage_ros.ros.launching.ownership import folder
from microstage_ros.ros.launching.shared_memory import ENDING
from microstage_ros.ros.operator import Operator
from microstage_ros.ros.transport.abandoned_locks import PLACE, READER, Segment

MOST_S = 1.0
"""Here other tests have the processors too, and real-time priorities may not be permitted: that it happens, not the figure that
`faults` measures."""

AHEAD = 100
"""Periods that the move server grants ahead, idle or not, where a test lets them pass; a driver with a fault counts 200 in a second."""


def begin_move(client, heard, target=2e-2, **options):
    """A long move that has begun; its handle and the future of its result. A fault before it begins ends the test."""
    goal = MoveTo.Goal(target=target, **{"max_velocity": 1e-3, "timeout": 60.0, **options})
    under_way = []
    sent = client._action.send_goal_async(goal, feedback_callback=under_way.append)
    spin_until(client.node, sent.done)
    result = sent.result().get_result_async()
    # accepted is not begun: on a loaded machine a fault may come between
    spin_until(client.node, lambda: under_way or result.done() or heard and heard[-1].fault)
    assert under_way, result.result().result.message if result.done() else heard[-1].message
    return sent.result(), result


def moving(view, node, heard):
    """Wait until there is voltage."""
    spin_until(node, lambda: abs(view.volts) > 0.01 or heard[-1].fault)
    assert not heard[-1].fault, heard[-1].message


def gone(pid):
    """True once a process has ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] in "ZX"
    except OSError:
        return True


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT, signal.SIGSTOP])
def test_the_voltage_goes_whatever_happens_to_the_driver(tmp_path, number):
    with running_cell(tmp_path) as (cell, node, client, heard, _):
        begin_move(client, heard)
        pid = cell.processes["axis_driver"].pid
        view = OutputView(pid)
        moving(view, node, heard)
        os.kill(pid, number)
        after = view.zero_after()
        assert after is not None and after < MOST_S
        if number == signal.SIGSTOP:
            assert view.by_watchdog
            time.sleep(1.2 * TRIP_S)
            os.kill(pid, signal.SIGCONT)
            spin_until(node, lambda: heard and heard[-1].fault == AxisState.FAULT_WATCHDOG)
            assert "watchdog took the voltage away" in heard[-1].message and view.volts == 0.0
        elif number != signal.SIGKILL:
            assert cell.processes["axis_driver"].wait(PATIENCE_S) == 0  # the loop has ended by itself


@pytest.mark.parametrize("mode", ["paced", "lockstep"])
def test_a_dead_controller_is_zero_volts_and_an_answered_move(tmp_path, mode):
    with running_cell(tmp_path, mode, supervised=True) as (cell, node, client, heard, supervisor):
        _, result = begin_move(client, heard)
        view = OutputView(cell.processes["axis_driver"].pid)
        moving(view, node, heard)
        cell.processes["str_controller"].kill()
        began = time.monotonic()
        with pytest.raises(CellFailure, match="str_controller ended by signal 9: the axis stands still"):
            while time.monotonic() < began + PATIENCE_S:
                supervisor.look()
        spin_until(node, lambda: result.done() and heard[-1].fault)
        assert heard[-1].fault in (AxisState.FAULT_PROCESS, AxisState.FAULT_COMMAND_TIMEOUT) and not heard[-1].active
        assert result.result().result.code == MoveTo.Result.CODE_FAULT and result.result().result.message
        assert view.volts == 0.0


def shut_all_locks(pid):
    """Stop a process, and have one that has ended hold both locks of each of its readers; the locks."""
    note = folder() / f"{pid}{ENDING}"
    end = time.monotonic() + PATIENCE_S
    while not (note.exists() and note.read_text().endswith("\n")):
        assert time.monotonic() < end
        time.sleep(0.05)
    os.kill(pid, signal.SIGSTOP)
    found = []
    for path in PLACE.glob(f"{READER}{note.read_text().split()[2]}_*"):
        with suppress(ValueError):  # of a writer
            found.append((path, Segment(path)))
    for which in (0, 1):
        shut_by_another_process([path for path, _ in found], which)
    assert found
    return [lock for _, lock in found]


def test_what_may_be_restarted_is_and_takes_its_place_again(tmp_path):
    with running_cell(tmp_path, "lockstep", NODES, supervised=True) as (cell, node, client, heard, supervisor):
        assert client.move(1e-5, timeout=20.0).reached
        for name in ("gms_observer", "interferometer_logger", "bag_recorder", "move_server"):
            before = cell.processes[name].pid
            locks = shut_all_locks(before)  # as in the moment in which it holds them: who writes to it waits there
            cell.processes[name].kill()
            spin_until(node, lambda locks=locks: all(lock.holders() == (None, None) for lock in locks))
            end = time.monotonic() + PATIENCE_S
            while cell.processes[name].pid in (None, before):
                supervisor.look()
                assert time.monotonic() < end, name
        again = AxisClient("/axis", node, wait=PATIENCE_S)
        assert again.move(-1e-5, timeout=20.0).reached and not heard[-1].fault
        supervisor.look()
    assert (tmp_path / "bag_2").is_dir()


@pytest.mark.parametrize("mode", ["paced"])
def test_ctrl_c_of_a_cell_leaves_nothing(tmp_path, mode):
    with ros_node() as node:
        heard = []
        node.create_subscription(JointState, "/axis/joint_states", heard.append, 10)
        cell = subprocess.Popen([sys.executable, "-m", "microstage_ros.commands", "cell", "--mode", mode,
                                 "--record", str(tmp_path / "bag")], text=True,
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)
        assert any("is active" in line for line in cell.stdout)  # the middleware prints there too
        spin_until(node, lambda: heard)  # the first period waits for all readers, on a busy machine for a while
        family = children(cell.pid)
        assert len(family) >= 7  # the fork server, five nodes, the watchdog
        began = time.monotonic()
        cell.send_signal(signal.SIGINT)
        out, err = cell.communicate(timeout=PATIENCE_S)
        took = time.monotonic() - began
        assert cell.returncode == 0 and "Traceback" not in err
        states = read_bag(tmp_path / "bag", ["/axis/state"])["/axis/state"]
        assert states["applied_voltage"][-1] == 0.0 and not states["status"][-1] & AxisState.STATUS_ACTIVE
        assert took < 30.0  # the figure is 2 s on a machine of its own; waiting for each process in turn could take 120 s
        end = time.monotonic() + PATIENCE_S
        while not all(map(gone, family)):
            assert time.monotonic() < end
            time.sleep(0.05)


def test_ctrl_c_of_the_demo_is_one_line(tmp_path):
    """Early, while its processes start, and it leaves none of them."""
    with own_domain():
        demo = subprocess.Popen([sys.executable, "-m", "microstage_ros.commands", "demo", "--quick", "--out",
                                 str(tmp_path / "out")], text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                                start_new_session=True)
        end = time.monotonic() + PATIENCE_S
        while not (family := children(demo.pid)):
            assert time.monotonic() < end and demo.poll() is None
            time.sleep(0.05)
        demo.send_signal(signal.SIGINT)
        _, err = demo.communicate(timeout=PATIENCE_S)
        assert demo.returncode == 1 and "Traceback" not in err and err.endswith("microstage demo: interrupted\n")
        while not all(map(gone, family)):
            assert time.monotonic() < end
            time.sleep(0.05)


def test_nothing_outlives_a_cell_that_is_killed(tmp_path):
    with own_domain():
        cell = subprocess.Popen([sys.executable, "-m", "microstage_ros.commands", "cell"], stdout=subprocess.PIPE, text=True,
                                stderr=subprocess.DEVNULL, start_new_session=True)
        assert any("is active" in line for line in cell.stdout)  # the middleware prints there too
        family = children(cell.pid)
        cell.kill()
        cell.communicate()
        end = time.monotonic() + PATIENCE_S
        while not all(map(gone, family)):
            assert time.monotonic() < end
            time.sleep(0.05)


def children(pid):
    """Numbers of all processes below one."""
    found, new = [], [pid]
    while new:
        parents, new = new, []
        for entry in Path("/proc").iterdir():
            if not entry.name.isdigit():
                continue
            try:
                parent = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
            except OSError:
                continue
            if parent in parents:
                new.append(int(entry.name))
        found += new
    return found


def test_the_lock_is_named_by_domain_and_namespace(monkeypatch, tmp_path):
    from microstage_ros.ros.launching.ownership import lock_file, owner

    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    path = lock_file("cell", "/left/stage")
    assert path.name == "7-left+stage.cell" and owner(path) is None
    path.write_text(json.dumps({"host": "x"}))
    assert owner(path) is None  # nobody holds it


def test_a_stranger_is_not_heard(tmp_path):
    """Malformed and foreign messages on every topic of the servo path: the axis goes on as if nobody had spoken."""
    import rclpy
    from microstage_ros.ros.benchmarks.hostile.trial import flood_a_cell

    with own_domain():
        rclpy.init()
        try:
            facts = flood_a_cell(3000, 5)
        finally:
            rclpy.try_shutdown()
    assert facts["sent"] == 3000 and not facts["fell_short"]


def test_malformed_messages_reach_every_callback_and_end_none():
    from microstage_ros.ros.benchmarks.hostile.callbacks import LONGEST_S, NODES, feed_in_a_process

    with own_domain():
        facts = feed_in_a_process(2000, 3)
    slow_machine = facts["longest_s"] > LONGEST_S  # a figure for a machine of its own
    assert facts["exceptions"] == 0 and facts["voltage"] == 0.0 and facts["left_waiting"] == 0
    assert slow_machine or not facts["fell_short"]
    assert facts["arrived"] > 1500 and set(facts["by_topic"]) == set(NODES)
    for heard in facts["by_topic"].values():
        assert all(heard["arrived"].get(topic) for topic in (*heard["arrived"], *heard["refused"]))


def test_a_lockstep_cell_goes_on_after_a_long_fault(tmp_path):
    """The driver counts periods while a fault is latched; they pass what followers had granted."""
    with running_cell(tmp_path, "lockstep", ahead=AHEAD) as (cell, node, client, heard, _), Operator("/axis", node) as axis:
        assert axis.stop()[0]
        began = axis.status().driver.sequence
        spin_until(node, lambda: axis.status().driver.sequence > began + 3 * AHEAD)
        assert axis.reset()[0]
        spin_until(node, lambda: not heard[-1].fault)
        spin_until(node, lambda: axis.home()[0])  # the move server hears of the reset when it does
        assert client.move(1e-5, timeout=20.0).reached
