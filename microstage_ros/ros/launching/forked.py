"""The nodes' processes as who starts them sees them; `fork_server` starts them."""

import json
import os
import secrets
import select
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

GRACE = 30.0
"""Longest time [s] that the server is given to end itself and its children; it kills what still runs after
`fork_server.GRACE`, which is shorter."""
SERVER_TELLS_S = 0.2
"""So long [s] the server takes at most to tell that a process has ended, unless it is stopped itself."""

UNKNOWN = 1
"""Taken for the exit status that it never reported."""

ENVIRONMENT = {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


PROFILES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")
SHARED = "<kind>AUTOMATIC</kind>"


def own_memory(folder):
    """Environment in which nodes share memory with each other alone.

    Messages of a process outside go through the ordinary transports: one that writes into shared memory faster than it
    is read can make a reader of it deaf to everybody.
    """
    given = next((os.environ[name] for name in PROFILES if os.environ.get(name)), None)
    if folder is None or given is None:
        return {}
    try:
        text = Path(given).read_text(encoding="utf-8")
    except OSError:
        return {}
    number = secrets.randbelow(65_000) + 1
    path = Path(folder) / "fastdds.xml"
    path.write_text(
        text.replace(SHARED, f"{SHARED}<domain_ids><domainId>{number}</domainId></domain_ids>"), encoding="utf-8"
    )
    return dict.fromkeys(PROFILES, str(path))


class ForkedNodes:
    """The fork server and its children.

    Parameters
    ----------
    nodes : dicts ``name``, ``arguments`` (command line), ``log`` (file for what it prints, None: our own output).
    log : file for what the server itself prints. folder : for a profile of their own, None: the one of this
        environment.

    Attributes
    ----------
    processes : name to `NodeProcess`. server_status : exit status of the server, None while it runs.
    """

    def __init__(self, nodes, log=None, folder=None):
        self._link, other = socket.socketpair()
        output = open(log, "wb") if log else None
        self._server = subprocess.Popen(
            [sys.executable, "-m", "microstage_ros.ros.launching.fork_server", str(other.fileno())],
            pass_fds=[other.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            start_new_session=True,
            # each node has the enclave of its name, which rcl gives up for an override that is meant for a command
            env={**os.environ, **ENVIRONMENT, **own_memory(folder), "ROS_SECURITY_ENCLAVE_OVERRIDE": ""},
        )
        other.close()
        if output:
            output.close()
        self._text, self.server_status = b"", None
        self.processes = {node["name"]: NodeProcess(self) for node in nodes}
        self._link.sendall(json.dumps(nodes).encode() + b"\n")

    @property
    def server_pid(self):
        """Number of the server's process."""
        return self._server.pid

    def listen(self, timeout):
        """Enter what the server tells, waiting at most ``timeout`` [s] for it."""
        if self.server_status is not None:
            time.sleep(min(timeout, 0.01))
            return
        self._link.settimeout(max(timeout, 1e-3))
        try:
            more = self._link.recv(65536)
        except (TimeoutError, BlockingIOError):
            return
        except OSError:
            more = b""
        if not more:
            self._ended()
            return
        *lines, self._text = (self._text + more).split(b"\n")
        for line in map(json.loads, lines):
            process = self.processes[line.pop("name")]
            process.began(line.get("pid", process.reported_pid))
            process.returncode = line.get("status", process.returncode)
            process.stopped = line.get("stopped", process.stopped) and process.returncode is None

    def _ended(self):
        """The server is gone, and its children have been asked to end by the system."""
        self.server_status = self._server.wait()
        for process in self.processes.values():
            if process.returncode is None and not process.can_be_watched:
                process.returncode = self.server_status or UNKNOWN

    def send(self, process, number):
        """The signal ``number`` [1] to a child: directly, since the server may be stopped, or through it while the
        child's number is not known."""
        if process.signal_directly(number):
            return
        name = next(name for name, its in self.processes.items() if its is process)
        try:
            self._link.sendall(json.dumps({"name": name, "signal": int(number)}).encode() + b"\n")
        except OSError:
            self._ended()

    def start_again(self, node):
        """Start a node that has ended; its new `NodeProcess`."""
        self.processes[node["name"]].forget()
        process = self.processes[node["name"]] = NodeProcess(self)
        try:
            self._link.sendall(json.dumps({"start": node}).encode() + b"\n")
        except OSError:
            self._ended()
        return process

    def go_on(self):
        """Let a server that was stopped by a signal go on: without it the end of every process is reported late."""
        if self.server_status is None:
            self._server.send_signal(signal.SIGCONT)

    def close(self):
        """Let the server go; whatever still runs, it stops, within `GRACE`."""
        try:
            if all(process.has_ended for process in self.processes.values()):
                self._server.kill()  # it has nothing left to do, and to unload its libraries takes half a second
            self._server.send_signal(signal.SIGCONT)  # it may have been stopped by a signal
            self._link.close()
            self._server.wait(GRACE)
        except subprocess.TimeoutExpired:
            self._server.kill()  # its children get SIGTERM from the system when it dies
            self._server.wait()
        for process in self.processes.values():
            process.forget()


class NodeProcess:
    """One node's process, in the words of `subprocess.Popen`; ``stopped``: by a signal, it is there and does
    nothing."""

    def __init__(self, owner):
        self._owner, self.reported_pid, self.returncode, self.stopped = owner, None, None, False
        self._handle = None

    def began(self, pid):
        """It has this number now, ``pid`` [1]; None: not known."""
        if pid is not None and pid != self.reported_pid:
            self.reported_pid = pid
            try:
                self._handle = os.pidfd_open(pid)  # means this process for ever, also when the number is given anew
            except (OSError, AttributeError):
                self._handle = None

    def signal_directly(self, number):
        """Send the signal ``number`` [1] without the server; False if that is not possible here."""
        if self._handle is None:
            return False
        try:
            signal.pidfd_send_signal(self._handle, number)
        except ProcessLookupError:
            pass  # it has ended, and its status is on the way
        return True

    @property
    def can_be_watched(self):
        """True if its end is seen without the server."""
        return self._handle is not None

    @property
    def has_ended(self):
        """True once it is gone, whether or not the server has reported its status."""
        return self.returncode is not None or (
            self._handle is not None and bool(select.select([self._handle], [], [], 0.0)[0])
        )

    def forget(self):
        """Let go of it."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    @property
    def pid(self):
        """Its number; waits until it is there, None if it never came."""
        while self.reported_pid is None and self.returncode is None:
            self._owner.listen(0.5)
        return self.reported_pid

    def poll(self):
        """Exit status, None while it runs."""
        if self.returncode is None:
            self._owner.listen(0.0)
            if self.returncode is None and self.has_ended:
                self._owner.listen(SERVER_TELLS_S)
                self.returncode = UNKNOWN if self.returncode is None else self.returncode
        return self.returncode

    def wait(self, timeout=None):
        """Exit status [1], once it has ended. Raises `subprocess.TimeoutExpired` after ``timeout`` [s]; None: never."""
        end = None if timeout is None else time.monotonic() + timeout
        while self.returncode is None:
            self._owner.listen(0.5 if end is None else max(min(end - time.monotonic(), SERVER_TELLS_S), 0.0))
            if self.returncode is None and self.has_ended:
                self._owner.listen(SERVER_TELLS_S)
                self.returncode = UNKNOWN if self.returncode is None else self.returncode
            if self.returncode is None and end is not None and time.monotonic() >= end:
                raise subprocess.TimeoutExpired("node", timeout)
        return self.returncode

    def send_signal(self, number):
        """Send the signal ``number`` [1]."""
        self._owner.send(self, number)

    def kill(self):
        """End it at once."""
        self.send_signal(signal.SIGKILL)
