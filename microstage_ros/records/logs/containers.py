"""MATLAB files and MCAP bags as tables of columns."""

import io
from collections import Counter

import numpy as np

from microstage_ros.quantities.errors import InputError
from microstage_ros.records.logs.text_table import Table


def read_mat(path):
    """`Table` of a MATLAB file: every vector of the commonest length, columns of matrices as ``name(:,k)``, fields of
    structs.

    Raises InputError for version 7.3 (HDF5), which scipy does not read, and for files without vectors.
    """
    from scipy.io import loadmat

    try:
        raw = loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        raise InputError(
            path, "a MATLAB file of version 7.3", "save it with `save(name, '-v7')`, or export CSV"
        ) from None
    except Exception as error:  # noqa: BLE001 - of a damaged file the library raises what comes
        raise InputError(path, " ".join(str(error).split())[:80], "a MATLAB file") from None
    vectors = {}
    for name, value in raw.items():
        if not name.startswith("__"):
            _collect(vectors, name, value)
    if not vectors:
        raise InputError(path, "no vectors of numbers", "a vector per quantity")
    times = Counter(len(v) for v in vectors.values())
    rows = max(times, key=lambda length: (times[length], length))
    left = [name for name, v in vectors.items() if len(v) != rows]
    notes = [f"left out, of another length than {rows}: {', '.join(left[:6])}"] if left else []
    return Table({name: v for name, v in vectors.items() if len(v) == rows}, {}, "MATLAB", None, notes)


def _collect(vectors, name, value):
    if hasattr(value, "_fieldnames"):
        for field in value._fieldnames:
            _collect(vectors, f"{name}.{field}", getattr(value, field))
        return
    value = np.asarray(value)
    if value.dtype.kind not in "fiub" or value.size < 2:
        return
    if value.ndim == 1:
        vectors[name] = value.astype(float)
    elif value.ndim == 2 and min(value.shape) <= 64:
        columns = value if value.shape[0] >= value.shape[1] else value.T
        for k in range(columns.shape[1]):
            vectors[f"{name}(:,{k + 1})"] = columns[:, k].astype(float)


def read_mcap(path, topic=""):
    """`Table` of one topic of an MCAP bag: joint states, trajectory-controller states, or any message of scalars.

    Columns are ``joint.position``, ``joint.velocity``, ``joint.effort`` and the like, with ``time`` from the header's
    stamp.

    Parameters
    ----------
    topic : its name, or an empty string: the one with joint states, else the one with the most messages.

    Raises
    ------
    InputError : a file that cannot be read, no such topic, or none of its messages.
    """
    try:
        return _mcap(path, topic)
    except InputError:
        raise
    except OSError as error:
        raise InputError(path, error.strerror, "a file that can be read") from None
    except Exception as error:  # noqa: BLE001 - of a damaged file the libraries raise what comes
        raise InputError(path, " ".join(str(error).split())[:80], "an MCAP bag of ROS 2 messages") from None


def _mcap(path, topic):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with open(path, "rb") as file:
        raw = file.read()
    reader = make_reader(io.BytesIO(raw), decoder_factories=[DecoderFactory()])
    counts, kinds = _contents(reader)
    chosen = topic or _best_topic(counts, kinds)
    if chosen not in counts:
        raise InputError(f"{path}: topic", chosen, "one of " + ", ".join(sorted(counts)))
    rows = [(message.log_time, decoded) for _, _, message, decoded in reader.iter_decoded_messages(topics=[chosen])]
    if not rows:
        raise InputError(f"{path}: {chosen}", "no messages", "a topic with messages")
    return _messages(rows, chosen, kinds.get(chosen, ""))


def _contents(reader):
    """({topic: messages}, {topic: type}) by the summary; read through where there is none (mcap.dev/spec, Footer)."""
    summary = reader.get_summary()
    if summary is not None and summary.statistics is not None:
        counts = {channel.topic: summary.statistics.channel_message_counts.get(key, 0)
                  for key, channel in summary.channels.items()}
        return counts, {channel.topic: summary.schemas[channel.schema_id].name
                        for channel in summary.channels.values() if channel.schema_id}
    found = [(channel.topic, schema.name if schema else "") for schema, channel, _ in reader.iter_messages()]
    return Counter(topic for topic, _ in found), dict(found)


def _best_topic(counts, kinds):
    def worth(topic):
        kind = kinds.get(topic, "")
        return ("JointTrajectoryControllerState" in kind, "JointState" in kind, counts[topic])

    return max(counts, key=worth)


def _messages(rows, topic, kind):
    columns, stamps = {}, []
    for number, (log_time, message) in enumerate(rows):
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        seconds = stamp.sec + 1e-9 * stamp.nanosec if stamp is not None else 0.0
        stamps.append(seconds or 1e-9 * log_time)
        for name, value in _scalars(message):
            if name not in columns:
                columns[name] = np.full(len(rows), np.nan)
            columns[name][number] = value
    time = np.array(stamps)
    return Table({"time": time - time[0], **columns}, {"time": "s"}, f"MCAP {kind or 'messages'} of {topic}", None, [])


def _scalars(message, prefix=""):
    """(name, value) of every number in a message; arrays beside a list of joint names are named by joint."""
    joints = list(getattr(message, "name", None) or getattr(message, "joint_names", None) or []) \
        if not isinstance(getattr(message, "name", None), str) else []
    for field in getattr(message, "__slots__", ()):
        value = getattr(message, field)
        label = f"{prefix}{field}".lstrip("_")
        if isinstance(value, (bool, int, float)):
            yield label, float(value)
        elif hasattr(value, "__slots__") and field not in ("header", "stamp"):
            points = {"positions": "position", "velocities": "velocity", "effort": "effort"}
            for part, short in points.items():
                numbers = getattr(value, part, None)
                if joints and numbers is not None and len(numbers) == len(joints):
                    for joint, number in zip(joints, numbers):
                        yield f"{joint}.{field}.{short}", float(number)
            if not joints:
                yield from _scalars(value, f"{label}.")
        elif not isinstance(value, str) and hasattr(value, "__len__") and joints and len(value) == len(joints):
            for joint, number in zip(joints, value):
                if isinstance(number, (int, float)):
                    yield f"{joint}.{field}", float(number)
