"""Hidden effects on a force-driven axis must be found, and nothing where there is nothing."""

import numpy as np
import pytest

from microstage_ros.control.runs.run_file import Run, run_from_dict
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.diagnosis.report.extended import extended_axis
from microstage_ros.diagnosis.resimulation.diagnose import diagnose_force_axis
from microstage_ros.diagnosis.resimulation.examination import Case, Outcome, examine, report
from microstage_ros.diagnosis.resimulation.examined_axes import motion
from microstage_ros.model.axis_file import load_axis
from microstage_ros.records import Record
from test.diagnosis.emps import ROOT, emps_record, there_and_back

NOISE = {"encoder_m": 2e-8, "voltage_V": 2e-3, "current_A": 0.0, "interferometer_m": 0.0, "friction_relative": 0.02}


@pytest.fixture(scope="module")
def axis():
    return load_axis(ROOT / "config/emps.yaml")


def record_of(axis, seed, cycles=3):
    columns = simulate(axis, Run(noise=NOISE, program=[{"reference": there_and_back(cycles)}]), seed=seed)
    return Record(1e-3, {k: columns[k] for k in ("encoder_m", "reference_m", "voltage_V")}, f"simulated {seed}")


def test_a_healthy_axis_has_no_cause(axis):
    """200 of 200 agree (docs/claims.md): more than two of eight do not once in 10⁴ runs, were it one of seventy."""
    answers = [diagnose_force_axis(axis, [record_of(axis, seed)]) for seed in range(5, 13)]
    assert all((answer.causes, answer.rivals) == ((), ()) for answer in answers)
    assert {answer.verdict for answer in answers} <= {"agrees", "unexplained"}
    assert sum(answer.verdict == "agrees" for answer in answers) >= 6


@pytest.mark.parametrize("baseline", [True, False])
def test_another_motion_held_out_is_no_noise(axis, baseline):
    """The learnt record's repetition was taken for the held-out one's, whose differences then were the noise floor: 54 N in place of
    0.5. In 75 of 245 cases with a clear effect the answer was `agrees` (`resimulation.examination`, seed 26103)."""
    hidden = axis.with_effects({"torque_ripple": {"amplitude_Nm": [8e-4], "cycles_per_turn": [1.0], "phase_rad": [1.6]}})
    noise = {**NOISE, "friction_relative": 0.01}
    unlike = motion(np.random.default_rng(1), 1e-3, 2)
    columns = simulate(hidden, Run(noise=noise, program=[{"reference": unlike}]), seed=4)
    held = Record(1e-3, {k: columns[k] for k in ("encoder_m", "reference_m", "voltage_V")}, "other motion")
    answer = diagnose_force_axis(axis, [record_of(hidden, 3)], [held], [record_of(axis, 6)] if baseline else [])
    assert [cause.id for cause in answer.causes] == ["torque_ripple"]
    assert answer.gain.floor < 0.7 and answer.gain.before > 1.5


def test_a_drive_of_another_gain_is_not_taken_for_other_numbers_of_the_axis(axis):
    """Mass, friction and offset together, all by one factor, are the gain's: fitted along, they hid it ("agrees", 10 of 15)."""
    answer = diagnose_force_axis(axis, [record_of(axis.with_effects({"amplifier_gain": {"factor": 0.85}}), 3)], [], [record_of(axis, 6)])
    assert answer.verdict == "undetermined" and "amplifier_gain" in sum((one.ids for one in answer.rivals), ())


def test_a_gain_and_a_payload_are_rivals_beside_another_cause(axis):
    hidden = axis.with_effects({"amplifier_gain": {"factor": 0.85}, "transport_delay": {"delay_s": 2e-3}})
    answer = diagnose_force_axis(axis, [record_of(hidden, 3)])
    assert "payload_change" not in [cause.id for cause in answer.causes]
    assert any({"amplifier_gain", "payload_change"} <= set(one.ids) for one in answer.rivals)


def test_an_asymmetry_is_no_constant_force_and_ripple():
    """A constant force was taken for an asymmetry, and what it misfits of friction along the stroke was named a ripple (seed 26103)."""
    outcome = examine(Case(26103, 111))
    hidden = {"direction_asymmetry", "position_dependent_friction"}
    assert set(outcome.hidden) == hidden and set(outcome.named) <= hidden
    assert set(outcome.named + sum(outcome.rivals, ())) >= hidden


def test_names_of_fresh_seeds():
    """In 2 of 262 hidden cases nothing of it is named or a rival, in 2 of 300 a wrong name stands, none is overlooked (seed 26106).
    Were the true rates their upper limits, 0.027, 0.024 and 0.014, more than 3 of 6 would come in less than one of 10⁴ runs."""
    seed = int(np.random.default_rng().integers(10**6))
    outcomes = [examine(Case(seed, number)) for number in range(6)]
    hidden, text = [one for one in outcomes if one.hidden], "\n".join([f"seed {seed}", *map(str, outcomes)])
    assert sum(not set(one.named + sum(one.rivals, ())) & set(one.hidden) for one in hidden) <= 3, text
    assert sum(bool(set(one.named) - set(one.hidden)) for one in outcomes) <= 3, text
    assert sum(one.verdict == "agrees" for one in hidden) <= 3, text


def test_no_probability_goes_beyond_what_was_examined(axis):
    """It was 1.000, from the size over its error alone, where 113 of 131 names were right."""
    answer = diagnose_force_axis(axis, [record_of(axis.with_effects({"torque_ripple": {
        "amplitude_Nm": [8e-4], "cycles_per_turn": [1.0], "phase_rad": [1.6]}}), 3)])
    (cause,) = answer.causes
    assert 0.9 < cause.probability < 0.999 and cause.evidence > 16.0 and cause.clarity == cause.share


