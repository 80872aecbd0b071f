"""Calls in the callback group of a client, from another thread than the executor's."""

import threading

import pytest
from rclpy.executors import MultiThreadedExecutor
from ros_support import ros_node

from microstage_ros.ros.transport.calls_in_turn import CallsInTurn


def test_calls_run_in_the_group_and_answer_where_they_were_asked_for():
    with ros_node() as node:
        calls, under_way, together = CallsInTurn(node), [], []

        def one(number):
            under_way.append(number)
            together.append(len(under_way))
            under_way.remove(number)
            return number, threading.get_ident()

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
    assert not {ident for _, ident in answers} & {asker.ident for asker in askers}
