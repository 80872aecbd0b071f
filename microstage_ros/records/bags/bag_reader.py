"""A bag, or a set of bags, as numpy arrays by topic.

Messages whose strings and sequences keep their lengths come straight from the unpacked chunk: one
gather of fixed-size records per chunk and topic, no Python object per message.  The others are
decoded one by one with `rosbags`.  A time range is found in the index; chunks outside of it are
not read.
"""

from bisect import bisect_left
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Lock

import numpy as np
import yaml

from microstage_ros.files import missing
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.yaml_text import yaml_tree
from microstage_ros.records.bags.bag_metadata import CUSTOM_DATA
from microstage_ros.records.bags.chunk import HEAD_BYTES, HEAD_DTYPE, LENGTH_BEFORE_PAYLOAD
from microstage_ros.records.bags.definition import installed_definition, parse_definition, service_event_text
from microstage_ros.records.bags.layout import NoFixedLayout, layout_of_message, layout_of_type
from microstage_ros.records.bags.mcap_sink import is_being_written
from microstage_ros.records.bags.mcap_source import ChunkPlace, McapSource
from microstage_ros.records.bags.variable import decode_messages

THREADS = 2
"""Chunks unpacked at the same time."""

FOREVER = 2**63 - 1
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
METADATA = "the metadata of a rosbag2 folder"
"""The safe loader in C where PyYAML has it: axis files and parameters make metadata long."""



@dataclass
class Topic:
    """One topic of a bag: type, schema text, schema encoding and message encoding."""

    name: str
    type: str
    text: str
    encoding: str
    message_encoding: str

    def definition(self):
        """Its parsed definition; from the installed package if the bag lacks it."""
        if not self.text:
            return installed_definition(self.type)
        if "/srv/" in self.type and self.type.endswith("_Event") and "\n---" in self.text:
            return parse_definition(self.type, service_event_text(self.type, self.text))
        return parse_definition(self.type, self.text)


class Bag:
    """An MCAP file or a rosbag2 folder, open for reading.

    Attributes
    ----------
    topics : name to `Topic`.
    custom_data : what the recorder left beside the messages, name to text.
    cut_off : True if the recorder crashed; what it had written is there.

    Raises
    ------
    InputError : no such bag, SQLite, compressed as a whole, damaged.
    """

    def __init__(self, path):
        self.path = Path(path)
        files, self.custom_data = _files_of(self.path)
        self.sources = [McapSource(file) for file in files]
        self.cut_off = any(source.cut_off for source in self.sources)
        self.topics = {}
        for source in self.sources:
            self.custom_data = {**source.metadata.get(CUSTOM_DATA, {}), **_custom_data(source), **self.custom_data}
            for channel in source.channels.values():
                schema = source.schemas.get(channel.schema_id)
                kind, text, encoding = (schema.name, schema.data.decode("utf-8", "replace"), schema.encoding) \
                    if schema else ("", "", "")
                self.topics.setdefault(channel.topic, Topic(channel.topic, kind, text, encoding,
                                                            channel.message_encoding))

    @property
    def start_ns(self):
        """First log time [ns], None in an empty bag."""
        return min((chunk.start for source in self.sources for chunk in source.chunks), default=None)

    @property
    def end_ns(self):
        """Last log time [ns], None in an empty bag."""
        return max((chunk.end for source in self.sources for chunk in source.chunks), default=None)

    @property
    def recorded(self):
        """Names of the topics of which it holds a message; one that was only announced is not among them."""
        return {source.channels[number].topic for source in self.sources for chunk in source.chunks
                for number in source.entries(chunk) if number in source.channels}

    @property
    def remarks(self):
        """What is to be said of a bag that was cut off, one sentence each."""
        if not self.cut_off:
            return ()
        length = (self.end_ns - self.start_ns) * 1e-9 if self.start_ns is not None else 0.0
        if any(is_being_written(source.path) for source in self.sources):
            return (f"{self.path}: is being recorded; read are the first {length:.4g} s",)
        return (f"{self.path}: cut off after {length:.4g} s; `microstage recover {self.path}` makes it whole",)

    def read(self, topics=None, start=None, end=None):
        """Messages as arrays, log times ``start`` <= t < ``end`` [ns]; see `read_bag`."""
        wanted = self._wanted(topics)
        parts = list(self._parts(wanted, start, end))
        sizes = {name: 0 for name in wanted}
        for part in parts:
            for name, entries in part.entries.items():
                part.at[name] = sizes[name]
                sizes[name] += len(entries)
        gathered = {name: _Gathered(count) for name, count in sizes.items()}
        with ThreadPoolExecutor(THREADS) as pool:
            for _ in pool.map(lambda part: part.gather_into(gathered), parts):
                pass
        return {name: _as_array(self, self.topics[name], gathered[name]) for name in wanted}

    def raw_messages(self, topics=None, start=None, end=None):
        """Yields (topic, log time [ns], CDR bytes) in the order of log time; few chunks are in memory at once.

        ``topics``: names, one name, or None for all; ``start`` <= log time < ``end`` [ns].
        """
        parts = sorted(self._parts(self._wanted(topics), start, end), key=lambda part: part.chunk.start)
        waiting = []
        for number, part in enumerate(parts):
            waiting = sorted([*waiting, *part.messages()], key=lambda message: message[:2])
            later = parts[number + 1].chunk.start if number + 1 < len(parts) else FOREVER
            ready = bisect_left(waiting, later, key=lambda message: message[0])
            for time, _, name, payload in waiting[:ready]:
                yield name, time, payload
            del waiting[:ready]

    def _wanted(self, topics):
        """Names asked for, all if None; InputError for one that the bag lacks."""
        if topics is None:
            return list(self.topics)
        names = [topics] if isinstance(topics, str) else list(topics)
        for name in names:
            if name not in self.topics:
                raise InputError(f"{self.path}: topic", name, "one of " + ", ".join(sorted(self.topics)))
        return names

    def _parts(self, wanted, start, end):
        """Yields the pieces of work: a chunk and which of its messages are wanted."""
        start, end = (0 if start is None else start), (FOREVER if end is None else end)
        for source in self.sources:
            names = {number: channel.topic for number, channel in source.channels.items() if channel.topic in wanted}
            for chunk in source.chunks:
                if chunk.end < start or chunk.start >= end:
                    continue
                if chunk.indexes and not set(chunk.indexes) & set(names):
                    continue
                entries = {}
                for number, index in source.entries(chunk).items():
                    if number in names and len(index):
                        entries[names[number]] = _between(index, start, end, chunk)
                yield _Part(source, chunk, {name: index for name, index in entries.items() if len(index)}, {})