def test_a_force_without_a_name_is_unexplained(axis):
    """1 N that swings at 3.1 Hz: no coordinate tells of it, and twice as much is left as noise makes."""
    record = record_of(axis, 500)
    push = np.sin(2.0 * np.pi * 3.1 * 1e-3 * np.arange(len(record.columns["voltage_V"])))
    columns = record.columns | {"voltage_V": record.columns["voltage_V"] + push / 35.15}
    answer = diagnose_force_axis(axis, [Record(1e-3, columns, "pushed")])
    assert (answer.verdict, answer.causes, answer.rivals) == ("unexplained", (), ())


def test_asymmetry_is_named_sized_and_pays_on_held_out_records(axis):
    hidden = axis.with_effects({"direction_asymmetry": {"contact": "guideway", "asymmetry": 0.0, "viscous_asymmetry": 0.2}})
    answer = diagnose_force_axis(axis, [record_of(hidden, 7)], [record_of(hidden, 8, 1)])
    assert [cause.id for cause in answer.causes] == ["direction_asymmetry"]
    size = answer.causes[0].parameters["viscous_asymmetry"]
    assert abs(size.value - 0.2) < 3 * size.stderr + 0.01
    assert answer.gain.records == ("simulated 8",)
    assert answer.gain.after < 0.5 * answer.gain.before
    assert answer.causes[0].share > 0.8


def test_a_motion_without_repetition_is_held_back_in_stretches(axis):
    hidden = axis.with_effects({"direction_asymmetry": {"contact": "guideway", "asymmetry": 0.0, "viscous_asymmetry": -0.25}})
    answer = diagnose_force_axis(axis, [record_of(hidden, 12, 1)])
    assert "direction_asymmetry" in [cause.id for cause in answer.causes]
    assert "every third" in answer.gain.records[0]
    assert 0.0 < answer.gain.floor < answer.gain.after < 0.5 * answer.gain.before


def test_a_film_of_another_form_is_named_nonlinear(axis):
    film = {"contact": "guideway", "coefficient": 60.0, "exponent": 0.5}
    answer = diagnose_force_axis(axis, [record_of(axis.with_effects({"nonlinear_viscous": film}), 9)])
    assert answer.causes[0].id == "nonlinear_viscous"
    assert "held back by the program" in answer.gain.records[0]
    assert answer.gain.after < 0.1 * answer.gain.before


def test_a_constant_force_stays_open_between_those_who_make_one(axis):
    answer = diagnose_force_axis(axis, [record_of(axis.with_effects({"amplifier_offset": {"offset_V": 0.3}}), 10)])
    assert answer.verdict == "undetermined"
    assert {"amplifier_offset", "gravity_tilt"} <= set(answer.rivals[0].ids)
    run = run_from_dict(answer.rivals[0].experiment)
    assert run.period_s == axis.value("period")
    extended = extended_axis(axis, answer)
    assert set(extended.effects) & {"amplifier_offset", "gravity_tilt", "direction_asymmetry"}


def test_emps_lacks_what_pays_on_time_it_was_not_fitted_on(axis):
    """One of the four repetitions is given, every third tenth of it held back; the other three judge."""
    record = emps_record().rows(0, 6240)
    answer = diagnose_force_axis(axis, [record])
    named = {cause.id for cause in answer.causes}
    assert {"direction_asymmetry", "nonlinear_viscous", "torque_ripple"} <= named
    assert any("actuator_lag" in rivals.ids for rivals in answer.rivals)
    assert answer.gain.before > 2.3 and answer.gain.after < 1.6
    unseen = emps_record()
    extended = extended_axis(axis, answer)
    force = simulate(extended, Run(program=[{"reference": unseen["reference_m"]}]), seed=1)["force_N"]
    error = axis.value("drive.gain") * unseen["voltage_V"] - force
    assert np.sqrt(np.mean(error[6240:] ** 2)) < 1.6      # what was not given
    assert np.sqrt(np.mean(error**2)) < 1.9


def test_the_report_of_an_examination_counts_what_was_said():
    def outcome(hidden, named, rivals=(), verdict="explained", stated=()):
        return Outcome(0, hidden, verdict, named, rivals, stated, True, 1)

    lines = report([
        outcome(("torque_ripple",), ("torque_ripple", "cable_spring"), stated=((100.0, 0.9, 0.98, True), (20.0, 0.1, 0.95, False))),
        outcome(("gravity_tilt",), (), (("amplifier_offset", "gravity_tilt"),), "undetermined"),
        outcome(("gravity_tilt",), (), (), "agrees"),
        outcome((), (), (), "agrees"),
        outcome((), (), (), "unexplained"),
    ])
    assert lines[0].startswith("first name right, or a rival right: 2 of 3")
    assert lines[1].startswith("nothing seen of what is hidden: 1 of 3")
    assert lines[2].startswith("a wrong name anywhere: 1 of 5")
    assert lines[3].startswith("healthy axes with a name or rivals: 0 of 2")
    assert lines[4].startswith("healthy axes unexplained: 1 of 2")
    assert lines[5].startswith("names right: 1 of 2")
    assert [line[:26] for line in lines[6:]] == ["stated 0.9 to 0.97, mean 0", "stated 0.97 to 1, mean 0.9"]
