"""Messages whose size varies: decoded one by one with `rosbags`, as columns."""

from functools import lru_cache

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.base import TypesysError

from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags.chunk import HEAD_BYTES, MESSAGE_HEAD
from microstage_ros.records.bags.definition import long_name, short_name


def decode_messages(topic, records):
    """Message records as a structured array.

    Parameters
    ----------
    topic : `bag_reader.Topic`.
    records : message records with their heads, bytes each.

    Returns
    -------
    array with `log_time_ns`, `publish_time_ns` and the fields as dotted paths; numbers in columns
    of their own, everything else as objects.

    Raises
    ------
    InputError : the definition or a message cannot be read.
    """
    try:
        store, kind = _store_of(topic.type, topic.encoding,
                                topic.text if topic.encoding == "ros2idl" else topic.definition().text)
        decoded = [store.deserialize_cdr(record[HEAD_BYTES:], kind) for record in records]
    except (TypesysError, SerdeError, KeyError, ValueError, IndexError, AssertionError) as error:
        raise InputError(
            f"topic {topic.name}",
            f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}",
            f"messages of type {topic.type} as the bag defines it",
        ) from None
    columns: dict[str, list] = {"log_time_ns": [], "publish_time_ns": []}
    for record in records:
        log_time, publish_time = MESSAGE_HEAD.unpack_from(record)[4:]
        columns["log_time_ns"].append(log_time)
        columns["publish_time_ns"].append(publish_time)
    for message in decoded:
        for name, value in _flat(message, ""):
            columns.setdefault(name, []).append(value)
    return _table(columns, len(records))


@lru_cache
def _store_of(name, encoding, text):
    """A type store with the definition of the bag, and the type's name in it."""
    store = get_typestore(Stores.EMPTY)
    if encoding == "ros2idl":
        store.register(get_types_from_idl(text))
        return store, name
    kind = long_name(short_name(name))
    store.register(get_types_from_msg(text, kind))
    return store, kind


def _flat(message, prefix):
    """Yields (dotted path, value) of a message's fields; nested messages are opened."""
    for name, value in vars(message).items():
        if name.startswith("__"):
            continue
        if hasattr(value, "__msgtype__"):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _table(columns, rows):
    """Columns as one structured array: numbers as such, the rest as objects."""
    kinds = {}
    for name, values in columns.items():
        number = all(isinstance(value, (bool, int, float, np.number, np.bool_)) for value in values)
        kinds[name] = np.array(values).dtype if number and values else np.dtype("i8" if name.endswith("_ns") else "O")
    table = np.empty(rows, np.dtype(list(kinds.items())))
    for name, values in columns.items():
        if kinds[name] == "O":
            for row, value in enumerate(values):
                table[name][row] = value
        else:
            table[name] = values
    return table
