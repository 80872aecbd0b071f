"""The motor's motion and the torque balance of a loop that swings on a soft drive, against the simulated truth."""

import dataclasses

import numpy as np
import pytest

from microstage_ros.diagnosis.case import diagnose_case
from microstage_ros.diagnosis.preprocessing.preparation import FUSION, _carried, _fusion, prepare
from microstage_ros.diagnosis.preprocessing.smoothing import triangle
from microstage_ros.diagnosis.prerequisites.lost_motion import shows_no_gap
from microstage_ros.diagnosis.residuals.mechanical import Mechanical
from microstage_ros.diagnosis.validation import second_world
from microstage_ros.diagnosis.validation.simulated_records import Hidden

PERIOD = 1.0e-4
SOFT = {"stiffness_factor": 0.071, "damping_factor": 0.81}
TRUTH = ("motor_speed_rad_s", "stage_velocity_m_s", "actuator_friction_Nm", "guideway_friction_N")
#: Pairs of seed 9601, case 97: a loop that swings from limit to limit of the amplifier.
SEED = 9601 * 100_003 + 97


def made(axis, seed):
    """Learning, held-out and baseline records, with the true speeds and frictions."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(second_world, "SEEN", (*second_world.SEEN, *TRUTH))
        patch.setattr(second_world, "CONTROLLERS", ("pid", "pid_feedforward", "self_tuning"))    # of which this seed draws one that swings
        hidden = Hidden("soft", ("drive_compliance",), {"drive_compliance": SOFT})
        return second_world.make_case(axis, hidden, seed, 0.04, "generalised_maxwell_slip")


def balance(record, drive):
    """Torque balance of a record, with the drive train as it is."""
    soft = dataclasses.replace(drive, stiffness=drive.stiffness * SOFT["stiffness_factor"],
                               damping=drive.damping * SOFT["damping_factor"])
    return Mechanical(prepare(record, soft), drive)


@pytest.fixture(scope="module")
def records(axis):
    return made(axis, SEED)


@pytest.fixture(scope="module")
def channel(records, drive):
    """Torque balance of one record of the swing."""
    return balance(records[0][0], drive)


def test_the_motors_speed_is_known_to_a_hundredth(records, channel, drive):
    """It was off by a fifth: the guideways' force did not swing at the resonance."""
    speed = drive.lever * records[0][0]["motor_speed_rad_s"]
    assert np.std(speed) > 2.0e-3       # m/s; it swings
    assert np.std(channel.prepared.speed - speed) < 0.01 * np.std(speed)


def test_what_the_motor_gives_is_what_rotor_stage_and_frictions_take(axis, records, channel, drive):
    """The error, as a viscosity, was sixteen times the axis's own, and a fifth of it as long as a part of the current was not
    smoothed like the rest. It is 0.09 over three records: 0.10 on this seed, which holds most of it, and 0.001 on two others."""
    balances = [(records[0][0], channel), *((one, balance(one, drive)) for one in (made(axis, seed)[0][0] for seed in (5, 6)))]
    own = error = 0.0
    for record, torque in balances:
        stage = record["guideway_friction_N"] + drive.mass * np.gradient(record["stage_velocity_m_s"], PERIOD)
        left = torque.torque - torque.mean(record["actuator_friction_Nm"] + drive.lever * stage)
        left, viscous = torque.whiten(np.stack([left, torque.viscous], axis=1))[0].T
        own, error = own + viscous @ viscous, error + abs(viscous @ left)
    assert error < 0.1 * own


def test_force_over_deflection_of_the_swing_is_a_straight_line(records, drive):
    """Which answers whether it is a gap that rattles."""
    learn, held, _ = records
    assert shows_no_gap({"learn": [prepare(r, drive) for r in learn], "held": [prepare(r, drive) for r in held]}, drive)


def test_no_friction_is_named_beside_a_drive_on_which_the_loop_swings(axis, records):
    """With other noise creep was named beside it in 4 of 14 records, and friction was open in 2 of 18, until a loop that swings from
    limit to limit told nothing of rest and of a level: in none of 10 since, three of those six among them."""
    learn, held, base = records
    answer = diagnose_case(axis, learn, held, base)
    assert [cause.id for cause in answer.causes] == ["drive_compliance"] and not answer.rivals
    assert answer.causes[0].parameters["stiffness_factor"].value == pytest.approx(SOFT["stiffness_factor"], rel=0.03)


def test_the_stage_tells_nothing_of_a_swing_at_the_resonance(drive):
    """A whole cycle of it at least: the reading corrects the motor below it only."""
    assert _fusion(drive, PERIOD) == FUSION       # of the shipped axis a cycle is shorter
    soft = dataclasses.replace(drive, stiffness=0.04 * drive.stiffness)
    width, omega = _fusion(soft, PERIOD), np.sqrt(soft.stiffness / soft.mass)
    assert width * PERIOD == pytest.approx(2.0 * np.pi / omega, rel=0.01)
    time = PERIOD * np.arange(20 * width)
    inner = slice(2 * width, -2 * width)
    assert np.abs(triangle(np.sin(omega * time), width)[inner]).max() < 1.0e-3
    assert np.abs(triangle(np.sin(omega * time), FUSION)[inner]).max() > 0.5


def test_the_guideways_force_moves_the_stage_through_the_drive_train(drive):
    """At rest by F/K; in a swing by |G| F: a viscous guideway of a stage that is dragged at a tenth above the resonance."""
    soft = dataclasses.replace(drive, stiffness=0.04 * drive.stiffness, guideway=dataclasses.replace(
        drive.guideway, viscous=200.0, static=1e-9, coulomb=1e-9, stiffness=np.array([1.0]), weight=np.ones(1)))
    omega = 1.1 * np.sqrt(soft.stiffness / soft.mass)
    time = PERIOD * np.arange(40_000)
    angle = 1.0e-5 * np.sin(omega * time)
    s = 1j * omega
    own = soft.mass * s**2 + soft.damping * s + soft.stiffness
    through = (soft.damping * s + soft.stiffness) / (own + soft.guideway.viscous * s)
    stage = 1.0e-5 * np.imag(through * np.exp(s * time))
    left = (stage - _carried(stage, angle, soft, PERIOD))[20_000:-200]
    driven = (stage - 1.0e-5 * np.imag((soft.damping * s + soft.stiffness) / own * np.exp(s * time)))[20_000:-200]
    assert np.std(left) < 0.1 * np.std(driven)
