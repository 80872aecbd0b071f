"""Nodes forked from one process: processes of their own, with their signals, exit statuses and logs."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from ros_support import own_domain

from microstage_ros.ros.launching import fork_server, forked
from microstage_ros.ros.launching.cell_processes import CellFailure, CellProcesses
from microstage_ros.ros.launching.fork_server import _Tracing, why_not_forked
from microstage_ros.ros.transport.abandoned_locks import OPENED, PLACE, READER

NODES = ("str_controller", "gms_observer")


@pytest.fixture
def domain():
    with own_domain() as number:
        yield number


def wait_for(condition, seconds=120.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def loops(pid):
    """True once the node is made: its servo path hears. A node that is asked to stop while it is made on a busy computer
    may be there longer than it is waited for, and ends with 1."""
    for path in Path(f"/proc/{pid}/task").glob("*/comm"):
        with contextlib.suppress(OSError):      # a thread that has ended
            if path.read_text().startswith("dds.dsha"):
                return True
    return False


def complaints(log):
    """Lines of the server's log, without that it opened a lock: it may be that of a process that another test killed."""
    return [line for line in log.read_text().splitlines() if not line.startswith(OPENED.partition("{")[0])]


def test_each_node_is_a_process_of_its_own(domain, tmp_path):
    with CellProcesses("/axis", NODES, logs=tmp_path) as cell:
        processes = dict(cell.processes)
        pids = [process.pid for process in processes.values()]
        wait_for(lambda: all(map(loops, pids)))
        assert len(set(pids)) == 2 and all(os.getsid(pid) == pid for pid in pids)
        assert [Path(f"/proc/{pid}/comm").read_text().strip() for pid in pids] == list(NODES)
        cell.check()
        assert all(process.poll() is None for process in processes.values())
        with pytest.raises(subprocess.TimeoutExpired):
            processes["str_controller"].wait(0.05)
        assert cell.stop_one("str_controller") == 0
        processes["gms_observer"].kill()
        assert processes["gms_observer"].wait(120.0) == -signal.SIGKILL
        with pytest.raises(CellFailure, match="gms_observer ended with status -9"):
            cell.check()
    assert (tmp_path / "gms_observer.log").exists() and not complaints(tmp_path / "fork_server.log")


def test_the_server_looks_at_the_locks_of_its_nodes(domain, tmp_path):
    """A thread of driver or controller that looks may wait for the interpreter's lock; the server has no writer to wait for.

    Seen by what it has mapped: a lock that is shut here may be opened by the driver of any other cell."""
    def readers(pid):
        name = f"{READER}*.{pid & 255:02x}.{pid >> 8 & 255:02x}.*.4"  # a GUID has the process's number in it
        return {path.name for path in PLACE.glob(name)}

    with CellProcesses("/axis", ("gms_observer",), logs=tmp_path) as cell:
        process, maps = cell.processes["gms_observer"], Path(f"/proc/{cell.server_pid}/maps")
        wait_for(lambda: process.poll() is None and process.reported_pid and readers(process.reported_pid))
        wait_for(lambda: all(name in maps.read_text() for name in readers(process.reported_pid)), 20.0)
    assert not complaints(tmp_path / "fork_server.log")


def test_signals_that_come_together_before_a_node_is_there_all_reach_it(domain, tmp_path):
    """A cell that was stopped while its loop was being compiled waited for ever: of several lines in the socket, the
    server read one."""
    with CellProcesses("/axis", ("interferometer_logger",), logs=tmp_path) as cell:
        process = cell.processes["interferometer_logger"]
        assert process.reported_pid is None
        for number in (signal.SIGCONT, signal.SIGCONT, signal.SIGKILL):
            process.send_signal(number)
        assert process.wait(120.0) == -signal.SIGKILL


def test_bad_parameter_is_status_2_and_one_line(domain, tmp_path):
    log = tmp_path / "str_controller.log"
    log.write_text("of an earlier cell\n")
    with CellProcesses("/axis", NODES, {"str_controller": {"controller": "magic"}}, tmp_path) as cell:
        assert cell.processes["str_controller"].wait(240.0) == 2
        with pytest.raises(CellFailure, match="status 2: str_controller: .*magic"):
            cell.check()
        assert cell.processes["gms_observer"].poll() is None
        said = log.read_text()
        cell.restart("str_controller")
        assert cell.processes["str_controller"].wait(240.0) == 2
    assert log.read_text() == 2 * said and "earlier" not in said  # what one said stays when it is started again


