"""ROS and the C library from compiled code: take, publish, sleep, without Python in between.

Together with `servo_path` the only place that knows how rclpy keeps what it wraps: a message is bytes in an
array of numpy, `Frame`, whose address ROS is given; publishers and subscriptions are the addresses of their C
structures.
"""

import ctypes

import numpy as np

from microstage_ros.numerics.compiled import external, in_place
from microstage_ros.records.bags.definition import installed_definition
from microstage_ros.records.bags.layout import layout_of_type
from microstage_ros.ros.transport.codec import ENCAPSULATION

SPARE = 256
"""Bytes more than a message needs: what comes is never larger, and a frame cannot grow."""

MONOTONIC, REALTIME, ABSOLUTE = 1, 0, 1
POINTER = "uintp"

INFO_WORDS, GID_AT, HALF = 16, 5, 0xffffffff
"""Room for an `rmw_message_info_t` in words of 8 bytes; where in it the identity of the publisher begins (after two
times, two numbers and the name of the middleware); the half of its second word that belongs to the process."""

_take = external("rcl_take_serialized_message", "int32", POINTER, POINTER, POINTER, POINTER)
_publish = external("rcl_publish_serialized_message", "int32", POINTER, POINTER, POINTER)
_clockwait = external("sem_clockwait", "int32", POINTER, "int32", POINTER)
_post = external("sem_post", "int32", POINTER)
_gettime = external("clock_gettime", "int32", "int32", POINTER)
_setscheduler = external("sched_setscheduler", "int32", "int32", "int32", POINTER)
_lock = external("pthread_mutex_lock", "int32", POINTER)
_trylock = external("pthread_mutex_trylock", "int32", POINTER)
_unlock = external("pthread_mutex_unlock", "int32", POINTER)
_nanosleep = external("clock_nanosleep", "int32", "int32", "int32", POINTER, POINTER)


class Space:
    """A place for the bytes of one message.

    Parameters
    ----------
    capacity : bytes of the largest message.

    Attributes
    ----------
    address : of the `rcl_serialized_message_t` around it. length : int64 (1,), bytes of what was taken last.
    """

    def __init__(self, capacity):
        self._bytes = np.zeros(capacity + SPARE, np.uint8)
        self._wrapped = np.zeros(8, np.uint64)  # buffer, length, capacity, and an allocator that is never called
        self._wrapped[:3] = self._bytes.ctypes.data, capacity, len(self._bytes)
        _allocator_into(self._wrapped[3:])
        self.address = int(self._wrapped.ctypes.data)
        self.length = self._wrapped[1:2].view(np.int64)

    def taken(self):
        """The bytes of what was taken last."""
        return self._bytes[:int(self.length[0])].tobytes()


class Frame(Space):
    """One message of fixed layout in one place.

    Attributes
    ----------
    message : its fields, a structured array of one, names as in `records.bags.layout`. raw : its bytes, uint8.
    """

    def __init__(self, type_name, package="microstage_msgs"):
        layout = layout_of_type(installed_definition(f"{package}/msg/{type_name}"))
        super().__init__(layout.size)
        self.raw = self._bytes[:layout.size]
        self.raw[:4] = np.frombuffer(ENCAPSULATION, np.uint8)
        self.message = self.raw.view(layout.dtype)

    @property
    def bytes(self):
        """The message as it is now."""
        return self.raw.tobytes()


def _allocator_into(words):
    """The default allocator of ROS, five pointers."""
    class Allocator(ctypes.Structure):
        _fields_ = [("words", ctypes.c_uint64 * 5)]

    default = ctypes.CDLL("librcutils.so").rcutils_get_default_allocator
    default.restype = Allocator
    words[:] = list(default().words)


def load_libraries():
    """Make the C functions known to compiled code; before any compiled function that calls them is used."""
    ctypes.CDLL("librcl.so", mode=ctypes.RTLD_GLOBAL)


@in_place
def take(subscription, frame):
    """The oldest message that waits into its frame; False if none does. Arguments are addresses."""
    return _take(subscription, frame, 0, 0) == 0


@in_place
def take_from(subscription, frame, sender):
    """As `take`; ``sender``: int64 of shape (`INFO_WORDS`,), filled with the middleware's information about the
    message."""
    return _take(subscription, frame, sender.ctypes.data, 0) == 0


@in_place
def known(sender, holder):
    """True if a message came from the process ``holder``, int64 (2,), as `identity.process_of` gives it; all zero:
    anybody.

    The identity of a DDS endpoint is 16 bytes, of which the first 12 are those of its process.
    """
    return holder[0] == 0 or (sender[GID_AT] == holder[0] and (sender[GID_AT + 1] & HALF) == holder[1])


@in_place
def publish(publisher, frame):
    """Send the message in a frame. Arguments are addresses."""
    return _publish(publisher, frame, 0) == 0


@in_place
def now(clock, times):
    """Time of ``clock`` [ns]; ``times``: int64 of shape (2,), a `timespec` to work in."""
    _gettime(clock, times.ctypes.data)
    return times[0] * 1_000_000_000 + times[1]


@in_place
def wait(semaphore, until, times):
    """Sleep until the semaphore at this address is posted or the monotonic clock says ``until`` [ns]."""
    times[0], times[1] = until // 1_000_000_000, until % 1_000_000_000
    return _clockwait(semaphore, MONOTONIC, times.ctypes.data) == 0


@in_place
def post(semaphore):
    """Wake who waits for the semaphore at this address."""
    _post(semaphore)


@in_place
def lock(mutex):
    """Have the mutex at this address, waiting for it."""
    _lock(mutex)


@in_place
def try_lock(mutex):
    """True if the mutex at this address was free; it is ours now."""
    return _trylock(mutex) == 0


@in_place
def unlock(mutex):
    """Let go of it."""
    _unlock(mutex)


@in_place
def set_policy(policy, priority, words):
    """Scheduling of the calling thread; ``words``: int64 array to work in. Where it is not permitted nothing
    changes."""
    words[0] = priority
    _setscheduler(0, policy, words.ctypes.data)


@in_place
def sleep_until(deadline, spin, times):
    """Sleep until ``spin`` [ns] before the monotonic clock says ``deadline`` [ns], then look at the clock until it
    does.

    Returns how late the sleep ended [ns]; -1 where there was no time for one.
    """
    early, late = deadline - spin, -1
    present = now(MONOTONIC, times)
    if present < early:
        times[0], times[1] = early // 1_000_000_000, early % 1_000_000_000
        _nanosleep(MONOTONIC, ABSOLUTE, times.ctypes.data, 0)
        present = now(MONOTONIC, times)
        late = present - early
    while present < deadline:
        present = now(MONOTONIC, times)
    return late
