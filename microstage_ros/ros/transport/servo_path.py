"""The servo path: raw bytes, and a semaphore to sleep on. All private calls of rclpy are in this file.

An executor of rclpy builds its wait set anew for every message, and even a wait set that is used again costs
30 µs of processor time each time that it really sleeps. Here the middleware itself posts a semaphore when a
message arrives (`rcl_subscription_set_on_new_message_callback` with `sem_post` as the callback: no Python, no
interpreter lock), and the servo loop sleeps on that. The subscriptions of this path belong to a callback group
that never lets an executor have them. Where the private calls are missing (another rclpy), `make_servo_path`
falls back to the public ones, slower, and says so in the node's log.
"""

import collections
import ctypes
import threading
import time

from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from rclpy.executors import ExternalShutdownException, ShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy

try:
    from rclpy.impl.implementation_singleton import rclpy_implementation
except ImportError:  # another rclpy
    rclpy_implementation = None

RCLError = getattr(rclpy_implementation, "RCLError", RuntimeError)
"""What rclpy raises when the process is asked to stop in the middle of a call."""

PRIVATE = {"Subscription": ("take_message", "pointer"), "Publisher": ("pointer",)}
"""Private classes and their members that the fast way uses."""

C_CALLS = {"librcl.so": ("rcl_subscription_set_on_new_message_callback", "rcl_take_serialized_message",
                         "rcl_publish_serialized_message"),
           "librcutils.so": ("rcutils_get_default_allocator", "rcutils_reset_error"),
           None: ("sem_init", "sem_post", "sem_clockwait", "clock_gettime", "clock_nanosleep", "pthread_mutex_lock",
                  "pthread_mutex_trylock", "pthread_mutex_unlock")}
"""Calls of C libraries that it uses; None: the C library itself."""

CLOCK_MONOTONIC = 1
SEMAPHORE_BYTES = 64


def missing_private_calls(implementation=rclpy_implementation, c_calls=None):
    """Names of the private calls that this rclpy lacks; empty where the fast way works."""
    if implementation is None:
        return ["rclpy.impl.implementation_singleton"]
    lacking = []
    for kind, members in PRIVATE.items():
        owner = getattr(implementation, kind, None)
        lacking += [f"{kind}.{name}" for name in members if not hasattr(owner, name)]
    for library, names in (C_CALLS if c_calls is None else c_calls).items():
        try:
            loaded = ctypes.CDLL(library)
        except OSError:
            lacking.append(library or "libc")
            continue
        lacking += [name for name in names if not hasattr(loaded, name)]
    return lacking


class ServoGroup(CallbackGroup):
    """A callback group whose members no executor ever runs."""

    def can_execute(self, entity):
        return False

    def beginning_execution(self, entity):
        return False

    def ending_execution(self, entity):
        pass


def reader_qos(depth, reliable, latched=False):
    """Quality of service of one reader of the servo path, which keeps ``depth`` messages [1] for it."""
    from rclpy.qos import DurabilityPolicy

    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


class Reader:
    """One subscription: `take` gives the oldest waiting message as bytes, or None."""

    def __init__(self, subscription):
        self.subscription = subscription
        self._take = subscription.handle.take_message
        self._type = subscription.msg_type

    @property
    def address(self):
        """Of the C structure of the subscription."""
        return int(self.subscription.handle.pointer)

    def take(self):
        """CDR bytes of the oldest message that waits, None if none does."""
        found = self._take(self._type, True)
        return None if found is None else found[0]

    @property
    def publishers(self):
        """Number of matched publishers."""
        return self.subscription.get_publisher_count()


def never_raising(publish):
    """``publish`` as a call that returns whether the message went out.

    The middleware refuses a message while it has no memory left for one: readers that were killed or stopped
    acknowledge nothing, and what waits for them fills the writer's history. That must not end a servo loop; who records
    sees the gap.
    """

    def send(raw):
        try:
            publish(raw)
        except RCLError:
            return False
        return True

    return send


class _Bytes(ctypes.Structure):
    """`rcl_serialized_message_t`: where the bytes are, how many, room for how many, and an allocator that is never
    called."""

    _fields_ = [("buffer", ctypes.c_void_p), ("length", ctypes.c_size_t), ("capacity", ctypes.c_size_t),
                ("allocator", ctypes.c_void_p * 5)]


class RawWriter:
    """Sends CDR bytes through a publisher; True if they went out (see `never_raising`).

    rclpy keeps the interpreter's lock in this call. A reader that was killed while it held the lock of its own shared
    memory makes the call wait for seconds, and with it every service of this process: so the lock is released here.

    What can be done once is: right after a thread has slept, every line of Python costs several times as much as in a
    loop. So messages of one length go out from one place.
    """

    def __init__(self, publisher):
        self._handle = publisher.handle
        with self._handle:
            self._pointer = ctypes.c_void_p(self._handle.pointer)
        self._publish = ctypes.CDLL("librcl.so").rcl_publish_serialized_message
        self._forget_error = ctypes.CDLL("librcutils.so").rcutils_reset_error
        self._turn = threading.Lock()
        self._make_place(0)

    def _make_place(self, length):
        """A place for messages of so many bytes."""
        place = (ctypes.c_char * length)()
        self._message = _Bytes(ctypes.addressof(place), length, length)
        self._address = ctypes.c_void_p(ctypes.addressof(self._message))
        self._length, self._place = length, memoryview(place).cast("B") if length else memoryview(b"")

    def send(self, raw):
        """Send the bytes of one message, ``raw``; one thread at a time does so.

        Raises rclpy's `InvalidHandle` where the publisher has been destroyed.
        """
        with self._turn:
            if len(raw) != self._length:
                self._make_place(len(raw))
            self._place[:] = raw
            with self._handle:  # only meanwhile: a publisher that is destroyed must leave the graph
                refused = self._publish(self._pointer, self._address, None)
            if not refused:
                return True
        self._forget_error()
        return False


