"""The stage replayed behind a gap, and what is found with it; strong floor lines; creep block by block."""

import dataclasses

import numpy as np
import pytest

from microstage_ros.diagnosis.preprocessing.friction_replay import replay
from microstage_ros.diagnosis.preprocessing.gap_replay import stage_behind_gap
from microstage_ros.diagnosis.preprocessing.preparation import prepare
from microstage_ros.diagnosis.prerequisites.amplifier import find_slowness
from microstage_ros.diagnosis.prerequisites.drive import drive_of
from microstage_ros.diagnosis.prerequisites.encoder import seen_interpolation
from microstage_ros.diagnosis.prerequisites.lines import find_lines
from microstage_ros.diagnosis.prerequisites.lost_motion import Deflection, _losses, _wound_up, find_gap
from microstage_ros.diagnosis.residuals.resonance import Resonance
from microstage_ros.diagnosis.validation import second_world
from microstage_ros.diagnosis.validation.simulated_records import Hidden, make_case

PERIOD = 1.0e-4
GROUPS = ("learn", "held", "base")


def prepared_case(axis, drive, effects, seed):
    groups = make_case(axis, Hidden("hidden", tuple(effects), effects), seed, friction=0.04)
    return {name: [prepare(record, drive) for record in group] for name, group in zip(GROUPS, groups)}


@pytest.mark.parametrize("gap", [0.0, 5.0e-6])
def test_the_stage_hangs_back_by_half_the_gap_and_the_wind_up(drive, gap):
    """Sliding at constant speed: (r/N) θ − x = ±(b/2 + F_g/K_c)."""
    speed = 1.0e-3
    there = speed * PERIOD * np.arange(5000)
    travel = np.concatenate([there, there[::-1]])
    lag = travel - stage_behind_gap(travel, gap, drive, PERIOD)
    wound = (drive.guideway.static + drive.guideway.viscous * speed) / drive.stiffness
    assert lag[4900] == pytest.approx(0.5 * gap + wound, abs=1.0e-9)
    assert lag[-1] == pytest.approx(-(0.5 * gap + wound), abs=1.0e-9)


def test_a_stage_within_the_gap_stays_where_it_is(drive):
    travel = 1.0e-6 * np.sin(2.0 * np.pi * 5.0 * PERIOD * np.arange(5000))
    assert np.ptp(stage_behind_gap(travel, 5.0e-6, drive, PERIOD)) == 0.0


@pytest.mark.parametrize("frequency", [40.0, 250.0, 400.0])
def test_the_drive_train_answers_as_its_closed_form_without_friction(drive, frequency):
    """x/θr = (K + jωD)/(K − mω² + jωD), below its resonance and above; a step that feeds energy in is off by more."""
    loose = dataclasses.replace(drive.guideway, static=1.0e-9, coulomb=1.0e-9, viscous=0.0)
    drive = dataclasses.replace(drive, guideway=loose)
    turn = 2.0j * np.pi * frequency
    stiff = drive.stiffness + turn * drive.damping
    expected = stiff / (stiff + drive.mass * turn**2)
    phase = np.exp(turn * PERIOD * np.arange(20000))
    stage = stage_behind_gap(1.0e-6 * phase.imag, 0.0, drive, PERIOD)
    late = slice(10000, 20000)      # whole cycles, after what was there at the start has died away
    found = 2.0j * np.mean(stage[late] * phase[late].conj()) / 1.0e-6
    assert abs(found - expected) < 0.01 * abs(expected), found / expected


@pytest.mark.parametrize("width, seed", [(0.004, 11), (0.0131, 12)])
def test_a_gap_is_found_whether_the_loop_rattles_or_not(axis, drive, width, seed):
    gap = find_gap(prepared_case(axis, drive, {"backlash": {"width_rad": width}}, seed), drive)
    assert gap is not None
    assert gap.width / drive.radius == pytest.approx(width, rel=0.1)


