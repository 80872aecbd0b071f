"""A name is asked again once the others are known; what the baseline does not clearly show decides nothing; and what the
selection asks of a form, of a size and of a name, on gains that are written down."""

import math
import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue.form import Form, one
from microstage_ros.diagnosis.residuals.evidence import Evidence
from microstage_ros.diagnosis.residuals.evidence_set import Choice, Evidences, Trial
from microstage_ros.diagnosis.selection import judge, selection
from microstage_ros.diagnosis.selection.agreement import OF_NAMES, agrees_with_itself, clear_part, log_odds, log_tail

FORMS = {effect: Form(effect, "torque", "", None, one("size", "1"))
         for effect in ("nonlinear_viscous", "viscous_change", "frictional_lag")}
CHOICES = {effect: Choice(effect, (form,)) for effect, form in FORMS.items()}


def lagging(truth, seed=4):
    """`Evidences` in which a power of the speed looks like viscosity and lag together; unit noise."""
    generator, groups = np.random.default_rng(seed), {}
    for group, rows in (("learn", 8000), ("held", 4000), ("base", 4000)):
        viscous, lag, rest = generator.normal(size=(3, rows))
        columns = np.stack([viscous + 0.5 * lag + 0.15 * rest, viscous, lag], axis=1)
        sizes = np.array([0.0 if group == "base" else truth.get(effect, 0.0) for effect in FORMS])
        matrix = np.column_stack([columns @ sizes + generator.normal(size=rows), columns])
        where = {form.key: slice(n, n + 1) for n, form in enumerate(FORMS.values(), 1)}
        groups[group] = {"torque": Evidence(matrix.T @ matrix, where, rows)}
    return Evidences(*groups.values(), list(FORMS.values()), {"torque": 1.0}, None)


def test_a_power_of_the_speed_becomes_a_viscosity_once_the_lag_is_known():
    case = lagging({"viscous_change": 1.0, "frictional_lag": 0.8})
    first = [CHOICES["nonlinear_viscous"], CHOICES["frictional_lag"]]
    trials = [selection.best_forms(case, effect, []) for effect in FORMS]
    assert max(trials, key=lambda trial: trial.gain).choice.effect == "nonlinear_viscous"
    assert [c.effect for c in selection._renamed(case, first, list(FORMS))] == ["viscous_change", "frictional_lag"]
    assert {c.effect for c in selection.select(case, list(FORMS))[0]} == {"viscous_change", "frictional_lag"}


def test_a_right_name_and_a_cause_alone_are_not_renamed():
    case = lagging({"nonlinear_viscous": 1.0, "frictional_lag": 0.8})
    for choices in ([CHOICES["nonlinear_viscous"], CHOICES["frictional_lag"]], [CHOICES["viscous_change"]]):
        assert selection._renamed(case, choices, list(FORMS)) == choices


def test_a_tilt_is_not_renamed_to_the_cable_that_contains_it():
    """A spring with its anchor far away is a constant force, and a little more of whatever else there is."""
    generator, groups = np.random.default_rng(6), {}
    forms = [Form("gravity_tilt", "torque", "", None, one("size", "1")), Form("amplifier_offset", "torque", "", None, one("size", "1")),
             Form("cable_spring", "torque", "", None, one("size", "1"))]
    for group, rows in (("learn", 8000), ("held", 4000), ("base", 4000)):
        tilt, offset, slope = generator.normal(size=(3, rows))
        columns = np.stack([tilt, offset, tilt, slope], axis=1)
        size = 0.0 if group == "base" else 1.0
        residual = size * (tilt + offset + 0.08 * slope) + generator.normal(size=rows)
        where = {form.key: slice(n, n + 1 + (n == 3)) for n, form in enumerate(forms, 1)}
        matrix = np.column_stack([residual, columns])
        groups[group] = {"torque": Evidence(matrix.T @ matrix, where, rows)}
    case = Evidences(*groups.values(), forms, {"torque": 1.0}, None)
    both = [Choice(form.effect, (form,)) for form in forms[:2]]
    wider = selection.best_forms(case, "cable_spring", both[1:])
    assert wider.gain > case.gain(both) - case.gain(both[1:]) + selection.RIVAL_MARGIN + 4.0
    assert selection._renamed(case, both, [form.effect for form in forms]) == both


