"""The demo's headline says what the interval allows; a move that did not settle counts."""

import numpy as np
import pytest

from microstage_ros.commands.operation.demo_report import accuracy_rows, comparison, headline, table_cells


def moves(errors, target=1e-6, reached=True):
    return [{"target_m": target, "reached": reached, "interferometer_error_m": e, "final_error_m": e, "settling_time_s": 0.1,
             "overshoot_m": 0.0} for e in errors]


def test_two_repeats_never_say_that_the_paper_is_beaten():
    """4s of ±10 nm from n = 2 is 57 nm, but its 95 % interval reaches beyond 173 nm."""
    results = moves([1e-8, -1e-8])
    rows = accuracy_rows(results)
    assert rows[0]["repeatability"].four_s < rows[0]["paper"] < rows[0]["repeatability"].four_s_interval[1]
    assert comparison(rows[0]) == "open"
    text, sure = headline(rows, results)
    assert "below the paper's for 0 of 1 targets" in text and "cannot tell" in text and not sure


def test_many_repeats_say_it():
    results = moves(1e-8 * np.tile([1.0, -1.0, 0.5, -0.5], 10))
    text, sure = headline(accuracy_rows(results), results)
    assert sure and "below the paper's for 1 of 1 targets" in text and "cannot tell" not in text


def test_a_move_that_did_not_settle_counts():
    results = moves(1e-8 * np.tile([1.0, -1.0], 20)) + moves([5e-6], reached=False)
    rows = accuracy_rows(results)
    assert comparison(rows[0]) == "open" and table_cells(rows)[0][1] == "40 of 41"
    text, sure = headline(rows, results)
    assert text.startswith("40 of 41 moves settled") and not sure


@pytest.mark.parametrize("size", [1e-6])
def test_worse_is_said_too(size):
    results = moves(size * np.tile([1.0, -1.0], 20))
    assert comparison(accuracy_rows(results)[0]) == "above"
    assert "above for 1" in headline(accuracy_rows(results), results)[0]
