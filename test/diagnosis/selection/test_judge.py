"""Judge and selection on evidence made by hand: what is put in is known exactly, and no simulation stands between.

Columns and noise are drawn with a seed of every test's own; an `Evidence` of n rows has unit noise, so that χ² per row is
one where nothing is wrong.
"""

import dataclasses
import math
import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue import FORMS
from microstage_ros.diagnosis.catalogue.form import Form, one
from microstage_ros.diagnosis.residuals.evidence import Evidence
from microstage_ros.diagnosis.residuals.evidence_set import Choice, Evidences, Trial
from microstage_ros.diagnosis.result import Finding
from microstage_ros.diagnosis.selection import judge, mass_or_drive, selection, splinters
from microstage_ros.diagnosis.selection.ledger import Ledger
from microstage_ros.diagnosis.selection.sizes import CAUTION, FORM_ERROR, form_error

ROWS = {"learn": 8000, "held": 4000, "base": 4000}
FORM = {form.key + (form.channel,): form for form in FORMS}


class World:
    """Evidence of made-up channels: ``truth`` {effect: size} acts on the columns of the forms."""

    def __init__(self, forms, truth, seed=1, base=None, excess=None, held=None, shared=None):
        self.generator = np.random.default_rng(seed)
        self.forms, self.frame = list(forms), None
        sums = {"learn": {}, "held": {}, "base": {}}
        for channel in sorted({form.channel for form in forms}):
            own = [form for form in forms if form.channel == channel]
            for group, rows in ROWS.items():
                sizes = {"learn": truth, "held": truth if held is None else held, "base": base or {}}[group]
                sums[group][channel] = self._evidence(own, rows, sizes, (excess or {}).get(channel, 0.0) * (group != "base"), shared or {})
        self.evidences = Evidences(sums["learn"], sums["held"], sums["base"], self.forms,
                                   {c: 1.0 for c in sums["learn"]}, self.frame)

    def _evidence(self, forms, rows, sizes, excess, shared):
        drawn, where, at, pieces = {}, {}, 1, []
        for form in forms:
            name = shared.get(form.key, form.key)
            if name not in drawn:
                drawn[name] = self.generator.normal(size=(rows, 1))
            column = drawn[name]
            pieces.append(column)
            where[form.key] = slice(at, at + 1)
            at += 1
        residual = self.generator.normal(size=rows) * math.sqrt(1.0 + excess)
        done = set()
        for form, column in zip(forms, pieces):
            if form.effect in sizes and (form.effect, form.channel) not in done:
                residual = residual + sizes[form.effect] * column[:, 0]
                done.add((form.effect, form.channel))
        matrix = np.concatenate([residual[:, None], *pieces], axis=1)
        return Evidence(matrix.T @ matrix, where, rows)


def simple(effect, channel="torque", variant="", accept=None):
    return Form(effect, channel, variant, None, one("size", "1"), accept)


EFFECTS = ("torque_ripple", "amplifier_offset", "scale_error", "amplifier_gain", "gravity_tilt")
PLAIN = [simple(effect) for effect in EFFECTS]


def choice(world, effect):
    return Choice(effect, tuple(form for form in world.forms if form.effect == effect))


def test_forward_selection_finds_what_was_put_in_and_nothing_else():
    world = World(PLAIN, {"torque_ripple": 0.5, "scale_error": -0.3}, seed=2)
    choices, _ = selection.select(world.evidences, EFFECTS)
    assert {c.effect for c in choices} == {"torque_ripple", "scale_error"}


@pytest.mark.parametrize("seed", range(8))
def test_nothing_is_found_in_noise(seed):
    choices, _ = selection.select(World(PLAIN, {}, seed=[3, seed]).evidences, EFFECTS)
    assert choices == []


