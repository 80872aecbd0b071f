"""The programme of the identification on a cell that runs: inside the travel wherever the axis stands."""

import pytest

from microstage_ros.commands.analysis import tune
from microstage_ros.commissioning.design.programme import run_about
from microstage_ros.control.runs.run_file import Run
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError


@pytest.mark.parametrize("place", [-0.0249, 0.0, 0.0249])
def test_programme_stays_in_the_travel(place):
    axis = load_axis(config_file("axis.yaml")).with_values({"period": 1e-3}, source="derived")
    program, centre = run_about(place, axis)
    reference = Run(program=program, start_m=centre).tables(1e-3)["reference"]
    assert axis.value("travel.minimum") < reference.min() and reference.max() < axis.value("travel.maximum")
    assert reference[0] == centre and len(reference) * 1e-3 < 60.0


@pytest.mark.parametrize("words", [["--running"], ["--record", "x"], ["--running", "--record", "x", "--response", "r.csv"]])
def test_running_and_record_go_together(words):
    with pytest.raises(InputError, match="--record"):
        tune.main(["--axis", str(config_file("axis.yaml")), *words])
