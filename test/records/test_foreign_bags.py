"""Bags that other people's software wrote: opened, and read the same as `rosbags` reads them."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags.bag import Bag, read_bag

BAGS = Path(__file__).parents[2].parent / "shared/data/bags"
pytestmark = pytest.mark.skipif(not BAGS.exists(), reason="the foreign bags (../shared/data/bags) are not here")
FILES = {"rosbag2__mcap_cdr_test_cdr_test_0.mcap": 7, "rosbag2__mcap_talker_talker.mcap": 20,
         "rosbag2__mcap_wbag_wbag_0.mcap": 1246, "rosbag2__topics_and_services.mcap": 13}


@pytest.mark.parametrize("name", FILES)
def test_every_message_is_found_with_its_bytes(name):
    bag = Bag(BAGS / name)
    ours = sorted((topic, time, bytes(raw)) for topic, time, raw in bag.raw_messages())
    with Reader(BAGS / name) as reader:
        theirs = sorted((connection.topic, time, bytes(raw)) for connection, time, raw in reader.messages())
    assert ours == theirs
    assert len(ours) == FILES[name] == sum(len(array) for array in bag.read().values())


def test_values_are_those_of_another_reader():
    read = read_bag(BAGS / "rosbag2__mcap_cdr_test_cdr_test_0.mcap")
    with AnyReader([BAGS / "rosbag2__mcap_cdr_test_cdr_test_0.mcap"]) as reader:
        rows = dict.fromkeys(read, 0)
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            row = read[connection.topic][rows[connection.topic]]
            rows[connection.topic] += 1
            for name in (name for name in row.dtype.names if "." not in name and hasattr(message, name)):
                mine = row[name].decode() if isinstance(row[name], bytes) else row[name]
                theirs = np.asarray(getattr(message, name))
                if name.startswith("byte_"):  # an octet; rosbags takes it as signed
                    theirs = theirs.astype(np.uint8)
                np.testing.assert_array_equal(mine, theirs)


def test_talker_and_service_event():
    read = read_bag(BAGS / "rosbag2__mcap_talker_talker.mcap")
    assert read["/topic"]["data"][3] == b"Hello, world! 3"
    assert read["/rosout"]["name"][0] == b"minimal_publisher"
    events = read_bag(BAGS / "rosbag2__topics_and_services.mcap")["/add_two_ints/_service_event"]
    asked = {event["request"][0].a + event["request"][0].b for event in events if event["request"]}
    assert asked == {event["response"][0].sum for event in events if event["response"]}


def test_sqlite_is_refused_with_the_way_out():
    with pytest.raises(InputError, match="ros2 bag convert"):
        read_bag(BAGS / "rosbag2__sqlite3_wbag_wbag_0.db3")
