"""Records side by side: in order, inside itself too, after a fork, and with the first error raised."""

import os

import pytest

from microstage_ros.diagnosis.preprocessing.threads import side_by_side


def test_in_order_and_inside_itself():
    nested = side_by_side(lambda k: side_by_side(lambda j: 10 * k + j, range(5)), range(9))
    assert nested == [[10 * k + j for j in range(5)] for k in range(9)]
    assert side_by_side(abs, iter([-1])) == [1] and side_by_side(abs, []) == []


def test_the_first_error_is_raised_and_the_threads_go_on():
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda k: 1 / k, [1, 0, 2])
    assert side_by_side(lambda k: 2 * k, [1, 2, 3]) == [2, 4, 6]


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_makes_its_own():
    assert side_by_side(abs, [-1, -2]) == [1, 2]
    child = os.fork()
    if not child:
        right = False
        try:
            right = side_by_side(abs, [-3, -4]) == [3, 4]
        finally:
            os._exit(0 if right else 1)     # whatever happens, the child is no second test run
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
