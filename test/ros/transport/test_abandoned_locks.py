"""Locks of readers whose holder was killed or stopped are opened; held ones and strange files are left alone."""

import fcntl
import os
import shutil
import subprocess
import sys

import pytest
from microstage_msgs.msg import VoltageCommand
from ros_support import shut_by_another_process, spin_until

from microstage_ros.ros.transport import abandoned_locks
from microstage_ros.ros.transport.abandoned_locks import (
    FIRST_PORT,
    HEADER,
    KIND,
    LAYOUTS,
    LOCK,
    MUTEX,
    NAMELESS_LOOKS,
    PLACE,
    PORT,
    PORTS,
    READER,
    SLEEPERS,
    VALUE,
    AbandonedLocks,
    Segment,
    process_of,
)

MUTEXES = (VALUE + SLEEPERS, VALUE + SLEEPERS + MUTEX)
"""Where the locks of a reader are in its file."""


@pytest.fixture
def reader(node):
    """Heard messages and the file of a reader of the running middleware."""
    heard = []
    node.create_subscription(VoltageCommand, "command", heard.append, 10)
    spin_until(node, lambda: node.get_subscriptions_info_by_topic("/axis/command"))
    identity = node.get_subscriptions_info_by_topic("/axis/command")[0].endpoint_gid
    name = ".".join(f"{byte:02x}" for byte in identity[:12]) + "_" + ".".join(f"{byte:x}" for byte in identity[12:16])
    return heard, PLACE / (READER + name)


@pytest.fixture
def copied(reader, tmp_path):
    """A folder with a copy of such a file, and that file."""
    return tmp_path, shutil.copy(reader[1], tmp_path / f"{READER}1")


@pytest.mark.parametrize("which", [0, 1])
def test_a_message_arrives_at_a_reader_whose_lock_a_killed_process_held(node, reader, tmp_path, which):
    heard, path = reader
    (tmp_path / path.name).symlink_to(path)
    locks, segment = AbandonedLocks(tmp_path), Segment(path)
    assert segment.holders() == (None, None) and locks.look() == 0
    with path.open("rb") as file:  # cells of other tests look after all readers of this user; who opens one holds its file
        fcntl.flock(file, fcntl.LOCK_EX)
        process = shut_by_another_process([path], which)
        assert segment.holders()[which] == process.pid
        assert locks.look() == 0  # seen once may be a moment's use
        (tmp_path / "copy").mkdir()
        shutil.copy(path, tmp_path / "copy")
        alone = AbandonedLocks(tmp_path / "copy")
        assert [alone.look() for _ in range(3)] == [0, 1, 0]
    locks.look()  # such a cell may have opened it first
    assert segment.holders() == (None, None) and locks.look() == 0
    publisher = node.create_publisher(VoltageCommand, "command", 10)
    spin_until(node, lambda: publisher.get_subscription_count() == 1)
    publisher.publish(VoltageCommand(voltage=3.0))
    spin_until(node, lambda: heard and heard[0].voltage == 3.0)


def test_a_segment_made_anew_under_its_name_is_looked_at_in_place_of_the_old_one(copied):
    """The middleware makes a port anew for the next process of the same number."""
    folder, path = copied
    locks = AbandonedLocks(folder)
    assert locks.look() == 0
    shutil.copy(path, folder / "new")
    (folder / "new").replace(path)
    shut_by_another_process([path], 1)
    locks._listed = 0.0  # as after `LISTED_S`
    assert [locks.look() for _ in range(3)] == [0, 1, 0]
    assert Segment(path).holders() == (None, None)


def test_a_stopped_holder_is_one_and_a_waiting_one_is_none(copied):
    folder, path = copied
    locks = AbandonedLocks(folder)
    waits = shut_by_another_process([path], 1, "sys.stdin.read()")
    try:
        assert [locks.look() for _ in range(2 * NAMELESS_LOOKS)] == [0] * 2 * NAMELESS_LOOKS
    finally:
        waits.communicate()
    assert locks.look() == 1
    stops = shut_by_another_process([path], 0, "os.kill(os.getpid(), signal.SIGSTOP)")
    try:
        os.waitid(os.P_PID, stops.pid, os.WSTOPPED | os.WNOWAIT)
        assert [locks.look() for _ in range(3)] == [0, 1, 0]
    finally:
        stops.kill()
        stops.communicate()


def test_a_lock_without_a_name_is_opened_later(copied):
    folder, path = copied
    with path.open("r+b") as file:
        file.seek(MUTEXES[1] + LOCK)
        file.write(b"\1")
    locks = AbandonedLocks(folder)
    assert [locks.look() for _ in range(NAMELESS_LOOKS + 1)] == [0] * (NAMELESS_LOOKS - 1) + [1, 0]


