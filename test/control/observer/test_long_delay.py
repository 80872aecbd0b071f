"""A voltage that acts five periods late or later: found, counted with in a slower loop, and not found where there is none."""

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


def largest(columns, first=0):
    """Largest true error from row ``first`` on [m]."""
    return np.abs(columns["stage_m"] - columns["reference_m"])[first:].max()


@pytest.mark.parametrize("delay, most", [(5e-4, 2e-7), (1e-3, 9e-7), (2e-3, 5e-6)])
def test_long_delay_is_found_at_once_and_the_observer_law_goes_on_with_it(axis, run, delay, most):
    """Handed over to the encoder-only law it cost 2.4, 5.4 and 15 um; after the first 0.1 s, in which it is found."""
    effects = {"transport_delay": {"delay_s": delay}}
    for seed in range(1, 8):
        columns = run("self_tuning_observer", PROGRAM, seed=seed, effects=effects)
        assert np.flatnonzero(delayed(axis, columns))[0] < 0.05 / 1e-4
        assert largest(columns, first=1000) < most


def test_half_a_millisecond_costs_less_than_a_tenth_of_a_micrometre(axis, run):
    """Of 2400 records none goes beyond 0.15 um (0 to 0.15 %; seeds 36000 to 38399), 50 nm in the median. Before the doubts of the
    first milliseconds went with the unknown delay 9 of 2400 went beyond 0.2 um."""
    errors = np.array([largest(run("self_tuning_observer", PROGRAM, seed=seed, effects={"transport_delay": {"delay_s": 5e-4}}),
                               first=1000) for seed in range(1, 41)])
    assert np.median(errors) < 7e-8
    assert np.count_nonzero(errors > 1.5e-7) < 2


@pytest.mark.parametrize("delay", [5e-4, 1e-3])
def test_a_long_delay_costs_no_more_than_under_the_encoder_only_law(axis, run, delay):
    """The whole run, with the 0.1 s in which it is found."""
    effects = {"transport_delay": {"delay_s": delay}}
    ours, others = ([largest(run(law, PROGRAM, seed=seed, effects=effects)) for seed in range(1, 8)]
                    for law in ("self_tuning_observer", "self_tuning"))
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
