"""Bags: what goes in comes out, here and in other people's readers."""

import time

import lz4.frame
import numpy as np
import pytest
import yaml
from bag_help import PERIOD_NS, SERVO, START_NS, WORDS, check_servo, servo_rows, words_message, write_bag
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from microstage_ros import __version__
from microstage_ros.records.bags import bag_reader, bag_writer
from microstage_ros.records.bags.bag import Bag, BagWriter, read_bag, read_bags
from microstage_ros.records.bags.mcap_sink import COMPRESSORS


@pytest.mark.parametrize("compression", COMPRESSORS)
@pytest.mark.parametrize("place", ["bag", "bag.mcap"])
@pytest.mark.parametrize("block", [True, False])
def test_round_trip(tmp_path, compression, place, block, monkeypatch):
    monkeypatch.setattr(bag_writer, "CHUNK_BYTES", 10_000)
    write_bag(tmp_path / place, compression=compression, block=block)
    read = read_bag(tmp_path / place)
    check_servo(read["/axis/servo"], 3000)
    assert list(read["/talk"]["data"]) == ["a", "bb", "ccc"]
    assert (read["/talk"]["publish_time_ns"] == START_NS - 1).all()
    assert len(read["/silent"]) == 0
    bag = Bag(tmp_path / place)
    assert bag.custom_data["seed"] == "3" and bag.custom_data["microstage_ros"]
    assert (bag.start_ns, bag.end_ns) == (START_NS, START_NS + 2999 * PERIOD_NS)
    assert not bag.cut_off and bag.recorded == {"/axis/servo", "/talk"}


@settings(max_examples=25, deadline=None)
@given(texts=st.lists(st.tuples(st.integers(0, 50), st.text(max_size=5).filter(lambda t: "\0" not in t)), max_size=30))
def test_any_messages_come_back_in_order_of_time(tmp_path_factory, texts):
    path = tmp_path_factory.mktemp("any") / "bag"
    with BagWriter(path) as bag:
        talk = bag.add_channel("/talk", WORDS)
        for time, text in texts:
            bag.write(talk, START_NS + time, words_message(text))
    read = read_bag(path)["/talk"]
    expected = sorted(texts, key=lambda entry: entry[0])
    told = [text.decode() if isinstance(text, bytes) else text for text in read["data"].tolist()] if texts else []
    assert told == [text for _, text in expected]
    assert read["log_time_ns"].tolist() == [START_NS + time for time, _ in expected]


class SlowToAllocate:
    """numpy, but another thread always has its turn while memory is allocated."""

    def __getattr__(self, name):
        return getattr(np, name)

    @staticmethod
    def empty(*shape):
        time.sleep(0.05)
        return np.empty(*shape)


def test_two_threads_that_begin_with_a_topic_at_once_lose_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(bag_writer, "CHUNK_BYTES", 10_000)
    write_bag(tmp_path / "bag")
    monkeypatch.setattr(bag_reader, "np", SlowToAllocate())
    check_servo(read_bag(tmp_path / "bag")["/axis/servo"], 3000)


def test_topics_and_time_ranges_read_only_what_is_asked_for(tmp_path, monkeypatch):
    monkeypatch.setattr(bag_writer, "CHUNK_BYTES", 10_000)
    write_bag(tmp_path / "bag")
    unpacked = []
    source = Bag(tmp_path / "bag").sources[0].__class__
    whole = source.unpack
    monkeypatch.setattr(source, "unpack", lambda self, chunk: unpacked.append(chunk) or whole(self, chunk))
    start = START_NS + 1000 * PERIOD_NS
    read = read_bag(tmp_path / "bag", "/axis/servo", start, start + 20 * PERIOD_NS)
    assert list(read) == ["/axis/servo"]
    check_servo(read["/axis/servo"], 20, first=1000)
    assert len(unpacked) == 1
    assert len(read_bag(tmp_path / "bag", "/talk", START_NS + 1, START_NS + 2)["/talk"]) == 1
    assert len(read_bag(tmp_path / "bag", start=START_NS + 10**12)["/axis/servo"]) == 0


def test_raw_messages_for_replay(tmp_path):
    rows, _ = write_bag(tmp_path / "bag", count=50)
    raw = list(Bag(tmp_path / "bag").raw_messages())
    assert [time for _, time, _ in raw] == sorted(time for _, time, _ in raw)
    assert [bytes(data) for name, _, data in raw if name == "/axis/servo"] == [row.tobytes() for row in rows]
    assert [bytes(data) for name, _, data in raw if name == "/talk"][1] == words_message("bb")


