"""One node in one process: services and parameters in a thread, the servo loop in the main thread."""

import contextlib
import ctypes
import gc
import os
import signal
import socket
import sys
import threading
import time
import traceback
import warnings

import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from microstage_ros.quantities.errors import InputError
from microstage_ros.ros.launching.interruption import LAST_RESORT, STOPPING
from microstage_ros.ros.launching.shared_memory import remember
from microstage_ros.ros.transport.scheduling import processors, take_place
from microstage_ros.ros.transport.servo_path import RCLError
from microstage_ros.ros.transport.topics import CREDIT

SWITCH_INTERVAL = 1e-4
"""How long the other thread may keep the interpreter [s]; Python's own 5 ms would be fifty control periods."""

URGENT = signal.SIGUSR1

ACKNOWLEDGED = {signal.SIGINT: 5.0, signal.SIGTERM: 0.5}
"""Longest wait [s] at the end until every reader has what was sent to it, by the signal that asked to stop: a reader
that was killed never has it, and who sends SIGTERM is in a hurry."""

MEETING = 1.0
"""Longest wait [s] at the begin for all threads of an executor."""

SERVED = 2.0
"""Longest wait [s] at the end for the thread that serves requests."""

LIBC = ctypes.CDLL(None)
"""Loaded once: every `ctypes.CDLL` makes a class, 3.4 kB that wait for a collection of garbage."""

M_MMAP_THRESHOLD, M_ARENA_MAX = -3, -8
LARGE = 16 * 1024
"""From so many bytes on a buffer has pages of its own. With 128 kB, where the C library begins, the memory of a process
that wrote a bag in blocks of 200 to 4000 rows went from 36 to 48 MB (medians of 400 blocks); with 16 kB from 30.3 to
32.2, for 13 % more of its time."""

_stop = threading.Event()
_asked = {"number": signal.SIGINT}
_stop_requested: list = []
_urgency_reported: list = []
_noted: list = []


def running():
    """False once the process is asked to stop (SIGINT, SIGTERM)."""
    return not _stop.is_set() and rclpy.ok()


def on_stop(call):
    """Have ``call`` called when the process is asked to stop, by a thread of its own, at once: the main thread may be
    in compiled code, where Python handles no signal."""
    _stop_requested.append(call)


def on_urgent(call):
    """Have ``call`` called at SIGUSR1, by the same thread."""
    _urgency_reported.append(call)


def _hear_signals():
    """Hear SIGINT and SIGTERM in a thread: the operating system's handler writes to a socket, whatever the main thread
    does."""
    ours, theirs = socket.socketpair()
    theirs.setblocking(False)
    signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)
    for number in STOPPING:  # background processes begin with SIGINT ignored
        signal.signal(number, lambda *_: _stop.set())
    signal.signal(URGENT, lambda *_: None)
    threading.Thread(target=_wait_for_signal, args=(ours, theirs), name="signals", daemon=True).start()


def _wait_for_signal(ours, theirs):
    while not (heard := set(ours.recv(64))) & set(STOPPING):
        if URGENT in heard:
            for call in _urgency_reported:
                try:
                    call()
                except Exception:  # noqa: BLE001 - whatever it is, the next signal has to be heard
                    traceback.print_exc()
    _asked["number"] = signal.SIGTERM if signal.SIGTERM in heard else signal.SIGINT
    _stop.set()
    for call in _stop_requested:
        call()
    time.sleep(LAST_RESORT)
    os._exit(1)


def keep_memory_steady():
    """Have the C library give large buffers back at once, and take small ones from one place for all threads.

    By itself it keeps what was freed, in a place per thread, for larger and larger buffers: a process that makes new
    ones of a megabyte all the time then goes up and down by megabytes. It makes allocation slower: not for servo loops.
    """
    LIBC.mallopt(M_MMAP_THRESHOLD, LARGE)
    LIBC.mallopt(M_ARENA_MAX, 1)


def release_memory():
    """Have the C library return pages to the system that hold nothing any more (`malloc_trim`, 0.2 ms for 40 MB).

    By itself it does so at the end of its heap alone. Where small buffers of all sizes come and go between long-lived
    ones, the holes grow in number for hours, although what is in use stays the same.
    """
    LIBC.malloc_trim(0)


