"""What other threads ask of the servo loop: done between two periods, withdrawn when nobody waits for it any more."""

import threading

import pytest

from microstage_ros.ros.transport.requests import Requests


def test_a_request_that_timed_out_is_never_done():
    requests, done = Requests(), []
    with pytest.raises(TimeoutError, match="withdrawn"):
        requests.ask(lambda: done.append("activate"), timeout=0.01)
    with pytest.raises(TimeoutError, match="as soon as the loop goes on"):
        requests.ask(lambda: done.append("stop"), timeout=0.01, withdraw=False)
    requests.serve()
    assert done == ["stop"] and requests.asked[0] == 0


def test_an_answer_and_an_error_reach_who_asked():
    requests, found = Requests(), []

    def asker():
        found.append(requests.ask(lambda: 7, timeout=60.0))
        with pytest.raises(ValueError, match="no"):
            requests.ask(lambda: int("no"), timeout=60.0)
        found.append("told")

    thread = threading.Thread(target=asker)
    thread.start()
    while thread.is_alive():
        requests.serve()
        thread.join(0.001)
    assert found == [7, "told"]


def test_nobody_waits_for_a_loop_that_has_ended():
    """The controller's callback did, for 2 s after every second Ctrl-C of a cell."""
    requests, done, errors = Requests(), [], []

    def asker(action, **how):
        try:
            requests.ask(action, timeout=60.0, **how)
        except TimeoutError as error:
            errors.append(str(error))

    waiting = [threading.Thread(target=asker, args=(lambda: done.append("activate"),)),
               threading.Thread(target=asker, args=(lambda: done.append("stop"),), kwargs={"withdraw": False})]
    for thread in waiting:
        thread.start()
    while requests._queue.qsize() < 2:
        pass
    requests.close()
    for thread in waiting:
        thread.join(60.0)
    asker(lambda: done.append("too late"))
    assert done == ["stop"] and errors == ["the servo loop has ended"] * 2
