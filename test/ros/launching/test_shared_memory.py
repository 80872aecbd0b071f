"""What killed nodes leave in shared memory: removed at the next start, and nothing else."""

import os
import subprocess
import sys
import time

from ros_support import own_domain

from microstage_ros.ros.launching import shared_memory
from microstage_ros.ros.launching.cell_processes import CellProcesses
from microstage_ros.ros.launching.shared_memory import ENDING, remove_left_behind


def test_only_ours_and_only_of_the_dead(tmp_path, monkeypatch):
    memory, notes = tmp_path / "shm", tmp_path / "notes"
    memory.mkdir()
    notes.mkdir()
    monkeypatch.setattr(shared_memory, "PLACE", memory)
    monkeypatch.setattr(shared_memory, "folder", lambda: notes)
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    began = shared_memory._began(os.getpid())
    for name, pid, start in (("dead", dead.pid, "1"), ("alive", os.getpid(), began), ("reused", os.getpid(), "17")):
        (notes / f"{name}{ENDING}").write_text(f"{pid} {start} 01.{name}\n")
    (notes / f"broken{ENDING}").write_text("?")
    for name in ("dead", "alive", "reused", "stranger"):
        (memory / f"fast_datasharing_01.{name}_0.0.15.3").write_text("x")
    assert remove_left_behind() == 2
    assert sorted(path.name.split(".")[1].split("_")[0] for path in memory.iterdir()) == ["alive", "stranger"]
    assert [path.name for path in notes.iterdir()] == [f"alive{ENDING}"]


def test_a_killed_node_leaves_nothing_for_long(tmp_path, monkeypatch):
    """With notes of its own: whatever cell starts meanwhile beside this test removes what it finds in the common ones."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with own_domain():
        with CellProcesses("/axis", ("gms_observer",), logs=tmp_path) as cell:
            process = cell.processes["gms_observer"]
            note = shared_memory.folder() / f"{process.pid}{ENDING}"
            for _ in range(1000):
                if note.exists() and note.read_text().endswith("\n"):
                    break
                assert process.poll() is None
                shared_memory.time.sleep(0.05)
            prefix = note.read_text().split()[2]
            process.kill()
            process.wait(120.0)
        assert list(shared_memory.PLACE.glob(f"fast_datasharing_{prefix}_*")) and note.exists()
        remove_left_behind()
        assert not list(shared_memory.PLACE.glob(f"fast_datasharing_{prefix}_*")) and not note.exists()


def test_a_segment_that_was_never_completed_is_removed(tmp_path, monkeypatch):
    """Its maker was killed meanwhile; complete and new ones, and the locks beside them, stay."""
    monkeypatch.setattr(shared_memory, "PLACE", tmp_path)
    made, half, new, lock = (tmp_path / f"fastrtps_port70{n}" for n in ("00", "04", "05", "00_el"))
    made.write_bytes(b"\2\0\0\0" + bytes(60))
    half.write_bytes(bytes(64))
    new.write_bytes(bytes(64))
    lock.write_bytes(b"")
    for path in (made, half, lock):
        os.utime(path, (time.time() - 60.0,) * 2)
    assert shared_memory.remove_half_made() == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fastrtps_port7000", "fastrtps_port7000_el", "fastrtps_port7005"]
