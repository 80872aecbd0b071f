"""Small bags for the tests, of a message type that needs no installation."""

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from microstage_ros.records.bags.bag import BagWriter, Qos
from microstage_ros.records.bags.definition import HEADER, SEPARATOR, TIME, parse_definition
from microstage_ros.records.bags.layout import layout_of_type


def defined(name, text):
    """A definition with its true hash, as an independent library computes it."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, name))
    return parse_definition(name, text, store.hash_rihs01(name))


SERVO = defined("demo_msgs/msg/Servo", f"std_msgs/Header header\nuint64 sequence\nfloat64 position\nuint8 flag\n"
                f"{SEPARATOR}\n{HEADER}{SEPARATOR}\n{TIME}")
WORDS = defined("std_msgs/msg/String", "string data\n")
START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 100_000


def servo_rows(count, first=0):
    """Messages `first` … as uint8 rows, their structured view, and their log times."""
    layout = layout_of_type(SERVO, {"header.frame_id": 4})
    rows = np.tile(np.frombuffer(layout.blank(header__frame_id=b"axis"), np.uint8), (count, 1))
    seen = rows.reshape(-1).view(layout.dtype)
    seen["sequence"] = first + np.arange(count)
    seen["position"] = np.sin(seen["sequence"] * 1e-3)
    times = START_NS + PERIOD_NS * (first + np.arange(count))
    seen["header.stamp.sec"], seen["header.stamp.nanosec"] = times // 10**9, times % 10**9
    return rows, seen, times


def words_message(text):
    """A std_msgs/String in CDR."""
    raw = text.encode() + b"\0"
    return b"\x00\x01\x00\x00" + len(raw).to_bytes(4, "little") + raw


def write_bag(path, count=3000, words=("a", "bb", "ccc"), block=True, **options):
    """A bag with a servo topic and a topic of texts of several lengths."""
    rows, _, times = servo_rows(count)
    with BagWriter(path, {"seed": 3}, **options) as bag:
        servo = bag.add_channel("/axis/servo", SERVO)
        talk = bag.add_channel("/talk", WORDS, [Qos(depth=1, durability="transient_local")])
        bag.add_channel("/silent", WORDS)
        if block:
            bag.write_block(servo, times, rows)
        else:
            for row, time in zip(rows, times.tolist()):
                bag.write(servo, time, row.tobytes())
        for number, text in enumerate(words):
            bag.write(talk, START_NS + number, words_message(text), publish_time_ns=START_NS - 1, sequence=number)
    return rows, times


def check_servo(array, count, first=0):
    """An array of the servo topic holds the messages `first` … of `servo_rows`."""
    _, seen, times = servo_rows(count, first)
    assert len(array) == count
    np.testing.assert_array_equal(array["log_time_ns"], times)
    for name in seen.dtype.names:
        np.testing.assert_array_equal(array[name], seen[name])


class FullDisk:
    """A file that has room for so many bytes and no more."""

    def __init__(self, file, room):
        self.file, self.room = file, room

    def write(self, raw):
        raw = bytes(raw)
        taken = min(len(raw), self.room - self.file.tell())
        if taken <= 0:
            raise OSError(28, "No space left on device")
        return self.file.write(raw[:taken])

    def __getattr__(self, name):
        return getattr(self.file, name)
