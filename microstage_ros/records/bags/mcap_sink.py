"""An MCAP file being written by a thread of its own, that survives a crash and a full disk.

Chunks are handed over through a queue of bounded length and are compressed and written behind the
back of the caller.  If the disk is slow the queue fills and the caller waits; memory stays bounded.
Every chunk reaches the operating system in one piece, so a process that dies leaves a file that can
be read up to its last whole chunk.  If the disk is full, the last incomplete chunk is taken back, the
file gets its closing part (if need be in the place of a whole chunk more), and every later call tells.
"""

import errno
import fcntl
import io
import queue
import struct
import threading
import zlib
from collections import Counter
from contextlib import suppress

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Statistics,
    SummaryOffset,
)

from microstage_ros import __version__
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags.chunk import chunk_bytes, index_bytes
from microstage_ros.records.bags.chunk_log import ChunkLog

MAGIC = b"\x89MCAP0\r\n"
COMPRESSORS = {"zstd": lambda: zstandard.ZstdCompressor(level=1).compress,
               "lz4": lambda: lambda raw: lz4.frame.compress(raw, compression_level=0, store_size=True),
               "": lambda: bytes}
"""Name in the file to a maker of the compressing function."""

WAITING_CHUNKS = 32
"""Chunks that may wait for the disk before the caller has to."""


class BagStopped(OSError):
    """The bag could not be written on; what was written before is closed and can be read."""