def started(arguments, context=None):
    """`rclpy.init` that hears no signals. Raises `InputError` for arguments or a parameter file that are none."""
    try:
        rclpy.init(args=arguments, context=context, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # noqa: BLE001 - rclpy's own classes are private
        says = " ".join(str(error).split())
        raise InputError(
            "ROS arguments",
            says[:300] or type(error).__name__,
            "names, remappings and a parameter file that ROS 2 understands",
        ) from None


def run_node(make, arguments=None, threads=1):
    """Make a node, serve it, run its `loop` until the process is asked to stop, and end the process.

    ROS goes on working while the node closes, so that nothing that was sent is lost. Returns a status only where no
    node could be made; else the process ends here with 0, or with 1 and the traceback in its log if the loop failed.

    Parameters
    ----------
    make : called without arguments; returns the node, which has `parameters`, `loop()` (it ends when `running`
        says so) and `close()`.
    arguments : command line; default that of the process.
    threads : of the executor [1]; more than one where callbacks wait for each other.
    """
    _hear_signals()
    sys.setswitchinterval(SWITCH_INTERVAL)
    # a client that was not discovered within 0.1 s asks again (`transport.calls.RepeatedCall`): nobody has to see it
    warnings.filterwarnings("ignore", "failed to send response", RuntimeWarning)
    try:
        started(arguments)
        node = make()
        cpus = processors(node.parameters.cpus)
    except (InputError, RCLError) as error:  # the second: security asked for and not there, and the like
        print(" ".join(str(error).split()), file=sys.stderr)
        rclpy.try_shutdown()
        return 2
    except OSError as error:  # a disk that is full, a folder that cannot be written
        print(f"{error.filename or 'the node cannot begin'}: {error.strerror or error}", file=sys.stderr)
        rclpy.try_shutdown()
        return 1
    _leave_garbage_alone()
    executor = MultiThreadedExecutor(threads) if threads > 1 else SingleThreadedExecutor()
    executor.add_node(node)
    _begin_threads(executor, threads)
    thread = threading.Thread(target=_serve, args=(executor, node.get_logger()), daemon=True)
    thread.start()
    noting = threading.Thread(target=lambda: _noted.append(remember(node, running)), daemon=True)
    noting.start()
    p = node.parameters
    os.nice(getattr(p, "nice", 0))
    take_place(node.get_logger(), cpus, getattr(p, "scheduling", "normal"), getattr(p, "real_time_priority", 0))
    failed = ""
    try:
        node.loop()
    except Exception:  # noqa: BLE001 - whatever it is, the node is closed and the log says what it was
        failed = traceback.format_exc()
    try:
        _stop.set()
        node.close()  # first of all: the driver writes zero volts there
        _wait_for_readers(node)
        noting.join(timeout=SERVED)  # it asks the node, which goes now
    except Exception:  # noqa: BLE001
        failed += traceback.format_exc()
    _end_process(node, executor, thread, failed)


def _begin_threads(executor, threads):
    """Have the executor begin all its threads now: else each comes, with its memory, when so many callbacks first wait
    at the same time, which may be after hours."""
    if threads < 2:
        return
    together = threading.Barrier(threads)

    def meet():
        with contextlib.suppress(threading.BrokenBarrierError):
            together.wait(MEETING)

    for _ in range(threads):
        executor.create_task(meet)


def _end_process(node, executor, thread, failed):
    """Take the node out of the graph and end the process, without unloading the interpreter.

    A thread that comes back from the middleware while the interpreter is unloaded is ended inside a C++ destructor, and
    that aborts the process (status -6). On a busy machine it comes back late: so nothing is unloaded.
    """
    thread.join(timeout=SERVED)
    try:
        if not thread.is_alive():
            executor.shutdown(timeout_sec=0.0)
            node.destroy_node()
        rclpy.try_shutdown()
    except Exception:  # noqa: BLE001
        failed += traceback.format_exc()
    for note in filter(None, _noted):
        note.unlink(missing_ok=True)
    print(failed, end="", file=sys.stderr)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(1 if failed else 0)


def _leave_garbage_alone():
    """What is there now stays: collections, each a millisecond's stop of the loop, look at new objects only, and
    rarely."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)


def _wait_for_readers(node):
    """Until reliable readers have acknowledged all that was sent, within `ACKNOWLEDGED`."""
    end = time.monotonic() + ACKNOWLEDGED[_asked["number"]]
    for publisher in node.publishers:
        if publisher.topic_name.endswith(f"/{CREDIT}"):  # nobody begins a period any more, and the driver may be gone
            continue
        rest = max(end - time.monotonic(), 0.01)
        try:
            publisher.wait_for_all_acked(Duration(nanoseconds=int(rest * 1e9)))
        except RCLError:  # nothing to wait for
            continue


def _serve(executor, logger):
    """Serve until the process is asked to stop; a callback that fails is reported, and the others go on."""
    while running():
        try:
            executor.spin_once(timeout_sec=0.2)
        except (KeyboardInterrupt, ExternalShutdownException):
            return
        except Exception as error:  # noqa: BLE001 - such as a lifecycle transition that does not exist
            if running():
                logger.error(f"a request failed: {type(error).__name__}: {error}")
