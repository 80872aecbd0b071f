"""Probabilities are calibrated on what campaigns found; the second world differs from the first, and repeats with its seed."""

import json
import types

import numpy as np
import pytest

from microstage_ros import __version__
from microstage_ros.commands.analysis.campaign import main
from microstage_ros.diagnosis.selection.calibration import (
    Calibration,
    calibrate,
    likely,
    probability,
    write_calibration,
)
from microstage_ros.diagnosis.validation import campaign, second_world, ways
from microstage_ros.diagnosis.validation.campaign import Outcome, reliability
from microstage_ros.diagnosis.validation.simulated_records import Hidden
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError


def drawn(count, seed=1):
    """Named causes of which a share 1/(1 + e^-(1 + 0.4 log χ² + 1.5 log share)) was hidden."""
    generator = np.random.default_rng(seed)
    evidence, share = 10.0 ** generator.uniform(1.0, 5.0, count), 10.0 ** generator.uniform(-2.5, 0.0, count)
    chance = 1.0 / (1.0 + np.exp(-(1.0 + 0.4 * np.log10(1.0 + evidence) + 1.5 * np.log10(share))))
    return list(zip(evidence, share, generator.uniform(size=count) < chance)), chance


def test_probabilities_are_those_of_the_campaign():
    """Of 4000 causes, the stated probability in every tenth is the share that was right, to 4 %."""
    told, chance = drawn(4000)
    fitted = calibrate(told)
    stated = np.array([fitted.probability(e, s) for e, s, _ in told])
    assert fitted.count == 4000 and fitted.right == sum(right for *_, right in told)
    assert np.abs(stated - chance).max() < 0.08
    for part in np.array_split(np.argsort(stated), 10):
        assert abs(stated[part].mean() - np.mean([told[k][2] for k in part])) < 0.06


def test_few_cases_cannot_say_certain():
    """Ten of ten right says no more than 11/12; nothing said says one half."""
    fitted = calibrate([(1e6, 1.0, True)] * 10)
    assert fitted.probability(1e6, 1.0) == pytest.approx(1.0 - 1.0 / 12.0)
    assert Calibration((50.0, 0.0, 0.0), 0, 0).probability(1.0, 1.0) == 0.5


def test_more_evidence_and_more_share_are_surer():
    sure = Calibration((0.0, 0.5, 1.0), 1000, 950).probability
    assert sure(1e5, 0.9) > sure(1e2, 0.9) and sure(1e3, 0.9) > sure(1e3, 0.01)
    assert sure(1e5, 0.5) == pytest.approx(1.0 / (1.0 + np.exp(-0.5 * np.log10(1.0 + 1e5) - np.log10(0.5))))
    assert 0.0 < probability(1.0, 0.0) < probability(1e9, 1.0) < 1.0      # the stored one


def test_what_rests_on_the_learning_records_has_the_share_of_its_like():
    """A replay that lost its place holds nothing on the held-out records, and says nothing of those that do."""
    told, _ = drawn(400)
    fitted = calibrate([*told, (0.0, 0.0, True), (0.0, 1.0, True), (0.0, 0.0, False)])
    assert (fitted.bare, fitted.count) == ((2, 3), 400) and fitted.coefficients == calibrate(told).coefficients
    assert fitted.probability(0.0, 0.0) == fitted.probability(0.0, 1.0) == 3.0 / 5.0
    assert Calibration((1.0, 1.0, 1.0), 10, 10).probability(0.0, 1.0) == 0.5


def test_the_features_are_the_decades_of_one_and_the_evidence_and_of_the_clarity():
    """A χ² of 9 beside the one is one decade, a clarity of 0.1 one below: logit p = 0.5 + 1 − 2.

    A χ² of 0.25 is 0.097 decades, not none and not that of one.
    """
    told = Calibration((0.5, 1.0, 2.0), 1000, 950).probability
    assert told(9.0, 0.1) == pytest.approx(1.0 / (1.0 + np.exp(0.5)))
    assert told(0.25, 1.0) == pytest.approx(1.0 / (1.0 + np.exp(-0.5 - np.log10(1.25))))


