"""How sure a name is: by the stored calibration, no surer than what was examined allows, and on the page."""

import pytest
import yaml

from microstage_ros.commands.analysis.log import main
from microstage_ros.diagnosis.logs.case import diagnose_logs
from microstage_ros.diagnosis.logs.report.answer import write_log_answer
from microstage_ros.diagnosis.logs.selection import verdict
from microstage_ros.diagnosis.selection.calibration import Calibration, write_calibration
from microstage_ros.diagnosis.stored_calibration import stored_calibration
from microstage_ros.diagnosis.validation import log_campaign
from microstage_ros.diagnosis.validation.simulated_logs import draw_case


def diagnosed(number, seed=31001, kind="mixed"):
    """The `LogDiagnosis` of one drawn case."""
    case = draw_case(number, seed, kind)
    return diagnose_logs(list(case.baseline), list(case.now), case.description), case


def test_a_name_is_as_sure_as_the_calibration_says(monkeypatch, tmp_path):
    """It was 0.999 or more for 98 of the 103 names of seed 31001, cases 0 to 699, of which 81 were right."""
    stored = stored_calibration(verdict.CALIBRATION)
    (cause,) = diagnosed(10, 5, "one")[0].diagnosis.causes
    assert cause.probability == stored.probability(cause.evidence, cause.clarity)
    assert 0.8 < cause.probability <= 1.0 - 1.0 / (stored.count + 2.0) and 0.5 < cause.clarity <= 1.0 < cause.evidence
    write_calibration(tmp_path / "other.yaml", Calibration((0.0, 0.0, 0.0), 100, 50), "by hand")
    monkeypatch.setattr(verdict, "CALIBRATION", tmp_path / "other.yaml")
    assert [c.probability for c in diagnosed(10, 5, "one")[0].diagnosis.causes] == [0.5]


def test_the_page_shows_the_probability_and_calls_no_name_sure(tmp_path):
    result, case = diagnosed(10, 5, "one")
    report = write_log_answer(result, case.description, tmp_path / "out", {"now": ["a"], "baseline": ["b"]})
    text = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    (cause,) = report["causes"]
    assert f">{cause['probability']:.2f}</td>" in text and f"probability {cause['probability']:.2f}" in text
    assert ">sure<" not in text and "sure to" not in text


def outcome(number, probability, right):
    """An `Outcome` in which one name was stated."""
    named = ("backlash",) if right else ("cable_spring",)
    return log_campaign.Outcome(number, ("backlash",), "reference position", 100.0, 5, 1, False, "explained", named, (), ("backlash",), (), (9.0,), (),
                                0.1, ((named[0], probability, 900.0, 0.9, right),))


def test_the_examination_prints_the_reliability_and_writes_the_calibration(monkeypatch, tmp_path, capsys):
    outcomes = [outcome(k, 0.9, k > 0) for k in range(9)]
    monkeypatch.setattr(log_campaign, "run", lambda *arguments: iter(outcomes))
    assert main(["--examine", "9", "--seed", "7", "--calibrate", str(tmp_path / "c.yaml")]) == 0
    assert "0.8 to 0.95, mean 0.900: right 8 of 9 (51.8 to 99.7 %)" in capsys.readouterr().out
    tree = yaml.safe_load((tmp_path / "c.yaml").read_text(encoding="utf-8"))
    assert (tree["named"], tree["right"]) == (9, 8) and tree["made_by"].startswith("./microstage log --examine 9 --seed 7 --calibrate")


def test_names_only_leaves_open_what_the_signals_carry():
    (found,) = list(log_campaign.run(1, 5, "one", "cable_spring", names_only=True))
    assert found.truth == ("cable_spring",) and not found.judged and (found.visible, found.distance) == ((), ())
    figures = log_campaign.scores([found])
    assert "a wrong name anywhere" in figures and not any(name.startswith(("visible", "hidden")) for name in figures)


@pytest.mark.parametrize("number, wrong, rival", [
    (84, "friction_level_change", ""),        # a ripple, and a level that takes a fourteenth of what the ripple takes
    (138, "backlash", "drive_compliance"),
    (233, "scale_error", "screw_pitch_error"),
    (527, "presliding_creep", "backlash"),
])
def test_what_is_no_further_cause_is_not_named(number, wrong, rival):
    result, _ = diagnosed(number)
    assert wrong not in [cause.id for cause in result.diagnosis.causes]
    assert not rival or any(rival in group.ids for group in result.diagnosis.rivals)