@dataclass
class _Part:
    """A chunk, the wanted messages in it by topic, and where they go in the arrays."""

    source: McapSource
    chunk: ChunkPlace
    entries: dict
    at: dict

    def gather_into(self, gathered):
        """Unpack the chunk and copy the wanted messages."""
        if self.entries:
            raw = self.source.unpack(self.chunk)
            for name, entries in self.entries.items():
                ends = self.record_ends(raw, entries)
                gathered[name].put(self.at[name], raw, entries["offset"].astype(np.int64), ends)

    def messages(self):
        """The wanted messages as (log time, place in the chunk, topic, CDR bytes)."""
        found = []
        if self.entries:
            raw = self.source.unpack(self.chunk)
            for name, entries in self.entries.items():
                begins, ends = entries["offset"].tolist(), self.record_ends(raw, entries).tolist()
                found += [(time, begin, name, raw[begin + HEAD_BYTES:end].tobytes())
                          for time, begin, end in zip(entries["log_time"].tolist(), begins, ends)]
        return found

    def record_ends(self, raw, entries):
        """Where the message records end that begin at the offsets of an index; InputError if it lies."""
        offsets = entries["offset"]
        place = f"{self.source.path}: chunk at byte {self.chunk.data[0]}"
        if int(offsets.max()) + HEAD_BYTES > len(raw):
            raise InputError(place, f"a message at byte {int(offsets.max())}", f"messages within its {len(raw)} bytes")
        lengths = np.ndarray((len(raw) - 8,), "<u8", raw.data, offset=1, strides=(1,))[offsets.astype(np.int64)]
        bad = (lengths < LENGTH_BEFORE_PAYLOAD) | (lengths > len(raw) - 9 - offsets)
        if bad.any():
            raise InputError(
                place, f"a message of {int(lengths[bad][0])} bytes", f"messages within its {len(raw)} bytes"
            )
        return (offsets + lengths + 9).astype(np.int64)


class _Gathered:
    """Messages of one topic, heads and payloads: rows of one size, or bytes one by one."""

    def __init__(self, count):
        self.count = count
        self.rows = None
        self.pieces = {}
        self._making = Lock()

    def put(self, at, raw, offsets, ends):
        """Copy the message records from `offsets` to `ends` of an unpacked chunk."""
        record = int(ends[0] - offsets[0])
        with self._making:  # chunks come from several threads: a second array would lose what is in the first
            if self.rows is None:
                self.rows = np.empty(self.count, f"V{record}")
        if self.rows.itemsize == record and (ends - offsets == record).all():
            every_byte = np.ndarray((len(raw) - record + 1,), self.rows.dtype, raw.data, strides=(1,))
            self.rows[at:at + len(offsets)] = every_byte[offsets]
        else:
            view = raw.data
            self.pieces[at] = [bytes(view[begin:end]) for begin, end in zip(offsets.tolist(), ends.tolist())]

    def messages(self):
        """All message records as bytes, in their order."""
        found, at = [], 0
        if self.rows is None:  # nothing was put
            return found
        while at < self.count:
            if at in self.pieces:
                found.extend(self.pieces[at])
            else:
                found.append(self.rows[at].tobytes())
            at = len(found)
        return found


def _between(index, start, end, chunk):
    """The entries of an index with start <= log time < end."""
    if chunk.start >= start and chunk.end < end:
        return index
    return index[(index["log_time"] >= start) & (index["log_time"] < end)]


