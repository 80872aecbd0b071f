"""Repetitions follow from the motion, wherever the runs were cut; a uniform change has a uniform cause."""

import dataclasses
import functools

import numpy as np
import pytest

from microstage_ros.diagnosis.logs.case import diagnose_logs
from microstage_ros.diagnosis.validation import simulated_logs
from test.diagnosis.logs.test_simulated import describe, machine_with, told

SIGNALS = "reference position current"
DEGRADED = {"names": simulated_logs.SIGNALS[SIGNALS][0], "signed": True, "rate": 250.0, "gain": 0.02, "noise": 1.0, "quantum": 0.0, "place_noise": 2e-6,
            "run": 0.005, "load_side": True, "temperature": 0.01, "ohmic": 0.7, "force_of_1_V": 60.0}
CYCLE_S = 3.2            # there and back, with both rests


@functools.cache
def twelve_cycles(level, seed):
    """One log without a break."""
    return simulated_logs.log_of(machine_with(level=level), 1, 12, np.random.default_rng(seed), DEGRADED, {}, f"level {level}")


def cut(log, seconds):
    """The log with a column of runs that begin every so many seconds."""
    run = ((log.time - log.time[0]) / seconds + 1e-9).astype(int)
    return dataclasses.replace(log, run=run, piece=np.zeros(len(run), int), runs=[(float(k),) for k in range(run.max() + 1)])


@pytest.mark.parametrize("seconds", [2.0 * CYCLE_S, 0.5 * CYCLE_S, 0.7, 0.1])
def test_runs_cut_elsewhere_than_at_the_moves_hide_nothing(seconds):
    healthy, changed, again = (cut(twelve_cycles(*which), seconds) for which in ((60.0, 3), (90.0, 9), (60.0, 4)))
    result = diagnose_logs([healthy], [changed], describe(SIGNALS))
    causes, rivals = told(result)
    assert (causes or rivals)[:1] == ["friction_level_change"], (causes, rivals)
    assert diagnose_logs([healthy], [again], describe(SIGNALS)).diagnosis.verdict == "agrees"
    assert any("cut within the motion" in note for note in result.diagnosis.notes) == (seconds < CYCLE_S)


def of_two_speeds(level, seed):
    """Eight runs, slow and fast in turn."""
    parts = [simulated_logs.log_of(dataclasses.replace(machine_with(level=level), top=top), 1, 2, np.random.default_rng(seed + k), DEGRADED, {}, "speeds")
             for k, top in enumerate([0.02, 0.1] * 4)]
    run = np.repeat(np.arange(8), [len(p) for p in parts])
    return dataclasses.replace(parts[0], time=np.concatenate([p.time for p in parts]), piece=run, run=run, condition=np.zeros(len(run), int),
                               signals={k: np.concatenate([p.signals[k] for p in parts]) for k in parts[0].signals}, runs=[(float(k),) for k in range(8)])


@pytest.mark.parametrize("seed", [50, 150])
def test_a_uniform_change_has_a_uniform_cause(seed):
    """Sliding friction half as much again at every place and both speeds, viscous friction as before."""
    causes, rivals = told(diagnose_logs([of_two_speeds(60.0, seed)], [of_two_speeds(90.0, seed + 20)], describe(SIGNALS)))
    assert (causes or rivals)[:1] == ["friction_level_change"] and "position_dependent_friction" not in causes + rivals, (causes, rivals)


def test_runs_of_one_speed_each_are_all_compared():
    result = diagnose_logs([of_two_speeds(60.0, 50)], [of_two_speeds(60.0, 90)], describe(SIGNALS))
    assert result.diagnosis.verdict == "agrees" and not any("are not compared" in note for note in result.diagnosis.notes)
