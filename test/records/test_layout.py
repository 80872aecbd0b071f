"""Layouts: every field where an independent encoder puts it, and refusal of what does not fit."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags.definition import installed_definition, parse_definition
from microstage_ros.records.bags.layout import NoFixedLayout, layout_of_message, layout_of_type

STORE = get_typestore(Stores.ROS2_JAZZY)
ODD_TEXT = """# every kind of field, in an awkward order
uint8 LIMIT=3      # a constant
string NAME="a # b"
bool flag
float64 first
int8 small
std_msgs/Header header
uint16[3] triple
string<=9 short "with # default"
float32[] many
builtin_interfaces/Time[2] times
string[] words
uint8 last 7
""" + "=" * 80 + """
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
""" + "=" * 80 + """
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
STORE.register(get_types_from_msg(ODD_TEXT, "odd/msg/Odd"))
ODD = STORE.types["odd/msg/Odd"]
HEADER, TIME = STORE.types["std_msgs/msg/Header"], STORE.types["builtin_interfaces/msg/Time"]

finite = st.floats(-1e300, 1e300)
name = st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=9)
times = st.builds(TIME, sec=st.integers(-2**31, 2**31 - 1), nanosec=st.integers(0, 2**32 - 1))


def odd_messages():
    return st.builds(
        ODD, flag=st.booleans(), first=finite, small=st.integers(-128, 127),
        header=st.builds(HEADER, stamp=times, frame_id=name),
        triple=st.lists(st.integers(0, 65535), min_size=3, max_size=3).map(lambda v: np.array(v, np.uint16)),
        short=name, many=st.lists(st.floats(width=32, allow_nan=False), max_size=4).map(lambda v: np.array(v, np.float32)),
        times=st.lists(times, min_size=2, max_size=2), words=st.lists(name, max_size=3), last=st.integers(0, 255))


@settings(max_examples=60, deadline=None)
@given(message=odd_messages(), little=st.booleans())
def test_fields_are_where_an_independent_encoder_puts_them(message, little):
    raw = bytes(STORE.serialize_cdr(message, "odd/msg/Odd", little_endian=little))
    layout = layout_of_message(parse_definition("odd/msg/Odd", ODD_TEXT), raw)
    read = np.frombuffer(raw, layout.dtype)[0]
    assert layout.fits(np.frombuffer(raw, np.uint8)[None])[0]
    for field in ("flag", "first", "small", "last"):
        assert read[field] == getattr(message, field)
    assert read["header.stamp.nanosec"] == message.header.stamp.nanosec
    assert read["header.frame_id"].decode() == message.header.frame_id
    assert read["short"].decode() == message.short
    assert read["times.1.sec"] == message.times[1].sec
    assert [read[f"words.{k}"].decode() for k in range(len(message.words))] == message.words
    np.testing.assert_array_equal(read["triple"], message.triple)
    if len(message.many):
        np.testing.assert_array_equal(read["many"], message.many)


def test_blank_is_what_an_independent_decoder_reads():
    definition = parse_definition("odd/msg/Odd", ODD_TEXT)
    layout = layout_of_type(definition, {"header.frame_id": 4, "many": 2, "words": 1, "words.0": 3})
    raw = layout.blank(header__frame_id=b"axis", many=[1.5, -2], words__0=b"abc", first=0.25, last=9)
    message = STORE.deserialize_cdr(bytes(raw), "odd/msg/Odd")
    assert (message.header.frame_id, message.words, message.first, message.last) == ("axis", ["abc"], 0.25, 9)
    np.testing.assert_array_equal(message.many, [1.5, -2])
    assert layout == layout_of_message(definition, raw)
    assert raw[layout.dtype.fields["last"][1]] == 9


def test_another_length_does_not_fit():
    definition = parse_definition("std_msgs/msg/String", "string data\n")
    three = np.frombuffer(b"\x00\x01\x00\x00\x04\x00\x00\x00abc\x00", np.uint8)
    layout = layout_of_message(definition, three.tobytes())
    rows = np.stack([three, three, three])
    rows[1, 4] = 3
    rows[2, 1] = 0
    assert layout.fits(rows).tolist() == [True, False, False]


@pytest.mark.parametrize("raw", [b"\x00\x01\x00\x00\xff\xff\xff\x7f", b"\x00\x01\x00\x00\x02", b"\x00\x07\x00\x00" + bytes(8),
                                 b"\x00\x01\x00\x00" + bytes(40)])
def test_damaged_messages_are_refused(raw):
    with pytest.raises(InputError, match="std_msgs/msg/String"):
        layout_of_message(parse_definition("std_msgs/msg/String", "string data\n"), raw)


def test_definitions_that_cannot_be_used():
    with pytest.raises(InputError, match="explains"):
        parse_definition("a/msg/B", "c/D field\n")
    with pytest.raises(InputError, match="line `type name`"):
        parse_definition("a/msg/B", "float64\n")
    with pytest.raises(NoFixedLayout, match="wide"):
        layout_of_type(parse_definition("a/msg/B", "wstring words\n"))
    with pytest.raises(InputError, match="AMENT_PREFIX_PATH"):
        installed_definition("nobody/msg/Nothing", prefixes=["/nonexistent"])


def test_empty_message_takes_one_byte():
    assert layout_of_type(parse_definition("std_msgs/msg/Empty", "")).size == 5


def installed_prefixes():
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    return [p for p in prefixes if (Path(p) / "share/sensor_msgs/msg/JointState.msg").exists()]


@pytest.mark.skipif(not installed_prefixes(), reason="no installed sensor_msgs in sight")
def test_installed_definition_carries_text_and_hash():
    definition = installed_definition("sensor_msgs/msg/JointState", installed_prefixes())
    assert definition.hash == STORE.hash_rihs01("sensor_msgs/msg/JointState")
    assert "MSG: builtin_interfaces/Time" in definition.text
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition.text, definition.name))
    assert store.hash_rihs01(definition.name) == definition.hash
