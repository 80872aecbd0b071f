"""A dead band of the amplifier: found, compensated, and not found where there is none; R where the current is noisy."""

import numpy as np
import pytest

from microstage_ros.control.evaluation.comparison import STRESS
from microstage_ros.control.friction_observer import FrictionObserver
from microstage_ros.control.observer.dead_band import INVERSE_WIDTH, beyond_band, over_band
from microstage_ros.control.runs.run_file import run_from_dict
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.control.runs.trials import step_trial

PROGRAM = [
    {"sine": {"amplitude_m": 1e-5, "frequency_hz": 0.25, "cycles": 1.0}},
    *({"move_to_m": place, "dwell_s": 0.2} for place in (1e-5, 0.0, 1e-4, 0.0, 1e-3, 0.0)),
]


def bands(axis, columns):
    """Dead band [V] that the observer has found by every period."""
    observer = FrictionObserver(axis)
    voltage = np.concatenate([[0.0], columns["voltage_V"][:-1]])
    seen = range(len(voltage))
    return observer.advance_all(columns["encoder_m"], voltage, columns["current_A"], seen)["dead_band"]


def test_the_inverse_undoes_the_band():
    for voltage in (-1.0, -0.02, INVERSE_WIDTH, 0.5):
        assert beyond_band(over_band(voltage, 0.03), 0.03) == pytest.approx(voltage, abs=1e-15)
    assert over_band(0.0, 0.03) == 0.0 and abs(beyond_band(0.02, 0.03)) == 0.0


@pytest.mark.parametrize("half_width", [0.005, 0.01, 0.05])
def test_dead_band_is_found_and_commanded_over(axis, run, half_width):
    """Not learned, it leaves moves of 1 mm 2 to 7 um off (5 seeds); learned, not more than the healthy axis has.

    Of 5 mV the error is 0.08 mV on average with a standard deviation of 0.11 mV (30 seeds; wider bands: 0.3 to 0.7 % and as much).
    """
    largest = []
    for seed in (1, 2, 3):
        columns = run("self_tuning_observer", PROGRAM, seed=seed, effects={"amplifier_deadband": {"half_width_V": half_width}})
        assert bands(axis, columns)[-1] == pytest.approx(half_width, rel=0.06, abs=5e-4)
        moves = slice(round(4.2 / 1e-4), None)
        largest.append(np.abs(columns["stage_m"] - columns["reference_m"])[moves].max())
    assert np.median(largest) < 1.5e-7 and max(largest) < 5e-7


@pytest.mark.parametrize("conditions", [
    {},
    {"noise": {"current_A": 5e-3}},
    {"effects": {"resistance_rise": {"initial": 0.2, "time_s": 5.0}}},
    {"effects": {"amplifier_gain": {"factor": 0.5}}},
    {"effects": {"backlash": {"width_rad": np.radians(0.5)}}},
])
def test_no_dead_band_is_found_where_there_is_none(axis, run, conditions):
    for seed in (1, 2):
        columns = run("self_tuning_observer", PROGRAM, seed=seed, **conditions)
        assert not np.any(bands(axis, columns))


def test_fast_moves_feign_no_dead_band(axis):
    """Short moves with half the friction: the averaged speed lagged by what no average allows for, a dead band of 23 to 39 mV was
    found for a second, and in 24 of 200 records (12 %) a move from the fourth on ended 30 to 80 nm off, in these six among them."""
    ends = [step_trial(axis, "self_tuning_observer", {}, 1e-5, seed, 8, **STRESS["friction x 0.5"]).errors[3:] for seed in (1, 8, 11, 19, 28, 33)]
    assert np.abs(ends).max() < 2.5e-8


@pytest.mark.parametrize("factor", [0.7, 1.0, 1.3])
def test_resistance_is_known_though_the_current_is_noisy(axis, run, factor):
    """Weighed by the model alone, R went to 2.8 times the file's with 5 mA of noise, and moves 8.5 um off (one of five seeds)."""
    machine = axis.with_values({"drive.resistance": factor * axis.value("drive.resistance")}, source="estimate")
    largest, learned = [], []
    for seed in range(1, 6):
        run_file = run_from_dict({"controller": {"type": "self_tuning_observer"}, "noise": {"current_A": 5e-3}, "program": PROGRAM,
                                  "start": {"friction": "relaxed"}})
        columns = simulate(axis, run_file, seed, machine=machine)
        observer = FrictionObserver(axis)
        observer.advance_all(columns["encoder_m"], np.concatenate([[0.0], columns["voltage_V"][:-1]]), columns["current_A"])
        assert observer.memory["binned_resistance"] == pytest.approx(factor, rel=0.05)
        learned.append(observer.memory["learned"][0])
        largest.append(np.abs(columns["stage_m"] - columns["reference_m"])[round(4.2 / 1e-4) :].max())
    assert np.median(learned) == pytest.approx(factor, abs=0.1)
    assert np.median(largest) < 3e-7 and max(largest) < 1e-6