@pytest.mark.parametrize("place", [HEADER + 8, HEADER + 12, MUTEXES[0] + KIND, MUTEXES[1] + KIND, VALUE + LAYOUTS[READER].size])
def test_another_layout_is_left_alone(copied, place):
    folder, path = copied
    data = bytearray(path.read_bytes())
    data[place] += 1
    data[MUTEXES[1]] = 1
    path.write_bytes(data)
    with pytest.raises(ValueError, match="2.14.5|another kind"):
        Segment(path)
    locks = AbandonedLocks(folder)
    assert sum(locks.look() for _ in range(NAMELESS_LOOKS + 1)) == 0 and path.read_bytes() == data


def test_a_port_is_marked_as_useless_before_its_lock_is_opened(node, tmp_path):
    """A message in it may be half written; a servo loop stood still for a second until the middleware made it anew."""
    first = FIRST_PORT + PORTS * int(os.environ["ROS_DOMAIN_ID"])
    found = [number for number in range(first, first + PORTS) if (PLACE / f"{PORT}{number}").exists()]
    path = shutil.copy(PLACE / f"{PORT}{found[0]}", tmp_path / f"{PORT}{found[0]}")
    other = shutil.copy(path, tmp_path / f"{PORT}{first + PORTS}")  # of another domain
    for which in (0, 1):
        shut_by_another_process([path, other], which)
    flags = VALUE + LAYOUTS[PORT].flags
    assert path.read_bytes()[flags] == 7
    locks = AbandonedLocks(tmp_path)
    assert [locks.look() for _ in range(3)] == [0, 2, 0]
    assert path.read_bytes()[flags] == 6 and Segment(path).holders() == (None, None)
    assert other.read_bytes()[flags] == 7 and None not in Segment(other).holders()


def test_where_the_c_library_has_other_mutexes_nothing_is_done(copied, monkeypatch):
    folder, path = copied
    monkeypatch.setattr(abandoned_locks, "OWNER", 12)
    shut_by_another_process([path], 1)
    locks, before = AbandonedLocks(folder), path.read_bytes()
    assert sum(locks.look() for _ in range(3)) == 0 and path.read_bytes() == before


def _opened_in(folder):
    """What this process's descriptors name in a folder; others come and go with what other tests leave behind."""
    links = (os.path.join("/proc/self/fd", number) for number in os.listdir("/proc/self/fd"))
    names = [os.readlink(link) for link in links if os.path.lexists(link)]
    return [name for name in names if name.startswith(str(folder))]


def test_a_thousand_readers_cost_no_descriptor(copied):
    folder, path = copied
    for number in range(1100):
        os.link(path, folder / f"{READER}{number + 2}")
    locks = AbandonedLocks(folder)
    assert locks.look() == 0 and len(locks._segments) == 1101
    assert not _opened_in(folder)
    with open(path, "rb"):
        assert len(_opened_in(folder)) == 1


def test_the_file_of_a_reader_names_its_process(reader):
    assert process_of(reader[1].name) == os.getpid() & 0xFFFF
    assert process_of(f"{READER}1") is None and process_of(f"{PORT}7400") is None


def test_readers_whose_process_is_long_gone_cost_nothing(copied, monkeypatch):
    """The file of this process's reader under the names of two processes, one of which ended before the first look."""
    assert os.getpid() & 0xFFFF in abandoned_locks.process_numbers()
    folder, path = copied
    gone, ending = 0x1234, 0x21FD
    dead, alive = (folder / f"{READER}01.0f.78.fd.{number & 0xFF:02x}.{number >> 8:02x}.41.90.00.00.00.00_0.0.1c.4"
                   for number in (gone, ending))
    shutil.copy(path, dead)
    shutil.copy(path, alive)
    monkeypatch.setattr(abandoned_locks, "process_numbers", lambda: {1, ending})
    locks = AbandonedLocks(folder)
    locks.look()
    assert set(locks._watched) == {path.name, alive.name}
    monkeypatch.setattr(abandoned_locks, "process_numbers", lambda: {1})
    monkeypatch.setattr(abandoned_locks, "COUNTED_S", 0.0)
    locks.look()
    assert alive.name in locks._watched  # who knew it may still write to it
    monkeypatch.setattr(abandoned_locks, "GIVEN_UP_S", 0.0)
    locks.look()
    assert set(locks._watched) == {path.name}
    locks.look()
    assert set(locks._watched) == {path.name} and len(locks._segments) == 3


def test_a_segment_stays_mapped_until_its_process_is_gone(copied):
    """A thread looks until the end: nothing that runs at exit may unmap what it reads, nor count what it makes."""
    code = """
import atexit, pathlib, sys
kept = []
atexit.register(lambda: print(kept[0].holders()))      # the first to be registered is the last to be called
from microstage_ros.ros.transport.abandoned_locks import Segment
kept.append(Segment(pathlib.Path(sys.argv[1])))
"""
    done = subprocess.run([sys.executable, "-c", code, str(copied[1])], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "(None, None)\n", "")