def test_an_error_of_the_lead_neither_hides_a_gap_nor_passes_for_one(axis, drive):
    """A lead that is off by as much as the gap is wide (pairs, seed 9103, case 6)."""
    beside = {"screw_pitch_error": {"amplitude_m": 2.7e-6, "phase_rad": 3.2}}
    gap = find_gap(prepared_case(axis, drive, beside | {"backlash": {"width_rad": 0.0131}}, 12), drive)
    assert gap is not None and gap.width / drive.radius == pytest.approx(0.0131, rel=0.1)
    assert gap.held_after < 0.5 * gap.held_before
    prepared = prepared_case(axis, drive, beside, 12)
    assert find_gap(prepared, drive) is None
    channels = [Deflection(p, drive) for p in prepared["learn"]]
    assert _losses(channels, 0.0) < 1.0         # noise: √(2/π)


@pytest.mark.parametrize("effects", [
    {}, {"drive_compliance": {"stiffness_factor": 0.05}}, {"amplifier_deadband": {"half_width_V": 0.03}},
], ids=["healthy", "soft drive", "dead zone of the amplifier"])
def test_nothing_else_is_taken_for_a_gap(axis, drive, effects):
    assert find_gap(prepared_case(axis, drive, effects, 13), drive) is None


def test_a_soft_drive_that_hangs_back_is_no_gap_however_fine_the_encoder(axis):
    """An eighth of the stiffness winds up by as much at every reversal as a gap of 0.8 µm: the balance of forces tells it."""
    hidden = Hidden("soft", ("drive_compliance",), {"drive_compliance": {"stiffness_factor": 0.1233, "damping_factor": 1.28}})
    groups = second_world.make_case(axis, hidden, 833 * 100_003 + 3, 0.0225)
    drive = seen_interpolation(drive_of(axis), groups[2])
    prepared = {name: [prepare(record, drive) for record in group] for name, group in zip(GROUPS, groups)}
    assert find_gap(prepared, drive) is None
    channels = [Deflection(p, drive) for p in prepared["learn"]]
    assert _losses(channels, 7.7e-7) < 0.7 * _losses(channels, 0.0)      # a gap would explain much of it
    assert _wound_up(channels) < 0.5 * _losses(channels, 7.7e-7)


def test_a_line_faster_than_rest_is_found_with_its_amplitude(axis, drive):
    """0.17 µm at 42 Hz moves at 45 µm/s and stands far above the noise: neither motion nor an outlier."""
    effects = {"floor_vibration": {"frequencies_hz": [41.8], "amplitudes_m": [1.7e-7]}}
    prepared = prepared_case(axis, drive, effects, 14)
    lines = find_lines(*([Resonance(p, drive) for p in prepared[name]] for name in GROUPS))
    assert [line.frequency for line in lines] == pytest.approx([41.8], abs=0.05)
    assert lines[0].amplitude == pytest.approx(1.7e-7, rel=0.03)


def test_a_delay_just_short_of_five_periods_is_found(axis, drive):
    """Next to a whole number of periods the best fit is narrow."""
    slow = find_slowness(prepared_case(axis, drive, {"transport_delay": {"delay_s": 4.936e-4}}, 15), drive)
    assert slow.effect == "transport_delay"
    assert slow.time == pytest.approx(4.936e-4, abs=5.0e-6)


def test_a_held_block_flows_in_proportion_to_its_force(drive):
    """dF/dt = −k f F/F_max while it sticks: after n periods of flow f, F₀ (1 − k f/F_max)^n."""
    contact = dataclasses.replace(drive.actuator, stiffness=np.array([2.0]), weight=np.array([1.0]), static=1.0e-3,
                                  coulomb=1.0e-3)
    speed = np.zeros(101)
    speed[:2] = 1.0     # loads the block to k · w · T = 2e-4 … then it is held
    flow = np.full(101, 1.0e-6)
    force, _ = replay(contact, speed, PERIOD, flow=flow)
    share = 2.0 * 1.0e-6 / 1.0e-3
    assert 0.0 < force[2] < contact.static
    assert force[100] == pytest.approx(force[2] * (1.0 - share) ** 98, rel=1.0e-9)
    free, _ = replay(contact, speed, PERIOD)
    assert free[100] == pytest.approx(free[2])