def test_a_chi_squared_below_one_on_the_held_out_records_is_evidence():
    """The one cause that has any is fitted and says no more than 2/3; the other one, wrong, is the only bare one."""
    fitted = calibrate([(0.5, 0.5, True), (0.0, 0.5, False)])
    assert (fitted.count, fitted.right, fitted.bare) == (1, 1, (0, 1))
    assert fitted.probability(0.5, 0.5) == pytest.approx(2.0 / 3.0) and fitted.probability(0.0, 0.5) == 1.0 / 3.0


@pytest.mark.parametrize("right", [True, False])
def test_one_cause_draws_the_coefficients_away_from_the_prior_until_their_slopes_are_equal(right):
    """The prior is a = 2 ± 2, b and c = 0.5 ± 0.5; of one cause with χ² = 99 and clarity 0.1, log p has a slope of
    (1, 2, −1) times the probability of what was not found, and the prior one of (coefficient − mean) / variance."""
    a, b, c = calibrate([(99.0, 0.1, right)]).coefficients
    chance = 1.0 / (1.0 + np.exp(-(a + 2.0 * b - c)))
    slope = 1.0 - chance if right else -chance
    assert (a, b, c) == pytest.approx((2.0 + 4.0 * slope, 0.5 + 0.25 * 2.0 * slope, 0.5 - 0.25 * slope), abs=1e-3)


def test_nothing_to_calibrate_from_is_told():
    with pytest.raises(InputError, match="no named cause"):
        calibrate([])


def outcome(number, told, hidden=("a",)):
    return Outcome(number, "single", hidden, "+".join(hidden), "explained", tuple(t[0] for t in told), (), (), 2.0, 1.0, 1.0, 1.0, {}, "", told)


def test_reliability_and_wrong_names_are_counted():
    outcomes = [outcome(0, (("a", 0.97, 1e3, 1.0, True),)), outcome(1, (("a", 0.9, 1e3, 0.9, True), ("b", 0.5, 9.0, 0.1, False)))]
    rows = reliability(outcomes)
    assert [(right, named) for *_, right, named in rows] == [(0, 1), (1, 1), (1, 1)]
    counts, _ = campaign.scores(outcomes)
    assert counts["a wrong name anywhere in the answer"] == (1, 2)
    assert counts["single: right name first"] == (2, 2)
    assert counts["named, and 90 % of the way to the noise"] == (2, 2)
    assert counts["causes named, and 90 % of the way in their own channel"] == (2, 3)


def test_earlier_campaigns_are_counted_along(tmp_path, capsys):
    told = [["a", 0.97, 1e3, 1.0, True]]
    case = {"number": 0, "kind": "single", "hidden": ["a"], "name": "a", "verdict": "explained", "named": ["a"], "rivals": [], "covered": [],
            "before": 2.0, "after": 1.0, "floor": 1.0, "seconds": 1.0, "sizes": {}, "error": "", "stated": told}
    (tmp_path / "earlier.json").write_text(json.dumps({"cases": [case] * 3}))
    assert main(["--cases", "0", "--from", str(tmp_path / "earlier.json"), "--calibrate", str(tmp_path / "c.yaml")]) == 0
    assert "3 of 3" in capsys.readouterr().out
    assert "named: 3" in (tmp_path / "c.yaml").read_text()
    with pytest.raises(InputError, match="--from"):
        main(["--cases", "0", "--from", str(tmp_path / "c.yaml")])


def test_a_calibration_that_cannot_be_written_is_told(tmp_path):
    with pytest.raises(InputError, match="--calibrate"):
        write_calibration(tmp_path / "nowhere" / "c.yaml", Calibration((0.0, 0.0, 0.0), 1, 1), "x")


@pytest.mark.parametrize(("stated", "clarity", "share", "named"), [
    (0.82, 0.5, 1.0, True), (0.81, 0.5, 1.0, False),
    (0.95, 0.115, 3.7e-4, False), (0.95, 0.031, 1.9e-4, False),      # were not there
    (0.95, 0.32, 3.7e-4, True),      # the clarity of one that was there
    (0.95, 0.115, 0.0019, False), (0.95, 0.115, 0.0021, True)])