def of_sizes(signal, **sizes):
    return types.SimpleNamespace(agreement=lambda choice, others, group: sizes[group], signal=lambda *_: signal)


@pytest.mark.parametrize(("scatter", "named"), [(1.0, True), (3.0, False)])
def test_a_baseline_that_was_elsewhere_is_asked_once_where_the_noise_model_holds(scatter, named):
    """Friction along the stroke of which the baseline, that hardly went there, says 0.06 ± 0.29. Three standard errors
    are enough where the size scatters as the noise model has it, and not where the machine's law may be another one."""
    sizes = {"learn": (1.03, 0.05, 20.0), "held": (1.1, 0.06, 12.0), "base": (0.06, 0.29, 20.0)}
    signal = (scatter / 0.05) ** 2
    assert agrees_with_itself(of_sizes(signal, **sizes), CHOICES["viscous_change"], []) == named
    sizes["base"] = (0.6, 0.29, 20.0)      # it shows it, too
    assert not agrees_with_itself(of_sizes(signal, **sizes), CHOICES["viscous_change"], [])


def test_the_clear_part_of_a_size_is_what_stands_above_its_error():
    assert clear_part((0.1, 0.2, 9.0)) == (0.0, 0.0, 9.0) and clear_part((0.0, 0.2, 9.0)) == (0.0, 0.0, 9.0)
    assert clear_part((1.0, 0.5, 9.0)) == pytest.approx((0.75, 0.5 * math.sqrt(0.75), 9.0))
    assert clear_part((-2.0, 0.1, 9.0))[0] == pytest.approx(-2.0, rel=0.01)


@pytest.mark.parametrize(("lead", "base", "leads"), [
    ((0.5, 0.25, 30.0), (0.1, 0.2, 30.0), True),       # one for the first name; the baseline shows nothing clearly
    ((0.5, 0.25, 30.0), (0.6, 0.1, 30.0), False),      # the healthy axis gains as much
    ((0.2, 0.05, 60.0), (0.0, 0.1, 30.0), True),       # neither is right to the last, yet the first is certainly nearer
    ((0.1, 0.06, 60.0), (0.0, 0.1, 30.0), False),
    ((0.2, 0.08, 60.0), (0.0, 0.1, 30.0), False),      # an asymmetry on a machine of LuGre's law, called a tilt
    ((-0.5, 0.25, 30.0), (0.0, 0.1, 30.0), False),
    # a level of friction: the healthy axis was nearer to a viscosity (pairs, seed 10201, case 47), or to the level
    ((0.297, 0.033, 52.0), (-0.339, 0.096, 24.0), True),
    ((0.297, 0.033, 52.0), (0.339, 0.096, 24.0), False),
    # or to the level, by little (seed 10431, case 8)
    ((0.341, 0.086, 167.0), (0.325, 0.16, 56.0), True),
])
def test_a_name_leads_by_the_odds_of_two_names_or_by_certainty(lead, base, leads):
    case = types.SimpleNamespace(lead=lambda *_: lead, lead_of_baseline=lambda *_: base)
    assert judge._leads(case, CHOICES["viscous_change"], CHOICES["nonlinear_viscous"], []) == leads


@pytest.mark.parametrize(("value", "error", "leads"), [(0.27, 0.05, False), (0.27, 0.09, True), (0.44, 0.05, True)])
def test_a_tilt_leads_an_asymmetry_only_if_it_may_be_right_to_the_last(value, error, leads):
    """An asymmetry on a machine of LuGre's law, called a tilt (singles, seed 6101, case 29)."""
    case = types.SimpleNamespace(lead=lambda *_: (value, error, 116.0), lead_of_baseline=lambda *_: (0.0, 0.1, 30.0))
    tilt, asymmetry = (Choice(effect, (Form(effect, "torque", "", None, one("size", "1")),))
                       for effect in ("gravity_tilt", "direction_asymmetry"))
    assert judge._leads(case, tilt, asymmetry, []) == leads
    # a tilt is the same under any law: what does not fit to the last may still be no tilt (pairs, seed 8701, case 17)
    assert judge._leads(case, asymmetry, tilt, [])
    assert judge._leads(case, CHOICES["viscous_change"], CHOICES["nonlinear_viscous"], [])


