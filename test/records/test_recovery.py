"""Bags that were cut off or damaged: made whole, opened by other tools, and what was lost is told."""

import fcntl

import pytest
from bag_help import SERVO, servo_rows
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags.bag_reader import Bag, read_bag
from microstage_ros.records.bags.bag_writer import BagWriter
from microstage_ros.records.bags.mcap_source import McapSource
from microstage_ros.records.bags.recovery import DAMAGED, recover


def written(path, count=4000, close=True, **options):
    """A bag of chunks of 500 messages."""
    bag = BagWriter(path, {"seed": "1"}, **options)
    channel = bag.add_channel("/axis/state", SERVO)
    for first in range(0, count, 500):
        rows, _, times = servo_rows(500, first)
        bag.write_block(channel, times, rows)
        bag.flush()
        bag.hand_over()
    if close:
        bag.close()
    else:
        fcntl.flock(bag._sink._file.fileno(), fcntl.LOCK_UN)  # as the death of a recorder does
    return bag


def count(path):
    return sum(1 for _ in Bag(path).raw_messages(["/axis/state"]))


def opened_by_others(folder):
    with Reader(folder) as reader:
        found = sum(1 for _ in reader.messages())
    files = sorted(folder.glob("*.mcap"))
    with open(files[0], "rb") as file:
        assert make_reader(file).get_summary().statistics.message_count > 0
    return found


def test_a_bag_whose_recorder_was_killed(tmp_path):
    bag = written(tmp_path / "bag", close=False)
    file = bag.file
    file.write_bytes(file.read_bytes()[:-9000])  # in the middle of the last chunk
    done = recover(tmp_path / "bag")[0]
    assert not done.whole and done.messages == 3500 and done.topics == {"/axis/state": 3500} and done.lost_bytes > 0
    assert opened_by_others(tmp_path / "bag") == count(tmp_path / "bag") == 3500
    assert file.with_name(file.name + DAMAGED).exists()
    assert Bag(tmp_path / "bag").custom_data["seed"] == "1"
    assert recover(tmp_path / "bag")[0].whole


def test_a_whole_bag_stays_as_it_is(tmp_path):
    bag = written(tmp_path / "bag")
    before = bag.file.read_bytes()
    assert recover(tmp_path / "bag")[0].whole and bag.file.read_bytes() == before


def test_a_damaged_chunk_is_left_out(tmp_path):
    bag = written(tmp_path / "bag")
    raw = bytearray(bag.file.read_bytes())
    raw[McapSource(bag.file).chunks[2].data[0] + 20] ^= 64
    bag.file.write_bytes(raw)
    done = recover(tmp_path / "bag")[0]
    assert done.lost_chunks == 1 and done.messages == count(tmp_path / "bag") == opened_by_others(tmp_path / "bag") == 3500


@pytest.mark.parametrize("what", [b"demo_msgs/msg/Servo", b"/axis/state"])
def test_a_damaged_schema_or_channel_is_taken_from_the_closing_part(tmp_path, what):
    """One byte that is no UTF-8: the bag was called whole, with 0 messages, and held all of them."""
    file = written(tmp_path / "bag").file
    raw = bytearray(file.read_bytes())
    raw[raw.index(what)] |= 0x80
    file.write_bytes(raw)
    done = recover(tmp_path / "bag")[0]
    assert not done.whole and done.messages == 4000 and done.lost_bytes == 0
    assert opened_by_others(tmp_path / "bag") == count(tmp_path / "bag") == 4000
    assert recover(tmp_path / "bag")[0].whole


def test_no_bag(tmp_path):
    with pytest.raises(InputError, match="not there"):
        recover(tmp_path / "nowhere")
    (tmp_path / "x.mcap").write_bytes(b"no bag at all, really")
    with pytest.raises(InputError, match="MCAP"):
        recover(tmp_path / "x.mcap")


def test_a_bag_is_split_and_bounded(tmp_path):
    bag = written(tmp_path / "bag", split_bytes=20_000)
    files = sorted(bag.folder.glob("*.mcap"))
    assert len(files) > 2 and count(bag.folder) == opened_by_others(bag.folder) == 4000
    few = written(tmp_path / "few", split_bytes=20_000, keep_files=2)
    left = sorted(few.folder.glob("*.mcap"))
    assert len(left) == 2 and left[-1] == few.file and 0 < opened_by_others(few.folder) < 4000


def test_a_bag_that_is_being_recorded_is_left_alone(tmp_path):
    """Its file was moved away from the recorder, which went on to write into the damaged one; reading it suggested so."""
    rows, _, times = servo_rows(3000)
    bag = BagWriter(tmp_path / "live")
    servo = bag.add_channel("/axis/servo", SERVO)
    bag.write_block(servo, times[:1000], rows[:1000])
    bag.flush()
    assert "is being recorded" in Bag(tmp_path / "live").remarks[0] and "recover" not in Bag(tmp_path / "live").remarks[0]
    with pytest.raises(InputError, match="live_0.mcap: got 'being recorded', expected a bag whose recorder has ended"):
        recover(tmp_path / "live")
    bag.write_block(servo, times[1000:], rows[1000:])
    bag.close()
    assert len(read_bag(tmp_path / "live")["/axis/servo"]) == 3000 and [one.whole for one in recover(tmp_path / "live")] == [True]