def test_sizes_are_learned_on_the_learning_records_alone():
    """Records that were held out and show the opposite refuse the cause; sizes from them would have gained there."""
    world = World(PLAIN, {"torque_ripple": 0.5}, held={"torque_ripple": -0.5})
    mine = [choice(world, "torque_ripple")]
    assert world.evidences.gain(mine) > 1000.0
    assert world.evidences.held_gain(mine) < -2000.0     # −(0.5² + 2·0.5²)·4000 = −3000
    assert selection.select(world.evidences, EFFECTS)[0] == []


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_amplitude_in_the_baseline_is_measured(share):
    world = World(PLAIN, {"torque_ripple": 0.5}, base={"torque_ripple": 0.5 * share})
    amplitude, stderr = world.evidences.amplitude_in_base(choice(world, "torque_ripple"), [])
    assert amplitude == pytest.approx(share, abs=4.0 * stderr)
    assert stderr == pytest.approx(1.0 / (0.5 * math.sqrt(ROWS["base"])), rel=0.1)
    found = {c.effect for c in selection.select(world.evidences, EFFECTS)[0]}
    assert found == (set() if share else {"torque_ripple"})


def test_without_a_baseline_the_amplitude_says_nothing():
    world = World(PLAIN, {"torque_ripple": 0.5})
    world.evidences.base = {}
    assert world.evidences.amplitude_in_base(choice(world, "torque_ripple"), [])[1] > 1e6
    assert [c.effect for c in selection.select(world.evidences, EFFECTS)[0]] == ["torque_ripple"]


def test_a_wider_nameless_shape_that_says_much_more_refuses_the_name():
    forms = [simple("gravity_tilt"), simple("generic:position")]
    world = World(forms, {"gravity_tilt": 0.1, "generic:position": 0.5})
    mine = choice(world, "gravity_tilt")
    trial = selection.best_forms(world.evidences, "gravity_tilt", [])
    assert selection.misfit(world.evidences, mine, [mine]) > 0.9
    assert not selection.acceptable(world.evidences, trial, [])
    alone = World(forms, {"gravity_tilt": 0.1})
    assert selection.acceptable(alone.evidences, selection.best_forms(alone.evidences, "gravity_tilt", []), [])


@pytest.mark.parametrize(("channel", "refused"), [("position", True), ("torque", False)])
def test_a_wide_shape_is_excused_by_a_cause_of_its_own_channel_alone(channel, refused):
    """A drift of another course in every record was a scale error, as friction lagged in the torque (pairs, seed 9103, case 10)."""
    forms = [simple("gravity_tilt"), simple("generic:position"), simple("amplifier_offset", channel)]
    put_in = {"gravity_tilt": 0.1, "amplifier_offset": 0.4}
    world = World(forms, {**put_in, "generic:position": 0.5}, held={**put_in, "generic:position": -0.5})
    mine, other = choice(world, "gravity_tilt"), choice(world, "amplifier_offset")
    assert (selection.misfit(world.evidences, mine, [other, mine]) > 0.9) == refused


def test_two_names_for_one_trace_are_rivals_and_others_are_not():
    world = World(PLAIN, {"torque_ripple": 0.4}, shared={("amplifier_offset", ""): ("torque_ripple", "")})
    mine = choice(world, "torque_ripple")
    assert judge.rivals_of(world.evidences, mine, [mine], EFFECTS) == ["amplifier_offset"]
    apart = World(PLAIN, {"torque_ripple": 0.4})
    assert judge.rivals_of(apart.evidences, choice(apart, "torque_ripple"), [choice(apart, "torque_ripple")], EFFECTS) == []


def test_ledger_by_closed_form():
    """before = n (1 + a²), after = n, floor = n times the baseline's χ² per row, each to its own chance."""
    world = World(PLAIN, {"torque_ripple": 0.5}, seed=5)
    mine = [choice(world, "torque_ripple")]
    book, n = judge.ledger_of(world.evidences, mine), ROWS["held"]
    assert book.rows == n
    assert book.before == pytest.approx(1.25 * n, rel=0.1)
    assert book.after == pytest.approx(n, rel=0.1)
    base = world.evidences.base["torque"]
    assert book.floor == pytest.approx(min(base.energy() / base.rows * n, book.after))
    assert book.parts["torque_ripple"] == pytest.approx(0.25 * n, rel=0.15)
    assert book.excess == book.before - book.floor