def test_replay_is_in_order_of_time_across_chunks(tmp_path, monkeypatch):
    """A slow topic reaches the recorder late: its messages lie in later chunks than their time says."""
    monkeypatch.setattr(bag_writer, "CHUNK_BYTES", 1000)
    rows, _, times = servo_rows(200)
    with BagWriter(tmp_path / "bag") as bag:
        servo, talk = bag.add_channel("/axis/servo", SERVO), bag.add_channel("/talk", WORDS)
        for number in range(0, 200, 10):
            bag.write_block(servo, times[number:number + 10], rows[number:number + 10])
            bag.write(talk, int(times[max(number - 25, 0)]) + 1, words_message(str(number)))
    raw = list(Bag(tmp_path / "bag").raw_messages())
    assert len(raw) == 220
    assert [time for _, time, _ in raw] == sorted(time for _, time, _ in raw)


@pytest.mark.parametrize("place", ["bag", "bag.mcap"])
def test_custom_data_may_come_late(tmp_path, place):
    with BagWriter(tmp_path / place, {"seed": 1}) as bag:
        bag.custom_data["parameters /axis/driver"] = "mode: paced\n"
    assert Bag(tmp_path / place).custom_data["parameters /axis/driver"] == "mode: paced\n"
    assert Bag(tmp_path / place).custom_data["seed"] == "1"


def test_sets_of_bags(tmp_path):
    for name in ("a", "b"):
        write_bag(tmp_path / name, count=10)
    found = dict(read_bags([tmp_path / "a", tmp_path / "b"], ["/axis/servo"]))
    assert len(found) == 2
    for arrays in found.values():
        check_servo(arrays["/axis/servo"], 10)


def test_rosbags_opens_ours(tmp_path):
    rows, times = write_bag(tmp_path / "bag", count=200)
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == 203
        talk = next(connection for connection in reader.connections if connection.topic == "/talk")
        assert talk.ext.offered_qos_profiles[0].durability.name == "TRANSIENT_LOCAL"
        assert talk.digest == WORDS.hash
    with AnyReader([tmp_path / "bag"]) as reader:
        servo = [connection for connection in reader.connections if connection.topic == "/axis/servo"]
        found = [(time, raw) for _, time, raw in reader.messages(connections=servo)]
        assert found == [(time, row.tobytes()) for time, row in zip(times.tolist(), rows)]
        assert reader.deserialize(found[7][1], SERVO.name).sequence == 7


def test_mcap_and_its_ros2_support_open_ours(tmp_path):
    write_bag(tmp_path / "bag", count=200)
    file = tmp_path / "bag" / "bag_0.mcap"
    with open(file, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
        assert summary.statistics.channel_message_counts == {1: 200, 2: 3}
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
        described = {record.name: record.metadata for record in reader.iter_metadata()}
        own = yaml.safe_load(described["rosbag2"]["serialized_metadata"])
        assert own["message_count"] == summary.statistics.message_count and own["storage_identifier"] == "mcap"
        assert len(list(reader.iter_messages(["/axis/servo"]))) == 200
    with open(file, "rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        decoded = [message.position for *_, message in reader.iter_decoded_messages(["/axis/servo"])]
    np.testing.assert_array_equal(decoded, np.sin(np.arange(200) * 1e-3))


def test_channel_metadata_says_what_the_folder_says(tmp_path):
    write_bag(tmp_path / "bag", count=5)
    about = yaml.safe_load((tmp_path / "bag/metadata.yaml").read_text())["rosbag2_bagfile_information"]
    channels = {channel.topic: channel for channel in Bag(tmp_path / "bag").sources[0].channels.values()}
    assert about["version"] == 9 and about["message_count"] == 8
    assert about["custom_data"] == {"microstage_ros": __version__, "seed": "3"}
    for topic in about["topics_with_message_count"]:
        metadata = channels[topic["topic_metadata"]["name"]].metadata
        assert yaml.safe_load(metadata["offered_qos_profiles"]) == topic["topic_metadata"]["offered_qos_profiles"]
        assert metadata["topic_type_hash"] == topic["topic_metadata"]["type_description_hash"]


def test_index_that_lies_is_not_believed(tmp_path):
    """Messages of several sizes on one topic, one of them at the very end of a chunk."""
    with BagWriter(tmp_path / "bag", compression="") as bag:
        talk = bag.add_channel("/talk", WORDS)
        for number, text in enumerate(["long text", "long txet", "x"]):
            bag.write(talk, START_NS + number, words_message(text))
    assert read_bag(tmp_path / "bag")["/talk"]["data"].tolist() == ["long text", "long txet", "x"]
    assert lz4.frame.decompress(COMPRESSORS["lz4"]()(b"abc")) == b"abc"
