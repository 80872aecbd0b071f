"""A reference that begins in motion is led in from rest."""

import pathlib

import numpy as np

from microstage_ros.control.runs.run_file import Run
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.control.trajectories.lead_in import lead_in
from microstage_ros.model.axis_file import load_axis

ROOT = pathlib.Path(__file__).resolve().parents[3]
QUIET = {"encoder_m": 0.0, "voltage_V": 0.0, "current_A": 0.0, "interferometer_m": 0.0, "friction_relative": 0.0}


def ramp(rows, acceleration=0.8, period=1e-3):
    t = np.arange(rows) * period
    return 0.5 * acceleration * t**2


def test_a_cut_ramp_gets_its_rows_back():
    whole = ramp(200)
    assert np.allclose(lead_in(whole[16:], 5e-8), whole[:16], atol=1e-12)


def test_a_reference_at_rest_or_at_even_speed_is_taken_as_it_is():
    assert len(lead_in(np.full(10, 0.3), 5e-8)) == 0
    assert len(lead_in(1e-4 * np.arange(10), 5e-8)) == 0
    assert len(lead_in(ramp(200)[::-1][:50], 5e-8)) == 0   # slowing down: no start from rest leads there


def test_the_loop_does_not_feel_where_the_table_was_cut():
    axis, whole = load_axis(ROOT / "config/emps.yaml"), ramp(400)
    cut = simulate(axis, Run(noise=QUIET, program=[{"reference": whole[16:]}]))
    uncut = simulate(axis, Run(noise=QUIET, program=[{"reference": whole}]))
    assert np.allclose(cut["voltage_V"], uncut["voltage_V"][16:], atol=1e-9)
    jolted = simulate(axis, Run(noise=QUIET, program=[{"reference": whole[16:]}], start_m=float(whole[16])))
    assert np.abs(jolted["voltage_V"][:20] - uncut["voltage_V"][16:36]).max() > 0.5
