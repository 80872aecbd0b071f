"""Where numba keeps the compiled code of a function: one place for the same sources, whatever checkout they lie in.

Numba's usual place is named after the folder of the source file, so that a second checkout of the same version compiles
everything again. The folder that `numerics.compiled` names holds a digest of all sources that matter; inside it the
module's name and the digest of its own file are enough. Used through numba's setting ``CACHE_LOCATOR_CLASSES`` (0.62
and later; an older numba ignores it and keeps its usual place).
"""

import contextlib
import fcntl
import functools
import hashlib
import os
import tempfile
import time
from pathlib import Path

import numba

PACKAGE = Path(__file__).resolve().parent.parent


class CachePlace:
    """The place of one function's compiled code, as numba's cache asks for it.

    Parameters
    ----------
    module : path of the source file from the package, with dots. file : the source file.
    line : first one of the function.
    """

    def __init__(self, module, file, line):
        self._module, self._line = module, line
        self._py_file = str(file)    # numba's name: its warning about a function that cannot be cached reads it

    @classmethod
    def from_function(cls, function, file):
        """The place for a function of this package; None for any other: numba then asks its own classes."""
        path = Path(file).resolve()
        if not path.is_relative_to(PACKAGE) or not numba.config.CACHE_DIR:
            return None
        module = path.relative_to(PACKAGE).with_suffix("").as_posix().replace("/", ".")
        place = cls(module, path, function.__code__.co_firstlineno)
        try:
            place.ensure_cache_path()
        except OSError:
            return None
        return place

    def ensure_cache_path(self):
        """Make the folder; raises `OSError` if nothing can be written there."""
        os.makedirs(self.get_cache_path(), exist_ok=True)
        tempfile.TemporaryFile(dir=self.get_cache_path()).close()

    def get_cache_path(self):
        """The folder."""
        return os.path.join(numba.config.CACHE_DIR, self._module)

    def get_source_stamp(self):
        """What has to agree for the code to be used: the digest of the source file."""
        return _digest(self._py_file)

    def get_disambiguator(self):
        """Tells functions of one name apart."""
        return str(self._line)


@contextlib.contextmanager
def one_at_a_time(folder):
    """A lock of the ``folder``: one process, and one thread of it, is inside at a time; the others wait.

    Numba names the files of one function's signatures by their number, which it looks up first. Two processes that
    compile different signatures at once would take one name, and from then on the code of one signature would run in
    place of the other's, on records of another layout. A folder that cannot be written is not locked.
    """
    try:
        os.makedirs(folder, exist_ok=True)
        lock = open(os.path.join(folder, ".lock"), "a", encoding="ascii")
    except OSError:
        yield
        return
    with lock:
        fcntl.flock(lock, fcntl.LOCK_EX)   # until it is closed, or the process ends
        yield


# s, after which whoever waits compiles, too; derived: three times what all that the shipped axis needs took (96 s, by
# `commands.project.compile_ahead`)
LONGEST_WAIT = 300.0
_HELD = set()      # locks of this process: what it compiles may call itself


@contextlib.contextmanager
def one_process(file):
    """The lock ``file``: one process is inside; the others wait, `LONGEST_WAIT` at most, and go on without it then.

    For a caller that no other thread of its process follows in. A process that has the lock may come in again, and a
    file that cannot be written is no lock.
    """
    if file in _HELD:
        yield
        return
    try:
        os.makedirs(os.path.dirname(file), exist_ok=True)
        lock = open(file, "a", encoding="ascii")
    except OSError:
        yield
        return
    with lock:
        end = time.monotonic() + LONGEST_WAIT
        while not _locked(lock) and time.monotonic() < end:
            time.sleep(0.02)
        _HELD.add(file)
        try:
            yield
        finally:
            _HELD.discard(file)
            fcntl.flock(lock, fcntl.LOCK_UN)    # a child that was forked meanwhile holds the file, but no lock


def _locked(lock):
    """Whether the open file ``lock`` is locked by now."""
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


@functools.lru_cache
def _digest(path):
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
