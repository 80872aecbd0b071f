"""`metadata.yaml` of a rosbag2 folder, version 9, as ROS 2 Jazzy writes it."""

from collections import Counter
from dataclasses import dataclass

import yaml

CUSTOM_DATA = "microstage"
"""Name of the metadata record that holds the custom data from the start, for a bag that crashes."""

FOREVER = {"sec": 9223372036, "nsec": 854775807}
"""An infinite duration, as rosbag2 writes it."""


@dataclass(frozen=True)
class Qos:
    """The quality of service that a topic's publisher offered.

    Attributes
    ----------
    history : `keep_last` or `keep_all`; depth : messages kept.
    reliability : `reliable` or `best_effort`.
    durability : `volatile` or `transient_local` (latched).
    """

    history: str = "keep_last"
    depth: int = 10
    reliability: str = "reliable"
    durability: str = "volatile"

    def as_dict(self):
        """The profile with the names of rosbag2; durations are infinite."""
        return {"history": self.history, "depth": self.depth, "reliability": self.reliability,
                "durability": self.durability, "deadline": dict(FOREVER), "lifespan": dict(FOREVER),
                "liveliness": "automatic", "liveliness_lease_duration": dict(FOREVER),
                "avoid_ros_namespace_conventions": False}


def qos_text(profiles):
    """Profiles as the text that a channel's metadata holds; it must say what `metadata.yaml` says."""
    return yaml.safe_dump([profile.as_dict() for profile in profiles], sort_keys=False)


@dataclass
class TopicInfo:
    """One topic of a bag: channel number in the file, name, type, type hash, profiles."""

    channel: int
    name: str
    type: str
    hash: str
    qos: tuple


def metadata_of(file_name, topics, counts, start_ns, end_ns, custom_data, ros_distro):
    """What `metadata.yaml` says, below its one key.

    Parameters
    ----------
    file_name : the one MCAP file of the folder.
    topics : list of `TopicInfo`.
    counts : channel to number of messages [1].
    start_ns, end_ns : first and last log time [ns], None in an empty bag.
    custom_data : what the recorder wants to keep with the bag, name to text.
    """
    messages = sum(counts.values())
    start = 0 if start_ns is None else start_ns
    duration = 0 if start_ns is None else end_ns - start_ns
    span = {"starting_time": {"nanoseconds_since_epoch": start}, "duration": {"nanoseconds": duration},
            "message_count": messages}
    return {
        "version": 9, "storage_identifier": "mcap",
        "duration": span["duration"], "starting_time": span["starting_time"], "message_count": messages,
        "topics_with_message_count": [
            {"topic_metadata": {"name": topic.name, "type": topic.type, "serialization_format": "cdr",
                                "offered_qos_profiles": [profile.as_dict() for profile in topic.qos],
                                "type_description_hash": topic.hash},
             "message_count": counts.get(topic.channel, 0)} for topic in topics],
        "compression_format": "", "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [{"path": file_name, **{key: dict(value) if isinstance(value, dict) else value
                                         for key, value in span.items()}}],
        "custom_data": dict(custom_data) or None,
        "ros_distro": ros_distro,
    }


def metadata_of_files(parts, ros_distro="jazzy"):
    """Metadata of a bag of several files.

    Parameters
    ----------
    parts : (file name, (topics, counts, start_ns, end_ns, custom_data)) in the order of the files.
    ros_distro : name of the ROS 2 distribution.

    Returns
    -------
    dict
        As `bag_metadata.metadata_of`, with an entry in ``files`` for each.
    """
    named, counted, custom, files = {}, Counter(), {}, []
    for name, (topics, counts, start, end, values) in parts:
        custom |= values
        for topic in topics:
            number = named.setdefault(topic.name, topic).channel
            counted[number] += counts.get(topic.channel, 0)
        files.append(metadata_of(name, topics, counts, start, end, {}, ros_distro)["files"][0])
    starts = [part[2] for _, part in parts if part[2] is not None]
    ends = [part[3] for _, part in parts if part[3] is not None]
    whole = metadata_of(
        parts[0][0],
        list(named.values()),
        counted,
        min(starts, default=None),
        max(ends, default=None),
        custom,
        ros_distro,
    )
    whole["relative_file_paths"], whole["files"] = [name for name, _ in parts], files
    return whole


def folder_text(information):
    """Text of `metadata.yaml`."""
    return as_text({"rosbag2_bagfile_information": information})


def as_text(information):
    """Metadata as YAML; this alone, without the key above it, is what a bag's own `rosbag2` record holds."""
    return yaml.safe_dump(information, sort_keys=False, width=1 << 20)
