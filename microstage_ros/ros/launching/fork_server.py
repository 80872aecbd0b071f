"""One process that imports what the nodes of an axis need once, and forks each of them: started in half the time.

Started by `forked.ForkedNodes`, with the descriptor of a socket as argument, over which lines of JSON go. To here: the
list of nodes, ``{"name", "arguments", "log"}``, then ``{"name", "signal"}`` and ``{"start": node}``. Back:
``{"name", "pid"}``, ``{"name", "status"}``, ``{"name", "stopped"}``. When the other end closes, or on SIGINT and
SIGTERM, it stops all nodes. Each node is a process of its own as if it had been started alone; only its command line
reads as that of this process.

Forked is before any thread of ours or of the middleware exists, and before `rclpy.init`. Where that cannot be (a
library that starts a thread when it is loaded, a system without fork), it says so and starts each node alone, slower.

It opens locks in shared memory that a killed or stopped node holds, as driver and controller do for themselves: their
threads may wait for the interpreter's lock, which a writer that waits for such a lock has. Here is no writer.
"""

import ctypes
import gc
import importlib
import json
import os
import re
import selectors
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from microstage_ros.numerics.compiled import cache_folder
from microstage_ros.ros.launching.interruption import STOPPING
from microstage_ros.ros.transport.abandoned_locks import OPENED, AbandonedLocks
from microstage_ros.ros.transport.checked import load_taking

PACKAGE = "microstage_ros.ros.nodes"
PR_SET_PDEATHSIG, PR_SET_NAME = 1, 15
GRACE = 20.0
"""Time [s] that children have to end after SIGINT before they are killed; a bag of hours closes in some seconds."""


class ForkServer:
    """The children and the socket.

    Parameters
    ----------
    link : socket to who started this process.
    """

    def __init__(self, link):
        self._link, self._text, self._closed = link, b"", False
        self._names = {}

    def serve(self):
        """Start the nodes and tell of them until all have ended. In a forked child: the call that makes it the node."""
        nodes = self._receive()
        modules = {node["name"]: importlib.import_module(f"{PACKAGE}.{node['name']}") for node in nodes}
        tracing = _Tracing()
        why = why_not_forked(tracing)
        if why:
            print(f"nodes are started one by one, slower: {why}", file=sys.stderr, flush=True)
        else:
            _load_message_types()
            load_taking()
        wakened = self._watch_children()
        nodes.sort(key=lambda node: hasattr(modules[node["name"]], "warm_up"))  # what is ready goes to work meanwhile
        warming = [modules[node["name"]].warm_up for node in nodes if hasattr(modules[node["name"]], "warm_up")]
        beside = None if why else _compile_beside(warming[1:])
        for node in nodes:
            if not why:
                warm_up = getattr(modules[node["name"]], "warm_up", lambda: None)
                if beside and warm_up in warming[1:]:
                    beside = os.waitpid(beside, 0) and None
                warm_up()
                # so that a collection in a child does not write to, and copy, what it shares with the others
                gc.freeze()
            child = self._start(node, modules, why, tracing, wakened)
            if child:
                return child
        return self._go_on(wakened, lambda node: self._start(node, modules, why, tracing, wakened)) or (lambda: 0)

    def _start(self, node, modules, why, tracing, wakened):
        """Start one node. In a forked child: the call that makes it the node; else None."""
        pid = _start_alone(node) if why else tracing.fork()
        if pid == 0:
            signal.set_wakeup_fd(-1)
            for end in (self._link, *wakened):
                end.close()
            return lambda: _become(node, modules[node["name"]])
        self._names[pid] = node["name"]
        self._send(name=node["name"], pid=pid)
        return None

    def _watch_children(self):
        """Sockets of which the first is readable after every signal."""
        ends = socket.socketpair()
        for end in ends:
            end.setblocking(False)
        signal.set_wakeup_fd(ends[1].fileno(), warn_on_full_buffer=False)
        for number in (signal.SIGCHLD, *STOPPING):
            signal.signal(number, self._on_signal)
        return ends

    def _on_signal(self, number, frame):
        self._closed = self._closed or number in STOPPING

    def _go_on(self, wakened, start):
        """Until every child has ended and nobody can ask for another: pass on signals, tell who ended. In a child that
        is forked meanwhile: what `_start` gives."""
        wakened = wakened[0]
        with selectors.DefaultSelector() as selector:
            selector.register(self._link, selectors.EVENT_READ)
            selector.register(wakened, selectors.EVENT_READ)
            killed_at, locks, look_at = None, AbandonedLocks(), 0.0
            while self._reap() or not self._closed:
                if time.monotonic() >= look_at:
                    if opened := locks.look():
                        print(OPENED.format(opened), file=sys.stderr, flush=True)
                    look_at = time.monotonic() + locks.pause
                if self._closed and killed_at is None:
                    killed_at = time.monotonic() + GRACE
                    self._signal_all(signal.SIGINT)
                    self._signal_all(signal.SIGCONT)
                if killed_at is not None and killed_at <= time.monotonic():
                    self._signal_all(signal.SIGKILL)
                # what has come already does not make the socket readable again
                ready = [] if b"\n" in self._text else selector.select(max(look_at - time.monotonic(), 0.0))
                if any(key.fileobj is wakened for key, _ in ready):
                    wakened.recv(4096)
                if b"\n" in self._text or any(key.fileobj is self._link for key, _ in ready):
                    asked = self._receive()
                    if asked is None:
                        selector.unregister(self._link)
                    elif "start" in asked:
                        child = start(asked["start"])
                        if child:
                            return child
                    else:
                        self._signal_all(asked["signal"], asked["name"])
        return None

    def _reap(self):
        """Tell of children that have ended; True while there are others."""
        while self._names:
            pid, status = os.waitpid(-1, os.WNOHANG | os.WUNTRACED | os.WCONTINUED)
            if pid == 0:
                return True
            if pid not in self._names:      # a child that this process had before it became a server
                continue
            if os.WIFSTOPPED(status) or os.WIFCONTINUED(status):
                self._send(name=self._names[pid], stopped=os.WIFSTOPPED(status))
                continue
            self._send(name=self._names.pop(pid), status=os.waitstatus_to_exitcode(status))
        return False

    def _signal_all(self, number, name=None):
        """To the child of that name, None for all. Nobody else can have its number, since only we wait for it."""
        for pid, its_name in self._names.items():
            if name in (None, its_name):
                os.kill(pid, number)

    def _receive(self):
        """The next line; None when the other end has closed."""
        while b"\n" not in self._text:
            more = self._link.recv(65536)
            if not more:
                self._closed = True
                return None
            self._text += more
        line, _, self._text = self._text.partition(b"\n")
        return json.loads(line)

    def _send(self, **values):
        try:
            self._link.sendall(json.dumps(values).encode() + b"\n")
        except OSError:  # nobody there to tell
            self._closed = True


