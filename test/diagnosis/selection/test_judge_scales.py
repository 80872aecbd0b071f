"""Decisions of the judge do not hang on the scale of χ², and each of its thresholds stands where it says.

The scatter of a channel divides every χ² of it; multiplied into rows, it must cancel from every comparison within a channel.
"""

import types

import numpy as np
import pytest

from microstage_ros.diagnosis.residuals.evidence import Evidence
from microstage_ros.diagnosis.residuals.evidence_set import Choice
from microstage_ros.diagnosis.result import Finding
from microstage_ros.diagnosis.selection import judge
from microstage_ros.diagnosis.selection.ledger import Ledger, ledger_of, usual_size
from test.diagnosis.selection.test_judge import PLAIN, World, choice, simple
from test.diagnosis.selection.test_judge_margins import GUIDEWAY, NAMELESS, WHOLE


def scaled_rows(evidence, factor):
    """The same rows ``factor`` times as loud in χ²."""
    return Evidence(evidence.matrix * factor, evidence.where, evidence.rows)


def scaled(world, channel, scatter):
    """The world with rows of a channel √scatter times as loud, which its scatter says: every decision stays."""
    evidences = world.evidences
    for group in (evidences.learn, evidences.held, evidences.base):
        group[channel] = scaled_rows(group[channel], scatter)
    evidences.scatter[channel] = scatter
    return evidences


@pytest.mark.parametrize("scatter", [1.0, 9.0])
@pytest.mark.parametrize(("excess", "stands"), [(2.5, []), (5.0, ["torque"])])
def test_loudness_is_judged_in_units_of_the_baseline(scatter, excess, stands):
    """Against a baseline three times as loud as its model: 3.5/3 is nothing, 6/3 is."""
    world = World(PLAIN, {}, seed=41, excess={"torque": excess})
    world.evidences.base["torque"] = scaled_rows(world.evidences.base["torque"], 3.0)
    assert judge.stands_out(scaled(world, "torque", scatter), []) == stands


@pytest.mark.parametrize("scatter", [1.0, 9.0])
@pytest.mark.parametrize(("size", "is_one"), [(0.4, True), (1.2, False)])
def test_a_constant_force_is_judged_at_any_scale(scatter, size, is_one):
    world = World([WHOLE, simple("gravity_tilt"), GUIDEWAY], {"gravity_tilt": size}, seed=42, shared={GUIDEWAY.key: ("gravity_tilt", "")})
    tilt = choice(world, "gravity_tilt")
    assert judge.is_constant_force(scaled(world, "torque", scatter), tilt, "direction_asymmetry", []) is is_one
    assert not judge.is_constant_force(world.evidences, choice(world, "direction_asymmetry"), "torque_ripple", [])


@pytest.mark.parametrize("scatter", [1.0, 9.0])
@pytest.mark.parametrize(("size", "kept"), [(0.5, False), (0.9, True)])
def test_a_stranger_is_one_by_what_it_explains_itself(scatter, size, kept):
    """Of 4000 rows five times as loud, 16000 are left: six times its own part is 6·0.25·4000 = 6000, or 6·0.81·4000 = 19440."""
    world = World([simple("encoder_sde", "position"), simple("torque_ripple")], {"encoder_sde": size, "torque_ripple": 0.5}, excess={"position": 4.0}, seed=43)
    evidences, mine = scaled(world, "position", scatter), [choice(world, "encoder_sde"), choice(world, "torque_ripple")]
    assert (mine[0] in judge.without_strangers(evidences, mine)) is kept


@pytest.mark.parametrize("scatter", [1.0, 9.0])
@pytest.mark.parametrize(("size", "kept"), [(0.2, False), (0.7, True)])
def test_a_reading_is_judged_at_any_scale_of_the_position(scatter, size, kept):
    """Readings that differ by 3·4000, of which a tenth, 1200, lies between 0.04·4000 and 0.49·4000."""
    forms = [simple("drive_compliance", "resonance"), simple("encoder_sde", "position"), simple("torque_ripple")]
    world = World(forms, {"drive_compliance": size, "torque_ripple": 0.5}, seed=44, excess={"position": 3.0})
    evidences, mine = scaled(world, "position", scatter), [choice(world, "drive_compliance"), choice(world, "torque_ripple")]
    evidences.scatter["position"], evidences.learn["position"] = 1.0, scaled_rows(evidences.learn["position"], 1.0 / scatter)
    evidences.held["position"], evidences.base["position"] = (scaled_rows(group["position"], 1.0 / scatter) for group in (evidences.held, evidences.base))
    assert (mine[0] in judge.without_strangers(evidences, mine)) is kept


