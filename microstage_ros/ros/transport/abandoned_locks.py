"""Locks in shared memory whose holder was killed or stopped: opened again, so that who waits for them goes on.

Fast DDS has two kinds of segment in ``/dev/shm`` by which writers wake a reader: one for each reader with data sharing
(`DataSharingNotification`), and the ports of the shared-memory transport (`SharedMemGlobal::PortNode`). Both hold a
list of who sleeps (`RobustInterprocessCondition`) and two process-shared mutexes that are not robust: one that a thread
held when its process was killed stays shut. Whoever needs it then waits for 1 s
(`BOOST_INTERPROCESS_TIMEOUT_WHEN_LOCKING`), with its own locks held. At a port once, since the middleware marks it as
useless then and makes it anew: the servo loop stands still for a second. At a reader with every message, until
discovery gives the reader up after 20 s: no service of the process is answered meanwhile. A reader whose lock was left
shut by a writer hears nothing more.

To open a reader's lock is safe, even where its holder was only stopped and goes on later: its list is changed by the
one thread that reads, others walk through it, and all else that is guarded is an atomic flag. A lock that is opened
wrongly can delay one waking until the next message; nothing else. A port may hold a message that is half written: it is
marked as useless first, as the middleware itself would do a second later.

Tried with Fast DDS 2.14.5 and glibc 2.36 on x86-64. A segment that is not laid out as expected is left alone. Without
this file the waits above are back.
"""

import contextlib
import ctypes
import fcntl
import mmap
import os
import struct
import threading
import time
from pathlib import Path
from typing import NamedTuple

PLACE = Path("/dev/shm")

LIBC = ctypes.CDLL(None, use_errno=True)
LIBC.mmap.restype = ctypes.c_void_p
LIBC.mmap.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long)
LIBC.munmap.argtypes = (ctypes.c_void_p, ctypes.c_size_t)


class Layout(NamedTuple):
    """Of the named object of a segment: its name, its bytes, where its list of sleepers is, where what marks a port."""

    name: bytes
    size: int
    sleepers: int
    flags: int | None


READER, PORT = "fast_datasharing_", "fastrtps_port"
LAYOUTS = {
    READER: Layout(b"notification_node\0", 20584, 0, None),
    PORT: Layout(b"port_node_abi5\0", 41136, 56, 44),
}
"""Beginning of the file's name to what is in it. The mutex of the list follows the list, and the other that mutex."""

HEADER, VALUE = 240, 256
"""Where the named object has its header and its value."""

SLEEPERS = 512 * 40 + 2 * 8
"""Bytes of the list: semaphores, and the ends of two chains."""

LOCK, OWNER, KIND, MUTEX = 0, 8, 16, 40
"""Words of glibc's `pthread_mutex_t`: 0 where it is open; the thread that holds it; what kind it is; bytes of all."""

BOTH = struct.Struct("<I4xI28xI4xI")
"""The first two of these words of the two mutexes."""
BOTH_BYTES, _bytes_at = BOTH.size, ctypes.string_at

PROCESS_SHARED = 0x80
"""The kind: shared by processes, and otherwise normal, so that any thread may open it."""

PORT_IS_USABLE = 1
"""Bit of a port's flags."""

EVERY_S, AGAIN_S = 0.05, 0.005
"""Time between two looks [s], and where a lock was shut. A thread that runs holds one for less than a microsecond."""

NAMELESS_LOOKS = 10
"""A thread that has shut a lock writes its number into it with the next instruction. One that was killed between the
two leaves a lock without a holder, which is opened after so many looks."""

LISTED_S, MAKING_S = 0.25, 5.0
"""Time between two looks for new files [s]. One that is nothing of ours after `MAKING_S` will not become it."""

COUNTED_S, GIVEN_UP_S = 5.0, 30.0
"""Time between two looks at which readers' processes are there [s], and after which the segments of one that is not are
left alone. Discovery gives a process up after 20 s, so nobody writes to it any more; but its files stay, in thousands
where many were killed, and to look at 2300 of them took 2.4 ms each time."""

OPENED = "opened {} locks in shared memory whose holders have ended or are stopped"
FIRST_PORT, PORTS = 7400, 250
"""Port numbers of domain 0 begin here, and every domain has so many (RTPS specification, 9.6.1.1)."""


