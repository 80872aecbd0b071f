"""Who brings a message does the loop's work while the loop waits, and only then; nothing is done twice or forgotten."""

import ctypes
import threading

import numpy as np
import pytest

from microstage_ros.numerics.compiled import called_from_c, compiled, kind_of
from microstage_ros.ros.transport.c_calls import MONOTONIC, now
from microstage_ros.ros.transport.servo_path import Semaphore
from microstage_ros.ros.transport.work_handover import (
    HEAD,
    SEMAPHORE,
    SIZE,
    WAITING,
    WORD,
    handover_of,
    hand_back,
    end_work,
    hand_over,
    may_take,
    begin_work,
)

ENOUGH, LATE = 7, 8


@compiled
def do_one(done, most):
    """One message: ENOUGH when there have been ``most``."""
    done[0] += 1
    return ENOUGH if done[0] % most[0] == 0 else WAITING


def on_message(work, count):
    """As `driver_loop.on_message`."""
    handover = handover_of(work)
    if may_take(handover):
        hand_back(handover, do_one(*work[0]))


@compiled
def loop(handover, work, patience_ns, times):
    """Wait until somebody else has found a reason to end, LATE when nobody came for ``patience_ns``. Also: wakings."""
    wakings, woken, why = 0, True, WAITING
    begin_work(handover)
    while woken and why == WAITING:
        woken, why = hand_over(handover, work, now(MONOTONIC, times) + patience_ns, times)
        wakings += woken
    end_work(handover)
    return LATE if why == WAITING else why, wakings


class Place:
    """A handover with its work, and `bring`, a message as the middleware brings it."""

    def __init__(self, most):
        self.done, self.times, self.semaphore = np.zeros(1, np.int64), np.zeros(2, np.int64), Semaphore()
        self.work = (self.done, np.full(1, most))
        self.handover = np.zeros(SIZE, np.int64)
        self.handover[SEMAPHORE] = self.semaphore.address.value
        self._called = called_from_c(on_message, kind_of(self.work))
        call = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_uint64)(self._called.address)
        self.bring = lambda: call(self.handover.ctypes.data + HEAD * WORD, 1)

    def run(self, patience=0.01):
        """`loop`."""
        return loop(self.handover, self.work, round(patience * 1e9), self.times)


@pytest.fixture
def place():
    made = Place(3)
    assert made.run(0.0) == (LATE, 0)  # compiled
    return made


def test_a_loop_that_is_away_is_woken_and_the_message_left_to_it(place):
    place.bring()
    assert place.done[0] == 0
    assert place.run() == (LATE, 1) and place.done[0] == 0


def test_a_loop_that_waits_is_carried_on_and_woken_at_the_end(place):
    ended = []
    waits = threading.Thread(target=lambda: ended.append(place.run(60.0)))
    waits.start()
    while not ended:
        place.bring()
    waits.join()
    assert ended[0][0] == ENOUGH and place.done[0] == 3  # what came afterwards was left alone


def test_many_who_bring_and_a_loop_that_comes_and_goes(place):
    """Every third message done ends a wait, each of them once, however the threads meet."""
    threads = [threading.Thread(target=lambda: [place.bring() for _ in range(20_000)]) for _ in range(2)]
    for thread in threads:
        thread.start()
    reasons = []
    while any(thread.is_alive() for thread in threads):
        reasons.append(place.run(0.001)[0])
    assert 3 < place.done[0] < 40_000 and reasons.count(ENOUGH) == place.done[0] // 3
