"""Compiled code on disk: processes that compile side by side, and the lock that keeps their files apart."""

import fcntl
import gc
import os
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from microstage_ros.numerics import cache_place, compiled
from microstage_ros.numerics.cache_place import one_at_a_time, one_process
from microstage_ros.numerics.random import uniform

SIDE_BY_SIDE = """
import sys, time
import numpy as np
from numba.core.caching import IndexDataCacheFile
from microstage_ros.numerics.random import uniform
look, step = IndexDataCacheFile._load_index, int(sys.argv[1])
def slowly(self):
    found = look(self)
    time.sleep(0.5)  # as where a busy computer lets another process go on here
    return found
IndexDataCacheFile._load_index = slowly
print("ready", flush=True)
sys.stdin.readline()
print(uniform(np.repeat(np.arange(1, 5, dtype=np.uint64), step)[::step]))
"""


ONCE = """
import sys
import numpy as np
from microstage_ros.numerics.random import uniform
print("ready", flush=True)
sys.stdin.readline()
uniform(np.arange(1, 5, dtype=np.uint64))
print(sum(uniform.stats.cache_misses.values()))
"""


def begin(code, folder, *arguments):
    """A process of this code, whose compiled functions lie in the folder, as far as it says that it is ready."""
    environment = {**os.environ, "MICROSTAGE_CACHE": str(folder)}
    process = subprocess.Popen([sys.executable, "-c", code, *map(str, arguments)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                               env=environment)
    assert process.stdout.readline() == "ready\n"
    return process


def go_on(processes):
    """What each of them prints when all are let go at once."""
    for process in processes:
        process.stdin.write("go\n")
        process.stdin.flush()
    return [process.communicate()[0] for process in processes]


@pytest.mark.parametrize("before", [True, False])
def test_garbage_is_searched_for_again_once_a_compiler_has_ended(before, monkeypatch):
    monkeypatch.setattr(gc, "isenabled", lambda: before)
    calls = []
    monkeypatch.setattr(gc, "disable", lambda: calls.append("off"))
    monkeypatch.setattr(gc, "enable", lambda: calls.append("on"))
    with pytest.raises(ZeroDivisionError), compiled._uncollected():
        calls.append(1 / 0)
    assert calls == ["off", "on"] if before else ["off"]


def test_what_one_process_compiles_the_others_wait_for(tmp_path):
    """Three workers of the tests compiled the same 368 functions in 454 s of processor time, where one takes 155."""
    assert sorted(go_on([begin(ONCE, tmp_path) for _ in range(3)])) == ["0\n", "0\n", "1\n"]


def test_whoever_has_the_lock_comes_in_again_and_nobody_waits_for_ever(tmp_path, monkeypatch):
    file = str(tmp_path / "new" / "lock")
    with one_process(file), one_process(file):
        with open(file, "a", encoding="ascii") as other, pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    monkeypatch.setattr(cache_place, "LONGEST_WAIT", 0.1)
    with open(file, "a", encoding="ascii") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with one_process(file):
            pass
    with pytest.raises(ZeroDivisionError), one_process(file):
        raise ZeroDivisionError
    with open(file, "a", encoding="ascii") as other:
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)      # free again


def test_two_processes_that_compile_at_once_do_not_take_each_others_code(tmp_path):
    """Two layouts of the same state: code for one reads other words of the other."""
    expected = str(uniform(np.arange(1, 5, dtype=np.uint64)))
    for _ in ("compiled", "loaded"):
        assert [out.split() for out in go_on([begin(SIDE_BY_SIDE, tmp_path, step) for step in (1, 2)])] == [[expected]] * 2
        assert len(list(tmp_path.rglob("random.uniform*.nbc"))) == 2  # a file for each of the two


def test_one_at_a_time(tmp_path):
    inside, most, folder = [], [], tmp_path / "new"

    def work():
        with one_at_a_time(folder):
            inside.append(1)
            most.append(len(inside))
            time.sleep(0.02)
            inside.pop()

    threads = [threading.Thread(target=work) for _ in range(5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1] * 5


def test_what_cannot_be_written_is_not_locked(tmp_path):
    (tmp_path / "file").write_text("")
    with one_at_a_time(tmp_path / "file" / "below"), one_process(str(tmp_path / "file" / "below" / "lock")):
        pass
