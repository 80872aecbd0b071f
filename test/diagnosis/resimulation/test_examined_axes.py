"""What examinations of re-simulated drives draw: machines that run, and effects that they can have."""

import numpy as np
import pytest

from microstage_ros.control.runs.run_file import Run
from microstage_ros.diagnosis.resimulation.examined_axes import DRIVES, drawn_axis
from microstage_ros.solver.plant import make_plant


@pytest.mark.parametrize("name", DRIVES)
@pytest.mark.parametrize("seed", range(3))
def test_what_is_drawn_can_be_simulated(name, seed):
    generator, drive = np.random.default_rng(seed), DRIVES[name]
    axis = drawn_axis(drive, generator)
    sizes = drive.sizes(axis, generator)
    assert all(make_plant(axis.with_effects({effect: given})) is not None for effect, given in sizes.items())
    for repeats in (1, 3):
        reference = Run(program=drive.program(generator, axis, repeats)).tables(axis.value("period"))["reference"]
        assert axis.value("travel.minimum") <= reference.min() < reference.max() <= axis.value("travel.maximum")


@pytest.mark.parametrize("name", DRIVES)
def test_numbers_of_the_axis_are_drawn_within_their_factor(name):
    drive = DRIVES[name]
    ratios = []
    for seed in range(20):
        axis, file = drawn_axis(drive, np.random.default_rng(seed)), drawn_axis(drive._replace(own=()), None)
        ratios += [axis.value(key) / file.value(key) for key in drive.own]
    assert 1.0 / drive.factor < min(ratios) < 0.8 and 1.25 < max(ratios) < drive.factor