def test_a_further_cause_is_named_from_the_numbers_of_the_campaigns_on(stated, clarity, share, named):
    """A probability of 0.82; beside a rattle, a clarity between 0.115 and 0.32 or two thousandths of the gap's χ²."""
    first, further = (types.SimpleNamespace(id=name, probability=stated, channel="torque", clarity=clarity,
                                            evidence=share * 1e6) for name in ("backlash", "direction_asymmetry"))
    assert likely([first, further], rattled=1e6) == (([first, further], []) if named else ([first], [further]))


def test_a_calibration_is_written_in_the_order_of_its_reader_with_four_decimals(tmp_path):
    """What gave it stands first; a coefficient is rounded far below its standard error."""
    write_calibration(tmp_path / "c.yaml", Calibration((1.23456, -0.5, 2.0), 5, 4, (1, 3)), "a campaign")
    assert (tmp_path / "c.yaml").read_text(encoding="utf-8").splitlines() == [
        "made_by: a campaign", f"version: {__version__}", "named: 5", "right: 4", "without_evidence:", "- 1", "- 3",
        "coefficients:", "- 1.2346", "- -0.5", "- 2.0"]


def test_machines_of_the_second_world_are_of_other_laws_with_the_files_limits():
    axis = load_axis(config_file("axis.yaml"))
    for law in second_world.LAWS:
        own = second_world.habits(np.random.default_rng(1), 0.04)
        machine = second_world.machine_of(axis, second_world.dataclasses.replace(own, law=law))
        assert machine.law("actuator") == law
        for leaf in ("static", "coulomb", "stribeck_velocity", "viscous"):
            assert machine.value(f"contacts.actuator.{leaf}") == axis.value(f"contacts.actuator.{leaf}")
        assert machine.value("sensors.encoder.resolution") == own.encoder_resolution


def test_the_second_worlds_programme_repeats_with_its_seed_and_rests_with_the_motor_off():
    period = 1e-3
    one, off = second_world.program(np.random.default_rng(5), 0.0, period)
    again, _ = second_world.program(np.random.default_rng(5), 0.0, period)
    other, _ = second_world.program(np.random.default_rng(6), 0.0, period)
    np.testing.assert_array_equal(one, again)
    assert 18.0 < len(one) * period < 36.0 and len(other) != len(one)
    assert np.ptp(one[off[0]:off[1]]) == 0.0 and 0.7 < (off[1] - off[0]) * period < 1.6
    assert np.abs(np.diff(one)).max() / period < 6.1e-3      # m/s: within the limits of a move


def test_the_worlds_are_the_campaigns():
    assert set(ways.CASES) == {"first", "second"} and ways.CASES["second"] is second_world.make_case
    assert campaign.examinations(2, 1, "axis.yaml", world="second")[0].world == "second"
    assert Hidden("x").effects == {}


def test_a_campaign_goes_on_where_it_was_left(monkeypatch, tmp_path):
    """With --resume only the missing cases are run, and a file of other settings is refused."""
    asked = []

    def examine(one):
        asked.append(one.number)
        if len(asked) == 3:
            raise KeyboardInterrupt
        return outcome(one.number, (("a", 0.9, 100.0, 0.5, True),))

    monkeypatch.setattr(campaign, "examine", examine)
    file = str(tmp_path / "cases.json")
    command = ["--kind", "single", "--seed", "7", "--json", file, "--resume", "--cases"]
    with pytest.raises(KeyboardInterrupt):
        main([*command, "4"])
    assert len(json.loads((tmp_path / "cases.json").read_text())["cases"]) == 2      # written case by case
    main([*command, "4"])
    assert asked == [0, 1, 2, 2, 3]
    assert [case["number"] for case in json.loads((tmp_path / "cases.json").read_text())["cases"]] == [0, 1, 2, 3]
    with pytest.raises(InputError, match="seed"):
        main([*command, "4", "--seed", "8"])
    with pytest.raises(InputError, match="--json FILE"):
        main(["--resume"])
