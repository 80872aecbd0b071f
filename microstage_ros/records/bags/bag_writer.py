"""Bags as rosbag2 lays them out: raw message bytes in, a folder that every ROS 2 tool opens out.

with BagWriter("runs/first", custom_data={"seed": "1"}) as bag:
state = bag.add_channel("/axis/state", installed_definition("microstage_msgs/msg/AxisState"))
bag.write(state, time_ns, raw_bytes)
"""

from pathlib import Path

import numpy as np
from mcap.records import Channel, Schema

from microstage_ros import __version__
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags.bag_metadata import (
    CUSTOM_DATA,
    Qos,
    TopicInfo,
    as_text,
    folder_text,
    metadata_of,
    metadata_of_files,
    qos_text,
)
from microstage_ros.records.bags.chunk import HEAD_BYTES, OpenChunk
from microstage_ros.records.bags.mcap_sink import BagStopped, McapSink, open_file

CHUNK_BYTES = 1 << 20
"""Messages in one chunk, before compression.  Measured on servo messages: four times as much
packs no better, a quarter as much costs a tenth of the speed of reading."""

CHUNK_NS = 1_000_000_000
"""A chunk closes after this much log time, so that a crash costs one second at most."""

DEFAULT_QOS = (Qos(),)


class BagWriter:
    """Writes one bag.

    Parameters
    ----------
    path : a folder to make, or a file ending in `.mcap` for the file alone.
    custom_data : name to text that goes into the bag beside the messages: parameters, version,
        seed, axis file.  `microstage_ros` (the version) is added; the attribute of this name takes
        more until the bag is closed.
    split_bytes : a file that has grown so large is closed and the next one begun (a folder only); 0: never.
    keep_files : at most so many files; the oldest goes when another begins; 0: all are kept.
    compression : `zstd` (level 1, 23 bytes for a servo message of 98), `lz4` (33 bytes, half the
        effort) or an empty string.
    ros_distro : goes into the folder's metadata.

    Raises
    ------
    InputError : the place exists or cannot be written.
    """

    def __init__(self, path, custom_data=None, compression="zstd", ros_distro="jazzy", split_bytes=0, keep_files=0):
        path = Path(path)
        self._split_bytes, self._keep_files, self._compression = split_bytes, keep_files, compression
        self._earlier, self._channels = [], []
        self.folder = None if path.suffix == ".mcap" else path
        self.file = path if self.folder is None else path / f"{path.name}_0.mcap"
        self.custom_data = {"microstage_ros": __version__, **(custom_data or {})}
        self.topics = []
        self._ros_distro = ros_distro
        self._chunk = OpenChunk()
        self._closed = False
        self._close_at_ns = 0
        _make_place(path, self.folder)
        self._sink = McapSink(self.file, open_file(self.file), compression)
        self._write_metadata()
        self._sink.add_metadata(CUSTOM_DATA, _texts(self.custom_data))

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        self.close()

    @property
    def waiting_chunks(self):
        """Chunks that wait for a slow disk; at `mcap_sink.WAITING_CHUNKS` writing has to wait too."""
        return self._sink.waiting

    @property
    def bytes_written(self):
        """Bytes in the file so far."""
        return self._sink.place

    def add_channel(self, topic, definition, qos=DEFAULT_QOS):
        """Announce a topic before its first message.

        Parameters
        ----------
        topic : full name, beginning with a slash.
        definition : `records.bags.definition.Definition` of its type.
        qos : what the publishers offered.

        Returns
        -------
        int : the channel to write to.

        Raises
        ------
        InputError : the topic is in the bag already.
        """
        if any(known.name == topic for known in self.topics):
            raise InputError(f"{self.file}: topic", topic, "every topic once")
        number = len(self.topics) + 1
        info = TopicInfo(number, topic, definition.name, definition.hash, tuple(qos))
        schema = Schema(id=number, name=definition.name, encoding="ros2msg", data=definition.text.encode())
        metadata = {"offered_qos_profiles": qos_text(info.qos), "topic_type_hash": info.hash}
        channel = Channel(id=number, topic=topic, message_encoding="cdr", metadata=metadata, schema_id=number)
        self._sink.add_channel(schema, channel)
        self._channels.append((schema, channel))
        self.topics.append(info)
        return number

    def write(self, channel, log_time_ns, payload, publish_time_ns=None, sequence=0):
        """Append one message: its CDR bytes as they crossed, and when they came [ns].

        ``sequence``: the publisher's number of it [1], 0 where it gives none.

        Raises
        ------
        BagStopped : the disk is full or failed; the bag is closed and can be read.
        """
        chunk = self._chunk
        if not chunk.records:
            self._close_at_ns = log_time_ns + CHUNK_NS
        chunk.add(channel, log_time_ns, log_time_ns if publish_time_ns is None else publish_time_ns, sequence, payload)
        if len(chunk.records) >= CHUNK_BYTES or log_time_ns >= self._close_at_ns:
            self._close_chunk()

    def write_block(self, channel, log_times_ns, payloads):
        """Append many messages of one size.

        Parameters
        ----------
        log_times_ns : shape (n,), ascending.
        payloads : CDR bytes, uint8, shape (n, size).

        Raises
        ------
        BagStopped : as for `write`.
        """
        payloads = np.ascontiguousarray(payloads, dtype=np.uint8)
        log_times = np.asarray(log_times_ns, dtype=np.uint64)
        record = HEAD_BYTES + payloads.shape[1]
        if len(log_times) and not self._chunk.records:
            self._close_at_ns = int(log_times[0]) + CHUNK_NS
        if len(log_times) and log_times[-1] >= self._close_at_ns:
            self._close_chunk()
            self._close_at_ns = int(log_times[-1]) + CHUNK_NS
        done = 0
        while done < len(payloads):
            rows_left = max((CHUNK_BYTES - len(self._chunk)) // record, 1)
            part = slice(done, done + rows_left)
            self._chunk.add_block(channel, log_times[part], payloads[part])
            done += rows_left
            if len(self._chunk) + record > CHUNK_BYTES:
                self._close_chunk()

    def hand_over(self):
        """Close the chunk in hand; what is in it survives this process a moment later."""
        self._close_chunk()
        if self._split_bytes and self.folder is not None and self._sink.place > self._split_bytes:
            self._next_file(self.folder)

    def _next_file(self, folder):
        """Close the file and begin the next one of the ``folder``."""
        self._close_file()
        self._earlier.append((self.file.name, self._part()))
        number = int(self.file.stem.rpartition("_")[2]) + 1
        if self._keep_files and len(self._earlier) >= self._keep_files:
            oldest, _ = self._earlier.pop(0)
            (folder / oldest).unlink(missing_ok=True)
        self.file = folder / f"{folder.name}_{number}.mcap"
        self._sink = McapSink(self.file, open_file(self.file), self._compression)
        self._sink.add_metadata(CUSTOM_DATA, _texts(self.custom_data))
        for schema, channel in self._channels:
            self._sink.add_channel(schema, channel)
        self._write_metadata()

    def _part(self):
        """What `metadata_of_files` needs of the file in hand."""
        sink = self._sink
        return list(self.topics), dict(sink.counts), sink.start_time, sink.end_time, _texts(self.custom_data)

    def flush(self):
        """Close the chunk in hand and wait until the disk has it; call it when messages are rare."""
        self._close_chunk()
        self._sink.wait()

    def close(self):
        """Write what is left, the file's closing part and the folder's metadata.

        Raises
        ------
        BagStopped : the bag had stopped; what it holds is closed and can be read.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self._close_file()
        finally:
            self._write_metadata()

    def _close_file(self):
        try:
            self.flush()  # the metadata counts what is written
            self._sink.add_metadata("rosbag2", {"serialized_metadata": as_text(self._metadata())})
        except BagStopped:
            pass  # reported below, after the metadata of what was kept is written
        self._sink.close()

    def _close_chunk(self):
        if len(self._chunk):
            chunk, self._chunk = self._chunk, OpenChunk()
            self._sink.add_chunk(chunk)

    def _metadata(self):
        sink = self._sink
        if self._earlier:
            return metadata_of_files([*self._earlier, (self.file.name, self._part())], self._ros_distro)
        return metadata_of(self.file.name, self.topics, sink.counts, sink.start_time, sink.end_time,
                           _texts(self.custom_data), self._ros_distro)

    def _write_metadata(self):
        """The folder's metadata; at the start too, so that a bag that crashes has one."""
        if self.folder is None:
            return
        try:
            (self.folder / "metadata.yaml").write_text(folder_text(self._metadata()), encoding="utf-8")
        except OSError as error:
            if not self._closed:
                raise InputError(self.folder, error.strerror, "a place that can be written") from None
            if self._sink.failure is None:
                raise BagStopped(error.errno, f"{self.folder}/metadata.yaml: {error.strerror}") from None


def _make_place(path, folder):
    """Make the folder that the bag goes into; refuse to write over a bag."""
    if path.exists() and (folder is not None or path.is_dir()):
        raise InputError(path, "there already", "a name that is free")
    try:
        (folder or path.parent).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(path, error.strerror, "a place that can be written") from None


def _texts(values):
    """Every value as text, as bags hold it."""
    return {str(name): value if isinstance(value, str) else str(value) for name, value in values.items()}
