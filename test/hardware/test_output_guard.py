"""The watchdog's process: the voltage goes when commands stop, when the driver hangs and when it is gone, and not before."""

import os
import resource
import signal
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from microstage_ros.hardware import watchdog
from microstage_ros.hardware.output_guard import OutputGuard
from microstage_ros.hardware.watchdog import BEAT, BYTES, HOLDS, LIMIT, TAKEN, TAKEN_COUNT, VOLTS, Watch

LIMIT_S = 0.05


def wait(condition, seconds=120.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.002)


@pytest.fixture
def guard():
    made = OutputGuard(LIMIT_S)
    assert made.start()
    yield made
    made.close()


def test_it_starts_from_a_process_of_more_than_a_thousand_descriptors():
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 2048), hard))
    taken, made = [os.open(os.devnull, os.O_RDONLY) for _ in range(1100)], OutputGuard(LIMIT_S)
    try:
        assert made.start()
        looked = int(made.words[watchdog.DOG])
        wait(lambda: made.words[watchdog.DOG] > looked)  # it goes on
    finally:
        made.close()
        for descriptor in taken:
            os.close(descriptor)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_a_look_in_time_and_a_look_too_late():
    memory, stopped = bytearray(BYTES), []
    watch = Watch(memory, lambda: stopped.append(1))
    assert watch.look() == watchdog.LONGEST  # not armed
    now = time.monotonic_ns()
    watch.set(LIMIT, 10**9)
    watch.set(BEAT, now)
    struct.pack_into("<d", memory, 8 * VOLTS, 1.5)
    assert 0.0 < watch.look() <= watchdog.LONGEST and not stopped
    watch.set(BEAT, now - 2 * 10**9)
    watch.look()
    assert stopped == [1] and struct.unpack_from("<d", memory, 8 * VOLTS)[0] == 0.0 and watch.word(TAKEN) and watch.word(TAKEN_COUNT) == 1
    at = watch.word(TAKEN)
    watch.look()
    watch.died()  # when it was taken first stays known; a machine's outside stop is called once more
    assert watch.word(TAKEN) == at and watch.word(TAKEN_COUNT) == 1 and len(stopped) == 2


def test_when_it_looks_next(monkeypatch):
    memory = bytearray(BYTES)
    watch = Watch(memory)
    monkeypatch.setattr(time, "monotonic_ns", lambda: 10**12)
    assert watch.look() == 0.1 and watch.word(watchdog.DOG) == 10**12
    watch.set(LIMIT, 10**7)
    for age, expected in ((0, 0.01), (4 * 10**6, 0.006), (-(10**9), 0.1), (10**7, 0.01), (5 * 10**7, 0.01)):
        watch.set(BEAT, 10**12 - age)
        assert watch.look() == pytest.approx(expected)
    assert watch.word(TAKEN) == 0  # there was no voltage to take away
    struct.pack_into("<d", memory, 8 * VOLTS, -1e-3)
    watch.set(BEAT, 10**12 - 10**7 + 1)
    assert watch.look() == pytest.approx(1e-9) and watch.word(TAKEN) == 0
    watch.set(BEAT, 10**12 - 10**7)
    assert watch.look() == pytest.approx(0.01) and watch.word(TAKEN) == 10**12
    watch.died()
    assert watch.word(watchdog.DIED) == 10**12


def test_words_of_the_shared_memory():
    """Driver and watchdog are two programs: each place is one number, 64 bit wide."""
    places = VOLTS, BEAT, LIMIT, TAKEN, watchdog.DOG, TAKEN_COUNT, watchdog.DIED, watchdog.ZEROED, HOLDS
    assert places == tuple(range(9)) and BYTES == 72
    made = OutputGuard(0.25)
    assert made.words.shape == made.volts.shape == (9,) and not made.words.any() and made.pid is None and not made.watching
    assert not made.taken and made.taken_count == 0 and made.restarts == 0
    made.arm()
    assert made.words[LIMIT] == 250_000_000 and made.words[BEAT] > 0
    made.put(1.0)
    made.words[TAKEN] = made.words[BEAT] + 1_500_000_000
    assert made.words[watchdog.ZEROED] == 0 and made.taken_after == pytest.approx(1.5)
    made.arm()
    assert made.taken == 0
    made.put(0.0)
    at = made.words[watchdog.ZEROED]
    made.put(0.0)
    assert at > 0 and made.words[watchdog.ZEROED] == at
    made.close()
    holds = OutputGuard(0.25, holds=True)
    holds.arm()
    assert holds.words[LIMIT] == 0  # nothing to take away
    holds.close()


