"""One MCAP file as a list of chunks: from its summary, or from a scan if it was cut off.

Only the summary is read at first; a chunk is read and unpacked when its messages are wanted.
"""

import io
import mmap
import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Metadata, MetadataIndex, Schema
from mcap.stream_reader import StreamReader

from microstage_ros.files import unreadable
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags.chunk import CHUNK, HEAD_BYTES, INDEX_ENTRY, MESSAGE, MESSAGE_INDEX
from microstage_ros.records.bags.mcap_sink import MAGIC

FOOTER = 29 + len(MAGIC)
RECORD_HEAD = struct.Struct("<BQ")
CHUNK_HEAD = struct.Struct("<QQQII")
SQLITE = b"SQLite format 3"
LARGEST_CHUNK = 1 << 32
"""Bytes of one unpacked chunk: writers make chunks of about 1 MiB; a head that gives more than this is damaged or
hostile."""
PIECE = 1 << 24
"""Bytes that are unpacked at a time, so that memory follows what there is and not what a head says."""


@dataclass
class ChunkPlace:
    """Where a chunk is and what it holds.

    Attributes
    ----------
    data : byte range of the packed messages in the file.
    size : bytes when unpacked.
    crc : CRC-32 of the unpacked bytes, 0 where the writer gave none (mcap.dev/spec, Chunk).
    start, end : first and last log time [ns].
    indexes : channel to the place of its message index record; empty if the file has none.
    """

    data: tuple
    size: int
    compression: str
    start: int
    end: int
    crc: int = 0
    indexes: dict = field(default_factory=dict)