def _as_array(bag, topic, gathered):
    """What was gathered of one topic as a structured array, by log time."""
    if topic.message_encoding != "cdr":
        raise InputError(f"{bag.path}: topic {topic.name}", f"messages in {topic.message_encoding!r}", "cdr messages")
    array = None
    if not gathered.pieces and topic.encoding in ("ros2msg", ""):
        array = _fixed_array(topic, gathered.rows)
    if array is None:
        array = decode_messages(topic, gathered.messages())
    times = array["log_time_ns"]
    if (times[1:] < times[:-1]).any():
        array = array[np.argsort(times, kind="stable")]
    return array


def _fixed_array(topic, rows):
    """Rows of one size as a structured array over the same bytes; None if the layout is not fixed.

    Without rows the array is empty, with the fields of the type.
    """
    try:
        if rows is None:
            layout = layout_of_type(topic.definition())
            rows = np.empty(0, f"V{HEAD_BYTES + layout.size}")
        else:
            layout = layout_of_message(topic.definition(), rows[0].tobytes()[HEAD_BYTES:])
    except NoFixedLayout:
        return None
    payloads = rows.view(np.uint8).reshape(len(rows), rows.itemsize)[:, HEAD_BYTES:]
    return rows.view(_with_times(layout)) if layout.fits(payloads).all() else None


def _with_times(layout):
    """The dtype of whole message records: the two times, then the fields of the message."""
    head = HEAD_DTYPE.fields or {}
    fields = {name: layout.dtype.fields[name] for name in layout.dtype.names}
    return np.dtype({
        "names": ["log_time_ns", "publish_time_ns", *fields],
        "formats": ["<i8", "<i8", *(kind for kind, _ in fields.values())],
        "offsets": [head["log_time"][1], head["publish_time"][1],
                    *(HEAD_BYTES + offset for _, offset in fields.values())],
        "itemsize": HEAD_BYTES + layout.size})


def _custom_data(source):
    """Custom data as the file's own copy of the folder's metadata holds it; empty if it has none."""
    try:
        about = yaml.load(source.metadata["rosbag2"]["serialized_metadata"], LOADER)
        return dict(about["custom_data"])
    except (KeyError, TypeError, ValueError, yaml.YAMLError):
        return {}


def _files_of(path):
    """The MCAP files of a bag in order, and its custom data."""
    if not path.exists():
        raise missing(path, "an MCAP file or a rosbag2 folder")
    if path.is_file():
        return [path], {}
    described = path / "metadata.yaml"
    if not described.exists():
        files = sorted(path.glob("*.mcap"))
        if not files:
            raise InputError(path, "a folder without metadata.yaml and .mcap files", "a rosbag2 folder")
        return files, {}
    about = _described(described)
    names, kind = about.get("relative_file_paths"), about.get("storage_identifier")
    if kind != "mcap":
        raise InputError(f"{described}: storage_identifier", kind, "mcap; `ros2 bag convert` makes one of it")
    if about.get("compression_mode"):
        raise InputError(f"{described}: compression_mode", about["compression_mode"],
                         "an MCAP bag compressed by chunk; `ros2 bag convert` makes one of it")
    if not isinstance(names, list) or not names or not all(isinstance(name, str) and Path(name).name for name in names):
        raise InputError(f"{described}: relative_file_paths", names, "a list of the names of the bag's MCAP files")
    custom = about.get("custom_data") or {}
    if not isinstance(custom, dict):
        raise InputError(f"{described}: custom_data", custom, "a mapping")
    return [path / Path(name).name for name in names], custom


def _described(path):
    """The mapping of a rosbag2 folder's ``metadata.yaml``. Raises InputError for another file."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(path, str(error), METADATA) from None
    tree = yaml_tree(text, str(path), METADATA)
    about = tree.get("rosbag2_bagfile_information") if isinstance(tree, dict) else None
    if not isinstance(about, dict):
        raise InputError(f"{path}: rosbag2_bagfile_information", about, f"{METADATA}: a mapping")
    return about


def read_bag(path, topics=None, start=None, end=None):
    """Messages of a bag as one structured array per topic.

    Parameters
    ----------
    path : an MCAP file or a rosbag2 folder.
    topics : names, one name, or None for all.
    start, end : log times [ns]; start <= log time < end.

    Returns
    -------
    dict : topic to array of shape (n,), by log time, with `log_time_ns`, `publish_time_ns` and the
        message's fields as dotted paths (`header.stamp.sec`).  Strings are bytes where all have one
        length, objects where they vary; so are sequences.

    Raises
    ------
    InputError : no such bag or topic, or a bag that cannot be read, with what would be right.
    """
    return Bag(path).read(topics, start, end)


def read_bags(paths, topics=None, start=None, end=None):
    """Yields (path, arrays as from `read_bag`) for a set of bags, one in memory at a time.

    ``topics``, and log times ``start`` <= t < ``end`` [ns], as there.
    """
    for path in paths:
        yield path, read_bag(path, topics, start, end)
