"""Following a topic of the servo path without waking for every message of it.

Whoever sends on such a topic sends each message to those who listen, and all of them once more in blocks
(`MessageBlock` on `_blocks/<topic>`) to those who follow: the recorder, the observer, the move server. A
follower gets every message, in order, at a hundredth of the wakings.
"""

import struct
import threading
import time

import numpy as np
from microstage_msgs.msg import MessageBlock
from rclpy.qos import QoSProfile, ReliabilityPolicy

from microstage_ros.ros.transport.block_buffer import SLOTS, close, crowded, keep, new_ring
from microstage_ros.ros.transport.checked import CheckedReader
from microstage_ros.ros.transport.codec import ENCAPSULATION, Codec
from microstage_ros.ros.transport.identity import Holder
from microstage_ros.ros.transport.servo_path import reader_qos
from microstage_ros.ros.transport.topics import BLOCKS, DEPTH, SENDERS, SERVO

HEAD = struct.Struct("<4sQII")
"""Encapsulation, first, size, bytes of all messages: what stands before them in a `MessageBlock`."""

BLOCK_BYTES = 8192
BLOCK_DEPTH = 500
"""Blocks kept for a slow follower: more than it lets the axis run ahead, 4 MB of shared memory."""

WORD = 8
"""A message as ROS serialises it may be longer by less than so many bytes."""

MOST_PERIODS, LONGEST = 100, 0.02
"""A block holds this many control periods, or this much time [s] where that is less."""

FOUND_S = 1.0
"""Longest wait [s] for the followers to find a new publisher; one of them may be gone."""

BLOCK_QOS = QoSProfile(depth=BLOCK_DEPTH, reliability=ReliabilityPolicy.RELIABLE)


def periods_per_block(period):
    """Control periods in one block [1], for a control ``period`` [s]."""
    return max(1, min(MOST_PERIODS, round(LONGEST / period)))


