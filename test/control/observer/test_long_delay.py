"""A voltage that acts five periods late or later: found, counted with in a slower loop, and not found where there is none."""

import numpy as np
import pytest

from microstage_ros.control.friction_observer import FrictionObserver
from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.observer import drive_learning, source_doubt

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


def lately_delayed(axis, lag, answers):
    """(parameters, memory of the observer) of a loop whose long delay of 5 periods has been clear, counted with ``lag``."""
    controller = make_controller("self_tuning_observer", axis)
    parameters, memory = controller.parameters, controller.memory["observer"]
    volts, amperes = 0.05, 0.05 / float(parameters["feedforward"]["resistance"])
    memory["far_voltage_power"], memory["far_current_power"] = volts**2, amperes**2
    memory["far_answers"][: len(answers)] = np.array(answers) * volts * amperes
    memory["delayed"], memory["delay"], memory["lag"] = 1, 5, lag
    return parameters, memory


@pytest.mark.parametrize("lag, found", [(4, 5), (0, 5), (7, 7)])
def test_a_long_delay_that_was_clear_of_every_short_one_replaces_it(axis, lag, found):
    """In a swing the steps of two neighbouring periods hardly differ: lag 4 was kept for 0.2 s behind a delay of 5 (1.8 um once)."""
    parameters, memory = lately_delayed(axis, lag, (0.5, 0.55, 0.6, 0.65, 0.7, 0.8, 0.7, 0.65))
    drive_learning.find_lag(parameters["observer"], parameters["feedforward"], memory)
    assert memory["lag"] == found


def test_doubts_that_an_unknown_delay_raised_go_with_it(axis):
    """They stayed for minutes: behind half a millisecond 0.2 to 0.26 um in 7 of 1200 records."""
    parameters, memory = make_controller("self_tuning_observer", axis).parameters, make_controller("self_tuning_observer", axis).memory["observer"]
    memory["voltage_factor"], memory["unfollowed"], memory["push_power"], memory["waves"] = 5.0, 30, 1.0, 4
    source_doubt.trust_voltage(parameters["observer"], memory)
    assert memory["voltage_factor"] == parameters["observer"]["voltage_doubt"]
    assert memory["unfollowed"] == memory["waves"] == memory["push_power"] == 0