@pytest.mark.parametrize("scatter", [0.5, 4.0])
def test_what_the_readings_differ_by_is_in_the_unit_of_what_a_cause_holds(scatter):
    """What is left of the position is divided by its scatter as the cause's own part is: (3·4000)/scatter·0.1 against 0.36·4000."""
    forms = [simple("drive_compliance", "resonance"), simple("encoder_sde", "position")]
    world = World(forms, {"drive_compliance": 0.45}, seed=45, excess={"position": 3.0, "resonance": 0.3})
    world.evidences.scatter["position"] = scatter
    mine = choice(world, "drive_compliance")
    assert (mine in judge.without_strangers(world.evidences, [mine])) is (0.1 * 12000.0 / scatter < 0.45**2 * 4000.0)


def test_a_cause_that_leaves_nothing_of_its_own_channel_needs_no_other_reading():
    """However much the two readings differ: what explains its channel to the noise is not that."""
    forms = [simple("drive_compliance", "resonance"), simple("encoder_sde", "position")]
    for excess, kept in ((0.0, True), (0.3, False)):
        world = World(forms, {"drive_compliance": 0.45}, seed=46, excess={"position": 30.0, "resonance": excess})
        mine = choice(world, "drive_compliance")
        assert (mine in judge.without_strangers(world.evidences, [mine])) is kept


@pytest.mark.parametrize(("left", "stands"), [(15.0, False), (19.9, False), (20.1, True), (25.0, True)])
def test_what_only_the_learning_records_show_must_be_twice_its_threshold(left, stands):
    finding = Finding("torque", "time", left, 10.0, left)
    assert bool(judge.of_learning_records([(finding, 0.0)])) is stands


def test_shapes_of_which_healthy_axes_show_a_little_have_three_times_the_threshold():
    loose = [simple(f"generic:{name}") for name in ("time", "velocity", "friction in time", "viscous in time", "position")]
    world = World(loose, {}, seed=46)
    thresholds = [finding.threshold for finding, _ in judge.findings_of(world.evidences, [], loose)]
    assert [value / thresholds[4] for value in thresholds[:4]] == pytest.approx([2.0] * 4) and NAMELESS


@pytest.mark.parametrize(("gain", "held", "sizes", "rival"), [(1000.0, 500.0, 1, True), (985.0, 485.0, 1, False), (994.0, 500.0, 1, True), (989.0, 500.0, 1, True),
                                                             (970.0, 490.0, 1, False), (994.0, 500.0, 6, True), (990.0, 500.0, 9, False)])
def test_the_lead_of_a_name_counts_both_groups_and_every_size(monkeypatch, gain, held, sizes, rival):
    """Lead 1000 + 500 − 2 of the name over gain + held − 2·sizes of the other, against 2 % of 1000 = 20."""
    mine, other = (types.SimpleNamespace(effect=e, forms=()) for e in ("torque_ripple", "amplifier_offset"))
    monkeypatch.setattr(judge, "best_or_same", lambda *_: types.SimpleNamespace(gain=1000.0, held=500.0, sizes=1))
    monkeypatch.setattr(judge, "stand_side_by_side", lambda *_: False)
    monkeypatch.setattr(judge, "best_forms", lambda *_: types.SimpleNamespace(choice=other, gain=gain, held=held, sizes=sizes))
    first = {"is_the_first": False}
    for name, value in (("acceptable", True), ("_leads", True), ("level_or_viscous", None), ("is_constant_force", False)):
        monkeypatch.setattr(judge, name, lambda *_, value=value: value)
    monkeypatch.setattr(judge, "is_the_first", lambda *_: first["is_the_first"])
    ask = lambda: judge.rivals_of(None, mine, [mine], ["torque_ripple", "amplifier_offset"])
    assert ask() == (["amplifier_offset"] if rival else [])
    first["is_the_first"] = True        # where the stretches put the records at the name itself, the margin of 12 decides
    assert ask() == (["amplifier_offset"] if 1500.0 - 2.0 - (gain + held - 2.0 * sizes) < 12.0 else [])


