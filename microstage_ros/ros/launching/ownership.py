"""One axis has one owner: a lock per domain and namespace, held by whoever started its processes and by its driver.

The lock is the operating system's (`flock`), so it goes with the process that holds it, however that ends. The file
says who it is: computer, process, command, since when. It lies in `$XDG_RUNTIME_DIR`, or in the folder for temporary
files, under the user's number. It covers one computer; over a network `driver_status` names computer and process of the
driver (docs/safety.md).
"""

import errno
import fcntl
import json
import math
import os
import socket
import sys
import tempfile
import time
from pathlib import Path

from microstage_ros.quantities.errors import InputError

KINDS = ("cell", "driver")


def folder():
    """Where the locks are."""
    base = os.environ.get("XDG_RUNTIME_DIR")
    place = Path(base) / "microstage" if base else Path(tempfile.gettempdir()) / f"microstage-{os.getuid()}"
    place.mkdir(mode=0o700, parents=True, exist_ok=True)
    return place


def lock_file(kind, namespace):
    """The file of one lock of a namespace, in the domain of this environment."""
    name = namespace.strip("/").replace("/", "+") or "root"
    return folder() / f"{os.environ.get('ROS_DOMAIN_ID', '0')}-{name}.{kind}"


class Ownership:
    """Holds one lock for as long as it lives.

    Parameters
    ----------
    kind : of `KINDS`. namespace : of the axis. others : kinds that nobody else may hold either when this one is taken.

    Raises
    ------
    InputError : another process owns the axis; the text names it.
    """

    def __init__(self, kind, namespace, others=()):
        self._path, self._namespace = lock_file(kind, namespace), namespace
        self._file = self._locked(self._path)
        if self._file is None:
            raise InputError(f"namespace {namespace}", "taken", f"a namespace of its own: {owner_in_words(self._path)}")
        try:
            for other in others:
                self._free(lock_file(other, namespace))
        except InputError:
            self.release()
            raise
        self._who = {"host": socket.gethostname(), "process": os.getpid(), "since": time.time(),
                     "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])[:200]}
        self._write()

    def _write(self):
        self._file.seek(0)
        self._file.truncate(0)
        self._file.write(json.dumps(self._who))
        self._file.flush()

    def activated(self):
        """Note in the lock's file that the axis is active: it is not starting any more."""
        self._who["active"] = True
        self._write()

    def _free(self, path):
        """Raise `InputError` if somebody else holds another lock of the axis."""
        file = self._locked(path)
        if file is None:
            raise InputError(f"namespace {self._namespace}", "taken", f"a namespace of its own: {owner_in_words(path)}")
        file.close()

    @staticmethod
    def _locked(path):
        """The file, locked; None if another process has it."""
        file = open(path, "a+", encoding="utf-8")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            file.close()
            if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
                return None
            raise
        return file

    def release(self):
        """Give the axis free."""
        if self._file is not None:
            self._file.close()
            self._file = None


def free_namespace(wanted="/axis", others=("/demo", *map("/demo_{}".format, range(2, 100)))):
    """``wanted`` if no process of this machine owns an axis of that name, else the first of the others that is free.

    Raises `InputError`, which names the owner of ``wanted``, if all are taken.
    """
    refusals = []
    for name in (wanted, *others):
        try:
            Ownership("cell", name, ("driver",)).release()
        except InputError as error:
            refusals.append(error)
        else:
            return name
    raise refusals[0]


def owned_namespaces():
    """Namespaces of this domain that a process of this user on this computer owns, sorted; known at once, without
    discovery."""
    domain, found = f"{os.environ.get('ROS_DOMAIN_ID', '0')}-", set()
    for path in folder().glob(f"{domain}*"):
        if path.suffix[1:] in KINDS and owner(path) is not None:
            name = path.stem.removeprefix(domain)
            found.add("/" if name == "root" else "/" + name.replace("+", "/"))
    return sorted(found)


def starting_for(namespace):
    """For how long [s] a cell of this user on this computer has been starting at ``namespace``; infinite if none is."""
    who = owner(lock_file("cell", namespace))
    return max(time.time() - who["since"], 0.0) if who and not who.get("active") else math.inf


def owner(path):
    """Host, process, since, command of who holds a lock; None if nobody does."""
    try:
        file = Ownership._locked(path)
        if file is not None:
            file.close()
            return None
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def owner_in_words(path):
    """The same as half a sentence."""
    found = owner(path)
    if not found:
        return "another process holds it"
    since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(found.get("since", 0)))
    return f"{found.get('command')!r} on {found.get('host')}, process {found.get('process')}, has it since {since}"