class Segment:
    """The two locks of one segment, mapped. Raises `ValueError` if it is no such segment, `OSError` if it is gone.

    Kept small: there is one for every reader of this user, also of other cells.
    """

    __slots__ = ("_base", "_length", "_first", "_flags")

    def __init__(self, path):
        self._base = None
        layout = LAYOUTS[READER if path.name.startswith(READER) else PORT]
        with path.open("r+b") as file:
            about = os.fstat(file.fileno())
            start = os.pread(file.fileno(), VALUE, 0)
            name = os.pread(file.fileno(), len(layout.name), VALUE + layout.size)
            if (about.st_uid != os.getuid() or len(start) < VALUE or name != layout.name
                    or _word(start, HEADER + 8) != layout.size or start[HEADER + 12] != len(layout.name) - 1):
                raise ValueError(f"{path.name} is not laid out as Fast DDS 2.14.5 does it")
            self._length, self._base = about.st_size, _mapped(file.fileno(), about.st_size)
        self._first = self._base + VALUE + layout.sleepers + SLEEPERS
        self._flags = None if layout.flags is None else self._base + VALUE + layout.flags
        if any(_word(ctypes.string_at(self.address(which), MUTEX), KIND) != PROCESS_SHARED for which in (0, 1)):
            raise ValueError(f"{path.name} has mutexes of another kind")

    def __del__(self, unmap=LIBC.munmap):
        # not by weakref.finalize, which unmaps at exit too, while the thread that looks still reads and makes segments
        if self._base is not None:
            unmap(self._base, self._length)

    def address(self, which):
        """Of the mutex of that number, ``which`` [1]: 0 is the list's, 1 the other."""
        return ctypes.c_void_p(self._first + which * MUTEX)

    def holders(self):
        """For each lock None if it is open, else the number of the thread that holds it, 0 if it does not say."""
        first, holder_of_first, second, holder_of_second = BOTH.unpack(_bytes_at(self._first, BOTH_BYTES))
        return holder_of_first if first else None, holder_of_second if second else None

    def open(self, which):
        """Open the lock of that number, ``which`` [1], of a port that is marked as useless first; the thread that
        waits for it goes on."""
        if self._flags is not None:
            flags = ctypes.c_ubyte.from_address(self._flags)
            flags.value &= ~PORT_IS_USABLE
        LIBC.pthread_mutex_unlock(self.address(which))


