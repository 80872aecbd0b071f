"""What the encoder's rounding leaves between the two readings: by the closed form, and never told as an error of the encoder."""

import dataclasses

import numpy as np
import pytest

from microstage_ros.diagnosis.preprocessing.preparation import count_of
from microstage_ros.diagnosis.prerequisites.drive import drive_of
from microstage_ros.diagnosis.residuals.position import LEAST_ROUNDING, Position, rounding_left
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file


@pytest.mark.parametrize("count, noise", [(25e-9, 8e-9), (50e-9, 4e-9), (50e-9, 0.0), (10e-9, 2e-9)])
def test_closed_form_against_readings(count, noise):
    generator = np.random.default_rng(3)
    places = np.linspace(0.0, count, 401)[:-1]
    readings = np.round((places[:, None] + noise * generator.standard_normal((400, 4000))) / count) * count
    left = readings.mean(axis=1) - places
    assert rounding_left(count, noise) == pytest.approx(left.std(), rel=0.05)


def test_without_noise_a_twelfth_of_the_square_of_a_count_and_nothing_without_counts():
    assert rounding_left(50e-9, 0.0) == pytest.approx(50e-9 / 12**0.5, rel=2e-3)
    assert rounding_left(0.0, 8e-9) == 0.0 and rounding_left(1e-9, 8e-9) < 1e-15


def test_count_of_a_reading():
    generator = np.random.default_rng(4)
    x = np.cumsum(1e-8 * generator.standard_normal(20_000))
    counts = np.round(x / 50e-9) * 50e-9
    assert count_of(counts) == pytest.approx(50e-9, rel=1e-6)
    gaps = np.where(generator.random(len(x)) < 0.01, np.nan, counts)
    assert count_of(gaps) == pytest.approx(50e-9, rel=1e-6)
    assert count_of(x) == 0.0 and count_of(np.zeros(100)) == 0.0


@dataclasses.dataclass
class Rests:
    """What `Position` needs of a prepared record."""

    count: float
    stage_position: np.ndarray
    interferometer: np.ndarray
    encoder: np.ndarray
    shake: np.ndarray | float = 0.0
    period: float = 1e-4

    def __post_init__(self):
        self.time = np.arange(len(self.encoder)) * self.period
        self.stage_speed = np.gradient(self.stage_position, self.period)
        self.stage = self.interferometer


@pytest.mark.parametrize("amplitude, frequency", [(28e-9, 83.0), (58e-9, 16.7)])
def test_a_stage_that_the_floor_shakes_over_a_count_renews_the_rounding(amplitude, frequency):
    """χ² per row of what rounding leaves at rest, with the floor's line taken out of both readings: 1.5 where the noise knows it."""
    generator = np.random.default_rng(6)
    drive = drive_of(load_axis(config_file("axis.yaml")))
    stage = np.repeat(generator.uniform(-1e-3, 1e-3, 30), 5000)
    line = amplitude * np.sin(2.0 * np.pi * frequency * np.arange(len(stage)) * 1e-4)
    encoder = np.round((stage + line + 4e-9 * generator.standard_normal(len(stage))) / 50e-9) * 50e-9 - line
    interferometer = stage + 1e-8 * generator.standard_normal(len(stage))

    def per_row(shake):
        channel = Position(Rests(50e-9, stage, interferometer, encoder, shake), drive)
        return float(np.mean(channel.whiten(channel.residual[:, None])[0] ** 2))

    assert per_row(line) < 2.0 and per_row(0.0) > 3.0


def test_rests_of_a_coarse_encoder_say_no_more_than_one_reading_each():
    """A stage that rests at thirty places: an offset of up to half a count at each is rounding, and χ² stays that of noise."""
    generator = np.random.default_rng(5)
    drive = drive_of(load_axis(config_file("axis.yaml")))
    stage = np.repeat(generator.uniform(-1e-3, 1e-3, 30), 5000)
    encoder = np.round((stage + 4e-9 * generator.standard_normal(len(stage))) / 50e-9) * 50e-9
    rests = Rests(50e-9, stage, stage + 1e-8 * generator.standard_normal(len(stage)), encoder)
    places = np.repeat(np.eye(30), 1000, axis=0)      # one offset for each rest

    def chi_square(channel):
        white = channel.whiten(np.column_stack([channel.residual, places]))[0]
        return float(np.sum((white[:, 1:] @ np.linalg.lstsq(white[:, 1:], white[:, 0], rcond=None)[0]) ** 2))

    channel = Position(rests, drive)
    assert channel.rounding > rounding_left(50e-9, 4e-9)
    assert chi_square(channel) < 60.0      # χ² of 30 sizes is beyond it in a thousandth of all cases
    channel.rounding = LEAST_ROUNDING      # as a fine encoder would be judged
    assert chi_square(channel) > 300.0