class McapSource:
    """An MCAP file open for reading.

    Attributes
    ----------
    schemas, channels : number to `mcap.records.Schema` and `Channel`.
    chunks : list of `ChunkPlace`, by time.
    metadata : name to dict of the file's metadata records.
    cut_off : True if the file has no closing part (the recorder crashed); everything up to its
        last whole chunk is there.

    Raises
    ------
    InputError : not an MCAP file, or damaged.
    """

    def __init__(self, path):
        self.path = Path(path)
        self.schemas, self.channels, self.chunks, self.metadata = {}, {}, [], {}
        self.cut_off = False
        self._bytes = _mapped(self.path)
        try:
            if not self._read_summary():
                self._scan()
        except (McapError, struct.error, ValueError, IndexError, OverflowError) as error:
            if isinstance(error, InputError):
                raise
            says = str(error) or type(error).__name__
            raise InputError(self.path, f"damaged ({says})",
                             "a whole MCAP file; `microstage recover` keeps what is whole of it") from None
        self.chunks.sort(key=lambda chunk: (chunk.start, chunk.data))

    def unpack(self, chunk):
        """The message records of a chunk, uint8, shape (bytes,).

        Raises
        ------
        InputError : the chunk is damaged or packed in an unknown way.
        """
        packed = self._bytes[chunk.data[0]:chunk.data[1]]
        place = f"{self.path}: chunk at byte {chunk.data[0]}"
        if chunk.size > LARGEST_CHUNK:
            raise InputError(place, f"{chunk.size} bytes unpacked", f"at most {LARGEST_CHUNK} bytes")
        try:
            if chunk.compression == "zstd":
                raw = _limited(zstandard.ZstdDecompressor().stream_reader(io.BytesIO(packed)), chunk.size)
            elif chunk.compression == "lz4":
                raw = _limited(lz4.frame.LZ4FrameFile(io.BytesIO(packed)), chunk.size)
            elif chunk.compression == "":
                raw = packed
            else:
                raise InputError(f"{self.path}: compression", chunk.compression, "zstd, lz4 or none")
        except (zstandard.ZstdError, RuntimeError, EOFError, OverflowError, MemoryError) as error:
            raise InputError(place, str(error), "a whole chunk") from None
        if len(raw) != chunk.size:
            raise InputError(place, f"{'more' if len(raw) > chunk.size else len(raw)} bytes", f"{chunk.size} bytes")
        if chunk.crc and zlib.crc32(raw) != chunk.crc:
            raise InputError(place, "bytes that do not match their CRC-32", "an undamaged chunk")
        return np.frombuffer(raw, np.uint8)

    def entries(self, chunk):
        """Channel to (log time [ns], offset [byte]) of its messages in a chunk, `chunk.INDEX_ENTRY`, each (n,)."""
        if not chunk.indexes:
            return message_entries(self.unpack(chunk))
        return {channel: self._index(place) for channel, place in chunk.indexes.items()}

    def _index(self, place):
        if place + 15 > len(self._bytes):
            raise InputError(f"{self.path}: place of a message index", place, f"within the {len(self._bytes)} bytes")
        opcode, length = RECORD_HEAD.unpack_from(self._bytes, place)
        size = struct.unpack_from("<I", self._bytes, place + 11)[0]
        if opcode != MESSAGE_INDEX or size + 6 > length or size % INDEX_ENTRY.itemsize \
                or place + 15 + size > len(self._bytes):
            raise InputError(f"{self.path}: byte {place}", f"record {opcode} of {length} bytes", "a message index")
        return np.frombuffer(self._bytes, INDEX_ENTRY, size // INDEX_ENTRY.itemsize, place + 15)

    def _read_summary(self):
        """Fill in from the closing part; False if there is none or it does not tell enough."""
        raw = self._bytes
        if len(raw) < FOOTER + len(MAGIC) or raw[-len(MAGIC):] != MAGIC or raw[-FOOTER] != Opcode.FOOTER:
            return False
        start = struct.unpack_from("<Q", raw, len(raw) - FOOTER + 9)[0]
        if start == 0:
            return False
        counted = 0
        for record in StreamReader(io.BytesIO(raw[start:]), skip_magic=True).records:
            if isinstance(record, Schema):
                self.schemas[record.id] = record
            elif isinstance(record, Channel):
                self.channels[record.id] = record
            elif isinstance(record, ChunkIndex):
                self._add_chunk(record.chunk_start_offset, dict(record.message_index_offsets))
            elif isinstance(record, MetadataIndex):
                self._add_metadata(record.offset)
            elif hasattr(record, "message_count"):
                counted = record.message_count
        return bool(self.chunks) or counted == 0

    def _add_chunk(self, place, indexes):
        """Note the chunk record at `place`."""
        opcode, length = RECORD_HEAD.unpack_from(self._bytes, place)
        if opcode != CHUNK or place + 9 + length > len(self._bytes):
            raise InputError(f"{self.path}: byte {place}", f"record {opcode} of {length} bytes", "a chunk")
        start, end, size, crc, name = CHUNK_HEAD.unpack_from(self._bytes, place + 9)
        at = place + 9 + CHUNK_HEAD.size
        compression = bytes(self._bytes[at:at + name]).decode()
        packed = struct.unpack_from("<Q", self._bytes, at + name)[0]
        data = (at + name + 8, at + name + 8 + packed)
        self.chunks.append(ChunkPlace(data, size, compression, start, end, crc, indexes))

    def _add_metadata(self, place):
        length = RECORD_HEAD.unpack_from(self._bytes, place)[1]
        record = Metadata.read(ReadDataStream(io.BytesIO(self._bytes[place + 9:place + 9 + length])))
        self.metadata[record.name] = dict(record.metadata)

    def _scan(self):
        """Fill in from the records one by one, up to the last whole one."""
        self.schemas, self.channels, self.chunks, self.metadata = {}, {}, [], {}
        place, loose, closed = len(MAGIC), [], False
        while place + 9 <= len(self._bytes):
            opcode, length = RECORD_HEAD.unpack_from(self._bytes, place)
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                closed = True
                break
            if opcode == 0 or place + 9 + length > len(self._bytes):
                break
            if opcode == MESSAGE:
                loose.append(place)
            elif opcode == CHUNK:
                self._add_chunk(place, {})
            elif opcode == MESSAGE_INDEX and self.chunks:
                channel = struct.unpack_from("<H", self._bytes, place + 9)[0]
                self.chunks[-1].indexes[channel] = place
            elif opcode == Opcode.METADATA:
                self._add_metadata(place)
            else:
                self._learn(opcode, self._bytes[place + 9:place + 9 + length])
            place += 9 + length
        self.cut_off = not closed
        if loose:
            self._add_loose(place)
        self._repair()

    def _learn(self, opcode, body):
        """Note a schema or channel record."""
        if opcode == Opcode.SCHEMA:
            record = Schema.read(ReadDataStream(io.BytesIO(body)))
            self.schemas[record.id] = record
        elif opcode == Opcode.CHANNEL:
            record = Channel.read(ReadDataStream(io.BytesIO(body)))
            self.channels[record.id] = record

    def _add_loose(self, end):
        """Messages outside of chunks: take the whole data part as one chunk that is not packed."""
        records = np.frombuffer(self._bytes, np.uint8)[len(MAGIC):end]
        times = np.concatenate([entries["log_time"] for entries in message_entries(records).values()])
        self.chunks.append(ChunkPlace((len(MAGIC), end), end - len(MAGIC), "", int(times.min()), int(times.max())))

    def _repair(self):
        """After a scan: index chunks whose index was lost, learn the channels that are declared inside chunks."""
        for chunk in self.chunks:
            if chunk is self.chunks[-1] and self.cut_off:
                chunk.indexes = {}
            if not chunk.indexes or not set(chunk.indexes) <= set(self.channels):
                for opcode, body in _records(self.unpack(chunk)):
                    if opcode != MESSAGE:
                        self._learn(opcode, body)


def _limited(stream, size):
    """All that a decompressing stream holds, read no further than one byte beyond the ``size`` that its head gives."""
    parts, rest = [], size + 1
    while rest > 0 and (part := stream.read(min(rest, PIECE))):
        parts.append(part)
        rest -= len(part)
    return b"".join(parts)


def _mapped(path):
    """The bytes of an MCAP file, mapped into memory."""
    try:
        with open(path, "rb") as file:
            begin = file.read(16)
            if begin.startswith(SQLITE) or path.suffix == ".db3":
                raise InputError(path, "an SQLite bag", "an MCAP bag; `ros2 bag convert` makes one of it")
            if not begin.startswith(MAGIC):
                raise InputError(path, begin[:8].hex(" ") or "an empty file", "an MCAP file (89 4d 43 41 50 …)")
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except OSError as error:
        raise unreadable(path, error, "an MCAP file that can be read") from None


def _records(raw):
    """Yields (opcode, body) of the records in unpacked bytes."""
    view, place = memoryview(raw), 0
    while place + 9 <= len(view):
        opcode, length = RECORD_HEAD.unpack_from(view, place)
        yield opcode, bytes(view[place + 9:place + 9 + length])
        place += 9 + length


def message_entries(raw):
    """Channel to (log time [ns], offset [byte]) of the messages in unpacked bytes ``raw``, uint8 of shape (bytes,).

    Found by going through them.
    """
    found, place, view = {}, 0, memoryview(raw)
    while place + 9 <= len(view):
        opcode, length = RECORD_HEAD.unpack_from(view, place)
        if opcode == MESSAGE and place + HEAD_BYTES <= len(view):
            channel, _, log_time = struct.unpack_from("<HIQ", view, place + 9)
            found.setdefault(channel, []).append((log_time, place))
        place += 9 + length
    return {channel: np.array(entries, INDEX_ENTRY) for channel, entries in found.items()}
