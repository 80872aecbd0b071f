"""Cases from another simulator of the same model: nothing may depend on this project's own."""

import pathlib

import pytest

from microstage_ros.diagnosis.case import diagnose_case
from microstage_ros.model.axis_file import load_axis
from microstage_ros.records import read_record

ROOT = pathlib.Path(__file__).resolve().parents[3]
PRACTICE = ROOT.parent / "shared/data/practice"
EXPECTED = {"healthy": set(), "cable": {"cable_spring"}, "two": {"position_dependent_friction", "encoder_sde"}}


@pytest.mark.parametrize("case", EXPECTED)
def test_right_names(case):
    folder = PRACTICE / case
    if not folder.is_dir():
        pytest.skip(f"{folder} is not here (measured data are not part of the repository)")
    records, hold, base = ([read_record(folder / f"{name}.csv.xz") for name in names]
                           for names in (("rec1", "rec2"), ("hold",), ("base",)))
    answer = diagnose_case(load_axis(ROOT / "config/axis.yaml"), records, hold, base)
    assert {cause.id for cause in answer.causes} == EXPECTED[case]
    assert answer.verdict == ("explained" if EXPECTED[case] else "agrees")
    if case == "two":
        amplitude = next(c for c in answer.causes if c.id == "encoder_sde").parameters["amplitude1_m"].value
        assert amplitude == pytest.approx(12e-9, rel=0.03)