def test_the_odds_of_two_names_are_those_of_the_factor():
    assert log_odds((0.0, 0.2, 30.0)) == pytest.approx(0.0)
    assert log_odds((0.5, 0.2, 1.0e6)) == pytest.approx(0.5 / 0.2**2, rel=1e-3)       # Gauss
    assert log_odds((0.5, 0.2, 3.0)) < 0.5 / 0.2**2 and log_odds((0.5, 0.0, 3.0)) == math.inf
    assert log_odds((0.2, 0.01, 1.0e6)) == pytest.approx(0.2 / 0.3**2, rel=1e-3)      # a distance of 0.3 from the first
    assert log_tail((0.5, 0.25, 30.0)) > OF_NAMES


def test_what_the_baseline_shows_of_two_names_is_the_machines_or_of_one_record():
    gauss = 1.0e6
    both = log_odds((0.5, 0.1, gauss), (0.2, 0.0, gauss)), log_odds((0.5, 0.1, gauss), (-0.2, 0.0, gauss))
    random = math.hypot(0.1, 0.2)
    density = lambda distance, spread: math.exp(-0.5 * (distance / spread) ** 2) / spread
    for found, shown in zip(both, (0.2, -0.2)):     # a distance of 0.2 from the first name if it is the machine's
        first = density(0.2, 0.1) + density(0.0, random)
        assert found == pytest.approx(math.log(first / (density(1.0 - shown, 0.1) + density(1.0, random))), rel=1e-3)
    assert both[1] > both[0]


class Written:
    """Evidences of gains that add up: ``parts`` {(effect, channel, variant): (gain, held-out gain, number of sizes)}."""

    def __init__(self, parts, held_rows=4000):
        self.parts, self.frame, self.base, self.raw = parts, None, {}, {}
        self.forms = [Form(*key, None, one("size", "1")) for key in parts]
        self.learn, channels = {}, {channel for _, channel, _ in parts}
        self.scatter = dict.fromkeys(channels, 1.0)
        self.held = {channel: types.SimpleNamespace(rows=held_rows) for channel in sorted(channels)}
        for channel in sorted(channels):
            where, at = {}, 1
            for (effect, place, variant), (_, _, count) in parts.items():
                if place == channel:
                    where[effect, variant], at = slice(at, at + count), at + count
            fit = lambda keys, channel=channel, where=where: (
                np.ones(sum(where[key].stop - where[key].start for key in keys)), None, self.total(channel, keys, 0))
            self.learn[channel] = types.SimpleNamespace(where=where, fit=fit, rows=8000)

    def total(self, channel, keys, which):
        return sum(self.parts[effect, channel, variant][which] for effect, variant in keys)

    def choice(self, effect):
        return Choice(effect, tuple(form for form in self.forms if form.effect == effect))

    def channel_gain(self, channel, choices, extra=()):
        return self.total(channel, Evidences._keys(channel, choices, extra), 0)

    def gain(self, choices, extra=()):
        return sum(self.channel_gain(channel, choices, extra) for channel in self.learn)

    def held_gain(self, choices, channels=None):
        return sum(self.total(channel, Evidences._keys(channel, choices), 1) for channel in channels or self.held)

    def more(self, channel, keys, key):
        return self.total(channel, [key], 0)

    def held_more(self, channel, keys, key):
        return self.total(channel, [key], 1)

    def usual(self, channel, key):
        return 0.0

    def signal(self, choice, others):
        return math.inf


def test_a_trial_counts_every_size_once():
    case = Written({("torque_ripple", "torque", ""): (300.0, 150.0, 3), ("torque_ripple", "windup", ""): (100.0, 40.0, 2)})
    trial = selection.best_forms(case, "torque_ripple", [])
    assert (trial.gain, trial.held, trial.sizes) == (400.0, 190.0, 5)


