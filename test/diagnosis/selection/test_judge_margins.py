"""The judge's margins by closed forms, on evidence made by hand as in `test_judge`."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.stats import chi2

from microstage_ros.diagnosis.catalogue.form import Form, one
from microstage_ros.diagnosis.residuals.evidence import Evidence
from microstage_ros.diagnosis.residuals.evidence_set import Evidences
from microstage_ros.diagnosis.selection import judge

from test.diagnosis.selection.test_judge import PLAIN, ROWS, World, choice, simple


def louder(evidence, factor):
    """The same evidence of columns and residual with the residual's χ² times ``factor``."""
    matrix = evidence.matrix.copy()
    matrix[0, 0] *= factor
    return dataclasses.replace(evidence, matrix=matrix)


def mixed(share, seed=1, second=0.0):
    """`Evidences` of two effects whose columns have the correlation ``share``; the first one acts with size 0.4, the other
    with size ``second``."""
    generator, forms, sums = np.random.default_rng(seed), [simple("torque_ripple"), simple("amplifier_offset")], {}
    for group, rows in ROWS.items():
        a, b, noise = generator.normal(size=(3, rows))
        other = share * a + math.sqrt(1.0 - share**2) * b
        matrix = np.stack([noise + (0.4 * a + second * other) * (group != "base"), a, other], axis=1)
        where = {forms[0].key: slice(1, 2), forms[1].key: slice(2, 3)}
        sums[group] = {"torque": Evidence(matrix.T @ matrix, where, rows)}
    return Evidences(sums["learn"], sums["held"], sums["base"], forms, {"torque": 1.0}, None)


def test_the_floor_is_the_baselines_energy_on_as_many_rows():
    """A baseline twice as loud makes a floor twice as high, as far as what was reached is not lower."""
    world = World(PLAIN, {}, seed=21, excess={"torque": 2.0})
    world.evidences.base["torque"] = louder(world.evidences.base["torque"], 2.0)
    per_row = world.evidences.base["torque"].energy() / ROWS["base"]
    book = judge.ledger_of(world.evidences, [])
    assert book.floor == pytest.approx(per_row * ROWS["held"]) and 1.8 < per_row < 2.2
    world.evidences.scatter["torque"] = 4.0
    assert judge.ledger_of(world.evidences, []).floor == pytest.approx(per_row * ROWS["held"] / 4.0)


@pytest.mark.parametrize(("share", "rivals"), [(0.7, []), (0.999, ["amplifier_offset"])])
def test_a_name_that_explains_half_as_much_is_no_rival(share, rivals):
    """χ² of a column with correlation ρ is ρ² of the true one's: half of it is clearly less, 0.998 of it is not."""
    world = mixed(share)
    mine = choice(world, "torque_ripple")
    assert judge.rivals_of(world, mine, [mine], ("torque_ripple", "amplifier_offset")) == rivals


@pytest.mark.parametrize(("share", "rivals"), [(0.3, []), (0.9, ["amplifier_offset"])])
def test_a_name_that_explains_something_else_is_no_rival(share, rivals):
    """Both act. A level of friction beside a payload had a rival in a soft drive, which explained what the payload left in
    the resonance (pairs, seed 9901, case 83)."""
    world = mixed(share, second=0.4)
    mine = choice(world, "torque_ripple")
    assert judge.rivals_of(world, mine, [mine], ("torque_ripple", "amplifier_offset")) == rivals


def test_a_name_that_the_baseline_shows_is_no_rival():
    """Two names of one trace, of which the second's column stands in the baseline as strongly."""
    world = mixed(0.999)
    base = world.base["torque"]
    at = base.where[simple("amplifier_offset").key].start
    base.matrix[0, at] = base.matrix[at, 0] = 0.4 * base.matrix[at, at]
    mine = choice(world, "torque_ripple")
    assert judge.rivals_of(world, mine, [mine], ("torque_ripple", "amplifier_offset")) == []


GUIDEWAY = Form("direction_asymmetry", "torque", "guideway", None, one("asymmetry", "1"))
WHOLE = simple("direction_asymmetry")


@pytest.mark.parametrize(("size", "is_one"), [(0.4, True), (0.917, True), (1.2, False)])
def test_a_constant_force_is_an_asymmetry_up_to_the_guideways_friction(size, is_one):
    """Within three standard errors (0.033) of 0.9 it still may be one; the general form of the asymmetry is never asked."""
    world = World([WHOLE, simple("gravity_tilt"), GUIDEWAY, simple("torque_ripple")], {"gravity_tilt": size, "torque_ripple": 1.0}, seed=22,
                  shared={GUIDEWAY.key: ("gravity_tilt", "")})
    tilt, ripple = choice(world, "gravity_tilt"), choice(world, "torque_ripple")
    assert judge.is_constant_force(world.evidences, tilt, "direction_asymmetry", [ripple]) is is_one
    assert judge.is_constant_force(world.evidences, tilt, "torque_ripple", [ripple]) is False


