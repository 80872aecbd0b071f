"""Locks in shared memory whose holder was killed or stopped: opened again, so that who waits for them goes on.

A reader with data sharing owns a segment in ``/dev/shm`` by which writers wake it: two process-shared mutexes, a list
of who sleeps, and one atomic flag (`DataSharingNotification`, `RobustInterprocessCondition` of Fast DDS). The mutexes
are not robust: one that a thread held when its process was killed stays shut. Every message to that reader then waits
for 1 s (`BOOST_INTERPROCESS_TIMEOUT_WHEN_LOCKING`) with the writer's own lock held, one message after the other, until
discovery gives the reader up after 20 s. Who needs the writer's lock waits too: the middleware's receiving threads, and
with them all services of the process. A reader whose lock was left shut by a writer hears nothing more.

To open such a lock is safe, even where its holder was only stopped and goes on later: the list is changed by the one
thread that reads, others walk through it, and all else that is guarded is the atomic flag. A lock that is opened
wrongly can delay one waking until the next message; nothing else.

Tried with Fast DDS 2.14.5 and glibc 2.36 on x86-64. A segment that is not laid out as expected is left alone. Without
this file the waits above are back. The locks of the shared-memory transport's ports are not touched: the middleware
makes such a port anew, and a message that is half put into one must not be found later.
"""

import contextlib
import ctypes
import fcntl
import math
import mmap
import os
import struct
import threading
import time
from pathlib import Path

PLACE = Path("/dev/shm")
BEGINNING = "fast_datasharing_"

NAME = b"notification_node\0"
HEADER, VALUE, VALUE_BYTES = 240, 256, 20584
"""Where the named object of such a segment has its header and its value, and how long that is: 512 semaphores of 40
bytes, two lists of 8, two mutexes of 40, the flag with what aligns it."""

MUTEXES = (VALUE + 512 * 40 + 2 * 8, VALUE + 512 * 40 + 2 * 8 + 40)
"""Of the list of sleepers, and of the flag."""

LOCK, OWNER, KIND = 0, 8, 16
"""Places of words in glibc's `pthread_mutex_t`: 0 where it is open; the thread that holds it; what kind it is."""

BOTH = struct.Struct("<I4xI28xI4xI")
"""Those two words of the two mutexes, which lie beside each other."""

PROCESS_SHARED = 0x80
"""The kind: shared by processes, and otherwise normal, so that any thread may open it."""

EVERY_S = 0.05
"""Time between two looks [s]. A lock is held for less than a microsecond by a thread that runs."""

NAMELESS_LOOKS = 4
"""A thread that has shut a lock writes its number into it with the next instruction. One that was killed between the
two leaves a lock without a holder, which is opened after so many looks."""

MAKING_S = 5.0
"""A file that is no notification after so long [s] will not become one: it is a writer's."""


class Segment:
    """The two locks of one segment, mapped. Raises `ValueError` if it is no such segment, `OSError` if it is gone."""

    def __init__(self, path):
        with path.open("r+b") as file:
            about = os.fstat(file.fileno())
            start = os.pread(file.fileno(), VALUE, 0)
            name = os.pread(file.fileno(), len(NAME), VALUE + VALUE_BYTES)
            if (about.st_uid != os.getuid() or len(start) < VALUE or name != NAME
                    or _word(start, HEADER + 8) != VALUE_BYTES or start[HEADER + 12] != len(NAME) - 1):
                raise ValueError(f"{path.name} is no notification of a reader as Fast DDS 2.14.5 makes it")
            first = MUTEXES[0] // mmap.PAGESIZE * mmap.PAGESIZE
            self._pages = mmap.mmap(file.fileno(), about.st_size - first, offset=first)
        self._base = ctypes.addressof(ctypes.c_char.from_buffer(self._pages))
        self._words = [place - first for place in MUTEXES]
        if any(_word(self._pages, at + KIND) != PROCESS_SHARED for at in self._words):
            raise ValueError(f"{path.name} has mutexes of another kind")

    def holders(self):
        """For each lock None if it is open, else the number of the thread that holds it, 0 if it does not say."""
        first, holder_of_first, second, holder_of_second = BOTH.unpack_from(self._pages, self._words[0])
        return holder_of_first if first else None, holder_of_second if second else None

    def open(self, which):
        """Open one lock; the thread that waits for it goes on."""
        ctypes.CDLL(None).pthread_mutex_unlock(ctypes.c_void_p(self._base + self._words[which]))