class Outlet:
    """One topic of the servo path as its sender sees it.

    Parameters
    ----------
    node : its node. servo : its servo path. kind, topic : message class and name.
    always : send singly even if nobody seems to listen (a reader may have come a moment ago).

    Attributes
    ----------
    ring : what waits for its block to be full, as `kept_rows.keep` takes it.
    closed : called when `flush` has closed a block; sends it, unless a `Sender` is to do so.
    sent : called with the messages of every block that was sent, as a structured array; None: nobody asks.
    unsent : blocks that the middleware did not take.
    """

    def __init__(self, node, servo, kind, topic, always=False):
        self._kind, self._single, self._left_singles = kind, node.create_publisher(kind, topic, SERVO), []
        self._blocks = node.create_publisher(MessageBlock, BLOCKS + topic, BLOCK_QOS)
        self._write_single, self._send_block = servo.writer(self._single), servo.writer(self._blocks)
        self._always = self._listened = always
        self._codec = Codec(kind.__name__)
        self.ring = new_ring(BLOCK_BYTES // self._codec.size, self._codec.size)
        self.closed, self.sent = self.send_closed, None
        self._sending, self.unsent, self._left, self._node, self._writer = threading.Lock(), 0, [], node, servo.writer

    @property
    def listeners(self):
        """Matched readers of single messages."""
        return self._single.get_subscription_count()

    @property
    def followers(self):
        """Matched readers of blocks."""
        return self._blocks.get_subscription_count()

    def send_single(self, raw):
        """Send one message to those who listen; through a new publisher if the middleware refuses it."""
        if not self._write_single(raw):
            self.renew_single()
            self._write_single(raw)

    def renew_single(self):
        """A new publisher of single messages in place of one that refuses them, as `_send_anew`; nobody is waited for.

        The old one stays until the next: compiled code may be about to send through it.
        """
        self._left_singles.append(self._single)
        if len(self._left_singles) > 2:
            self._node.destroy_publisher(self._left_singles.pop(0))
        self._node.get_logger().warning(
            f"the middleware refuses messages on {self._single.topic_name}: they go through a new publisher"
        )
        self._single = self._node.create_publisher(self._kind, self._single.topic_name, SERVO)
        self._write_single = self._writer(self._single)

    def send(self, sequence, raw):
        """Send the message of period ``sequence`` [1]; it goes into the block that `flush` sends."""
        if self._listened:
            self.send_single(raw)
        self.keep(sequence, raw)

    def send_all(self, messages):
        """Send ``messages`` of shape (n,) that belong together (`Codec.array`) at once; what waits for its block goes
        first."""
        self.flush()
        rows = messages.view(np.uint8).reshape(len(messages), -1)
        if self._listened:
            for row in rows:
                self.send_single(row.tobytes())
        most = BLOCK_BYTES // self._codec.size
        for first in range(0, len(rows), most):
            self._send_rows(int(messages["sequence"][first]), rows[first : first + most])

    def _send_rows(self, first, rows):
        """Send one block, uint8 of shape (n, size)."""
        raw = rows.tobytes()
        block = HEAD.pack(ENCAPSULATION, first, rows.shape[1], len(raw)) + raw
        if self._send_block(block) or self._send_anew(block):
            return
        self.unsent += 1
        if self.unsent & (self.unsent - 1) == 0:  # 1, 2, 4, ...
            self._node.get_logger().warning(f"{self.unsent} blocks could not be sent so far")

    def _send_anew(self, block):
        """Send through a new publisher: one that has refused a message once never takes another (docs/safety.md).

        The old one stays for a while, since slow readers still read in its memory.
        """
        followers, end = self.followers, time.monotonic() + FOUND_S
        self._left.append(self._blocks)
        if len(self._left) > 1:
            self._node.destroy_publisher(self._left.pop(0))
        self._node.get_logger().warning(
            "the middleware refuses blocks, perhaps because a reader was killed: they go through a new publisher"
        )
        self._blocks = self._node.create_publisher(MessageBlock, self._blocks.topic_name, BLOCK_QOS)
        self._send_block = self._writer(self._blocks)
        while self.followers < followers and time.monotonic() < end:
            time.sleep(0.005)
        return self._send_block(block)

    def keep(self, sequence, raw):
        """The message of period ``sequence`` [1] into the block alone."""
        row = np.frombuffer(raw, np.uint8)
        while not keep(self.ring, row, sequence):
            self.send_closed()
        if crowded(self.ring):
            self.send_closed()

    def flush(self):
        """Close the block, if there is anything in it, and have it sent."""
        close(self.ring)
        self._listened = self._always or self.listeners > 0
        self.closed()

    def send_closed(self, wait=True):
        """Send all closed blocks; not ``wait``: nothing while another thread sends, which may be kept from its
        processor."""
        rows, fill, ends = self.ring
        if not self._sending.acquire(blocking=wait):
            return
        try:
            while ends[1] < ends[0]:
                slot = ends[1] % SLOTS
                count, first = fill[slot].tolist()
                self._send_rows(first, rows[slot, :count])
                if self.sent is not None:
                    self.sent(self._codec.array(rows[slot, :count]))
                ends[1] += 1
        finally:
            self._sending.release()

    @property
    def address(self):
        """Of the C structure of the publisher of single messages."""
        return int(self._single.handle.pointer)


class Refusals:
    """Sees that compiled code's messages were refused, and gives it a new publisher.

    Parameters
    ----------
    outlet : whose single messages compiled code sends.
    """

    def __init__(self, outlet):
        self._outlet, self._seen = outlet, 0

    def look(self, counts, links, name):
        """Renew if ``counts.refused`` has grown.

        ``counts``, ``links``: arrays of shape (1,), of one record each, that the compiled loop works with; ``name``:
        the publisher's place in ``links``. One thread, the sender's.
        """
        refused = int(counts["refused"][0])
        if refused != self._seen:
            self._outlet.renew_single()
            links[name] = self._outlet.address
            self._seen = int(counts["refused"][0])


class Sender:
    """A thread that sends the closed blocks of some outlets, away from the processor of the servo loop.

    Parameters
    ----------
    outlets : `Outlet`. semaphore : posted when a block has to go at once. also : called at every waking.
    """

    def __init__(self, outlets, semaphore, also=lambda: None):
        self._outlets, self._semaphore, self._also = outlets, semaphore, also
        self._going = True
        for outlet in outlets:
            outlet.closed = semaphore.post_now
        self._thread = threading.Thread(target=self._run, name="sender", daemon=True)
        self._thread.start()

    def _run(self):
        while self._going:
            self._semaphore.wait(LONGEST)
            self._also()
            for outlet in self._outlets:
                outlet.send_closed()

    def stop(self):
        """Send what is left; then outlets send by themselves."""
        self._going = False
        self._semaphore.post_now()
        self._thread.join(2.0)
        for outlet in self._outlets:
            outlet.closed = outlet.send_closed
            outlet.flush()


class Stream:
    """Every message of one topic of the servo path, in order; block by block where the sender makes blocks.

    Parameters
    ----------
    node : its node. servo : its servo path. kind, topic : message class and name.

    Attributes
    ----------
    readers : what to wait for.
    """

    def __init__(self, node, servo, kind, topic):
        self._node, self._servo, self._kind, self._topic = node, servo, kind, topic
        self._size, names = Codec(kind.__name__).size, SENDERS.get(topic, ())
        self._expected = {(node.get_namespace(), name) for name in names}
        self._holder, self._single_holder = Holder(node, BLOCKS + topic, names), Holder(node, topic, names)
        self._blocks = CheckedReader(
            servo.reader(MessageBlock, BLOCKS + topic, reader_qos(BLOCK_DEPTH, reliable=True)),
            HEAD.size,
            self._holder,
            HEAD.size + BLOCK_BYTES,
        )
        self.malformed = 0
        self._single, self._suspects, self._left = None, set(), None
        self.readers: tuple = (self._blocks.reader,)

    @property
    def publishers(self):
        """Number of matched senders [1]."""
        return self._blocks.publishers + (self._single.publishers if self._single else 0)

    @property
    def singly(self):
        """True if there is a sender that makes no blocks."""
        return self._single is not None

    def take(self):
        """The oldest messages that wait, uint8 of shape (n, size); None if none do. What is no block of these is
        dropped."""
        while (raw := self._blocks.take()) is not None:
            _, _, size, length = HEAD.unpack_from(raw)
            if self._size <= size < self._size + WORD and 0 < length <= len(raw) - HEAD.size and length % size == 0:
                return np.frombuffer(raw, np.uint8, length, HEAD.size).reshape(-1, size)
            self.malformed += 1
        raw = self._single.take() if self._single else None
        return None if raw is None else np.frombuffer(raw, np.uint8).reshape(1, -1)

    def take_all(self):
        """All messages that wait, uint8 of shape (n, size); None if none do. Those of another size are left for the
        next call."""
        found, self._left = [] if self._left is None else [self._left], None
        while (rows := self.take()) is not None:
            if found and rows.shape[1] != found[0].shape[1]:
                self._left = rows
                break
            found.append(rows)
        return None if not found else found[0] if len(found) == 1 else np.concatenate(found)

    def look(self):
        """Read singly too if there is a sender that makes no blocks; to be called now and then. True if that changed.

        A stranger beside the expected sender of blocks is nobody to be read: what the latter sends would come twice.
        """
        in_blocks = _senders(self._node, BLOCKS + self._topic)
        if in_blocks & self._expected:
            self._suspects = set()
            return self._single is not None and self._read_blocks_alone(self._single)
        if self._single is not None:
            return False
        blockless = _senders(self._node, self._topic) - in_blocks
        seen_twice, self._suspects = blockless & self._suspects, blockless  # its blocks may be found a moment later
        if not seen_twice:
            return False
        single = CheckedReader(
            self._servo.reader(self._kind, self._topic, reader_qos(DEPTH, reliable=True)),
            self._size,
            self._single_holder,
            self._size + WORD,
        )
        self._single, self.readers = single, (self._blocks.reader, single.reader)
        return True

    def _read_blocks_alone(self, single):
        self._node.destroy_subscription(single.reader.subscription)
        self._single, self.readers = None, (self._blocks.reader,)
        return True


def _senders(node, topic):
    """Namespaces and names of the nodes that publish on a topic."""
    full = node.resolve_topic_name(topic)
    return {(info.node_namespace, info.node_name) for info in node.get_publishers_info_by_topic(full)}