@pytest.mark.parametrize(("gain", "channels"), [(7.9, ["torque"]), (8.1, ["torque", "windup"])])
def test_a_further_channel_must_be_worth_its_sizes(gain, channels):
    """Twice its two sizes, and four more."""
    case = Written({("torque_ripple", "torque", ""): (300.0, 150.0, 1), ("torque_ripple", "windup", ""): (gain, 3.0, 2)})
    assert [form.channel for form in selection.best_forms(case, "torque_ripple", []).choice.forms] == channels


def test_an_only_channel_is_on_trial_however_little_it_is_worth():
    case = Written({("torque_ripple", "torque", ""): (0.5, 0.0, 1)})
    assert selection.best_forms(case, "torque_ripple", []).gain == 0.5
    assert selection.best_forms(case, "gravity_tilt", []) is None


def test_a_channel_that_makes_the_held_out_records_worse_is_no_trace_of_the_effect():
    case = Written({("torque_ripple", "torque", ""): (300.0, 150.0, 3), ("torque_ripple", "windup", ""): (100.0, -5.0, 2)})
    trial = selection.best_forms(case, "torque_ripple", [])
    assert ([form.channel for form in trial.choice.forms], trial.gain, trial.held, trial.sizes) == (["torque"], 300.0, 150.0, 3)


def test_the_best_form_pays_for_its_sizes():
    case = Written({("torque_ripple", "torque", "fine"): (303.0, 150.0, 5), ("torque_ripple", "torque", "plain"): (300.0, 150.0, 1)})
    assert selection.best_forms(case, "torque_ripple", []).choice.forms[0].variant == "plain"
    assert selection.best_forms(case, "torque_ripple", [Choice("torque_ripple", (case.forms[1],))]).choice.forms[0].variant == "fine"
    assert selection.best_forms(case, "torque_ripple", [Choice("torque_ripple", (case.forms[0],))]).choice.forms[0].variant == "plain"
    case.forms[1:1] = [Form("torque_ripple", "torque", "", None, one("size", "1"), lambda beta: False)]      # a size that makes no sense
    case.learn["torque"].where["torque_ripple", ""], case.parts["torque_ripple", "torque", ""] = slice(7, 8), (900.0, 450.0, 1)
    assert selection.best_forms(case, "torque_ripple", []).choice.forms[0].variant == "plain"


def test_behind_a_wave_that_the_baseline_shows_the_other_profiles_are_asked(monkeypatch):
    along = "position_dependent_friction"
    case = Written({(along, "torque", "wave"): (900.0, 400.0, 2), (along, "torque", "bump"): (300.0, 150.0, 2)})
    monkeypatch.setattr(selection, "is_wave_of_baseline", lambda evidences, form, choices: form.variant == "wave")
    assert selection.best_forms(case, along, []).choice.forms[0].variant == "bump"


@pytest.mark.parametrize(("wide", "sizes", "share"), [(108.0, 4, 0.5), (8.5, 4, 0.5 / 100.5), (5.0, 4, 0.0), (308.0, 4, 0.75)])
def test_the_misfit_is_what_a_wider_shape_explains_of_both_beyond_its_sizes(wide, sizes, share):
    """108 of χ² by four sizes are worth 100, as much as the named cause's own 100: half."""
    case = Written({("gravity_tilt", "torque", ""): (100.0, 50.0, 1), ("generic:position", "torque", ""): (wide, 0.0, sizes)})
    mine = case.choice("gravity_tilt")
    assert selection.misfit(case, mine, [mine]) == pytest.approx(share)
    case.usual = lambda channel, key: 0.6 * wide      # of which the healthy axis shows so much, too
    more = max(0.4 * wide - 2.0 * sizes, 0.0)
    assert selection.misfit(case, mine, [mine]) == pytest.approx(more / (100.0 + more))
    case.forms.pop()
    assert selection.misfit(case, mine, [mine]) == 0.0