def test_only_the_guideways_asymmetry_is_a_constant_force():
    world = World([simple("gravity_tilt"), WHOLE, GUIDEWAY], {"gravity_tilt": 0.4}, seed=23)
    tilt = choice(world, "gravity_tilt")
    assert judge.is_constant_force(world.evidences, dataclasses.replace(tilt, effect="direction_asymmetry", forms=(GUIDEWAY,)), "gravity_tilt", [])
    assert not judge.is_constant_force(world.evidences, dataclasses.replace(tilt, effect="direction_asymmetry", forms=(WHOLE,)), "gravity_tilt", [])
    assert not judge.is_constant_force(world.evidences, tilt, "direction_asymmetry", [])       # another column: it explains nothing
    without = World([simple("gravity_tilt"), WHOLE], {"gravity_tilt": 0.4}, seed=23, shared={WHOLE.key: ("gravity_tilt", "")})
    assert not judge.is_constant_force(without.evidences, choice(without, "gravity_tilt"), "direction_asymmetry", [])


NAMELESS = [simple("generic:position"), simple("generic:time"), simple("generic:acceleration", "windup")]


def test_dependences_are_told_with_their_threshold():
    """Statistic and rest are χ² of the shape alone and beside the causes; the threshold is the chance of 10⁻⁶, times 1.5."""
    world = World([*PLAIN, *NAMELESS], {"generic:position": 0.3, "torque_ripple": 0.5}, seed=24)
    mine = choice(world, "torque_ripple")
    found = {f.coordinate: (f, held) for f, held in judge.findings_of(world.evidences, [mine], NAMELESS)}
    assert set(found) == {"position", "time", "acceleration"}
    position, held = found["position"]
    assert position.left == pytest.approx(0.09 * ROWS["learn"], rel=0.2) and held == pytest.approx(0.09 * ROWS["held"], rel=0.3)
    assert position.threshold == pytest.approx(1.5 * chi2.isf(1e-6, 1)) and position.statistic > 0.5 * position.left
    assert found["time"][0].left < position.threshold
    assert found["acceleration"][0].threshold == pytest.approx(30.0 * chi2.isf(1e-6, 1))       # healthy axes show a little of it


def test_a_dependence_of_the_baseline_raises_the_threshold():
    """Three times what the baseline shows on as many rows."""
    world = World(NAMELESS[:2], {"generic:position": 0.3}, base={"generic:position": 0.3}, seed=25)
    ((finding, _),) = judge.findings_of(world.evidences, [], NAMELESS[:1])
    usual = world.evidences.base["torque"].fit([NAMELESS[0].key])[2]
    assert finding.threshold == pytest.approx(3.0 * usual * ROWS["learn"] / ROWS["base"])
    assert judge.leftovers([(finding, 1e3)]) == []


@pytest.mark.parametrize(("size", "kept"), [(0.02, False), (0.6, True)])
def test_what_one_reading_tells_must_hold_a_tenth_of_what_the_two_readings_differ_by(size, kept):
    """A cause of the resonance alone beside readings that differ by three times their noise: 3·4000·0.1 is 1200 of its χ²."""
    forms = [simple("drive_compliance", "resonance"), simple("encoder_sde", "position"), simple("torque_ripple")]
    world = World(forms, {"drive_compliance": size, "torque_ripple": 0.02}, seed=26, excess={"position": 3.0})
    mine = [choice(world, "drive_compliance"), choice(world, "torque_ripple")]
    assert judge.stands_out(world.evidences, mine) == ["position"]
    left = judge.without_strangers(world.evidences, mine)
    assert (mine[0] in left) is kept and mine[1] in left      # the torque does not hang on a reading


def test_without_a_torque_balance_no_constant_force_is_asked_for():
    world = World([simple("gravity_tilt", "position"), simple("direction_asymmetry", "position", "guideway")], {}, seed=52)
    assert not judge.is_constant_force(world.evidences, choice(world, "gravity_tilt"), "direction_asymmetry", [])


def test_an_empty_ledger_gains_nothing():
    assert judge.overall_gain(judge.Ledger(), []).before == 0.0
    assert judge.Ledger().excess == 1e-9


@pytest.mark.parametrize(("decided", "rivals"), [(True, []), (False, ["friction_level_change"])])
def test_a_level_or_a_viscosity_that_friction_along_the_stroke_decides_is_no_open_question(monkeypatch, decided, rivals):
    """Two names of one trace; what a profile beside them says of their means is all that parts them."""
    forms = [simple("viscous_change"), simple("friction_level_change")]
    world = World(forms, {"viscous_change": 0.4}, seed=51, shared={forms[1].key: forms[0].key})
    mine = choice(world, "viscous_change")
    monkeypatch.setattr(judge, "level_or_viscous", lambda *_: mine if decided else None)
    assert judge.rivals_of(world.evidences, mine, [mine], ("viscous_change", "friction_level_change")) == rivals
