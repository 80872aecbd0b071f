"""The judge's margins by closed forms, on evidence made by hand as in `test_judge`."""

import dataclasses
import math
import types

import numpy as np
import pytest
from scipy.stats import chi2, norm

from microstage_ros.diagnosis.catalogue.form import Form, one
from microstage_ros.diagnosis.residuals.evidence import Evidence
from microstage_ros.diagnosis.residuals.evidence_set import Choice, Evidences
from microstage_ros.diagnosis.result import Finding
from microstage_ros.diagnosis.selection import judge
from microstage_ros.diagnosis.selection.ledger import Ledger

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
    assert judge.overall_gain(Ledger(), []).before == 0.0
    assert Ledger().excess == 1e-9


@pytest.mark.parametrize(("decided", "rivals"), [(True, []), (False, ["friction_level_change"])])
def test_a_level_or_a_viscosity_that_friction_along_the_stroke_decides_is_no_open_question(monkeypatch, decided, rivals):
    """Two names of one trace; what a profile beside them says of their means is all that parts them."""
    forms = [simple("viscous_change"), simple("friction_level_change")]
    world = World(forms, {"viscous_change": 0.4}, seed=51, shared={forms[1].key: forms[0].key})
    mine = choice(world, "viscous_change")
    monkeypatch.setattr(judge, "level_or_viscous", lambda *_: mine if decided else None)
    assert judge.rivals_of(world.evidences, mine, [mine], ("viscous_change", "friction_level_change")) == rivals


def test_a_cause_that_makes_the_held_out_records_worse_has_no_part_of_them():
    world = World(PLAIN, {"torque_ripple": 0.5}, held={"torque_ripple": -0.5}, seed=61)
    assert judge.ledger_of(world.evidences, [choice(world, "torque_ripple")]).parts == {"torque_ripple": 0.0}


def one_channel(energy, explained, rows=400):
    """Evidences of one channel whose held-out χ² is ``energy``, of which any choice explains so much."""
    held = types.SimpleNamespace(energy=lambda: energy, rows=rows)
    return types.SimpleNamespace(held={"torque": held}, scatter={"torque": 1.0},
                                 held_gain=lambda choices, channels=None: explained * len(choices))


@pytest.mark.parametrize(("explained", "after"), [(300.0, 0.5), (399.5, math.sqrt(0.5 / 400.0)), (400.0, 0.0), (400.0 + 1e-9, 0.0)])
def test_what_is_left_by_a_cause_that_explains_all_is_nothing(explained, after):
    """Rounding may take a last bit more than there was."""
    mine = Choice("gravity_tilt", (simple("gravity_tilt"),))
    channel, gain = judge.cause_gain(one_channel(400.0, explained), mine, [mine], {"torque": (1.0, "V")})
    assert (channel, gain.before, gain.unit) == ("torque", 1.0, "V") and gain.after == pytest.approx(after, abs=1e-12)


@pytest.mark.parametrize(("mine", "other", "asked"), [("windup", "windup", False), ("windup", "torque", False), ("torque", "windup", False), ("torque", "torque", True)])
def test_only_where_both_names_are_of_the_torque_must_stretches_agree(mine, other, asked):
    """No friction law is in the other channels: there χ² alone decides. A lead of nothing, as certain as can be, is none."""
    case = types.SimpleNamespace(lead=lambda *_: (0.0, 0.01, 50.0), lead_of_baseline=lambda *_: (0.0, 0.0, 0.0))
    pair = (Choice("amplifier_gain", (simple("amplifier_gain", mine),)), Choice("gravity_tilt", (simple("gravity_tilt", other),)))
    assert judge._leads(case, *pair, []) is not asked


@pytest.mark.parametrize(("base", "agrees", "stays"), [(False, True, True), (True, True, False), (False, False, False), (True, False, False)])
def test_a_dependence_needs_to_be_new_and_to_agree_with_itself(monkeypatch, base, agrees, stays):
    world = World(NAMELESS[:2], {"generic:position": 0.3}, seed=62)
    monkeypatch.setattr(judge, "shortfall", lambda *_: 0.0)
    monkeypatch.setattr(judge, "in_baseline", lambda *_: base)
    monkeypatch.setattr(judge, "agrees_with_itself", lambda *_: agrees)
    found = judge.findings_of(world.evidences, [], NAMELESS[:1])
    assert (len(judge.leftovers(found)) == 1) is stays


@pytest.mark.parametrize(("quiet", "said", "louder"), [(0.4, 1.1, False), (0.4, 1.5, True), (2.0, 2.1, False), (2.0, 2.5, True)])
def test_a_baseline_that_is_quieter_than_the_noise_model_is_no_yardstick(quiet, said, louder):
    """By 0.1 of 0.1 nothing is louder, by 0.5 it is; what counts is the louder one of the baseline and the model's 1."""
    sizes = {"learn": (said, 0.1, 200.0), "base": (quiet, 0.0, 0.0)}
    case = types.SimpleNamespace(mostly_louder=lambda *_: False, loudness=lambda channel, choices, group: sizes[group], base={"torque": None}, learn={"torque": None})
    assert judge._louder(case, "torque", []) is louder


