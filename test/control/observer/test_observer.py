"""The friction observer against the friction that the simulator knows."""

import numpy as np
import pytest

from microstage_ros.control.evaluation.observer_trial import level_jump_trial
from microstage_ros.control.feedforward import axis as feedforward
from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control import friction_observer
from microstage_ros.control.friction_observer import FrictionObserver
from microstage_ros.model.friction.curve import viscous_force
from microstage_ros.model.friction.generalised_maxwell_slip import stretch
from microstage_ros.quantities.errors import InputError

SINE = [{"sine": {"amplitude_m": 1e-5, "frequency_hz": 0.25, "cycles": 1.0}}]
MOVES = [{"move_to_m": place, "dwell_s": 0.2} for place in (1e-6, 0.0, 1e-6)]
PER_TORQUE = 19 / (2e-3 / 2 / np.pi)  # N at the stage per N m at the motor shaft


def follow(axis, columns, **gains):
    observer = FrictionObserver(axis, **gains)
    voltage = np.concatenate([[0.0], columns["voltage_V"][:-1]])
    return [observer.step(*row) for row in zip(columns["encoder_m"], voltage, columns["current_A"])]


@pytest.mark.parametrize("kind, program, share", [
    ("self_tuning", SINE, 0.03), ("self_tuning_observer", SINE, 0.03), ("self_tuning_observer", MOVES, 0.03),
    ("self_tuning", MOVES, 0.04),  # the encoder-only law rings at the end of a move of 1 um
])
def test_total_friction_within_three_percent(axis, run, kind, program, share):
    columns = run(kind, program, seed=1)
    true = PER_TORQUE * columns["actuator_friction_Nm"] + columns["guideway_friction_N"]
    estimates = follow(axis, columns)
    got = np.array([e.total_force for e in estimates])
    assert np.sqrt(np.mean((got - true) ** 2)) < share * np.sqrt(np.mean(true**2))
    position = np.array([e.position for e in estimates])
    phase = 2 * np.pi * columns["stage_m"] / 1e-5
    position -= 5e-9 * np.sin(phase) + 2.5e-9 * np.sin(2 * phase)  # what the encoder itself is off by
    assert np.sqrt(np.mean((position - columns["stage_m"]) ** 2)) < 5e-9


def test_its_numbers_are_named_and_follow_the_period(axis):
    with pytest.raises(InputError, match="loudness.*one of .*encoder_noise"):
        FrictionObserver(axis, loudness=1.0)
    assert FrictionObserver(axis, encoder_noise=3e-8).parameters["encoder_noise"] == 3e-8
    slow = FrictionObserver(axis, period=1e-3).parameters
    theirs = make_controller("self_tuning_observer", axis, period=1e-3).parameters["observer"]
    own = [name for name in slow.dtype.names if name != "held_doubts"]  # designed with the regulator, which this has not
    assert all(np.array_equal(slow[name], theirs[name]) for name in own)
    assert slow["swing_share"] != 0.0 and FrictionObserver(axis).parameters["swing_share"] == 0.0


@pytest.mark.parametrize("factor", [0.85, 1.15])
def test_change_of_level_is_seen_within_two_seconds(axis, run, factor):
    columns = run("self_tuning", SINE, seed=1, noise={"friction_relative": 0.0},
                  effects={"friction_level_change": {"factor": factor}})
    after = follow(axis, columns)[int(1.9e4)]
    assert after.level == pytest.approx(factor, abs=0.02)
    assert abs(after.level - factor) < 4 * after.level_stderr + 0.01


@pytest.mark.parametrize("factor", [0.85, 1.15])
def test_a_jump_of_the_level_is_seen_while_friction_varies(axis, factor):
    found = level_jump_trial(axis, 1e-5, 0.25, factor, seed=31)
    assert 0.0 < found["seen"] < 2.0
    assert found["mean"] < 0.02 and found["rms"] < 0.02


