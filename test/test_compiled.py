"""Compiled code on disk: processes that compile side by side, and the lock that keeps their files apart."""

import os
import subprocess
import sys
import threading
import time

import numpy as np

from microstage_ros.numerics.cache_place import one_at_a_time
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


def test_two_processes_that_compile_at_once_do_not_take_each_others_code(tmp_path):
    """Two layouts of the same state: code for one reads other words of the other."""
    expected = str(uniform(np.arange(1, 5, dtype=np.uint64)))
    environment = {**os.environ, "MICROSTAGE_CACHE": str(tmp_path)}

    def begun(step):
        return subprocess.Popen([sys.executable, "-c", SIDE_BY_SIDE, str(step)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)

    for _ in ("compiled", "loaded"):
        processes = [begun(step) for step in (1, 2)]
        for process in processes:
            assert process.stdout.readline() == "ready\n"
        for process in processes:
            process.stdin.write("go\n")
            process.stdin.flush()
        assert [process.communicate()[0].split() for process in processes] == [[expected]] * 2
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
    with one_at_a_time(tmp_path / "file" / "below"):
        pass