@pytest.mark.parametrize(("channels", "louder"), [(1, True), (3, True), (4, False), (40, False)])
def test_the_more_channels_the_less_likely_must_a_loudness_be(channels, louder):
    """2.8 standard errors are a chance of 0.0026: in one of three channels less than a hundredth, in one of four more."""
    case = types.SimpleNamespace(mostly_louder=lambda *_: False, loudness=lambda channel, choices, group: (1.28, 0.1, 1.0e6), base={}, learn=dict.fromkeys(range(channels)))
    assert judge._louder(case, "torque", []) is louder is bool(channels * norm.sf(2.8) < 0.01)


@pytest.mark.parametrize(("sizes", "rival"), [(1, False), (6, False), (7, True), (12, True)])
def test_every_size_of_the_named_cause_takes_from_its_lead(monkeypatch, sizes, rival):
    """1000 + 500 − 2·sizes over 980 + 490 − 2: a lead of 30, 20, 18 and 8, of which 20 are needed."""
    mine, other = (types.SimpleNamespace(effect=e, forms=()) for e in ("torque_ripple", "amplifier_offset"))
    monkeypatch.setattr(judge, "best_or_same", lambda *_: types.SimpleNamespace(gain=1000.0, held=500.0, sizes=sizes))
    monkeypatch.setattr(judge, "best_forms", lambda *_: types.SimpleNamespace(choice=other, gain=980.0, held=490.0, sizes=1))
    for name, value in (("acceptable", True), ("_leads", True), ("level_or_viscous", None), ("is_constant_force", False),
                        ("stand_side_by_side", False), ("is_the_first", False)):
        monkeypatch.setattr(judge, name, lambda *_, value=value: value)
    assert (judge.rivals_of(None, mine, [mine], ["torque_ripple", "amplifier_offset"]) == ["amplifier_offset"]) is rival


@pytest.mark.parametrize(("learned", "kept"), [(231.0, True), (300.0, True), (229.0, False)])
def test_what_the_learning_records_show_twice_as_clearly_needs_no_more_than_there_can_be(learned, kept):
    """Twice 115 of χ²; the held-out records, which hardly go there, can show 65 and show 80."""
    mine = Choice("cable_spring", (simple("cable_spring"),))
    case = types.SimpleNamespace(gain=lambda choices: learned * len(choices), held_gain=lambda choices: 80.0 * len(choices), signal=lambda *_: 65.0)
    assert (judge.without_faint(case, [mine]) == [mine]) is kept


@pytest.mark.parametrize(("others", "kept"), [(114.5, False), (115.0, True)])
def test_another_cause_is_clear_from_the_least_evidence_on(monkeypatch, others, kept):
    monkeypatch.setattr(judge, "unsteadiness", lambda *_: 0.1)
    first, mine = (Choice(e, (simple(e),)) for e in ("torque_ripple", "gravity_tilt"))
    parts = {"torque_ripple": others, "gravity_tilt": 80.0}
    total = lambda choices: sum(parts[c.effect] for c in choices)
    learned = lambda choices: sum({"torque_ripple": 300.0, "gravity_tilt": 80.0}[c.effect] for c in choices)
    case = types.SimpleNamespace(gain=learned, held_gain=total, signal=lambda choice, others: 65.0)      # of which the first has enough
    monkeypatch.setattr(judge, "LEAST_EVIDENCE", 115.0)
    assert (mine in judge.without_faint(case, [first, mine])) is kept


@pytest.mark.parametrize("scatter", [1.0, 4.0])
def test_the_part_of_a_cause_is_what_it_adds_to_the_others_in_units_of_the_scatter(scatter):
    world = World(PLAIN, {"torque_ripple": 0.5, "gravity_tilt": 0.3}, seed=63)
    world.evidences.scatter["torque"] = scatter
    both = [choice(world, "torque_ripple"), choice(world, "gravity_tilt")]
    book, n = judge.ledger_of(world.evidences, both), ROWS["held"] / scatter
    assert book.parts["torque_ripple"] == pytest.approx(0.25 * n, rel=0.15) and book.parts["gravity_tilt"] == pytest.approx(0.09 * n, rel=0.2)
    assert book.before == pytest.approx(1.34 * n, rel=0.1) and book.after == pytest.approx(n, rel=0.1)


@pytest.mark.parametrize(("left", "kept"), [(49.0, True), (51.0, False)])
def test_a_channel_is_clear_where_a_twentieth_of_what_its_cause_took_is_left(monkeypatch, left, kept):
    """A size that is off by a fifth leaves a twenty-fifth of 1000, whatever the readings differ by."""
    mine = Choice("drive_compliance", (simple("drive_compliance", "resonance"),))
    case = types.SimpleNamespace(held_gain=lambda choices, channels=None: 1000.0 * len(choices))
    monkeypatch.setattr(judge, "stands_out", lambda *_: ["position"])
    monkeypatch.setattr(judge, "ledger_of", lambda *_: Ledger(left={"position": 1.0e6, "resonance": left}))
    assert (judge._shown_by_more_than_the_reading(case, [mine]) == [mine]) is kept


