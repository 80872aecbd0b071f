"""Calls in the callback group of a client, from another thread than the executor's; calls that are made again."""

import threading

import pytest
from rclpy.executors import MultiThreadedExecutor
from rclpy.task import Future
from ros_support import ros_node

from microstage_ros.ros.transport.calls import CallsInTurn, RepeatedCall


def test_calls_run_in_the_group_and_answer_where_they_were_asked_for():
    with ros_node() as node:
        calls, under_way, together = CallsInTurn(node), [], []

        def one(number):
            under_way.append(number)
            together.append(len(under_way))
            under_way.remove(number)
            return number, threading.current_thread()  # an ended thread's number goes to the next one

        executor = MultiThreadedExecutor(4)
        executor.add_node(node)
        thread = threading.Thread(target=executor.spin, daemon=True)
        thread.start()
        answers = []
        askers = [
            threading.Thread(target=lambda k=k: answers.extend(calls.call(lambda n=n: one(n)) for n in range(10 * k, 10 * k + 10)))
            for k in range(4)
        ]
        for asker in askers:
            asker.start()
        for asker in askers:
            asker.join(30.0)
        with pytest.raises(ZeroDivisionError):
            calls.call(lambda: 1 / 0)
        executor.shutdown()
        thread.join(10.0)
    assert sorted(number for number, _ in answers) == list(range(40)) and set(together) == {1}
    assert not {thread for _, thread in answers} & set(askers)


def asked(every):
    """A call, and its futures so far."""
    futures = []

    def call():
        futures.append(Future())
        return futures[-1]

    return RepeatedCall(call, every), futures


def test_no_call_is_made_again_before_its_time():
    question, futures = asked(60.0)
    assert not any(question.done() for _ in range(5)) and len(futures) == 1 and question.result() is None


def test_a_call_without_an_answer_is_made_again_and_any_answer_counts():
    question, futures = asked(0.0)
    while len(futures) < 3:
        assert not question.done()
    futures[1].set_result("late")  # of a call that was given up
    assert question.done() and question.result() == "late"
    assert question.done() and len(futures) == 3, "what has an answer is not asked again"
