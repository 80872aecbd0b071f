"""A voltage that acts later than the observer law is designed for: found, handed over, and not found where there is none."""

import numpy as np
import pytest

from microstage_ros.control.friction_observer import FrictionObserver

PROGRAM = [
    {"sine": {"amplitude_m": 1e-5, "frequency_hz": 0.5, "cycles": 1.0}},
    *({"move_to_m": place, "dwell_s": 0.2} for place in (1e-4, 0.0, 1e-3, 0.0)),
]


def delayed(axis, columns):
    """Whether the observer takes the voltage to act late, in every period."""
    observer = FrictionObserver(axis)
    voltage = np.concatenate([[0.0], columns["voltage_V"][:-1]])
    return observer.advance_all(columns["encoder_m"], voltage, columns["current_A"], range(len(voltage)))["delayed"]


def largest(columns):
    return np.abs(columns["stage_m"] - columns["reference_m"]).max()


@pytest.mark.parametrize("delay", [5e-4, 1e-3])
def test_long_delay_is_found_at_once_and_costs_no_more_than_under_the_encoder_only_law(axis, run, delay):
    """Not found, 1 ms left the axis 5 to 72 um off (five seeds of a campaign), where `self_tuning` has 3.5.

    Single runs of either law go up to 10 um: medians are compared.
    """
    effects = {"transport_delay": {"delay_s": delay}}
    ours, others = [], []
    for seed in range(1, 8):
        columns = run("self_tuning_observer", PROGRAM, seed=seed, effects=effects)
        assert np.flatnonzero(delayed(axis, columns))[0] < 0.05 / 1e-4
        ours.append(largest(columns))
        others.append(largest(run("self_tuning", PROGRAM, seed=seed, effects=effects)))
    assert np.median(ours) < 1.2 * np.median(others) and max(ours) < 1.5 * max(others)


@pytest.mark.parametrize("conditions", [
    {},
    {"noise": {"current_A": 5e-3}},
    {"effects": {"transport_delay": {"delay_s": 3e-4}}},
    {"effects": {"amplifier_gain": {"factor": 2.0}}},
    {"effects": {"payload_change": {"mass_kg": 9.18}}},
])
def test_no_long_delay_is_found_where_there_is_none(axis, run, conditions):
    for seed in (1, 2):
        assert not np.any(delayed(axis, run("self_tuning_observer", PROGRAM, seed=seed, **conditions)))