@pytest.mark.parametrize(("own", "wide", "share"), [(75.0, 25.0, 0.25), (25.0, 75.0, 0.5), (-10.0, -0.5, 0.0), (-10.0, 40.0, 0.5), (0.6, 0.4, 0.4)])
def test_beside_another_cause_the_misfit_must_be_there_on_the_held_out_records(own, wide, share):
    """Of half in the learning records, no more than what the held-out ones show of it."""
    case = Written({("gravity_tilt", "torque", ""): (100.0, own, 1), ("generic:position", "torque", ""): (102.0, wide, 1),
                    ("amplifier_offset", "torque", ""): (1.0e4, 5.0e3, 1)})
    mine, other = case.choice("gravity_tilt"), case.choice("amplifier_offset")
    assert selection.misfit(case, mine, [other, mine]) == pytest.approx(share)


def accepting(monkeypatch, **refused):
    """Every rule of `acceptable` but those of its own lets a trial stand, or what ``refused`` says."""
    usual = {"_channels_agree": True, "is_level_of_a_profile": False, "in_baseline": False, "uneven_as_ever": False, "misfit": 0.0,
             "is_splinter": False, "agrees_with_itself": True, "is_wave_of_friction": False}
    for name, value in {**usual, **refused}.items():
        monkeypatch.setattr(selection, name, lambda *_, value=value: value)


@pytest.mark.parametrize("refused", [None, {"_channels_agree": False}, {"is_level_of_a_profile": True}, {"in_baseline": True},
                                     {"uneven_as_ever": True}, {"misfit": 0.5}, {"is_splinter": True}, {"agrees_with_itself": False},
                                     {"is_wave_of_friction": True}])
def test_every_rule_alone_refuses_a_trial(monkeypatch, refused):
    case = Written({("gravity_tilt", "torque", ""): (100.0, 50.0, 1)})
    case.held["windup"], case.learn["windup"] = (types.SimpleNamespace(rows=n, where={}) for n in (100, 0))     # nothing to learn from there
    accepting(monkeypatch, **(refused or {}))
    assert selection.acceptable(case, selection.best_forms(case, "gravity_tilt", []), []) is (refused is None)
    assert not selection.acceptable(case, None, [])


@pytest.mark.parametrize(("gain", "held", "signal", "stands"), [
    (23.0, 20.0, math.inf, False), (25.0, 20.0, math.inf, True),       # a chance of 10⁻⁶ of one size is 23.9 of χ²
    (40.0, 4.9, math.inf, False), (40.0, 5.1, math.inf, True),         # five of χ² at least
    (1000.0, 49.0, math.inf, False), (1000.0, 51.0, math.inf, True),   # a tenth of what half as many rows should show,
    (1000.0, 19.0, 200.0, False), (1000.0, 21.0, 200.0, True),         # or of what they can show where they go
])
def test_a_trial_must_be_significant_and_there_on_the_held_out_records(monkeypatch, gain, held, signal, stands):
    case = Written({("gravity_tilt", "torque", ""): (gain, held, 1)})
    case.signal = lambda choice, others: signal
    accepting(monkeypatch)
    assert selection.acceptable(case, selection.best_forms(case, "gravity_tilt", []), []) is stands


def test_the_strongest_trial_for_its_sizes_comes_first():
    """598 before 580, 98.5 before 98 and 80 of χ² beyond two for each size."""
    sizes = {"gravity_tilt": (100.0, 1), "encoder_sde": (104.5, 3), "cable_spring": (120.0, 20), "torque_ripple": (600.0, 1), "backlash": (620.0, 20), "scale_error": (3.0, 1)}
    case = Written({(effect, "torque", ""): (gain, 0.0, count) for effect, (gain, count) in sizes.items()})
    ranked = selection._Balance(case, [*sizes, "amplifier_gain"]).trials([])
    assert [trial.choice.effect for trial in ranked] == ["torque_ripple", "backlash", "encoder_sde", "gravity_tilt", "cable_spring", "scale_error"]
    assert "torque_ripple" not in {t.choice.effect for t in selection._Balance(case, list(sizes)).trials([case.choice("torque_ripple")])}