class Semaphore:
    """A POSIX semaphore that is posted by the middleware's threads and waited for by one of Python's."""

    class _Time(ctypes.Structure):
        _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]

    def __init__(self):
        libc = ctypes.CDLL(None)
        self._bytes = ctypes.create_string_buffer(SEMAPHORE_BYTES)
        self._until = self._Time()
        libc.sem_init(self._bytes, 0, 0)
        self._clockwait = libc.sem_clockwait
        self._clockwait.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p]
        self._post = libc.sem_post
        self.post = ctypes.cast(libc.sem_post, ctypes.c_void_p)
        self.address = ctypes.c_void_p(ctypes.addressof(self._bytes))
        self._until_address = ctypes.c_void_p(ctypes.addressof(self._until))
        _KEPT.append(self)

    def post_now(self):
        """Wake who waits."""
        self._post(self.address)

    def wait(self, timeout):
        """Until it is posted, at most ``timeout`` [s]; a signal ends it too."""
        until, end = self._until, time.monotonic() + timeout
        until.seconds = seconds = int(end)
        until.nanoseconds = int((end - seconds) * 1e9)
        self._clockwait(self.address, CLOCK_MONOTONIC, self._until_address)


class FastServoPath:
    """Readers and writers of one node, and waiting for them, with the private calls.

    Everything that waits in any of the readers must be taken before `wait` is called again.
    """

    def __init__(self, node):
        self._node = node
        self._group = ServoGroup()
        self.semaphore = Semaphore()
        self._notify = ctypes.CDLL("librcl.so").rcl_subscription_set_on_new_message_callback
        self._notify.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]

    def reader(self, message_type, topic, qos):
        """A `Reader` of CDR bytes."""
        subscription = self._node.create_subscription(
            message_type, topic, lambda raw: None, qos, callback_group=self._group, raw=True)
        self._tell(subscription)
        return Reader(subscription)

    def _tell(self, subscription):
        """Have the semaphore posted for every message; False where the middleware cannot."""
        return self._notify(subscription.handle.pointer, self.semaphore.post, self.semaphore.address) == 0

    def call(self, reader, function, argument, owner):
        """Have ``function`` called in the middleware's thread for every message of ``reader``, in place of the
        semaphore.

        Parameters
        ----------
        function : of `numerics.compiled.called_from_c`. argument : address that it gets [1]. owner : of what is there.
        """
        _KEPT.append((function, owner))
        self._notify(reader.address, function.address, argument)

    def reports_messages(self):
        """True if the middleware tells of new messages; tried with a subscription that is taken back."""
        from microstage_msgs.msg import Credit

        trial = self._node.create_subscription(Credit, "_blocks/trial", lambda raw: None, 1, raw=True)
        try:
            return self._tell(trial)
        finally:
            self._node.destroy_subscription(trial)

    def writer(self, publisher):
        """The call that sends CDR bytes through ``publisher``; True if they went out."""
        return RawWriter(publisher).send

    def wait(self, readers, timeout):
        """Sleep until one of ``readers`` (a tuple) has a message, at most ``timeout`` [s]; it may return sooner."""
        self.semaphore.wait(timeout)


_KEPT: list = []
"""Semaphores and what is called for a message live as long as the process: a thread of the middleware may still use
them while a node is destroyed."""


class QueueReader:
    """A reader of the public way: an executor's callbacks fill a queue."""

    def __init__(self):
        self.queue = collections.deque()
        self.subscription = None

    def take(self):
        """As `Reader.take`."""
        return self.queue.popleft() if self.queue else None

    @property
    def publishers(self):
        """Number of matched publishers."""
        return 0 if self.subscription is None else self.subscription.get_publisher_count()


class PlainServoPath:
    """The same with public calls alone: an executor of its own in the waiting thread."""

    def __init__(self, node):
        # a node of its own, so that the executor of parameters and services does not take the messages
        self._node = _companion(node)
        self._group = MutuallyExclusiveCallbackGroup()
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(self._node)

    def reader(self, message_type, topic, qos):
        """A `QueueReader`."""
        reader = QueueReader()
        reader.subscription = self._node.create_subscription(
            message_type, topic, lambda raw: reader.queue.append(raw), qos, callback_group=self._group, raw=True)
        return reader

    def writer(self, publisher):
        """As `FastServoPath.writer`."""
        return never_raising(publisher.publish)

    def wait(self, readers, timeout):
        """As `FastServoPath.wait`, at most ``timeout`` [s]."""
        if any(reader.queue for reader in readers):
            return
        try:
            self._executor.spin_once(timeout_sec=timeout)
        except (ShutdownException, ExternalShutdownException):
            pass


def _companion(node):
    """A second node of the process, in the same namespace."""
    import rclpy

    return rclpy.create_node(f"{node.get_name()}_servo", namespace=node.get_namespace(), context=node.context,
                             use_global_arguments=False, start_parameter_services=False, enable_rosout=False)


def make_servo_path(node, plain=False):
    """The fastest way that this rclpy allows; ``plain`` asks for the public one."""
    if plain:
        return PlainServoPath(node)
    lacking = missing_private_calls()
    if not lacking:
        path = FastServoPath(node)
        if path.reports_messages():
            return path
        lacking = ["news of messages from the middleware"]
    node.get_logger().warning("missing here: " + ", ".join(lacking) + "; the servo path uses an executor, slower")
    return PlainServoPath(node)