FAILS = """
import sys, threading, time
from types import SimpleNamespace
from rclpy.node import Node
from microstage_ros.ros.launching.process import run_node

class Fails(Node):
    parameters = SimpleNamespace(cpus="")
    closed = False

    def loop(self):
        print("loop", flush=True)
        if len(sys.argv) > 1:
            raise OSError("the reason")

    def close(self):
        print("closed", flush=True)

run_node(lambda: Fails("fails"), [])
"""


@pytest.mark.parametrize("arguments, status", [((), 0), (("now",), 1)])
def test_a_loop_that_fails_is_status_1_and_its_reason_the_last_line(domain, arguments, status):
    done = subprocess.run([sys.executable, "-c", FAILS, *arguments], capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == status and done.stdout.split() == ["loop", "closed"], done.stderr
    assert not status or done.stderr.strip().splitlines()[-1] == "OSError: the reason"


def test_nodes_do_not_outlive_who_started_them(domain, tmp_path):
    with CellProcesses("/axis", NODES, logs=tmp_path) as cell:
        pids = [process.pid for process in cell.processes.values()]
        wait_for(lambda: all(map(loops, pids)))
        os.kill(cell._forked._server.pid, signal.SIGKILL)
        wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in pids))
        with pytest.raises(CellFailure, match="status"):
            cell.check()


def test_a_thread_forbids_forking():
    tracing, stop = _Tracing(), threading.Event()
    tracing.threads = len(os.listdir("/proc/self/task")) - 1
    assert why_not_forked(tracing) == ""
    thread = threading.Thread(target=stop.wait)
    thread.start()
    try:
        assert "threads" in why_not_forked(tracing)
    finally:
        stop.set()
        thread.join()


def test_without_forking_nodes_start_one_by_one(domain, tmp_path, monkeypatch):
    (tmp_path / "sitecustomize.py").write_text(
        "import sys, threading, time\n"
        "if 'fork_server' in ' '.join(sys.orig_argv): threading.Thread(target=time.sleep, args=(1e6,), daemon=True).start()\n")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    with CellProcesses("/axis", NODES, logs=tmp_path / "logs") as cell:
        pids = [process.pid for process in cell.processes.values()]
        wait_for(lambda: all(map(loops, pids)))
        assert cell.stop_one("gms_observer") == 0 and cell.stop_one("str_controller") == 0
    assert "one by one, slower: a library has started threads" in (tmp_path / "logs" / "fork_server.log").read_text()


def state_of(pid):
    """The letter of a process's state."""
    return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]


def test_close_ends_within_its_grace_when_the_server_hangs(domain, tmp_path, monkeypatch):
    """A server that is stopped answers nothing; closing neither waits for it for ever nor leaves its children behind."""
    monkeypatch.setattr(forked, "GRACE", 0.5)
    nodes = forked.ForkedNodes([{"name": name, "arguments": ["--ros-args", "-r", "__ns:=/axis"], "log": str(tmp_path / name)}
                                for name in NODES], str(tmp_path / "server"))
    pids = [process.pid for process in nodes.processes.values()]
    wait_for(lambda: all(map(loops, pids)))
    os.kill(nodes._server.pid, signal.SIGSTOP)
    wait_for(lambda: state_of(nodes._server.pid) == "T")
    nodes.go_on()
    wait_for(lambda: state_of(nodes._server.pid) != "T")
    os.kill(nodes._server.pid, signal.SIGSTOP)
    began = time.monotonic()
    nodes.close()
    assert time.monotonic() - began < 60.0     # for ever, before
    wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in pids))


def test_a_child_that_ignores_the_stop_is_killed(monkeypatch):
    """The server's own part, without nodes: SIGINT first, SIGKILL when the grace is over."""
    monkeypatch.setattr(fork_server, "GRACE", 0.3)
    another = subprocess.Popen(["true"])      # no child of the server's: a test before may leave one
    deaf = subprocess.Popen([sys.executable, "-c", "import signal, time; signal.signal(2, signal.SIG_IGN); print('deaf', flush=True)\n"
                             "while True: time.sleep(1)"], stdout=subprocess.PIPE)
    assert deaf.stdout.readline()
    ours, its = socket.socketpair()
    wakened = socket.socketpair()
    server = fork_server.ForkServer(its)
    server._names = {deaf.pid: "deaf"}
    statuses = []
    monkeypatch.setattr(server, "_send", lambda **values: statuses.append(values))
    ours.close()
    previous = signal.signal(signal.SIGCHLD, lambda *_: wakened[1].send(b"x"))
    try:
        server._go_on(wakened, lambda node: None)
    finally:
        signal.signal(signal.SIGCHLD, previous)
        deaf.returncode = another.returncode = 0
        deaf.stdout.close()
        for end in (its, *wakened):
            end.close()
    assert statuses == [{"name": "deaf", "status": -signal.SIGKILL}]