def late(memory, stop, volts=1.5):
    """A watch whose last command is too long ago."""
    watch = Watch(memory, stop)
    struct.pack_into("<d", memory, 8 * VOLTS, volts)
    watch.set(LIMIT, 10**6)
    watch.set(BEAT, time.monotonic_ns() - 10**9)
    return watch


def test_a_stop_that_does_not_succeed_is_called_again_until_it_does():
    answers = [False, False, True]
    watch = late(bytearray(BYTES), lambda: answers.pop(0))
    for left in (2, 1, 0, 0, 0):
        watch.look()
        assert len(answers) == left
    assert watch.word(TAKEN_COUNT) == 1


def test_what_is_put_out_again_by_a_loop_that_stands_still_is_taken_away_again():
    memory, stopped = bytearray(BYTES), []
    watch = late(memory, lambda: stopped.append(1))
    watch.look()
    struct.pack_into("<d", memory, 8 * VOLTS, 1.5)
    watch.set(LIMIT, 10**12)
    watch.set(BEAT, time.monotonic_ns() - 2 * 10**12)
    watch.look()
    assert len(stopped) == 1  # the driver has so long to hear of it
    watch.set(LIMIT, 10**6)
    time.sleep(0.002)
    watch.look()
    assert len(stopped) == 2 and struct.unpack_from("<d", memory, 8 * VOLTS)[0] == 0.0 and watch.word(TAKEN_COUNT) == 2


def test_after_the_drivers_death_the_stop_is_tried_until_it_succeeds_or_time_is_over(monkeypatch):
    answers = [False] * 3 + [True]
    assert Watch(bytearray(BYTES), lambda: answers.pop(0)).died() and not answers
    taken = late(bytearray(BYTES), lambda: answers.pop(0))
    answers += [False, False, True]
    taken.look()
    assert taken.died() and not answers and taken.word(TAKEN_COUNT) == 1
    monkeypatch.setattr(watchdog, "TRIES_S", 0.05)
    tries = []
    assert not Watch(bytearray(BYTES), lambda: tries.append(1) or False).died() and len(tries) > 1


@pytest.mark.parametrize("text", ["null", "[]"])
def test_no_stop_from_outside(text):
    assert watchdog.outside_stop(text)() is True


