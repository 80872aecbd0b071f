"""Shared memory that killed nodes have left behind: found by what each node wrote down while it lived, and removed.

The middleware keeps one file per writer in ``/dev/shm``, named by the 12 bytes that are the same for all endpoints of a
process. A process that ends removes its files; one that is killed does not. Every node of this project writes its bytes
into a file of its own beside the locks (`ownership.folder`). Whoever starts a cell looks which of these processes are
dead and removes their files, and no others.
"""

import os
import time
from pathlib import Path

from microstage_ros.ros.launching.ownership import folder

PLACE = Path("/dev/shm")
ENDING = ".memory"
WAIT_S = 2.0
"""Longest wait for the own endpoint to appear in the graph."""

MADE = 2
"""First word of a segment that is complete (Boost.Interprocess: 0 and 1 while it is made, 3 where that failed)."""

MAKING_S = 5.0
"""A segment that is not complete after so long has lost its maker: making one takes microseconds."""


def _began(pid):
    """When a process began, in ticks since the start of the computer: with its number it means this process alone."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rsplit(")", 1)[1].split()[19]
    except OSError:
        return ""


def remember(node, running=lambda: True):
    """Write down which shared memory is this process's, while ``running()``; the file, None if that cannot be
    determined here."""
    topic = next(
        (
            publisher.topic_name
            for publisher in node.publishers
            if publisher.topic_name.startswith(node.get_namespace())
        ),
        None,
    )
    end = time.monotonic() + WAIT_S
    while topic is not None and PLACE.is_dir() and time.monotonic() < end and running():
        for info in node.get_publishers_info_by_topic(topic):
            if info.node_name == node.get_name() and info.node_namespace == node.get_namespace():
                prefix = ".".join(f"{byte:02x}" for byte in info.endpoint_gid[:12])
                path = folder() / f"{os.getpid()}{ENDING}"
                half = path.with_suffix(".writing")     # whoever reads the note meanwhile would remove it as broken
                try:
                    half.write_text(f"{os.getpid()} {_began(os.getpid())} {prefix}\n", encoding="ascii")
                    half.replace(path)
                except OSError:
                    return None
                return path
        time.sleep(0.02)
    return None


def remove_half_made():
    """Remove our segments whose maker was killed while it made them; how many.

    Whoever opens such a segment waits for its maker without end, and every node of the computer opens the same ports.
    """
    count = 0
    for path in PLACE.glob("fastrtps_*"):
        try:
            about = path.stat()
            if path.name.endswith("_el") or about.st_uid != os.getuid() or time.time() - about.st_mtime < MAKING_S:
                continue
            with path.open("rb") as file:
                if int.from_bytes(file.read(4), "little") < MADE:
                    path.unlink()
                    count += 1
        except OSError:
            continue
    return count


def remove_left_behind():
    """Remove the shared memory of our dead processes; how many files."""
    count = remove_half_made()
    for note in folder().glob(f"*{ENDING}"):
        try:
            pid, began, prefix = note.read_text(encoding="ascii").split()
        except (OSError, ValueError):
            note.unlink(missing_ok=True)
            continue
        if _began(int(pid)) == began:
            continue
        for path in PLACE.glob(f"fast_datasharing_{prefix}_*"):
            try:
                path.unlink()
                count += 1
            except OSError:
                continue
        note.unlink(missing_ok=True)
    return count