@pytest.mark.parametrize(("excess", "stands"), [(0.7, []), (1.5, ["torque"])])
def test_without_a_baseline_a_channel_may_be_half_as_loud_again(excess, stands):
    """1.7 times the model's noise is below 1.35 times 1.5, 2.5 times is above."""
    world = World(PLAIN, {}, seed=45, excess={"torque": excess})
    world.evidences.base = {}
    assert judge.stands_out(world.evidences, []) == stands


@pytest.mark.parametrize(("freedom", "louder"), [(3.0, True), (2.0, False)])
def test_loudness_without_a_baseline_is_as_certain_as_its_own_stretches(freedom, louder):
    """Five standard errors are one chance in a hundred by Student's t with three degrees of freedom, and not with two."""
    case = types.SimpleNamespace(mostly_louder=lambda *_: False, loudness=lambda channel, choices, group: (6.0, 1.0, freedom), base={}, learn={"torque": None})
    assert judge._louder(case, "torque", []) is louder


def test_the_gain_of_one_row():
    gain = judge.overall_gain(Ledger(before=4.0, after=1.0, floor=0.25, rows=1), ["gravity_tilt"])
    assert (gain.before, gain.after, gain.floor) == (2.0, 1.0, 0.5)


@pytest.mark.parametrize(("scatter", "within"), [(1.0, False), (9.0, True)])
def test_how_sure_the_size_of_an_asymmetry_is_grows_with_the_scatter(scatter, within):
    """1.0 ± 0.032 exceeds the friction there is (0.9); with rows nine times as loud it is ± 0.095, and may not."""
    rows = types.SimpleNamespace(fit=lambda keys: (np.array([1.0]), np.array([[1.0e-3]]), 100.0 * scatter))
    case = types.SimpleNamespace(learn={"torque": rows}, scatter={"torque": scatter}, forms=[GUIDEWAY],
                                 channel_gain=lambda channel, choices: 100.0 * len(choices))
    tilt = Choice("gravity_tilt", (simple("gravity_tilt"),))
    assert judge.LARGEST_ASYMMETRY == 0.9 and judge.is_constant_force(case, tilt, "direction_asymmetry", []) is within


class Held:
    """χ² on held-out records {(effect, channel)}; what others explain in a channel adds up."""

    def __init__(self, parts):
        self.parts = parts

    def held_gain(self, choices, channels=None):
        here = {c.effect for c in choices}
        return sum(v for (effect, channel), v in self.parts.items() if effect in here and channel in (channels or (channel,)))


def test_the_channel_of_a_cause_is_where_it_adds_most_not_where_most_is_explained():
    mine = Choice("drive_compliance", (simple("drive_compliance", "windup"), simple("drive_compliance", "resonance")))
    other = Choice("screw_pitch_error", (simple("screw_pitch_error", "windup"),))
    case = Held({("drive_compliance", "windup"): 10.0, ("drive_compliance", "resonance"): 50.0, ("screw_pitch_error", "windup"): 1000.0})
    assert judge._main_channel(case, mine, [mine, other], [other]) == ("resonance", 50.0)


