"""The nodes' processes as who starts them sees them; `fork_server` starts them."""

import json
import os
import secrets
import socket
import subprocess
import sys
import time
from pathlib import Path

GRACE = 30.0
"""Longest time [s] that the server is given to end itself and its children; it kills what still runs after
`fork_server.GRACE`, which is shorter."""
ENVIRONMENT = {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


PROFILES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")
SHARED = "<kind>AUTOMATIC</kind>"


def own_memory(folder):
    """Environment in which nodes share memory with each other alone.

    Messages of a process outside go through the ordinary transports: one that writes into shared memory faster than it is
    read can make a reader of it deaf to everybody.
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
    path.write_text(text.replace(SHARED, f"{SHARED}<domain_ids><domainId>{number}</domainId></domain_ids>"), encoding="utf-8")
    return dict.fromkeys(PROFILES, str(path))


class ForkedNodes:
    """The fork server and its children.

    Parameters
    ----------
    nodes : dicts ``name``, ``arguments`` (command line), ``log`` (file for what it prints, None: our own output).
    log : file for what the server itself prints. folder : for a profile of their own, None: the one of this environment.

    Attributes
    ----------
    processes : name to `NodeProcess`.
    """

    def __init__(self, nodes, log=None, folder=None):
        self._link, other = socket.socketpair()
        output = open(log, "wb") if log else None
        self._server = subprocess.Popen(
            [sys.executable, "-m", "microstage_ros.ros.launching.fork_server", str(other.fileno())], pass_fds=[other.fileno()],
            stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True, env={**os.environ, **ENVIRONMENT, **own_memory(folder)})
        other.close()
        if output:
            output.close()
        self._text = b""
        self.processes = {node["name"]: NodeProcess(self) for node in nodes}
        self._link.sendall(json.dumps(nodes).encode() + b"\n")

    def listen(self, timeout):
        """Enter what the server tells, waiting at most ``timeout`` [s] for it."""
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
            process.told_pid = line.get("pid", process.told_pid)
            process.returncode = line.get("status", process.returncode)
            process.stopped = line.get("stopped", process.stopped) and process.returncode is None

    def _ended(self):
        """The server is gone, and with it its children."""
        status = self._server.wait()
        for process in self.processes.values():
            if process.returncode is None:
                process.returncode = status or 1

    def send(self, process, number):
        """A signal to a child."""
        name = next(name for name, its in self.processes.items() if its is process)
        try:
            self._link.sendall(json.dumps({"name": name, "signal": int(number)}).encode() + b"\n")
        except OSError:
            self._ended()

    def start_again(self, node):
        """Start a node that has ended; its new `NodeProcess`."""
        process = self.processes[node["name"]] = NodeProcess(self)
        try:
            self._link.sendall(json.dumps({"start": node}).encode() + b"\n")
        except OSError:
            self._ended()
        return process

    def close(self):
        """Let the server go; whatever still runs, it stops, within `GRACE`."""
        self._link.close()
        try:
            self._server.wait(GRACE)
        except subprocess.TimeoutExpired:
            self._server.kill()  # its children get SIGTERM from the system when it dies
            self._server.wait()


class NodeProcess:
    """One node's process, in the words of `subprocess.Popen`; ``stopped``: by a signal, it is there and does nothing."""

    def __init__(self, owner):
        self._owner, self.told_pid, self.returncode, self.stopped = owner, None, None, False

    @property
    def pid(self):
        """Its number; waits until it is there, None if it never came."""
        while self.told_pid is None and self.returncode is None:
            self._owner.listen(0.5)
        return self.told_pid

    def poll(self):
        """Exit status, None while it runs."""
        if self.returncode is None:
            self._owner.listen(0.0)
        return self.returncode

    def wait(self, timeout=None):
        """Exit status, once it has ended. Raises `subprocess.TimeoutExpired`."""
        end = None if timeout is None else time.monotonic() + timeout
        while self.returncode is None:
            self._owner.listen(0.5 if end is None else max(end - time.monotonic(), 0.0))
            if self.returncode is None and end is not None and time.monotonic() >= end:
                raise subprocess.TimeoutExpired("node", timeout)
        return self.returncode

    def send_signal(self, number):
        """Send a signal."""
        self._owner.send(self, number)

    def kill(self):
        """End it at once."""
        import signal

        self.send_signal(signal.SIGKILL)