def test_tells_the_effects_apart(axis, run):
    columns = run("self_tuning_observer", [{"scan": {"to_m": 2e-4, "speed_m_s": 2e-4}}], seed=1)
    estimate = follow(axis, columns)[-2000]
    assert estimate.sliding and estimate.block_slips.all() and estimate.guideway_block_slips.all()
    assert estimate.actuator_share == pytest.approx(1 - estimate.guideway_share)
    assert 0.8 < estimate.actuator_share < 0.98
    assert estimate.block_torque.sum() == pytest.approx(estimate.actuator_torque, rel=0.15)
    assert estimate.guideway_block_force.sum() == pytest.approx(0.9, rel=0.02)
    rest = follow(axis, run("self_tuning_observer", [{"move_to_m": 2e-8, "dwell_s": 0.05}], seed=1))[-1]
    assert not rest.sliding


def test_asymmetry_is_seen(axis, run):
    scans = [{"scan": {"to_m": to, "speed_m_s": 1e-3}} for to in (1e-3, 0.0)]
    columns = run("self_tuning_observer", scans, seed=1, noise={"friction_relative": 0.0},
                  effects={"direction_asymmetry": {"asymmetry": 0.1}})
    assert follow(axis, columns)[-1].asymmetry == pytest.approx(0.1, abs=0.03)


def test_learns_resistance_and_delay(axis, run):
    effects = {"resistance_rise": {"initial": 0.2, "rise_per_joule": 0.0, "time_s": 1e5}, "transport_delay": {"delay_s": 2e-4}}
    columns = run("self_tuning_observer", MOVES, seed=1, effects=effects)
    observer = FrictionObserver(axis)
    voltage = np.concatenate([[0.0], columns["voltage_V"][:-1]])
    for row in zip(columns["encoder_m"], voltage, columns["current_A"]):
        observer.advance(*row)
    assert float(observer.memory["learned"][0]) == pytest.approx(1.2, abs=0.02)
    assert int(observer.memory["lag"]) == 2


def test_works_without_a_current_and_with_lost_samples(axis, run):
    columns = run("self_tuning", MOVES, seed=1)
    columns["current_A"] = np.full_like(columns["current_A"], np.nan)
    columns["encoder_m"] = np.where(np.arange(len(columns["t_s"])) % 100 == 7, np.nan, columns["encoder_m"])
    estimates = follow(axis, columns)
    position = np.array([e.position for e in estimates])
    phase = 2 * np.pi * columns["stage_m"] / 1e-5
    position -= 5e-9 * np.sin(phase) + 2.5e-9 * np.sin(2 * phase)  # what the encoder itself is off by
    assert np.sqrt(np.mean((position - columns["stage_m"]) ** 2)) < 3e-8


@pytest.mark.parametrize("contact", ["actuator", "guideway"])
def test_friction_at_a_constant_speed_is_the_law_to_the_bit(axis, contact):
    model = np.zeros(1, feedforward.PARAMETERS)[0]
    feedforward.fill_model(model, axis)
    packed, random = model[contact].copy(), np.random.default_rng(4)
    ours, laws = np.zeros(feedforward.BLOCK_STATE), np.zeros(feedforward.BLOCK_STATE)
    base = 0.0
    for k in range(5000):
        if k % 50 == 0:
            base = random.choice([-1.0, 0.0, 1.0]) * 10.0 ** random.uniform(-7, 1 if contact == "actuator" else -3)
        velocity, factor = base * (1.0 + 0.3 * random.normal()), 1.0 + 0.1 * random.normal()
        found = feedforward.friction_along(packed, ours, velocity, 1e-4, factor)
        speed = abs(velocity)
        expected = stretch(packed, laws, np.sign(velocity), speed, speed, 1e-4, factor) + viscous_force(packed, velocity)
        assert found == expected and (ours == laws).all()


def test_a_single_message_compiles_nothing_anew(axis):
    """A view of one message's bytes cannot be written to: the running node compiled once more for it, 2 to 10 MB and seconds."""
    observer = FrictionObserver(axis)
    observer.advance_all(*np.zeros((3, 2)))
    before = len(friction_observer._steps.signatures)
    message = np.frombuffer(np.zeros(1, "f8,f8,f8").tobytes(), "f8,f8,f8")
    assert not message["f0"].flags.writeable
    observer.advance_all(*(message[name] for name in message.dtype.names), [0])
    assert len(friction_observer._steps.signatures) == before