def test_a_stop_from_outside_that_fails_is_told_once(tmp_path, monkeypatch, capsys):
    (tmp_path / "a_card_that_fails.py").write_text("def take(volts):\n    raise OSError(f'no {volts}')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    stop = watchdog.outside_stop('["a_card_that_fails:take", {"volts": 3}]')
    assert stop() is False and stop() is False
    assert capsys.readouterr().err == "watchdog: a_card_that_fails:take: OSError: no 3\n"


def test_its_process_watches_until_the_driver_is_gone():
    made = OutputGuard(0.0)
    alive, ours = os.pipe()
    process = subprocess.Popen([sys.executable, watchdog.__file__, str(made._memory), str(alive), "null"], pass_fds=[made._memory, alive])
    os.close(alive)
    made.put(1.0)
    wait(lambda: made.words[watchdog.DOG])
    assert process.poll() is None and made.words[watchdog.DIED] == 0
    os.close(ours)
    assert process.wait(120) == 0
    assert made.volts[VOLTS] == 0.0 and made.words[watchdog.DIED] == made.taken and made.taken_count == 1
    made.close()


@pytest.mark.parametrize("permitted", [True, False])
def test_it_asks_for_real_time_priority_and_does_without(monkeypatch, permitted):
    memory, (alive, ours), asked, ignored = os.memfd_create("output"), os.pipe(), [], []

    def schedule(pid, policy, parameters):
        asked.append((pid, policy, parameters.sched_priority))
        if not permitted:
            raise PermissionError("not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", schedule)
    monkeypatch.setattr(signal, "signal", lambda *what: ignored.append(what))
    monkeypatch.setattr(watchdog.gc, "freeze", lambda: None)
    monkeypatch.setattr(watchdog.gc, "disable", lambda: None)
    os.ftruncate(memory, BYTES)
    os.close(ours)  # the driver is gone at once
    assert watchdog.main([str(memory), str(alive), "null"]) == 0
    assert asked == [(0, os.SCHED_FIFO, 40)] and ignored == [(number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    words = struct.unpack("<9q", os.pread(memory, BYTES, 0))
    assert words[watchdog.DIED] == words[TAKEN] > 0 and words[TAKEN_COUNT] == 1
    os.close(memory)
    os.close(alive)


def test_a_watchdog_that_does_not_start_is_not_waited_for(monkeypatch):
    start = subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", lambda command, **more: start(["true"], **more))
    made = OutputGuard(LIMIT_S)
    assert not made.start(wait=1e6) and not made.watching  # its process has ended
    monkeypatch.setattr(subprocess, "Popen", lambda command, **more: start(["sleep", "100"], **more))
    assert not made.start(wait=0.05) and not made.watching and made.pid is not None
    made.close()
    assert made.pid is None


def test_one_that_has_not_looked_for_two_seconds_does_not_watch(guard, monkeypatch):
    now = time.monotonic_ns
    wait(lambda: guard.watching)
    os.kill(guard.pid, signal.SIGSTOP)
    time.sleep(0.05)
    looked = int(guard.words[watchdog.DOG])
    monkeypatch.setattr(time, "monotonic_ns", lambda: looked + 1_999_999_999)
    assert guard.watching
    monkeypatch.setattr(time, "monotonic_ns", lambda: looked + 2_000_000_000)
    assert not guard.watching
    monkeypatch.setattr(time, "monotonic_ns", now)


def test_the_loop_that_has_gone_to_zero_itself_is_left_alone():
    memory = bytearray(BYTES)
    watch = Watch(memory)
    watch.set(LIMIT, 1)
    watch.look()
    assert watch.word(TAKEN) == 0


def test_an_output_that_holds_a_position_is_left_as_it_is():
    memory = bytearray(BYTES)
    watch = Watch(memory)
    watch.set(HOLDS, 1)
    struct.pack_into("<d", memory, 8 * VOLTS, 1.5)
    watch.died()
    assert struct.unpack_from("<d", memory, 8 * VOLTS)[0] == 1.5 and watch.word(TAKEN)
    guard = OutputGuard(LIMIT_S, holds=True)
    guard.arm()
    guard.put(1.5)
    guard.close()
    assert guard.words[LIMIT] == 0 and guard.words[HOLDS] == 1 and guard.volts[VOLTS] == 1.5


def test_commands_stop(guard):
    guard.arm()
    guard.put(1.0)
    for _ in range(5):
        guard.commanded(time.monotonic_ns())
        time.sleep(LIMIT_S / 5)
    wait(lambda: guard.taken)
    assert guard.volts[VOLTS] == 0.0 and guard.taken_after >= LIMIT_S and guard.taken_count >= 1
    guard.hand_back()
    assert not guard.taken and guard.volts[VOLTS] == 0.0


def test_disarmed_it_waits(guard):
    guard.put(1.0)
    guard.disarm()
    time.sleep(4 * LIMIT_S)
    assert guard.volts[VOLTS] == 1.0 and not guard.taken


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_watchdog_that_does_not_watch_is_replaced(guard, number):
    first = guard.pid
    assert guard.renew() and guard.pid == first
    os.kill(first, number)
    wait(lambda: not guard.watching)
    wait(lambda: guard.renew())
    assert guard.pid != first and guard.restarts >= 1


def test_a_slow_start_is_not_taken_for_a_hang(monkeypatch):
    """Who looks after the watchdog leaves one alone that another thread is starting."""
    start = subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", lambda command, **more: start(["sh", "-c", 'sleep 0.3; exec "$@"', "sh", *command], **more))
    made, watches = OutputGuard(LIMIT_S), []
    starting = threading.Thread(target=lambda: watches.append(made.start()))
    starting.start()
    while starting.is_alive():
        assert made.renew() or not starting.is_alive()
        time.sleep(0.02)
    assert watches == [True] and made.restarts == 0
    made.close()


def test_it_outlives_signals_and_ends_with_the_driver(guard):
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(guard.pid, number)
    time.sleep(0.2)
    assert guard.watching


DRIVER = """
import sys, time
from microstage_ros.hardware.output_guard import OutputGuard
guard = OutputGuard(0.0)
assert guard.start(("{module}:take", {{"path": sys.argv[1]}}) if len(sys.argv) > 1 else None)
guard.put(1.25)
print(guard.pid, flush=True)
time.sleep(60)
"""
MODULE = "from pathlib import Path\ndef take(path):\n    Path(path).write_text('zero')\n"


def test_the_death_of_the_driver_takes_the_voltage_of_a_machine_away(tmp_path):
    (tmp_path / "my_card.py").write_text(MODULE)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])}
    driver = subprocess.Popen([sys.executable, "-c", DRIVER.format(module="my_card"), str(tmp_path / "told")], env=environment,
                              stdout=subprocess.PIPE, text=True)
    try:
        watchdog_pid = int(driver.stdout.readline())
        assert not (tmp_path / "told").exists()
    finally:
        driver.kill()
        driver.communicate()
    wait(lambda: (tmp_path / "told").exists() and (tmp_path / "told").read_text() == "zero")
    wait(lambda: not Path(f"/proc/{watchdog_pid}").exists() or "Z" in Path(f"/proc/{watchdog_pid}/stat").read_text().rsplit(")", 1)[1].split()[0])
