"""Bags that were cut off or damaged, made whole again: what can be read is written anew with a closing part and
metadata.

A recorder that is killed leaves an MCAP file without its closing part; this project's own reader goes through such a
file, other tools do not. A damaged chunk (its CRC does not match) is left out, and what was lost is reported.
"""

import os
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from mcap.exceptions import McapError

from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags.bag_metadata import (
    CUSTOM_DATA,
    Qos,
    TopicInfo,
    as_text,
    folder_text,
    metadata_of,
    metadata_of_files,
)
from microstage_ros.records.bags.mcap_sink import McapSink, is_being_written, open_file
from microstage_ros.records.bags.mcap_source import LARGEST_CHUNK, McapSource

DAMAGED = ".damaged"
"""Added to the name of the file as it was found; nothing is thrown away."""


@dataclass
class Recovery:
    """What was done with one file.

    Attributes
    ----------
    file : path. whole : there was nothing to do. messages : that can be read now. chunks : kept. lost_chunks : that
        could not be read. lost_bytes : behind the last whole record. topics : name to messages.
    """

    file: Path
    whole: bool = False
    messages: int = 0
    chunks: int = 0
    lost_chunks: int = 0
    lost_bytes: int = 0
    topics: dict = field(default_factory=dict)


class _Scanned(McapSource):
    """Goes through the records, whatever the closing part says, and takes what is whole."""

    unreadable = 0  # schemas and channels of the data part

    def _read_summary(self):
        return False

    def _repair(self):
        self.good, self.bad = [], 0
        self._learn_from_closing_part()
        for chunk in self.chunks:
            try:
                raw = self.unpack(chunk) if 0 < chunk.size <= LARGEST_CHUNK else None
                entries = None if raw is None else _entries(raw, self)
            except (InputError, McapError, ValueError, IndexError, OverflowError):
                entries = None
            if entries:
                self.good.append((chunk, raw, entries))
            else:
                self.bad += 1

    def _add_metadata(self, place):
        try:
            super()._add_metadata(place)
        except (McapError, ValueError, IndexError, OverflowError):
            pass  # a damaged note is no reason to lose the messages

    def _learn(self, opcode, body):
        try:
            super()._learn(opcode, body)
        except (McapError, ValueError, IndexError, OverflowError):
            self.unreadable += 1

    def _learn_from_closing_part(self):
        """Schemas and channels that the data part does not tell: the closing part repeats them."""
        try:
            closing = McapSource(self.path)
        except InputError:
            return
        self.schemas = closing.schemas | self.schemas
        self.channels = closing.channels | self.channels


def _entries(raw, source):
    """Index of a chunk's messages; learns the channels that are declared in it."""
    from microstage_ros.records.bags.mcap_source import MESSAGE, _records, message_entries

    for opcode, body in _records(raw):
        if opcode != MESSAGE:
            source._learn(opcode, body)
    return message_entries(raw)


class _Kept:
    """A chunk that was read, as `McapSink` takes it."""

    def __init__(self, raw, entries):
        self.records, self._entries = raw.tobytes(), entries

    def index(self):
        """Channel to its index entries."""
        return self._entries