class _Tracing:
    """ROS's tracing library, where it is loaded: it has threads of its own, and calls for who forks.

    Attributes
    ----------
    threads : that it may have.
    """

    def __init__(self):
        maps = Path("/proc/self/maps")
        lines = maps.read_text(encoding="utf-8").splitlines() if maps.exists() else []
        found = next((line.split()[-1] for line in lines if re.search(r"/liblttng-ust(-[0-9a-f]+)?\.so", line)), None)
        self._library = ctypes.CDLL(found) if found else None
        names = [name for name in ("lttng_ust_before_fork", "ust_before_fork") if hasattr(self._library, name)]
        self._prefix = names[0].removesuffix("before_fork") if names else None
        self.threads = 2 if self._prefix else 0

    def fork(self):
        """`os.fork`, after which the child traces as its parent does."""
        if self._prefix is None:
            return os.fork()
        signals = ctypes.create_string_buffer(128)
        getattr(self._library, self._prefix + "before_fork")(signals)
        pid = os.fork()
        getattr(self._library, self._prefix + ("after_fork_parent" if pid else "after_fork_child"))(signals)
        return pid


def why_not_forked(tracing):
    """Why forking would not be safe here, in words; empty if it is."""
    if not hasattr(os, "fork") or not Path("/proc/self/task").is_dir():
        return f"no fork on {sys.platform}"
    others = len(os.listdir("/proc/self/task")) - 1
    return f"a library has started threads ({others})" if others > tracing.threads else ""


def _load_message_types():
    """Load what every child would load for the types of messages that it knows."""
    kinds = {
        value
        for module in list(sys.modules.values())
        if getattr(module, "__name__", "").startswith((PACKAGE, "rclpy."))
        for value in list(vars(module).values())
        if hasattr(type(value), "__import_type_support__")
    }
    for kind in kinds:
        type(kind).__import_type_support__()


def _compile_beside(warming):
    """Where nothing is compiled yet: a child that compiles for ``warming`` into the cache while this process compiles
    for the first node. Its number; None where there is nothing to do."""
    if not warming or os.path.isdir(cache_folder("ros")):
        return None
    child = os.fork()
    if child:
        return child
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    try:
        for warm_up in warming:
            warm_up()
    finally:
        os._exit(0)


def _become(node, module):
    """In the child: what a process of its own would have and do. Returns the exit status."""
    for number in (signal.SIGCHLD, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.setsid()
    prctl = ctypes.CDLL(None).prctl
    prctl(PR_SET_NAME, node["name"].encode(), 0, 0, 0)
    prctl(PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if node["log"]:
        log = os.open(node["log"], os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)  # after what the one before said
        for descriptor in (1, 2):
            os.dup2(log, descriptor)
        os.close(log)
    sys.argv = [module.__file__, *node["arguments"]]
    gc.enable()
    return module.main()


def _start_alone(node):
    """A process of its own from the start. Returns its number."""
    log = open(node["log"], "ab") if node["log"] else None
    process = subprocess.Popen(
        [sys.executable, "-m", f"{PACKAGE}.{node['name']}", *node["arguments"]],
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=log,
        start_new_session=True,
    )
    process.returncode = 0  # we wait for all children alike
    return process.pid


if __name__ == "__main__":
    gc.disable()  # nothing of what imports leave behind is garbage
    sys.exit(ForkServer(socket.socket(fileno=int(sys.argv[1]))).serve()())