class AbandonedLocks:
    """Looks again and again at all readers of this user and at the ports of this domain, and opens what nobody will."""

    def __init__(self, place=PLACE):
        self._place, self._segments, self._files, self._seen = place, {}, {}, {}
        self._watched, self._dead, self._counted = {}, {}, 0.0
        self._changed, self._settled, self._listed = None, 0.0, 0.0
        self._known = _mutexes_are_as_expected()
        self._domain = int(os.environ.get("ROS_DOMAIN_ID") or 0)

    def look(self):
        """Open the locks held as at the last look, by a thread that is gone or stopped. Returns how many."""
        self._follow()
        self._forget_dead(time.monotonic())
        opened, seen = 0, {}
        for name, segment in self._watched.items():
            if (holders := segment.holders()) == (None, None):
                continue
            for which, holder in enumerate(holders):
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
        now = time.monotonic()
        if not self._known or self._segments and now < self._listed + LISTED_S or not self._place.is_dir():
            return
        changed, self._listed = self._place.stat().st_mtime_ns, now
        if changed == self._changed and now > self._settled:
            return
        if changed != self._changed:
            self._changed, self._settled = changed, now + MAKING_S
        known, new = 0, []
        with os.scandir(self._place) as entries:  # one after the other: there may be thousands
            for entry in entries:
                if entry.name in self._segments and self._files.get(entry.name) == entry.inode():
                    known += 1
                elif self._concerns(entry.name):
                    new.append((entry.name, entry.inode()))  # a port is made anew under the name that it had
        if known < len(self._segments):
            for name in [name for name in self._segments if not os.path.exists(os.path.join(self._place, name))]:
                del self._segments[name], self._files[name]
                self._watched.pop(name, None), self._dead.pop(name, None)
        for name, file in new:
            path, made = self._place / name, None
            for table in (self._segments, self._files, self._watched, self._dead):
                table.pop(name, None)
            with contextlib.suppress(OSError):  # gone meanwhile, or somebody else's
                try:
                    made = Segment(path)
                except ValueError:
                    if time.time() - path.stat().st_mtime <= MAKING_S:
                        continue
                self._segments[name], self._files[name] = made, file
                if made is not None:
                    self._watched[name] = made

    def _forget_dead(self, now):
        """Leave the segments alone whose process has been gone for `GIVEN_UP_S` at the time ``now`` [s]; at the first
        look those whose process is gone then, since who begins after its end never hears of it."""
        if self._counted and now < self._counted + COUNTED_S:
            return
        there, patience = process_numbers(), GIVEN_UP_S if self._counted else 0.0
        self._counted = now
        for name in list(self._watched):
            process = process_of(name)
            if process is None or not there or process in there:
                self._dead.pop(name, None)
            elif now - self._dead.setdefault(name, now) >= patience:
                self._segments[name] = None
                del self._watched[name], self._dead[name]

    def _concerns(self, name):
        """True for the file of a reader or writer with data sharing, and of a port of this domain."""
        number = name.removeprefix(PORT)
        return name.startswith(READER) or (
            number != name and number.isdecimal() and (int(number) - FIRST_PORT) // PORTS == self._domain)

    def _open(self, name, which, holder):
        """Open a lock that ``holder`` holds, unless another process does so at this moment. Returns 1 or 0."""
        with contextlib.suppress(OSError), (self._place / name).open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if self._segments[name].holders()[which] == holder:
                self._segments[name].open(which)
                return 1
        return 0

    @property
    def pause(self):
        """Time until the next look [s]."""
        return AGAIN_S if self._seen else EVERY_S

    def keep_looking(self, running, logger):
        """Have a thread look again and again until ``running()`` is false. Driver and controller do, each for both, and
        the process that starts all nodes: a thread may wait for the interpreter's lock, which a waiting writer has."""

        def look_on():
            pause = threading.Event()
            while running():
                if opened := self.look():
                    logger.warning(OPENED.format(opened))
                pause.wait(self.pause)

        threading.Thread(target=look_on, name="locks", daemon=True).start()


def _mapped(descriptor, size):
    """Address of a file of ``size`` bytes in this process's memory. Python's own `mmap` keeps a descriptor for each,
    of which a process may have a thousand only; there can be more readers. Raises `OSError`."""
    address = LIBC.mmap(None, size, mmap.PROT_READ | mmap.PROT_WRITE, mmap.MAP_SHARED, descriptor, 0)
    if address in (None, ctypes.c_void_p(-1).value):
        raise OSError(ctypes.get_errno(), "cannot be mapped")
    return address


def process_of(name):
    """Low 16 bits of the number of the process whose segment has the file ``name``, bytes 4 and 5 of its endpoint's
    identity; None where the name does not say."""
    parts = name.removeprefix(READER).split(".")
    try:
        return int(parts[5] + parts[4], 16) if name.startswith(READER) and len(parts) > 11 else None
    except ValueError:
        return None


def process_numbers():
    """Low 16 bits of the numbers of all processes; empty where they cannot be listed. Those of another container that
    shares our memory and not our numbers are not among them: their readers are looked after there."""
    try:
        return {int(name) & 0xFFFF for name in os.listdir("/proc") if name.isdecimal()}
    except OSError:
        return set()


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
    mutex, attributes = ctypes.create_string_buffer(64), ctypes.create_string_buffer(64)
    LIBC.pthread_mutexattr_init(attributes)
    LIBC.pthread_mutexattr_setpshared(attributes, 1)
    LIBC.pthread_mutex_init(mutex, attributes)
    LIBC.pthread_mutex_lock(mutex)
    held = _word(mutex.raw, LOCK), _word(mutex.raw, OWNER), _word(mutex.raw, KIND)
    LIBC.pthread_mutex_unlock(mutex)
    return held == (1, threading.get_native_id(), PROCESS_SHARED) and _word(mutex.raw, LOCK) == 0