def recover(path):
    """Make a bag whole: an MCAP file, or a rosbag2 folder with one or several.

    Returns
    -------
    list of `Recovery`
        One for each file.

    Raises
    ------
    InputError : no bag, or one that is being recorded.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(path, "not there", "an MCAP file or a rosbag2 folder")
    files = sorted(path.glob("*.mcap"), key=_number) if path.is_dir() else [path]
    if not files:
        raise InputError(path, "no .mcap file in it", "an MCAP file or a rosbag2 folder")
    for file in files:
        if is_being_written(file):
            raise InputError(file, "being recorded", "a bag whose recorder has ended")
    done, parts = [], []
    for file in files:
        found, part = _recover_file(file)
        done.append(found)
        parts.append((file.name, part))
    if path.is_dir():
        _write_metadata(path, parts)
    return done


def _number(path):
    """Files of a bag in their order: name_0, name_1, ..., name_10."""
    tail = path.stem.rpartition("_")[2]
    return (int(tail) if tail.isdigit() else 0, path.name)


def _recover_file(file):
    """One file; `Recovery`, and what its metadata need."""
    source = _Scanned(file)
    found = Recovery(file, chunks=len(source.good), lost_chunks=source.bad)
    channels = {number: channel for number, channel in source.channels.items() if channel.schema_id in source.schemas}
    counts = Counter()
    for _, _, entries in source.good:
        counts.update({channel: len(rows) for channel, rows in entries.items() if channel in channels})
    found.messages = sum(counts.values())
    found.topics = {channels[number].topic: count for number, count in sorted(counts.items())}
    found.whole = not (source.cut_off or source.bad or source.unreadable) and _closed(file, source.good)
    span = [(chunk.start, chunk.end) for chunk, _, _ in source.good]
    start, end = min((s for s, _ in span), default=None), max((e for _, e in span), default=None)
    topics = [
        TopicInfo(
            number,
            channel.topic,
            source.schemas[channel.schema_id].name,
            dict(channel.metadata).get("topic_type_hash", ""),
            _profiles(channel),
        )
        for number, channel in sorted(channels.items())
    ]
    part = topics, counts, start, end, source.metadata.get(CUSTOM_DATA, {})
    if not found.whole:
        found.lost_bytes = _write_anew(file, source, channels, part)
    return found, part


def _closed(file, good):
    """True if the closing part is there, can be read, and its index is that of the messages themselves."""
    try:
        source = McapSource(file)
        indexed = {chunk.data: source.entries(chunk) for chunk in source.chunks}
    except (InputError, McapError, ValueError, IndexError, OverflowError):
        return False
    return not source.cut_off and set(indexed) == {chunk.data for chunk, _, _ in good} and all(
        _same(indexed[chunk.data], entries) for chunk, _, entries in good)


def _same(indexed, found):
    return set(indexed) == set(found) and all(indexed[channel].tolist() == found[channel].tolist() for channel in found)


def _write_anew(file, source, channels, part):
    """Write the file beside the damaged one and put it in its place. Bytes that were of no use."""
    fresh = file.with_name(file.name + ".recovered")
    sink = McapSink(fresh, open_file(fresh), "zstd")
    for _, channel in sorted(channels.items()):
        sink.add_channel(source.schemas[channel.schema_id], channel)
    for name, values in source.metadata.items():
        if name != "rosbag2":
            sink.add_metadata(name, values)
    used = 0
    for chunk, raw, entries in source.good:
        used += chunk.data[1] - chunk.data[0]
        entries = {channel: rows for channel, rows in entries.items() if channel in channels}
        if entries:
            sink.add_chunk(_Kept(raw, entries))
    sink.wait()
    topics, counts, start, end, custom = part
    sink.add_metadata(
        "rosbag2", {"serialized_metadata": as_text(metadata_of(file.name, topics, counts, start, end, custom, "jazzy"))}
    )
    sink.close()
    size = file.stat().st_size
    os.replace(file, file.with_name(file.name + DAMAGED))
    os.replace(fresh, file)
    last = max((chunk.data[1] for chunk, _, _ in source.good), default=0)
    return max(size - last, 0) if source.cut_off else 0


def _profiles(channel):
    """The quality of service that is noted with a channel."""
    import yaml

    try:
        indexed = yaml.safe_load(dict(channel.metadata).get("offered_qos_profiles", "")) or []
        names = ("history", "depth", "reliability", "durability")
        return tuple(Qos(**{name: profile[name] for name in names}) for profile in indexed) or (Qos(),)
    except (yaml.YAMLError, KeyError, TypeError):
        return (Qos(),)


def _write_metadata(folder, parts):
    """The folder's `metadata.yaml`, for one or several files."""
    (folder / "metadata.yaml").write_text(folder_text(metadata_of_files(parts)), encoding="utf-8")