@pytest.mark.parametrize(("base", "louder"), [((1.0, 0.0, 4.0), True), ((1.0, 0.0, 0.0), False)])
def test_how_certain_a_loudness_is_both_groups_of_stretches_tell(base, louder):
    """3.2 standard errors are a chance of 0.016 with four degrees of freedom, and of 0.006 with eight."""
    sizes = {"learn": (1.32, 0.1, 4.0), "base": base}
    case = types.SimpleNamespace(mostly_louder=lambda *_: False, loudness=lambda channel, choices, group: sizes[group], base={"torque": None}, learn={"torque": None})
    assert judge._louder(case, "torque", []) is louder


@pytest.mark.parametrize("passed", ["chosen", "resonance", "constant force", "does not stand", "side by side", "no form"])
def test_a_name_that_is_passed_over_ends_no_search(monkeypatch, passed):
    """Whatever is said of the first name, the second one is a rival."""
    mine, first, last = (Choice(e, (simple(e),)) for e in ("drive_compliance", "payload_change" if passed == "resonance" else "gravity_tilt", "backlash"))
    is_first = lambda one: one == first or one == first.effect
    monkeypatch.setattr(judge, "best_or_same", lambda *_: types.SimpleNamespace(gain=1000.0, held=500.0, sizes=1))
    form = lambda evidences, effect, others: None if passed == "no form" and is_first(effect) else types.SimpleNamespace(
        choice=first if is_first(effect) else last, gain=1000.0, held=500.0, sizes=1)
    rules = {"best_forms": form, "level_or_viscous": lambda *_: None, "_leads": lambda *_: True, "is_the_first": lambda *_: True,
             "resonance_is": lambda *_: "drive_compliance", "is_constant_force": lambda evidences, choice, effect, others: passed == "constant force" and is_first(effect),
             "acceptable": lambda evidences, trial, others: not (passed == "does not stand" and is_first(trial.choice)),
             "stand_side_by_side": lambda evidences, choice, other, others: passed == "side by side" and is_first(other)}
    for name, rule in rules.items():
        monkeypatch.setattr(judge, name, rule)
    there = [mine, *([first] if passed == "chosen" else [])]
    found = judge.rivals_of(types.SimpleNamespace(base={}), mine, there, [first.effect, "backlash"])
    assert found == ([first.effect] if passed == "constant force" else []) + ["backlash"]


def test_a_cause_that_is_no_stranger_hides_none(monkeypatch):
    kept, shown, stranger = (Choice(e, (simple(e, "position"),)) for e in ("scale_error", "thermal_drift", "encoder_sde"))
    monkeypatch.setattr(judge, "ledger_of", lambda *_: Ledger(left={"position": 1.0e6, "torque": 0.0}))
    monkeypatch.setattr(judge, "stands_out", lambda *_: ["position"])
    monkeypatch.setattr(judge, "_main_channel", lambda evidences, choice, *_: ("torque" if choice is kept else "position", 1.0))
    monkeypatch.setattr(judge, "shown_by_rattle", lambda evidences, choice: choice is shown)
    monkeypatch.setattr(judge, "unsteadiness", lambda *_: 1.0)
    monkeypatch.setattr(judge, "_shown_by_more_than_the_reading", lambda _, choices: choices)
    assert judge.without_strangers(None, [kept, shown, stranger]) == [kept, shown]


def test_the_gain_of_a_cause_is_what_it_adds_to_the_others():
    world = World(PLAIN, {"torque_ripple": 0.5, "gravity_tilt": 0.3}, seed=64)
    found = judge.best_or_same(world.evidences, choice(world, "gravity_tilt"), [choice(world, "torque_ripple")])
    assert found.gain == pytest.approx(0.09 * ROWS["learn"], rel=0.2) and found.held == pytest.approx(0.09 * ROWS["held"], rel=0.2)
    assert found.sizes == 1


@pytest.mark.parametrize(("held", "stands"), [(24.9, False), (25.1, True)])
def test_a_dependence_needs_five_standard_errors_on_the_held_out_records(held, stands):
    finding = Finding("torque", "time", 90.0, 30.0, 90.0)
    assert bool(judge.leftovers([(finding, held)])) is stands


@pytest.mark.parametrize(("channel", "base", "share"), [("torque", {}, 0.2), ("torque", {"torque": object()}, 0.02), ("windup", {}, 0.02)])
def test_without_a_baseline_a_name_in_the_torque_must_lead_by_a_fifth(channel, base, share):
    """Friction along the stroke led a viscosity by 0.15 on moves to and fro, where the speed is a function of the place."""
    mine = Choice("position_dependent_friction", (simple("position_dependent_friction", channel),))
    assert judge._rival_share(types.SimpleNamespace(base=base), mine) == share
