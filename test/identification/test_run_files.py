"""The experiments as run files are those of the programs, and the live command takes the closed-loop ones."""

import numpy as np
import pytest

from microstage_ros.commands.operation.experiment import reference_of
from microstage_ros.control.runs.run_file import load_run
from microstage_ros.identification import experiments
from microstage_ros.model.transmission import screw_ratio
from microstage_ros.quantities.errors import InputError
from test.identification.conftest import ROOT

FOLDER = ROOT / "config" / "experiments"


@pytest.mark.parametrize("name, make", [
    ("slow_reversals", lambda r: experiments.slow_reversals(r)),
    ("constant_speeds", lambda r: experiments.constant_speeds(r)),
    ("accelerations", lambda r: experiments.accelerations(r)),
    ("voltage_ramp_up", lambda r: experiments.voltage_ramp(1e-4)),
    ("voltage_ramp_down", lambda r: experiments.voltage_ramp(1e-4, -0.015)),
    ("incremental_loading", lambda r: experiments.incremental_loading(1e-4)),
])
def test_run_file_is_the_program(actuator_bench, name, make):
    run, made = load_run(FOLDER / f"{name}.yaml"), make(screw_ratio(actuator_bench))
    tables, expected = run.tables(1e-4), made.tables(1e-4)
    assert run.friction == made.friction and run.noise == made.noise and run.controller == made.controller and run.limits == made.limits
    for column in ("reference", "open_loop"):
        assert abs(len(tables[column]) - len(expected[column])) <= 20  # numbers in the file have nine digits
        size = min(len(tables[column]), len(expected[column]))
        assert np.abs(tables[column][:size] - expected[column][:size]).max() < 1e-3 * np.ptp(expected[column]) + 1e-6


def test_incremental_loading_goes_back_and_on(guideway_bench):
    force = experiments.incremental_loading(1e-4).program[0]["voltage"]
    held = np.unique(np.round(force[1:][np.diff(force) == 0], 6))
    assert held[0] == 0.0 and np.diff(held) == pytest.approx(0.01, abs=1e-6)
    first = int(np.argmax(force > 0.305))
    assert force[first - 1] > 0.29 and force[: first].max() <= 0.3051 and force[10000:first].min() < 0.16


def test_live_program_is_the_run_file(paper_axis):
    run = load_run(FOLDER / "whole_axis.yaml")
    assert np.array_equal(reference_of(run, paper_axis), run.tables(1e-4)["reference"])


@pytest.mark.parametrize("program, message", [
    ([{"voltage": np.ones(100)}], "closed loop"),
    ([{"move_to_m": 0.2}], "places within"),
    ([{"scan": {"to_m": 1e-3, "speed_m_s": 1e-6}}], "at most 120 s"),
])
def test_live_refuses(paper_axis, program, message):
    run = load_run(FOLDER / "whole_axis.yaml")
    run.program = program
    with pytest.raises(InputError, match=message):
        reference_of(run, paper_axis)