def test_the_floor_knows_nothing_of_the_records_under_test():
    """Something nobody names stands in both record groups: it stays above the floor, whatever is named beside it."""
    quiet, loud = (World(PLAIN, {"torque_ripple": 0.5}, seed=6, excess={"torque": e}) for e in (0.0, 1.0))
    books = [judge.ledger_of(w.evidences, [choice(w, "torque_ripple")]) for w in (quiet, loud)]
    assert books[1].floor == pytest.approx(books[0].floor, rel=0.05)
    assert books[1].after > 1.8 * books[1].floor
    assert judge.stands_out(loud.evidences, [choice(loud, "torque_ripple")]) == ["torque"]
    assert judge.stands_out(quiet.evidences, [choice(quiet, "torque_ripple")]) == []


def test_the_floor_without_a_baseline_is_the_models_own_noise():
    world = World(PLAIN, {"torque_ripple": 0.5}, seed=7)
    world.evidences.base = {}
    assert judge.usual_size(world.evidences, "torque") == 1.0
    book = judge.ledger_of(world.evidences, [choice(world, "torque_ripple")])
    assert book.floor == min(ROWS["held"], book.after)


def test_what_stands_out_must_do_so_in_both_groups():
    world = World(PLAIN, {"torque_ripple": 2.0}, held={}, seed=8)
    assert judge.stands_out(world.evidences, []) == []
    both = World(PLAIN, {"torque_ripple": 2.0}, seed=8)
    assert judge.stands_out(both.evidences, []) == ["torque"]
    assert judge.stands_out(both.evidences, [choice(both, "torque_ripple")]) == []


CAUSE, RIVAL, LEFT = ("cause",), ("rival",), (Finding("torque", "time", 9.0, 1.0, 9.0),)
SHARES = {"all": 0.0, "most": 0.22, "half": 0.5}      # explained
TABLE = [
    ((), (), (), "all", (), "agrees"),
    ((), (), LEFT, "all", (), "unexplained"),
    ((), (), (), "all", ("torque",), "unexplained"),
    ((), RIVAL, (), "all", (), "undetermined"),
    (CAUSE, RIVAL, LEFT, "half", ("torque",), "undetermined"),
    (CAUSE, (), (), "all", (), "explained"),
    (CAUSE, (), (), "most", (), "explained"),
    (CAUSE, (), LEFT, "all", (), "explained"),
    (CAUSE, (), LEFT, "most", (), "partly_explained"),
    (CAUSE, (), (), "half", (), "partly_explained"),
    (CAUSE, (), (), "all", ("torque",), "partly_explained"),
]


@pytest.mark.parametrize(("causes", "rivals", "left", "explained", "above", "verdict"), TABLE)
def test_verdicts(causes, rivals, left, explained, above, verdict):
    assert judge.verdict_of(causes, rivals, left, SHARES[explained], above) == verdict


def test_strangers_are_dropped_and_others_kept():
    """A name that explains a hundredth of what stands out in its channel is no answer to it; one that explains it is."""
    forms = [simple("encoder_sde", "position"), simple("scale_error", "position")]
    world = World(forms, {"encoder_sde": 0.15}, excess={"position": 3.0}, seed=9)
    stranger = choice(world, "encoder_sde")
    assert judge.without_strangers(world.evidences, [stranger]) == []
    for error, kept in ((0.13, []), (0.11, [stranger])):       # of one size in every stretch it is no nearest name
        world.evidences.agreement = lambda *_, error=error: (1.0, error, 50.0)
        assert judge.without_strangers(world.evidences, [stranger]) == kept
    world = World(forms, {"encoder_sde": 2.0}, excess={"position": 0.6}, seed=9)
    mine = choice(world, "encoder_sde")
    assert judge.stands_out(world.evidences, [mine]) == ["position"]
    assert judge.without_strangers(world.evidences, [mine]) == [mine]


