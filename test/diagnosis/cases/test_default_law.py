"""Records of the shipped law on a plain programme: its voltage follows the current that it measures."""

import pytest

from microstage_ros.control.runs.run_file import run_from_dict
from microstage_ros.control.runs.simulate import simulated_record
from microstage_ros.diagnosis.batch import diagnose_records

PLAIN = [{"move_to_m": 1e-5, "dwell_s": 0.5}, {"sine": {"amplitude_m": 1e-5, "frequency_hz": 1.0, "cycles": 4}}, {"move_to_m": 1e-3, "dwell_s": 0.5},
         {"sine": {"amplitude_m": 3e-4, "frequency_hz": 0.5, "cycles": 3}}, {"move_to_m": -1e-4, "dwell_s": 1.0}]


@pytest.mark.parametrize(("time", "seed"), [(3.6e-4, 420), (1.8e-4, 1050)])
def test_a_lag_is_told_though_the_law_listens_to_the_current(axis, time, seed):
    """The current's noise returns in the command: beside the command's neighbours a healthy axis showed a lag of −0.6 of the form's,
    and a lag of 0.18 ms came out as 0.24, or beside a soft drive or a payload."""
    law = {"type": "self_tuning_observer"}
    records = [simulated_record(axis, run_from_dict({"program": PLAIN, "controller": law, "effects": effects}), seed + number)
               for number, effects in enumerate([{"actuator_lag": {"time_s": time}}] * 3 + [{}])]
    answer = diagnose_records(axis, records[:2], records[2:3], records[3:], seed=0)
    assert [cause.id for cause in answer.causes] == ["actuator_lag"] and not answer.rivals
    assert answer.causes[0].parameters["time_s"].value == pytest.approx(time, rel=0.05)