@pytest.mark.parametrize(("own", "left", "kept"), [(0.0, 3.0, False), (-2.0, 3.0, False), (1.0, 3.0, True), (1.0, 7.0, False), (-2.0, -5.0, True)])
def test_a_cause_that_explains_nothing_where_something_stands_out_is_a_stranger(monkeypatch, own, left, kept):
    """However little it is that stands out there; where nothing is left above the floor there is none."""
    mine = choice(World([simple("encoder_sde", "position")], {"encoder_sde": 0.1}, seed=47), "encoder_sde")
    monkeypatch.setattr(judge, "ledger_of", lambda *_: Ledger(left={"position": left}))
    monkeypatch.setattr(judge, "stands_out", lambda *_: ["position"])
    monkeypatch.setattr(judge, "_main_channel", lambda *_: ("position", own))
    monkeypatch.setattr(judge, "unsteadiness", lambda *_: 1.0)
    monkeypatch.setattr(judge, "has_two_sizes", lambda *_: False)
    monkeypatch.setattr(judge, "_shown_by_more_than_the_reading", lambda _, choices: choices)
    assert judge.without_strangers(None, [mine]) == ([mine] if kept else [])


@pytest.mark.parametrize(("late", "stands", "kept"), [(False, True, False), (True, True, True), (False, False, True), (True, False, True)])
def test_what_late_readings_leave_asks_no_cause_for_its_reading(monkeypatch, late, stands, kept):
    case = Held({("drive_compliance", "resonance"): 100.0, ("sampling_jitter", "position"): 1.0e6})
    mine = Choice("drive_compliance", (simple("drive_compliance", "resonance"),))
    named = [mine, *([Choice("sampling_jitter", (simple("sampling_jitter", "position"),))] if late else [])]
    monkeypatch.setattr(judge, "stands_out", lambda *_: ["position"] if stands else [])
    monkeypatch.setattr(judge, "ledger_of", lambda *_: Ledger(left={"position": 1.0e5, "resonance": 1.0e4}))
    assert (mine in judge._shown_by_more_than_the_reading(case, named)) is kept


def test_a_ledger_begins_at_nothing():
    world = World(PLAIN, {}, seed=48)
    book, held = ledger_of(world.evidences, []), world.evidences.held
    assert book.before == book.after == pytest.approx(sum(held[ch].energy() / world.evidences.scatter[ch] for ch in held), rel=1e-12)
    assert book.rows == sum(one.rows for one in held.values()) and Ledger().before == 0.0


def test_what_is_left_counts_where_the_causes_are():
    """Of 90 explained 10 are left in the torque, none in the wind-up, and the position is as loud as it happens to be."""
    book = Ledger(before=190.0, after=100.0, floor=40.0, above_noise={"torque": 10.0, "windup": 0.0, "position": 50.0})
    assert book.remaining(["windup"]) == 0.0 and book.remaining(["torque", "torque", "windup"]) == 0.1
    assert book.remaining(["position"]) == pytest.approx(50.0 / 140.0) and book.remaining(["command"]) == 0.0
    assert Ledger().remaining(["torque"]) == 0.0


def test_a_quiet_channel_without_a_cause_is_noise_and_makes_no_share_smaller():
    """A cause takes 10 and leaves nothing; the position, where nothing stands out, is 50 louder than the baseline was."""
    book = Ledger(before=200.0, after=190.0, floor=140.0, above_noise={"torque": 0.0, "position": 50.0}, parts={"cable_spring": 10.0})
    assert book.where_it_stands(["torque"]).excess == 10.0
    assert book.where_it_stands(["torque", "position"]).excess == 60.0 == book.excess
    assert book.where_it_stands(["torque"]).remaining(["torque"]) == book.remaining(["torque"]) == 0.0
    assert judge.overall_gain(book.where_it_stands(["torque"]), ["hold"]).floor == judge.overall_gain(book, ["hold"]).after


def test_what_is_no_louder_than_the_models_noise_is_not_left():
    """Of a channel that is 0.6 of it in the baseline and 0.9 in the held-out records, nothing; of 1.5, half."""
    for size, above_noise in ((0.9, 0.0), (1.5, 0.5)):
        world = World(PLAIN, {}, excess={"torque": size - 1.0}, seed=49)
        held = world.evidences.held["torque"]
        book = ledger_of(world.evidences, [])
        usual = max(usual_size(world.evidences, "torque"), 1.0)
        assert book.above_noise["torque"] == pytest.approx(max(held.energy() / held.rows - usual, 0.0) * held.rows / world.evidences.scatter["torque"])
        assert (book.above_noise["torque"] > 0.0) == (above_noise > 0.0)