@pytest.mark.parametrize(("held", "kept"), [(1.4, True), (1.6, False)])
def test_beside_another_cause_one_of_two_sizes_is_none(held, kept):
    """Where more stands out: 0.4 and 0.6 of its size are 2.2 and 3.2 standard errors of both record groups."""
    forms = [simple("encoder_sde", "position"), simple("scale_error", "position")]
    world = World(forms, {"encoder_sde": 0.3, "scale_error": 1.0}, excess={"position": 3.0}, seed=9)
    mine, larger = choice(world, "encoder_sde"), choice(world, "scale_error")
    sizes = {"learn": (1.0, 0.11, 50.0), "held": (held, 0.15, 20.0)}
    world.evidences.agreement = lambda one, others, group: sizes[group] if one is mine else (1.0, 0.11, 50.0)
    assert judge.without_strangers(world.evidences, [larger, mine]) == ([larger, mine] if kept else [larger])
    assert judge.without_strangers(world.evidences, [mine]) == [mine]      # alone it is the nearest name to what it is


def test_sizes_hold_the_error_of_the_form_and_the_caution_of_the_channel():
    """stderr² = (scatter · 2 σ_β)² + (share · size)², the share of `FORM_ERROR`; a factor counts from one."""
    forms = [FORM[("friction_level_change", "", "torque")], FORM[("gravity_tilt", "", "torque")]]
    forms = [dataclasses.replace(form, columns=None) for form in forms]
    world = World(forms, {"friction_level_change": 0.2}, seed=10)
    form = forms[0]
    sizes, effect = selection.sizes_of(world.evidences, Choice(form.effect, (form,)), [], form)
    value, stderr, unit = sizes["factor"]
    beta, covariance, _ = world.evidences.learn["torque"].fit([form.key])
    assert (value, unit) == (pytest.approx(1.0 + beta[0]), "1") and effect["factor"] == pytest.approx(value)
    own = math.sqrt(covariance[0, 0]) * CAUTION["torque"]
    share = FORM_ERROR["friction_level_change"]
    assert share > 0.0 and stderr == pytest.approx(math.hypot(own, share * (value - 1.0)))


def test_every_form_error_is_a_share_between_nothing_and_one():
    assert all(0.0 < share < 1.0 for share in FORM_ERROR.values())
    assert form_error("gravity_tilt") > 0.0


def resonant(mass_in_torque, payload=0.6, drive=0.6, stderr_rows=None):
    """A world in which resonance and wind-up show a payload of 3 kg or a soft drive alike, and the torque so many kg."""
    def mass(beta, covariance, frame):
        return {"mass_kg": (5.0 * float(beta[0]), 5.0 * math.sqrt(covariance[0, 0]), "kg")}, {"mass_kg": 5.0 * float(beta[0])}

    forms = [Form("payload_change", "resonance", "2", None, mass), Form("payload_change", "torque", "", None, mass),
             Form("drive_compliance", "resonance", "0.5", None, one("stiffness_factor", "1"))]
    shared = {("drive_compliance", "0.5"): ("payload_change", "2")}
    world = World(forms, {}, seed=11, shared=shared)
    for group, rows in ROWS.items():
        if group == "base":
            continue
        sums = getattr(world.evidences, group)
        one_world = World(forms, {"payload_change": payload}, seed=[12, rows], shared=shared)
        sums["resonance"] = getattr(one_world.evidences, group)["resonance"]
        torque = World(forms, {"payload_change": mass_in_torque / 5.0}, seed=[13, rows], shared=shared)
        sums["torque"] = getattr(torque.evidences, group)["torque"]
    world.evidences.frame = types.SimpleNamespace(rattled_mass=0.0)
    return world


def following(world, share):
    """The world in which a payload takes this share of what a soft drive takes from the resonance."""
    gain = world.evidences.channel_gain
    world.evidences.channel_gain = lambda channel, choices, extra=(): gain(channel, choices, extra) * (
        share if "payload_change" in {c.effect for c in choices} and channel == "resonance" else 1.0)
    return world


@pytest.mark.parametrize(("mass", "share", "said"), [(3.0, 1.0, "payload_change"), (2.4, 1.0, "payload_change"),
                                                     (3.0, 0.92, "payload_change"), (0.0, 0.88, "drive_compliance")])
