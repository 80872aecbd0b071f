"""The torque balance closes: what the motor gives is what rotor, stage and frictions take, also while they accelerate."""

import copy
import types

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from microstage_ros.diagnosis.catalogue import forms_of
from microstage_ros.diagnosis.catalogue.friction import COARSE
from microstage_ros.diagnosis.preprocessing.motion import load_kernel
from microstage_ros.diagnosis.preprocessing.preparation import MOTOR_NOISE, prepare
from microstage_ros.signals.current import between_readings
from microstage_ros.diagnosis.prerequisites.drive import drive_of
from microstage_ros.diagnosis.residuals.mechanical import BLOCK, Mechanical
from microstage_ros.diagnosis.validation import simulated_records as cases
from microstage_ros.solver.plant import NoiseSpec, make_plant

PERIOD = 1.0e-4


@pytest.fixture(scope="module")
def quiet(axis):
    """Channel of one record without any noise and without random friction."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cases, "NoiseSpec", lambda friction_relative: NoiseSpec(0.0, 0.0, 0.0, 1.0e-12, friction_relative))
        ideal = axis.with_values({**{f"sensors.current.{key}": 0.0 for key in ("noise", "offset", "bandwidth", "skew", "bits")},
                                  "sensors.encoder.interpolation_error": [0.0, 0.0]})
        (record, _), _, _ = cases.make_case(ideal, cases.Hidden("healthy"), 3, 0.0)
    drive = drive_of(ideal)
    return Mechanical(prepare(record, drive), drive)


def test_a_block_is_as_long_as_the_load_is_smoothed(axis):
    width = 1.0 / np.sum(load_kernel(drive_of(axis), PERIOD, MOTOR_NOISE) ** 2)
    assert BLOCK - COARSE < width <= BLOCK and BLOCK % COARSE == 0


def test_nothing_is_left_of_a_quiet_axis(quiet):
    known = quiet.span > 1.0e-4   # before, the friction's first state is not known
    left = quiet.residual[known]
    assert np.std(left) < 5.0e-7    # N m; the friction is 2.2e-4
    assert np.abs(left).max() < 1.0e-5


def test_what_scales_the_friction_scales_the_healthy_axiss_own(quiet):
    """A machine whose friction is a fifth more than the model's: a level and an asymmetry are of all of it."""
    level, asymmetry = (next(f for f in forms_of("torque") if f.effect == effect and not f.variant)
                        for effect in ("friction_level_change", "direction_asymmetry"))
    frame = types.SimpleNamespace(drive=quiet.drive)
    more = copy.copy(quiet)
    more.take_out(0.2 * quiet.friction)
    assert np.array_equal(quiet.own, np.zeros(len(quiet.residual)))     # the other channel keeps its own
    scaled = [form.columns(more, frame)[:, 0] - form.columns(quiet, frame)[:, 0] for form in (level, asymmetry)]
    assert np.allclose(scaled[0], 0.2 * quiet.friction, atol=1e-12)
    sliding = np.abs(quiet.friction) > 0.9 * np.abs(quiet.friction).max()
    assert sliding.sum() > 100
    assert np.allclose(scaled[1][sliding], 0.2 * np.abs(quiet.friction[sliding]), rtol=0.05, atol=1e-6)


def test_stage_and_rotor_accelerate_for_what_the_motor_gives(quiet):
    turning = (np.abs(quiet.inertial) > 3.0e-6) & (quiet.span > 1.0e-4)
    assert turning.sum() > 100
    slope = (quiet.residual @ (quiet.inertial * turning)) / (quiet.inertial @ (quiet.inertial * turning))
    assert abs(slope) < 0.05        # of the stage's mass; without the ripple of the current it is 0.4


def test_mean_current_between_readings(axis):
    """Against the winding's equation solved step by step while the speed rises and the controller holds it."""
    drive = drive_of(axis)
    rise, rows = 2.0e4, 60          # rad/s², periods
    current, mean, now = [0.0], [0.0], 0.0
    for n in range(rows):
        voltage = drive.back_emf * rise * (n + 0.5) * PERIOD + 0.4

        def slope(t, y, n=n, voltage=voltage):
            back = drive.back_emf * rise * (n * PERIOD + t)
            return [(voltage - drive.resistance * y[0] - back) / drive.inductance, y[0] / PERIOD]

        now, share = solve_ivp(slope, (0.0, PERIOD), [now, 0.0], rtol=1e-9, atol=1e-12).y[:, -1]
        current.append(now)
        mean.append(share)
    current, mean = np.array(current), np.array(mean)
    keep = np.exp(-PERIOD * drive.resistance / drive.inductance)
    settled = (current - keep * np.concatenate([current[:1], current[:-1]])) / (1.0 - keep)
    speed = drive.lever * rise * PERIOD * np.arange(rows + 1)
    told = drive.torque_constant * settled + between_readings(settled, current, speed, drive, PERIOD)
    wanted = drive.torque_constant * mean
    assert np.allclose(told[2:], wanted[2:], rtol=0.0, atol=1e-9)
    assert np.abs(drive.torque_constant * settled - wanted)[2:].max() > 2.0e-6   # what it is there for


def test_smoothing_keeps_a_load_and_its_place(axis):
    kernel = load_kernel(drive_of(axis), PERIOD, 2.0e-9)
    places = np.arange(len(kernel)) - len(kernel) // 2
    assert kernel.sum() == pytest.approx(1.0)
    assert abs(kernel @ places) < 1.0e-6 and np.allclose(kernel, kernel[::-1], atol=1e-9)


@pytest.mark.parametrize("coarse", [1, 2, 5])
def test_block_means_of_a_slope(quiet, coarse):
    rows = len(quiet.prepared.time) // coarse
    means = quiet.mean(np.arange(rows) * float(coarse), coarse)
    middle = 20.0 * np.arange(len(means)) + 10.0 - 0.5 * coarse
    assert np.allclose(means[10:-10], middle[10:-10], rtol=1e-9)


@pytest.mark.parametrize("angle", [0.08, -0.08])
def test_a_tilt_has_the_sign_of_its_angle(axis, angle):
    """Uphill in +x takes torque in both directions: (r/N) m g sin α of it, with that sign, and the fitted angle is the one put in."""
    plant = make_plant(axis, effects={"gravity_tilt": {"angle_rad": angle}})
    mass, g = axis.value("stage.mass"), 9.80665
    assert float(plant["push"]) == pytest.approx(-mass * g * np.sin(angle))     # a push in +x is against it uphill
    form = next(f for f in forms_of("torque") if f.effect == "gravity_tilt")
    channel = types.SimpleNamespace(residual=np.zeros(3))
    drive = drive_of(axis)
    column = form.columns(channel, types.SimpleNamespace(drive=drive))
    assert np.all(column == pytest.approx(drive.lever * mass * g)) and column.shape == (3, 1)
    sizes, effect = form.sizes(np.array([np.sin(angle)]), np.array([[1e-6]]), None)
    assert sizes["angle_rad"][0] == pytest.approx(angle) and effect["angle_rad"] == pytest.approx(angle)