class AbandonedLocks:
    """Looks again and again at all readers of this user, and opens what nobody will open."""

    def __init__(self, place=PLACE):
        self._place, self._segments, self._seen = place, {}, {}
        self._changed, self._settled = None, -math.inf
        self._known = _mutexes_are_as_expected()

    def look(self):
        """Open the locks held as at the last look, by a thread that is gone or stopped. Returns how many."""
        self._follow()
        opened, seen = 0, {}
        for name, segment in self._segments.items():
            if segment is None:
                continue
            for which, holder in enumerate(segment.holders()):
                if holder is None:
                    continue
                before, looks = self._seen.get((name, which), (holder, 0))
                looks = looks + 1 if before == holder else 1
                seen[name, which] = holder, looks
                if looks > 1 and _gone(holder) if holder else looks >= NAMELESS_LOOKS:
                    opened += self._open(name, which, holder)
        self._seen = seen
        return opened

    def _follow(self):
        """Know the segments that are there now."""
        changed = self._place.stat().st_mtime_ns if self._known and self._place.is_dir() else self._changed
        if changed == self._changed and time.monotonic() > self._settled:
            return
        if changed != self._changed:
            self._changed, self._settled = changed, time.monotonic() + MAKING_S
        names = {name for name in os.listdir(self._place) if name.startswith(BEGINNING)}
        for name in self._segments.keys() - names:
            del self._segments[name]
        for name in names - self._segments.keys():
            path = self._place / name
            with contextlib.suppress(OSError):  # gone meanwhile, or somebody else's
                try:
                    self._segments[name] = Segment(path)
                except ValueError:
                    if time.time() - path.stat().st_mtime > MAKING_S:
                        self._segments[name] = None

    def _open(self, name, which, holder):
        """Open a lock that ``holder`` holds, unless another process does so at this moment. Returns 1 or 0."""
        with contextlib.suppress(OSError), (self._place / name).open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if self._segments[name].holders()[which] == holder:
                self._segments[name].open(which)
                return 1
        return 0

    def keep_looking(self, running, logger):
        """Have a thread look every `EVERY_S` until ``running()`` is false. Driver and controller do, each for both: the
        thread of one may wait for the interpreter's lock, which a waiting writer of its process has."""

        def look_on():
            pause = threading.Event()
            while running():
                if opened := self.look():
                    logger.warning(f"opened {opened} locks in shared memory whose holders have ended or are stopped")
                pause.wait(EVERY_S)

        threading.Thread(target=look_on, name="locks", daemon=True).start()


def _word(data, at):
    return int.from_bytes(data[at:at + 4], "little")


def _gone(thread):
    """True if a thread has ended or is stopped by a signal."""
    try:
        state = Path(f"/proc/{thread}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return True
    except (OSError, IndexError):
        return False
    return state in "TtZX"


def _mutexes_are_as_expected():
    """True if a mutex of this C library has its words where they are looked for: tried with one."""
    libc = ctypes.CDLL(None)
    mutex, attributes = ctypes.create_string_buffer(64), ctypes.create_string_buffer(64)
    libc.pthread_mutexattr_init(attributes)
    libc.pthread_mutexattr_setpshared(attributes, 1)
    libc.pthread_mutex_init(mutex, attributes)
    libc.pthread_mutex_lock(mutex)
    held = _word(mutex.raw, LOCK), _word(mutex.raw, OWNER), _word(mutex.raw, KIND)
    libc.pthread_mutex_unlock(mutex)
    return held == (1, threading.get_native_id(), PROCESS_SHARED) and _word(mutex.raw, LOCK) == 0