def test_the_torque_balance_tells_a_payload_from_a_soft_drive(mass, share, said):
    world = following(resonant(mass), share)
    world.evidences.frame = types.SimpleNamespace(drive=types.SimpleNamespace(mass=5.0), rattled_mass=0.0)
    trials = {effect: selection.best_forms(world.evidences, effect, []) for effect in mass_or_drive.RESONANT}
    assert mass_or_drive.resonance_is(world.evidences, trials, []) == said
    for first in mass_or_drive.RESONANT:
        chosen = selection.mass_or_stiffness(world.evidences, [trials[first].choice])
        assert [c.effect for c in chosen] == [said]


def test_where_the_torque_says_neither_they_are_rivals():
    """A mass of a third of what the resonance needs is none of the two."""
    world = resonant(0.9)
    trials = {effect: selection.best_forms(world.evidences, effect, []) for effect in mass_or_drive.RESONANT}
    assert mass_or_drive.resonance_is(world.evidences, trials, []) == "open"
    mine = trials["drive_compliance"].choice
    assert judge.rivals_of(world.evidences, mine, [mine], mass_or_drive.RESONANT) == ["payload_change"]


def test_a_drive_that_lost_its_damping_in_proportion_may_be_a_payload():
    """A torque balance that tells no mass, on a machine of another friction law, is then no proof."""
    world = resonant(0.0)
    trials = {effect: selection.best_forms(world.evidences, effect, []) for effect in mass_or_drive.RESONANT}
    assert mass_or_drive.resonance_is(world.evidences, trials, []) == "open"


def test_a_drive_that_the_payload_does_not_follow_is_a_drive():
    """Between a half and nine tenths of its resonance a mass in the torque leaves it open, if it is the one that the
    stiffness stands for or a quarter of it; below, nothing does."""
    world = resonant(3.0)
    trials = {effect: selection.best_forms(world.evidences, effect, []) for effect in mass_or_drive.RESONANT}
    drive = trials["drive_compliance"]
    told = drive.choice.forms[0].sizes(world.evidences.learn["resonance"].fit([drive.choice.forms[0].key])[0], np.eye(1), None)[0]
    factor = told["stiffness_factor"][0]
    for share, expected, said in ((0.7, 3.0, "open"), (0.7, 10.0, "open"), (0.7, 30.0, "drive_compliance"),
                                  (0.7, -3.0, "drive_compliance"), (0.4, 3.0, "drive_compliance")):
        world = following(resonant(3.0), share)
        world.evidences.frame = types.SimpleNamespace(drive=types.SimpleNamespace(mass=expected / (1.0 / factor - 1.0)))
        assert mass_or_drive.resonance_is(world.evidences, trials, []) == said, (share, expected)
    assert mass_or_drive.resonance_is(world.evidences, {"payload_change": None, "drive_compliance": drive}, []) is None


@pytest.mark.parametrize(("size", "rivals"), [(0.4, ["direction_asymmetry"]), (3.0, [])])
def test_a_tilt_may_be_an_asymmetry_of_the_guideways_as_far_as_their_friction_goes(size, rivals):
    """Both are a constant force; one of three times the guideways' friction is no asymmetry of it."""
    forms = [simple("gravity_tilt"), Form("direction_asymmetry", "torque", "guideway", None, one("asymmetry", "1"),
                                          lambda beta: abs(beta[0]) < 0.9)]
    world = World(forms, {"gravity_tilt": size}, seed=14, shared={("direction_asymmetry", "guideway"): ("gravity_tilt", "")})
    mine = choice(world, "gravity_tilt")
    effects = ("gravity_tilt", "direction_asymmetry")
    assert judge.rivals_of(world.evidences, mine, [mine], effects) == rivals
    if rivals:
        other = choice(world, "direction_asymmetry")
        assert judge.rivals_of(world.evidences, other, [other], effects) == ["gravity_tilt"]


