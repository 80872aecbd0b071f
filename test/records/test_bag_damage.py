"""Bags after a crash, on a full or slow disk, damaged or made to mislead: read as far as they are whole, or refused in one line."""

import io
import os
import struct
import subprocess
import sys
import tracemalloc
from time import sleep

import numpy as np
import pytest
import yaml
from bag_help import SERVO, WORDS, FullDisk, check_servo, servo_rows, write_bag
from rosbags.rosbag2 import Reader

from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags import bag_writer, mcap_sink
from microstage_ros.records.bags.bag import Bag, BagStopped, BagWriter, read_bag
from microstage_ros.records.bags.chunk import CHUNK
from microstage_ros.records.bags.mcap_sink import COMPRESSORS, MAGIC


def test_a_process_that_dies_leaves_what_it_had_flushed(tmp_path):
    program = ("import os, sys\nsys.path[:0] = sys.argv[2:]\nfrom bag_help import *\n"
               "from microstage_ros.records.bags.bag import BagWriter\nrows, _, times = servo_rows(900)\n"
               "bag = BagWriter(sys.argv[1])\nservo = bag.add_channel('/axis/servo', SERVO)\n"
               "bag.write_block(servo, times[:600], rows[:600])\nbag.flush()\n"
               "bag.write_block(servo, times[600:], rows[600:])\nos._exit(9)\n")
    root = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    ended = subprocess.run([sys.executable, "-c", program, tmp_path / "bag", os.path.dirname(__file__), root], check=False)
    assert ended.returncode == 9
    bag = Bag(tmp_path / "bag")
    assert bag.cut_off and bag.custom_data["microstage_ros"]
    check_servo(bag.read()["/axis/servo"], 600)


