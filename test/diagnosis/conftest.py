"""The shipped axis, and its drive as the diagnosis takes it."""

import pytest

from microstage_ros.diagnosis.prerequisites.drive import drive_of
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file


@pytest.fixture(scope="module")
def axis():
    return load_axis(config_file("axis.yaml"))


@pytest.fixture(scope="module")
def drive(axis):
    return drive_of(axis)