def test_a_small_cause_beside_a_large_one_of_its_channel_is_a_splinter():
    world = World(PLAIN, {"torque_ripple": 2.0, "scale_error": 0.15}, seed=15)
    large, small = choice(world, "torque_ripple"), choice(world, "scale_error")
    assert splinters.without_splinters(world.evidences, [large, small]) == [large]
    even = World(PLAIN, {"torque_ripple": 0.5, "scale_error": 0.4}, seed=15)
    both = [choice(even, "torque_ripple"), choice(even, "scale_error")]
    assert splinters.without_splinters(even.evidences, both) == both


def test_prune_drops_what_no_longer_stands():
    world = World(PLAIN, {"torque_ripple": 0.5}, seed=16)
    kept = selection.prune(world.evidences, [choice(world, "torque_ripple"), choice(world, "scale_error")])
    assert [c.effect for c in kept] == ["torque_ripple"]


def test_trial_probability_is_that_of_chi_square():
    assert Trial(None, 23.93, 1).log_p == pytest.approx(math.log(1e-6), abs=0.01)
    assert Trial(None, -5.0, 2).log_p == 0.0


def test_leftovers_need_threshold_and_held_out_records():
    strong, weak = Finding("torque", "time", 9.0, 1.0, 5.0), Finding("torque", "time", 9.0, 1.0, 0.5)
    again = dataclasses.replace(strong, statistic=8.0)      # another one that the held-out records do not show
    assert judge.leftovers([(strong, 26.0), (again, 24.0), (weak, 26.0), (weak, 24.0)]) == [strong]
    assert judge.of_learning_records([(strong, 0.0), (weak, 0.0)]) == [strong]


def test_cause_gain_is_in_the_unit_of_its_channel():
    world = World(PLAIN, {"torque_ripple": 0.5}, seed=17)
    mine = [choice(world, "torque_ripple")]
    channel, gain = judge.cause_gain(world.evidences, mine[0], mine, {"torque": (2.0, "V")})
    assert channel == "torque" and gain.unit == "V"
    assert gain.before == pytest.approx(2.0 * math.sqrt(1.25), rel=0.05) and gain.after == pytest.approx(2.0, rel=0.05)


def test_overall_gain_interval():
    gain = judge.overall_gain(Ledger(400.0, 100.0, 90.0, 100), ["hold"])
    assert (gain.before, gain.after, gain.floor) == (2.0, 1.0, pytest.approx(math.sqrt(0.9)))
    assert gain.ci95 == (pytest.approx(1.0 - 1.96 / math.sqrt(200.0)), pytest.approx(1.0 + 1.96 / math.sqrt(200.0)))


def test_more_friction_alone_is_no_payload():
    """A mass moves the resonance, too: where no resonance is seen (behind a gap), or it says another mass, none is named."""
    world = resonant(3.0)
    both = selection.best_forms(world.evidences, "payload_change", [])
    assert {form.channel for form in both.choice.forms} == {"resonance", "torque"}
    assert selection.acceptable(world.evidences, both, [])
    torque = Choice("payload_change", tuple(form for form in both.choice.forms if form.channel == "torque"))
    assert not selection.acceptable(world.evidences, Trial(torque, both.gain, 1, both.held), [])
    for rattled, stands in ((3.0, True), (0.5, False)):     # behind a gap a rattle tells the mass that the resonance would
        world.evidences.frame.rattled_mass = rattled
        assert selection.acceptable(world.evidences, Trial(torque, both.gain, 1, both.held), []) == stands
    apart = resonant(3.0, payload=0.1)      # half a kilogram in the resonance
    assert not selection.acceptable(apart.evidences, selection.best_forms(apart.evidences, "payload_change", []), [])


def test_a_cause_that_holds_little_of_the_held_out_records_is_not_named():
    """χ² of a² n: 0.4² · 4000 = 640 stays, 0.12² · 4000 = 58 goes, and beside it the other keeps all of its own."""
    world = World(PLAIN, {"torque_ripple": 0.4, "scale_error": 0.12}, seed=31)
    both = [choice(world, "torque_ripple"), choice(world, "scale_error")]
    assert judge.without_faint(world.evidences, both) == both[:1]
    assert judge.without_faint(world.evidences, both[1:]) == [] == judge.without_faint(world.evidences, [])