@pytest.mark.parametrize(("gain", "sizes", "own_sizes", "renamed"), [
    (111.9, 1, 1, False), (112.1, 1, 1, True),      # odds of 400 to one are 11.98 of χ²
    (119.9, 5, 1, False), (120.1, 5, 1, True),      # two more for every size more,
    (103.9, 1, 5, False), (104.1, 1, 5, True),      # or less
])
def test_another_name_must_be_better_by_odds_of_400_to_one(monkeypatch, gain, sizes, own_sizes, renamed):
    case = Written({("gravity_tilt", "torque", ""): (100.0, 50.0, own_sizes), ("backlash", "torque", ""): (gain, 50.0, sizes),
                    ("amplifier_gain", "windup", ""): (500.0, 250.0, 1)})
    monkeypatch.setattr(selection, "acceptable", lambda *_: True)
    both = [case.choice("gravity_tilt"), case.choice("amplifier_gain")]
    names = [c.effect for c in selection._renamed(case, both, ["gravity_tilt", "backlash", "amplifier_gain"])]
    assert names == ["backlash" if renamed else "gravity_tilt", "amplifier_gain"]


def test_of_two_better_names_the_best_that_stands_is_taken(monkeypatch):
    case = Written({("gravity_tilt", "torque", ""): (100.0, 50.0, 1), ("backlash", "torque", ""): (150.0, 50.0, 1), ("torque_ripple", "torque", ""): (200.0, 50.0, 1),
                    ("scale_error", "torque", ""): (215.0, 50.0, 10), ("amplifier_gain", "windup", ""): (500.0, 250.0, 1)})
    both = [case.choice("gravity_tilt"), case.choice("amplifier_gain")]
    for barred, name in (((), "torque_ripple"), (("torque_ripple",), "scale_error"), (("torque_ripple", "scale_error"), "backlash")):
        monkeypatch.setattr(selection, "acceptable", lambda evidences, trial, others, barred=barred: trial.choice.effect not in barred)
        assert selection._renamed(case, both, [form.effect for form in case.forms])[0].effect == name


@pytest.mark.parametrize(("level", "viscous", "acceptable", "answer"), [
    (0.01, 0.3, True, "friction_level_change"), (-0.3, 0.01, True, "viscous_change"), (0.3, 0.28, True, None), (0.01, 0.3, False, None)])
def test_friction_along_the_stroke_tells_a_level_from_a_viscosity_by_its_mean(monkeypatch, level, viscous, acceptable, answer):
    names = ("position_dependent_friction", "friction_level_change", "viscous_change")
    case = Written({(name, "torque", ""): (100.0, 50.0, 1) for name in names})
    mean = {"friction_level_change": level, "viscous_change": viscous}
    monkeypatch.setattr(selection, "profile_of", lambda evidences, profile, choices: (mean[choices[-1].effect], 0.1))
    monkeypatch.setattr(selection, "acceptable", lambda *_: acceptable)
    profile, mine, other = map(case.choice, names)
    found = selection.level_or_viscous(case, [profile, other])
    assert (found.effect if found else None) == answer
    assert selection.level_or_viscous(case, [mine]) is None and selection.level_or_viscous(case, [profile, mine, other]) is None
    case.forms = [form for form in case.forms if form.effect != names[1]]
    assert selection.level_or_viscous(case, [profile, other]) is None       # one of the two cannot be asked


@pytest.mark.parametrize(("alone", "kept"), [(490.0, 3), (510.0, 2)])
def test_a_payload_that_explains_enough_of_a_resonance_needs_no_soft_drive_beside_it(monkeypatch, alone, kept):
    """Half of 1000; what else is there, 5000 of χ², counts for nothing."""
    case = Written({("payload_change", "resonance", ""): (alone, 100.0, 1), ("drive_compliance", "resonance", ""): (1000.0 - alone, 100.0, 1),
                    ("gravity_tilt", "torque", ""): (5000.0, 100.0, 1)})
    three = [case.choice(form.effect) for form in case.forms]
    left = selection._one_resonance(case, three)
    assert len(left) == kept and {"payload_change", "gravity_tilt"} <= {c.effect for c in left}
    assert selection._one_resonance(case, three[1:]) == three[1:]


