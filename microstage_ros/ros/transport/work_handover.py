"""A place of work for two threads: a servo loop, and the middleware's own thread that carries it on while it waits.

The middleware calls us in the thread in which it heard of a message. To answer there and then spares two of the four
wakings of a control period: nobody has to wake the loop's thread, and none of the loop's answers wait for it. So a loop
that has nothing left to do hands over all that it works on (`hand_over`); whoever brings the next message takes it
(`may_take`), does the period, and gives it back (`hand_back`). When something is out of the ordinary, or the loop's
thread is at work itself, the message stays where it is and the loop is woken for it, as it would be for every message
without all this.

Who brings a message holds the lock of the middleware's reader, which the loop needs to take one: so he never waits for
the handover, he only tries. The loop may wait for him.
"""

import numpy as np

from microstage_ros.numerics.compiled import address_of, called_from_c, compiled, in_place, kind_of, put_at, words_at
from microstage_ros.ros.transport.c_calls import lock, post, try_lock, unlock, wait

WAITING = -1
"""Nothing else to do than to wait for the next message. Any other value is why a loop has ended."""

SEMAPHORE, WHY, HEAD = 8, 9, 16
"""Places in a handover: a mutex of C before the first, the address of the loop's semaphore, WAITING while others may
carry on, and where what the loop works on begins."""
WORD = 8
SIZE = 1024


class Handover:
    """What one loop hands over while it waits.

    Parameters
    ----------
    on_message : compiled by `called_from_c`: ``on_message(pointer, count)`` with ``pointer[0]`` what `hand_over`
        was given.
    work : example of it, a tuple. servo : `FastServoPath`.

    Attributes
    ----------
    words : what the compiled functions of this file take.
    """

    def __init__(self, on_message, work, servo):
        self.words = np.zeros(SIZE, np.int64)
        self.words[SEMAPHORE] = servo.semaphore.address.value
        self._called = called_from_c(on_message, kind_of(work))
        self._servo = servo

    def answer(self, reader):
        """From now on what comes for ``reader`` is answered by who brings it, whenever the loop waits."""
        self._servo.call(reader, self._called, self.words.ctypes.data + HEAD * WORD, self)


@in_place
def begin_work(handover):
    """The loop's thread begins to work."""
    lock(handover.ctypes.data)
    handover[WHY] = 0


@in_place
def hand_over(handover, work, until, times):
    """The loop's thread waits for its semaphore, until the monotonic clock says ``until`` [ns]; others may carry on.

    Parameters
    ----------
    work : what they need, a tuple of arrays. times : int64 (2,), to work in.

    Returns
    -------
    True if it was woken, and why whoever carried on ended, WAITING if he did not.
    """
    put_at(handover.ctypes.data + HEAD * WORD, work)
    handover[WHY] = WAITING
    unlock(handover.ctypes.data)
    woken = wait(handover[SEMAPHORE], until, times)
    lock(handover.ctypes.data)
    why, handover[WHY] = handover[WHY], 0
    return woken, why


@in_place
def end_work(handover):
    """The loop's thread ends its work."""
    unlock(handover.ctypes.data)


@compiled
def handover_of(pointer):
    """The handover that holds what this points to."""
    return words_at(address_of(pointer) - HEAD * WORD, SIZE)


@in_place
def may_take(handover):
    """True for who brings a message if he is to answer it himself; else the loop's thread has been woken for it."""
    if not try_lock(handover.ctypes.data):
        post(handover[SEMAPHORE])
        return False
    if handover[WHY] != WAITING:
        unlock(handover.ctypes.data)
        post(handover[SEMAPHORE])
        return False
    return True


@in_place
def hand_back(handover, why):
    """He has done it; unless it is WAITING, ``why`` the loop's thread is needed."""
    handover[WHY] = why
    unlock(handover.ctypes.data)
    if why != WAITING:
        post(handover[SEMAPHORE])