class McapSink:
    """Writes chunks and records to one file.

    Parameters
    ----------
    path : the file, for messages.
    file : opened for unbuffered binary writing and seeking.
    compression : a key of `COMPRESSORS`.
    """

    def __init__(self, path, file, compression):
        if compression not in COMPRESSORS:
            raise InputError(f"{path}: compression", compression, "one of 'zstd', 'lz4', ''")
        self.path = path
        self.compression = compression
        self.counts: Counter = Counter()
        self.start_time = self.end_time = None
        self.failure = None
        self._compress = COMPRESSORS[compression]()
        self._file = file
        _hold(file)
        self._place = 0
        self._chunks, self._metadata = ChunkLog(), []
        self._schemas, self._channels = [], []
        self._queue: queue.Queue = queue.Queue(WAITING_CHUNKS)
        try:
            self._put(MAGIC + _bytes_of(Header("ros2", f"microstage_ros {__version__}")))
        except OSError as error:
            self.failure = error
            file.close()
            self.check()
        self._thread = threading.Thread(target=self._work, name="bag writer", daemon=True)
        self._thread.start()

    @property
    def place(self):
        """Bytes in the file."""
        return self._place

    @property
    def waiting(self):
        """Chunks that wait for the disk."""
        return self._queue.qsize()

    def add_channel(self, schema, channel):
        """Write a schema and its channel (`mcap.records`) ahead of the chunks that use them."""
        self._hand(lambda: self._write_channel(schema, channel))

    def add_metadata(self, name: str, values: dict[str, str]):
        """Write a metadata record; ``values``: {name: text}."""
        self._hand(lambda: self._write_metadata(Metadata(name=name, metadata=values)))

    def add_chunk(self, chunk):
        """Compress and write a filled `OpenChunk`."""
        self._hand(lambda: self._write_chunk(chunk))

    def wait(self):
        """Wait until everything handed over is on its way to the disk; raise BagStopped if it is not."""
        self._queue.join()
        self.check()

    def close(self):
        """Write the closing part and close the file; raise BagStopped if the bag had stopped before."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()
        self.check()

    def check(self):
        """Raise BagStopped if the bag has stopped."""
        if self.failure is not None:
            raise BagStopped(self.failure.errno, f"{self.path}: {self.failure.strerror or self.failure}; the bag is "
                             f"closed and holds the {sum(self.counts.values())} messages before that")

    def _hand(self, job):
        self.check()
        self._queue.put(job)

    def _work(self):
        """The thread: jobs until None, then the closing part; after a failure jobs are dropped."""
        while True:
            job = self._queue.get()
            try:
                if self.failure is None:
                    if job is None:
                        self._put(self._closing())
                    else:
                        job()
            except OSError as error:
                self._stop(error)
            except Exception as error:  # noqa: BLE001 the caller must hear of it, and the queue must not stand still
                self._stop(OSError(errno.EIO, f"{type(error).__name__}: {error}"))
            finally:
                self._queue.task_done()
            if job is None:
                self._file.close()
                self._chunks.close()
                return

    def _put(self, raw):
        """Write all of `raw` at the end of the file."""
        view = memoryview(raw)
        while view:
            view = view[self._file.write(view):]
        self._place += len(raw)

    def _write_channel(self, schema, channel):
        self._put(_bytes_of(schema) + _bytes_of(channel))
        self._schemas.append(schema)
        self._channels.append(channel)

    def _write_metadata(self, metadata):
        raw = _bytes_of(metadata)
        index = MetadataIndex(offset=self._place, length=len(raw), name=metadata.name)
        self._put(raw)
        self._metadata.append(index)

    def _write_chunk(self, chunk):
        index = chunk.index()
        start = min(int(entries["log_time"].min()) for entries in index.values())
        end = max(int(entries["log_time"].max()) for entries in index.values())
        raw, packed = chunk_bytes(chunk.records, start, end, self.compression, self._compress)
        indexes, offsets, place = [], {}, self._place + len(raw)
        for channel, entries in index.items():
            offsets[channel] = place
            indexes.append(index_bytes(channel, entries))
            place += len(indexes[-1])
        entry = ChunkIndex(
            chunk_start_offset=self._place, chunk_length=len(raw), message_start_time=start, message_end_time=end,
            message_index_offsets=offsets, message_index_length=place - self._place - len(raw),
            compression=self.compression, compressed_size=packed, uncompressed_size=len(chunk.records))
        self._put(b"".join([raw, *indexes]))
        counts = {channel: len(entries) for channel, entries in index.items()}
        self._chunks.append(
            _bytes_of(entry), [entry.chunk_start_offset, list(counts.items()), self.start_time, self.end_time]
        )
        self.counts.update(counts)
        self.start_time = start if self.start_time is None else min(start, self.start_time)
        self.end_time = end if self.end_time is None else max(end, self.end_time)

    def _drop_last_chunk(self):
        """Make the place of the last whole chunk free again."""
        self._place, counts, self.start_time, self.end_time = self._chunks.pop()
        self._metadata = [index for index in self._metadata if index.offset < self._place]
        self.counts -= Counter(dict(counts))

    def _stop(self, error):
        """Close the file as well as the disk allows after a failed write, and remember why."""
        self.failure = error
        while True:
            try:
                self._file.seek(self._place)
                self._file.truncate()
                self._put(self._closing())
                return
            except OSError:
                if not len(self._chunks):
                    return
                self._drop_last_chunk()

    def _closing(self):
        """Everything after the data: summary, offsets, footer."""
        groups = [(Opcode.SCHEMA, _bytes_of(*self._schemas)), (Opcode.CHANNEL, _bytes_of(*self._channels)),
                  (Opcode.STATISTICS, _bytes_of(self._statistics())),
                  (Opcode.CHUNK_INDEX, self._chunks.records()),
                  (Opcode.METADATA_INDEX, _bytes_of(*self._metadata))]
        data_end = _bytes_of(DataEnd(0))
        summary_start = self._place + len(data_end)
        summary, offsets = b"", b""
        for opcode, part in groups:
            offsets += _bytes_of(SummaryOffset(opcode, summary_start + len(summary), len(part))) if part else b""
            summary += part
        offset_start = summary_start + len(summary)
        checked = summary + offsets + struct.pack("<BQQQ", Opcode.FOOTER, 20, summary_start, offset_start)
        return (
            data_end + summary + offsets + _bytes_of(Footer(summary_start, offset_start, zlib.crc32(checked))) + MAGIC
        )

    def _statistics(self):
        return Statistics(
            attachment_count=0, channel_count=len(self._channels), channel_message_counts=dict(self.counts),
            chunk_count=len(self._chunks), message_count=sum(self.counts.values()), metadata_count=len(self._metadata),
            message_start_time=self.start_time or 0, message_end_time=self.end_time or 0,
            schema_count=len(self._schemas))


def _bytes_of(*records):
    """Records of the `mcap` package as bytes."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


def open_file(path):
    """A file for a sink: unbuffered, so that what was written survives the process.

    Raises
    ------
    InputError : the place cannot be written.
    """
    try:
        return io.FileIO(path, "w+")
    except OSError as error:
        raise InputError(path, error.strerror, "a place that can be written") from None


def _hold(file):
    """Let others know that ``file`` is being written, until it is closed or its process ends (`is_being_written`)."""
    with suppress(OSError, AttributeError, io.UnsupportedOperation):  # of a file system without locks
        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)


def is_being_written(path):
    """Whether a recorder has the bag's file ``path`` open."""
    with suppress(OSError), open(path, "rb") as file:
        try:
            fcntl.flock(file.fileno(), fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False
