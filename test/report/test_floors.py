"""The table of what was asked and reached, from figures that are known."""

import copy

import pytest

from microstage_ros.commands.analysis.compare import _show
from microstage_ros.report.acceptance import floors_table

LAW = "self_tuning_observer"
MOVES = {"four_s_worst": 7e-9, "bias_worst": -1e-9, "instrument_four_s_worst": 6e-8, "settling_median": 0.1, "overshoot_worst": 4e-8}
NOMINAL = {"peak": 1e-8, "learned_peak": 1e-8, "four_s_worst": 8e-9}
GOOD = {
    "controllers": ["pid", LAW],
    "tracking": {LAW: {"worst": 1.2e-8}},
    "rest": {LAW: 1e-8},
    "sines": [{"peak": {LAW: 1e-8, "best_pid": 2e-8}}],
    "positioning": {LAW: {1e-6: dict(MOVES), 1e-3: dict(MOVES)}},
    "stress": {"nominal": {LAW: NOMINAL}, "payload": {LAW: {"peak": 1.9e-8, "learned_peak": 1.9e-8, "four_s_worst": 1.5e-8}}},
    "weak_start": {LAW: [1.0, 1.0, 1.0], "guarded_pid": [2.0, 2.0, 2.0], "kept_pid": [1.5, 1.5, 1.5], "best_pid": [1.0, 1.0, 1.0]},
    "observer": {"sine": {"total": 0.02}},
    "level_jumps": [{"seen": 0.2, "mean": 0.01, "rms": 0.015}],
    "slow_sines": [{"after": after, "worst": 1.4e-8} for after in (False, True)],
}


def cells(result):
    return {row[0]: row[2] for row in floors_table(result)[2]}


def test_nothing_is_missed():
    assert not [cell for cell in cells(GOOD).values() if "no" in cell]
    assert cells(GOOD)["sine of 10 µm at 0.03 Hz, worst peak (nm)"] == "12"


@pytest.mark.parametrize("path, value, row, told", [
    (("tracking", LAW, "worst"), 4.1e-8, "sine of 10 µm at 0.03 Hz, worst peak (nm)", "41 (no)"),
    (("sines", 0, "peak", LAW), 3e-8, "sines no worse than the PID searched for that very sine", "0 of 1 (no)"),
    (("positioning", LAW, 1e-3, "four_s_worst"), 2.6e-8, "moves, true position, 4s (nm)", "26 (no)"),
    (("positioning", LAW, 1e-3, "bias_worst"), -1.1e-8, "moves, bias (nm)", "11 (no)"),
    (("positioning", LAW, 1e-6, "settling_median"), float("inf"), "moves of 1 µm, settled, median (ms)", "never (no)"),
    (("positioning", LAW, 1e-6, "overshoot_worst"), 6e-8, "moves, overshoot over what is allowed (5 % or 50 nm)", "1.2 (no)"),
    (("positioning", LAW, 1e-3, "overshoot_worst"), 6e-8, "moves, overshoot over what is allowed (5 % or 50 nm)", "0.8"),
    (("stress", "payload", LAW, "learned_peak"), 2.1e-8, "stress: sine, third cycle, within twice nominal", "0 of 1 (no)"),
    (("stress", "payload", LAW, "peak"), 3e-6, "stress: stable", "0 of 1 (no)"),
    (("weak_start", LAW), [1.0, 1.0, 1.2], "from a tenth of the gains, third move over the PID searched for these moves alone", "1.2 (no)"),
    (("slow_sines", 0, "worst"), 1.62e-8, "slow sines of 10 µm with loaded contacts, from the start (nm)", "16.2 (no)"),
    (("slow_sines", 0, "worst"), 1.62e-8, "the same after a move of 1 mm and back (nm)", "14"),
    (("level_jumps", 0, "seen"), 2.5, "friction 15 % up or down, seen to 2 % after (s)", "2.5 (no)"),
])
def test_every_miss_is_told_in_its_row(path, value, row, told):
    result = copy.deepcopy(GOOD)
    place = result
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    assert cells(result)[row] == told


def test_the_printed_tables_are_not_cut(capsys):
    """A table broader than the terminal lost the ends of its names."""
    _show([("Moves", ["controller", *(f"4s interferometer {k}" for k in range(8))], [["self_tuning_feedforward", *["13.4 (9.8 … 21.1)"] * 8]], "")])
    printed = capsys.readouterr().out
    assert "self_tuning_feedforward" in printed and printed.count("13.4 (9.8 … 21.1)") == 8 and "4s interferometer 7" in printed