@pytest.mark.parametrize("kept", [0.05, 0.3, 0.5, 0.77, 0.999])
def test_a_file_cut_anywhere_is_read_to_its_last_whole_chunk(tmp_path, kept, monkeypatch):
    monkeypatch.setattr(bag_writer, "CHUNK_BYTES", 10_000)
    write_bag(tmp_path / "whole.mcap")
    raw = (tmp_path / "whole.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(raw[:int(len(raw) * kept)])
    bag = Bag(cut)
    read = bag.read().get("/axis/servo", [])
    chunks = [chunk for chunk in Bag(tmp_path / "whole.mcap").sources[0].chunks if chunk.data[1] <= len(raw) * kept]
    per_chunk = len(Bag(tmp_path / "whole.mcap").sources[0].entries(chunks[0])[1]) if chunks else 0
    assert len(read) == min(per_chunk * len(chunks), 3000)
    if len(read):
        check_servo(read, len(read))


def test_a_file_of_mcap_writers_own_manner_cut_off(tmp_path):
    """Schemas and channels inside the chunks, as the C++ and the Python writer put them."""
    from mcap.writer import CompressionType, Writer
    rows, _, times = servo_rows(500)
    writer = Writer(str(tmp_path / "theirs.mcap"), chunk_size=5000, compression=CompressionType.LZ4)
    writer.start("ros2", "test")
    schema = writer.register_schema(SERVO.name, "ros2msg", SERVO.text.encode())
    channel = writer.register_channel("/axis/servo", "cdr", schema)
    for row, time in zip(rows, times.tolist()):
        writer.add_message(channel, time, row.tobytes(), time)
    writer.finish()
    raw = (tmp_path / "theirs.mcap").read_bytes()
    check_servo(read_bag(tmp_path / "theirs.mcap")["/axis/servo"], 500)
    (tmp_path / "theirs.mcap").write_bytes(raw[:len(raw) // 2])
    read = read_bag(tmp_path / "theirs.mcap")["/axis/servo"]
    assert 100 < len(read) < 400
    check_servo(read, len(read))


@pytest.mark.parametrize("room", [300_000, 100_000, 40_000, 21_000])
def test_full_disk_closes_the_bag_and_tells(tmp_path, room, monkeypatch):
    monkeypatch.setattr(bag_writer, "CHUNK_BYTES", 20_000)
    monkeypatch.setattr(bag_writer, "open_file", lambda path: FullDisk(io.FileIO(path, "w+"), room))
    rows, _, times = servo_rows(20_000)
    bag = BagWriter(tmp_path / "bag", compression="")
    servo = bag.add_channel("/axis/servo", SERVO)
    with pytest.raises(BagStopped, match=r"bag_0.mcap: No space left on device; the bag is closed"):
        for start in range(0, 20_000, 500):
            bag.write_block(servo, times[start:start + 500], rows[start:start + 500])
            bag.flush()
    with pytest.raises(BagStopped):
        bag.write_block(servo, times, rows)
    with pytest.raises(BagStopped):
        bag.close()
    bag.close()
    assert os.path.getsize(tmp_path / "bag/bag_0.mcap") <= room
    kept = Bag(tmp_path / "bag")
    assert not kept.cut_off
    read = kept.read()["/axis/servo"]
    assert len(read) * 90 > room - 60_000
    check_servo(read, len(read))
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == len(read) == len(list(reader.messages()))


def test_a_writer_that_breaks_inside_tells_instead_of_hanging(tmp_path, monkeypatch):
    monkeypatch.setitem(COMPRESSORS, "zstd", lambda: lambda raw: 1 / 0)
    rows, _, times = servo_rows(10)
    bag = BagWriter(tmp_path / "bag")
    bag.write_block(bag.add_channel("/axis/servo", SERVO), times, rows)
    with pytest.raises(BagStopped, match="ZeroDivisionError"):
        bag.close()


def test_what_is_no_bag_is_refused(tmp_path):
    def refusal(path, topics=None):
        with pytest.raises(InputError) as caught:
            read_bag(path, topics)
        return str(caught.value)

    write_bag(tmp_path / "bag", count=5)
    assert "one of /axis/servo, /silent, /talk" in refusal(tmp_path / "bag", "/nowhere")
    assert "file not found" in refusal(tmp_path / "none")
    (tmp_path / "folder").mkdir()
    assert "without metadata.yaml" in refusal(tmp_path / "folder")
    (tmp_path / "text.mcap").write_text("t_s,encoder_m\n")
    assert "an MCAP file" in refusal(tmp_path / "text.mcap")
    (tmp_path / "empty.mcap").write_bytes(b"")
    assert "an empty file" in refusal(tmp_path / "empty.mcap")
    (tmp_path / "old.db3").write_bytes(b"SQLite format 3\0")
    assert "ros2 bag convert" in refusal(tmp_path / "old.db3")
    described = tmp_path / "bag/metadata.yaml"
    text = described.read_text()
    for old, new, told in [("identifier: mcap", "identifier: sqlite3", "ros2 bag convert"), ("compression_mode: ''",
                           "compression_mode: FILE", "compressed by chunk"), ("rosbag2_bag", "x", "rosbag2_bagfile_information: got None")]:
        described.write_text(text.replace(old, new))
        assert told in refusal(tmp_path / "bag")
    with pytest.raises(InputError, match="free"):
        BagWriter(tmp_path / "bag")
    with pytest.raises(InputError, match="every topic once"), BagWriter(tmp_path / "twice") as bag:
        bag.add_channel("/a", WORDS)
        bag.add_channel("/a", WORDS)


@pytest.mark.parametrize("name, value", [
    ("relative_file_paths", None), ("relative_file_paths", 3), ("relative_file_paths", [1]), ("relative_file_paths", "bag.mcap"),
    ("relative_file_paths", ["."]), ("custom_data", [1]), ("version", "a date: 2026-13-45")])
def test_damaged_metadata_of_a_folder_is_refused(tmp_path, name, value):
    """Each of them ended in an error of Python, or opened the files of the word's letters."""
    write_bag(tmp_path / "bag", count=5)
    described = tmp_path / "bag/metadata.yaml"
    about = yaml.safe_load(described.read_text())
    about["rosbag2_bagfile_information"][name] = value
    text = yaml.safe_dump(about).replace("'a date: 2026-13-45'", "2026-13-45")
    described.write_text(text)
    with pytest.raises(InputError, match="metadata.yaml"):
        read_bag(tmp_path / "bag")


def test_damaged_bytes_are_told(tmp_path):
    write_bag(tmp_path / "whole.mcap", count=500)
    raw = bytearray((tmp_path / "whole.mcap").read_bytes())
    chunk = Bag(tmp_path / "whole.mcap").sources[0].chunks[0]
    raw[chunk.data[0] + 2:chunk.data[0] + 40] = bytes(38)
    (tmp_path / "bad.mcap").write_bytes(raw)
    with pytest.raises(InputError, match="whole chunk"):
        read_bag(tmp_path / "bad.mcap")


@pytest.mark.parametrize("compression", ["", "zstd", "lz4"])
def test_one_flipped_bit_of_a_chunk_is_told_by_its_crc(tmp_path, compression):
    """Damage before compression, and damage that no decompressor sees, are both caught by the chunk's CRC-32."""
    write_bag(tmp_path / "whole.mcap", count=500, compression=compression)
    raw = bytearray((tmp_path / "whole.mcap").read_bytes())
    chunk = Bag(tmp_path / "whole.mcap").sources[0].chunks[0]
    place = chunk.data[0] + (chunk.data[1] - chunk.data[0]) // 2 if compression == "" else chunk.data[0] - 8 - len(compression) - 8
    raw[place] ^= 1     # a payload byte; or the stored CRC itself, as from damage before packing
    (tmp_path / "bad.mcap").write_bytes(raw)
    with pytest.raises(InputError, match="CRC-32"):
        read_bag(tmp_path / "bad.mcap")


@pytest.mark.parametrize(("compression", "pack"), [("zstd", COMPRESSORS["zstd"]), ("lz4", COMPRESSORS["lz4"])])
def test_a_chunk_is_unpacked_no_further_than_its_head_says(tmp_path, compression, pack):
    """Half a gigabyte of zeros in a few kilobytes, behind a head that promises 100 bytes; and a head that promises too much."""
    packed = pack()(bytes(1 << 29))
    name = compression.encode()
    for size, told in ((100, "more bytes"), (1 << 40, "at most")):
        head = struct.pack("<QQQII", 0, 1, size, 0, len(name)) + name + struct.pack("<Q", len(packed))
        chunk = struct.pack("<BQ", CHUNK, len(head) + len(packed)) + head + packed
        (tmp_path / "bomb.mcap").write_bytes(MAGIC + chunk + struct.pack("<BQI", 0x0F, 4, 0))
        tracemalloc.start()
        try:
            with pytest.raises(InputError, match=told):
                read_bag(tmp_path / "bomb.mcap")
            assert tracemalloc.get_traced_memory()[1] < 1 << 26
        finally:
            tracemalloc.stop()


def test_no_damage_ends_in_anything_but_input_error(tmp_path, monkeypatch):
    """Bytes changed anywhere: the bag is read, or refused in one line; never another exception."""
    monkeypatch.setattr(bag_writer, "CHUNK_BYTES", 4000)
    write_bag(tmp_path / "whole.mcap", count=200, words=["a", "bb"] * 9)
    whole, generator, refused = (tmp_path / "whole.mcap").read_bytes(), np.random.default_rng(12), 0
    for _ in range(250):
        raw = bytearray(whole)
        for place in generator.integers(0, len(raw), size=generator.choice([1, 3, 20])):
            raw[place] = generator.integers(0, 256)
        (tmp_path / "bad.mcap").write_bytes(raw)
        try:
            bag = Bag(tmp_path / "bad.mcap")
            bag.read()
            list(bag.raw_messages())
        except InputError as error:
            refused += 1
            assert "\n" not in str(error)
    assert refused > 50


class SlowDisk(FullDisk):
    """A file that takes its time."""

    def write(self, raw):
        sleep(0.002)
        return self.file.write(raw)


def test_a_slow_disk_makes_the_writer_wait_and_memory_stays_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(bag_writer, "CHUNK_BYTES", 2000)
    monkeypatch.setattr(mcap_sink, "WAITING_CHUNKS", 4)
    monkeypatch.setattr(bag_writer, "open_file", lambda path: SlowDisk(io.FileIO(path, "w+"), 0))
    rows, _, times = servo_rows(2000)
    most = 0
    with BagWriter(tmp_path / "bag", compression="") as bag:
        servo = bag.add_channel("/axis/servo", SERVO)
        for start in range(0, 2000, 20):
            bag.write_block(servo, times[start:start + 20], rows[start:start + 20])
            most = max(most, bag.waiting_chunks)
    assert 3 <= most <= 4
    check_servo(read_bag(tmp_path / "bag")["/axis/servo"], 2000)


def test_a_folder_cannot_lead_out_of_itself(tmp_path):
    """A metadata.yaml that names a file elsewhere: only the folder's own file of that name is opened."""
    write_bag(tmp_path / "secret", count=7)
    write_bag(tmp_path / "bag", count=5)
    about = yaml.safe_load((tmp_path / "bag/metadata.yaml").read_text())
    information = about["rosbag2_bagfile_information"]
    for elsewhere in ("../secret/secret_0.mcap", str(tmp_path / "secret/secret_0.mcap")):
        information["relative_file_paths"] = [elsewhere]
        (tmp_path / "bag/metadata.yaml").write_text(yaml.safe_dump(about))
        with pytest.raises(InputError, match="bag/secret_0.mcap"):
            Bag(tmp_path / "bag")
    information["relative_file_paths"] = ["elsewhere/bag_0.mcap"]
    (tmp_path / "bag/metadata.yaml").write_text(yaml.safe_dump(about))
    check_servo(read_bag(tmp_path / "bag")["/axis/servo"], 5)
