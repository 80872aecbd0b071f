"""The mutation command: a weak test lets mutants live, a strict one does not; what it takes is checked."""

import contextlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import textwrap
import time

import pytest

from microstage_ros.commands.project import mutation
from microstage_ros.quantities.errors import InputError

pytestmark = pytest.mark.skipif(not importlib.util.find_spec("cosmic_ray"), reason="cosmic-ray is not installed")
FILE = "microstage_ros/metrology/repeatability.py"


def test_tests_of_something_else_notice_nothing(tmp_path, capsys):
    out = tmp_path / "out.json"
    assert (
        mutation.main(
            [FILE, "--tests", "test/metrology/test_rates.py", "--sample", "1", "--seed", "3", "--json", str(out)]
        )
        == 0
    )
    found = json.loads(out.read_text(encoding="utf-8"))
    assert (found["tried"], found["noticed"], len(found["rows"])) == (1, 0, 1) and found["mutants"] > 10
    said = capsys.readouterr().out
    assert said.startswith("survived") and "0 of 1" in said


def test_a_mutant_that_the_tests_notice(tmp_path, monkeypatch):
    """The time of the unchanged tests is not measured here: the test above does."""
    monkeypatch.setattr(mutation, "_unchanged", lambda folder, tests: 12.0)
    out = tmp_path / "out.json"
    assert (
        mutation.main(
            [
                FILE,
                "--tests",
                "test/metrology/test_repeatability.py",
                "--sample",
                "1",
                "--seed",
                "3",
                "--json",
                str(out),
            ]
        )
        == 0
    )
    assert json.loads(out.read_text(encoding="utf-8"))["noticed"] == 1


@pytest.mark.parametrize(
    "arguments, words",
    [(["nowhere"], "nowhere"), (["hardware", "--tests", "test/none.py"], "test/none.py"), ([FILE], "--tests")],
)
def test_bad_input_is_one_line(arguments, words):
    with pytest.raises(InputError, match=words):
        mutation.main(arguments)


def _ended(pid, within=20.0):
    """Whether a process is gone (or a zombie that nobody has fetched) within so many seconds."""
    until = time.monotonic() + within
    while time.monotonic() < until:
        try:
            with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
                if file.read().rpartition(")")[2].split()[0] == "Z":
                    return True
        except (FileNotFoundError, ProcessLookupError):
            return True
        time.sleep(0.05)
    return False


def _number(path, within=60.0):
    until = time.monotonic() + within
    while time.monotonic() < until:
        with contextlib.suppress(FileNotFoundError, ValueError):
            return int(path.read_text(encoding="utf-8"))
        time.sleep(0.05)
    raise AssertionError(f"{path}: nobody wrote it")


@pytest.fixture
def forking(tmp_path):
    """A folder with a test that forks what never ends, waits, and writes the number of the fork."""
    (tmp_path / "test_forks.py").write_text(textwrap.dedent(f"""
        import os, pathlib, time

        def test_forks():
            child = os.fork()
            while child == 0:
                time.sleep(0.1)
            pathlib.Path({str(tmp_path / "fork")!r}).write_text(str(child))
            time.sleep(600)
        """), encoding="utf-8")
    return tmp_path


def test_what_a_slow_mutant_forked_ends_with_it(forking):
    for slow in (4.0, 12.0, 60.0):                        # on a busy machine the test begins later
        assert mutation._run(str(forking), ["test_forks.py"], slow=slow) == (None, "")
        if (forking / "fork").exists():
            break
    assert _ended(_number(forking / "fork"))


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_workers_end_when_their_parent_is_stopped_or_killed(forking, how):
    program = textwrap.dedent(f"""
        import multiprocessing, os, pathlib
        from microstage_ros.commands.project import mutation
        if __name__ == "__main__":
            with multiprocessing.get_context("spawn").Pool(1, mutation._ends_with, (os.getpid(),)) as pool:
                pathlib.Path({str(forking / "worker")!r}).write_text(str(pool._pool[0].pid))
                pool.apply(mutation._run, ({str(forking)!r}, ["test_forks.py"]))
        """)
    (forking / "parent.py").write_text(program, encoding="utf-8")
    parent = subprocess.Popen([sys.executable, str(forking / "parent.py")], stderr=subprocess.DEVNULL)
    try:
        worker, fork = _number(forking / "worker"), _number(forking / "fork")
        os.kill(parent.pid, how)
        parent.wait(30.0)
        assert _ended(worker) and _ended(fork)
    finally:
        parent.kill()
        parent.wait()


def test_a_second_signal_does_not_cut_off_what_is_cleaned_up(tmp_path):
    """A parent with threads sends one as each of them ends: what a worker had forked then lived on, in 1 of 42 runs."""
    program = textwrap.dedent(f"""
        import os, pathlib, time
        from microstage_ros.commands.project import mutation
        mutation._ends_with(os.getppid())
        try:
            print(flush=True)
            time.sleep(600)
        finally:
            print(flush=True)
            time.sleep(1.0)
            pathlib.Path({str(tmp_path / "cleaned")!r}).touch()
        """)
    worker = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    try:
        for _ in range(2):                                 # in the body, then in what is cleaned up
            assert worker.stdout.readline() == b"\n"
            worker.terminate()
        assert worker.wait(30.0) == 1 and (tmp_path / "cleaned").exists()
    finally:
        worker.kill()
        worker.communicate()