def test_a_blocked_name_is_in_nobodys_way(monkeypatch):
    """A tilt is not taken in the place of a stronger payload that does not stand; an encoder's error, elsewhere, is."""
    case = Written({("payload_change", "torque", ""): (1000.0, 0.0, 1), ("gravity_tilt", "torque", ""): (300.0, 0.0, 1),
                    ("encoder_sde", "position", ""): (200.0, 0.0, 1), ("scale_error", "windup", ""): (0.4, 0.0, 1)})
    monkeypatch.setattr(selection, "acceptable", lambda evidences, trial, choices: trial.choice.effect != "payload_change")
    monkeypatch.setattr(selection, "in_baseline", lambda *_: False)
    trials = [Trial(case.choice(e), case.gain([case.choice(e)]), 1) for e in ("payload_change", "gravity_tilt", "encoder_sde", "scale_error")]
    assert selection._first_acceptable(case, trials, []) is trials[2]
    assert selection._first_acceptable(case, [trials[0], trials[3]], []) is trials[3]


@pytest.mark.parametrize(("gain", "held", "kept"), [(100.0, 0.5, True), (100.0, -0.5, False), (20.0, 10.0, False)])
def test_a_cause_that_no_longer_stands_beside_the_others_is_pruned(gain, held, kept):
    case = Written({("gravity_tilt", "torque", ""): (gain, held, 1), ("amplifier_gain", "windup", ""): (500.0, 250.0, 1)})
    both = [case.choice("gravity_tilt"), case.choice("amplifier_gain")]
    assert selection.prune(case, both) == (both if kept else both[1:])


def test_where_every_channel_makes_the_held_out_records_worse_all_of_them_are_on_trial():
    """The rules that follow refuse it as a whole."""
    case = Written({("torque_ripple", "torque", ""): (300.0, -150.0, 3), ("torque_ripple", "windup", ""): (100.0, -5.0, 2)})
    assert len(selection.best_forms(case, "torque_ripple", []).choice.forms) == 2


def test_a_shape_that_is_not_worth_its_sizes_is_no_misfit_however_small_the_cause():
    case = Written({("gravity_tilt", "torque", ""): (0.5, 0.2, 1), ("generic:position", "torque", ""): (7.3, 0.0, 4)})
    mine = case.choice("gravity_tilt")
    assert selection.misfit(case, mine, [mine]) == 0.0


def selecting(monkeypatch, best=None):
    """`select` on trials that stand whenever they are asked, of six names that have nothing to do with each other."""
    names = ("gravity_tilt", "torque_ripple", "viscous_change", "scale_error", "amplifier_gain", "amplifier_offset")
    case = Written({(name, "torque", ""): (1.0e3 * (6 - n), 500.0, 1) for n, name in enumerate(names)})
    case.forms.append(Form("friction_level_change", "torque", "", None, one("size", "1")))
    case.parts["friction_level_change", "torque", ""] = (1.0, 0.0, 1)
    case.learn["torque"].where["friction_level_change", ""] = slice(7, 8)
    for name, value in (("acceptable", True), ("level_or_viscous", best), ("in_baseline", False)):
        monkeypatch.setattr(selection, name, lambda *_, value=value: value)
    monkeypatch.setattr(selection, "without_splinters", lambda _, choices: choices)
    return case, names


def test_as_many_causes_are_taken_as_stand(monkeypatch):
    case, names = selecting(monkeypatch)
    assert [c.effect for c in selection.select(case, names)[0]] == list(names)


def test_what_friction_along_the_stroke_decides_takes_the_place_of_the_other_name_alone(monkeypatch):
    level = Choice("friction_level_change", (Form("friction_level_change", "torque", "", None, one("size", "1")),))
    case, names = selecting(monkeypatch, level)
    found, lost = selection.select(case, names)
    assert [c.effect for c in found] == ["gravity_tilt", "torque_ripple", "friction_level_change", *names[3:]] and lost
