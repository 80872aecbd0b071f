"""One chunk of an MCAP file while it is filled, and as the bytes that go to disk.

A message record is the opcode 0x05, its length, channel, sequence, log time, publish time and the
payload (mcap.dev/spec).  The `mcap` package builds each of them, and the index entry of each, as
Python objects; here a record is one `pack` and one append, and the index is built by numpy when
the chunk closes.
"""

import struct
import zlib

import numpy as np

MESSAGE, CHUNK, MESSAGE_INDEX = 0x05, 0x06, 0x07
MESSAGE_HEAD = struct.Struct("<BQHIQQ")
HEAD_DTYPE = np.dtype([("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"),
                       ("log_time", "<u8"), ("publish_time", "<u8")])
"""What stands before the payload of a message, 31 bytes."""

HEAD_BYTES = HEAD_DTYPE.itemsize
LENGTH_BEFORE_PAYLOAD = 22
"""Bytes of the head that count towards the record's length."""

INDEX_ENTRY = np.dtype([("log_time", "<u8"), ("offset", "<u8")])


class OpenChunk:
    """Messages on their way into a chunk."""

    def __init__(self):
        self.records = bytearray()
        self._channels, self._times, self._offsets = [], [], []
        self._blocks = []

    def __len__(self):
        return len(self.records)

    def add(self, channel, log_time, publish_time, sequence, payload):
        """Append one message: ``log_time`` and ``publish_time`` [ns], ``sequence`` number [1], ``payload`` bytes."""
        records = self.records
        self._channels.append(channel)
        self._times.append(log_time)
        self._offsets.append(len(records))
        records += MESSAGE_HEAD.pack(MESSAGE, LENGTH_BEFORE_PAYLOAD + len(payload), channel, sequence,
                                     log_time, publish_time)
        records += payload

    def add_block(self, channel, log_times, payloads):
        """Append messages of one size: ``log_times`` uint64 (n,) [ns], ``payloads`` uint8 (n, size)."""
        self._close_singles()
        count, size = payloads.shape
        rows = np.empty((count, HEAD_BYTES + size), np.uint8)
        head = np.zeros(count, HEAD_DTYPE)
        head["opcode"], head["length"], head["channel"] = MESSAGE, LENGTH_BEFORE_PAYLOAD + size, channel
        head["log_time"] = head["publish_time"] = log_times
        rows[:, :HEAD_BYTES] = head.view(np.uint8).reshape(count, HEAD_BYTES)
        rows[:, HEAD_BYTES:] = payloads
        entries = np.empty(count, INDEX_ENTRY)
        entries["log_time"] = log_times
        entries["offset"] = len(self.records) + np.arange(count) * rows.shape[1]
        self._blocks.append((np.full(count, channel, np.uint16), entries))
        self.records += rows.data.cast("B")

    def _close_singles(self):
        """Turn what `add` noted since the last block into one block."""
        if self._times:
            entries = np.empty(len(self._times), INDEX_ENTRY)
            entries["log_time"], entries["offset"] = self._times, self._offsets
            self._blocks.append((np.array(self._channels, np.uint16), entries))
            self._channels, self._times, self._offsets = [], [], []

    def index(self):
        """Channel to its index entries (`INDEX_ENTRY`), in the order of writing."""
        self._close_singles()
        channels = np.concatenate([block[0] for block in self._blocks])
        entries = np.concatenate([block[1] for block in self._blocks])
        return {int(channel): entries[channels == channel] for channel in np.unique(channels)}


def chunk_bytes(records, start, end, compression, compress):
    """A chunk record.

    Parameters
    ----------
    records : the message records, one after the other.
    start, end : earliest and latest log time in it [ns].
    compression : name that goes into the file, `zstd`, `lz4` or empty.
    compress : bytes to bytes.

    Returns
    -------
    bytes, and the size of the compressed messages.
    """
    packed = compress(records)
    name = compression.encode()
    head = struct.pack("<QQQII", start, end, len(records), zlib.crc32(records), len(name)) + name
    head += struct.pack("<Q", len(packed))
    return struct.pack("<BQ", CHUNK, len(head) + len(packed)) + head + packed, len(packed)


def index_bytes(channel, entries):
    """The message index record of one channel of a chunk, bytes, of its ``entries``, `INDEX_ENTRY` of shape (n,)."""
    body = entries.tobytes()
    return struct.pack("<BQHI", MESSAGE_INDEX, 6 + len(body), channel, len(body)) + body
