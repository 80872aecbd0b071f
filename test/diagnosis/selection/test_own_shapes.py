"""What the healthy axis does itself is no cause, wherever the records go; made by hand, without a simulation."""

import math
import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue.drive import ripple_form, shaking_form
from microstage_ros.diagnosis.catalogue.form import Form, Frame
from microstage_ros.diagnosis.residuals.collection import Collection
from microstage_ros.diagnosis.residuals.evidence_set import STRETCH, Choice, Evidences, Trial
from microstage_ros.diagnosis.residuals.growing import Growing
from microstage_ros.diagnosis.residuals.healthy import profile_of, take_healthy, unevenness
from microstage_ros.diagnosis.selection import judge, selection, stroke_profile
from microstage_ros.diagnosis.selection.agreement import OF_NAMES, OF_ONE, agrees_with_itself, in_baseline, log_tail
from test.diagnosis.selection.test_agreement import CHOICE, EFFECT, OTHER, Channel, evidences, loud
from test.diagnosis.selection.test_healthy import FRAME, SPREADS, Balance

LONG = 5.0e-4                                       # m, of the wave
WAVE = lambda position, phase=0.0: np.sin(2.0 * np.pi * position / LONG + phase)


def test_a_baseline_freed_with_sizes_from_its_other_pieces_is_as_loud_as_any_record():
    """200 sizes from 3000 rows leave 0.93 of the noise where they were fitted, and 1.07 of it on any other record."""
    wide = Form("nonlinear_viscous", "torque", "", lambda channel, frame: channel.wide)
    pair = [Balance(11), Balance(12)]
    for number, one in enumerate(pair):
        one.wide = np.random.default_rng([13, number]).normal(size=(len(one.time), 200))
        one.residual, one.noise = one.residual + 0.15 * one.wide.sum(axis=1), one.residual.var()
    assert len(take_healthy(pair, pair[:1], [wide], FRAME, SPREADS)) == 1
    base, record = (one.residual.var() / one.noise for one in pair)
    assert record == pytest.approx(1.0 + 200 / 2800, abs=0.03) and base == pytest.approx(record, abs=0.06) and base > 1.03


def test_unevenness_is_the_profiles_standard_deviation():
    base = Balance(4, profile=lambda x: 0.05 * WAVE(x))
    taken = take_healthy([base], [base], [profile_of(FRAME, SPREADS)], FRAME, SPREADS)
    assert unevenness([base], taken, FRAME) == pytest.approx(0.05 / math.sqrt(2.0), rel=0.2)
    assert unevenness([base], [], FRAME) == 0.0


def test_a_size_that_the_healthy_model_took_from_the_baseline_is_still_the_baselines():
    """Taken out, the baseline shows none of it; another programme shows some of it again."""
    case = evidences(lambda k: 0.3, base=lambda k: 0.0)
    assert selection.acceptable(case, selection.best_forms(case, "gravity_tilt", []), [])
    for size, there in ((0.25, True), (0.05, False)):
        case.raw = {"torque": Growing([Channel(5, lambda k, size=size: size)], [EFFECT, OTHER], None)}
        assert in_baseline(case, CHOICE, []) == there
        assert (not selection.acceptable(case, selection.best_forms(case, "gravity_tilt", []), [])) == there
        assert case.usual("torque", EFFECT.key) == pytest.approx(2.0 * case.raw["torque"].fit([EFFECT.key])[2])
    assert not in_baseline(evidences(lambda k: 0.3, base=lambda k: 0.0), CHOICE, [])


def test_what_all_records_show_must_exceed_the_baseline_by_as_much_as_one_of_all_names_may():
    """On a machine of another law every record shows it; that one of them shows less is nothing rare."""
    rough = lambda size: lambda k: size + (1.1 if k % 2 else -1.1)
    between = 0
    for size in np.arange(0.0, 0.3, 0.03):
        case = evidences(rough(0.45), base=rough(0.45 - size))
        held, base = (case.agreement(CHOICE, [], group) for group in ("held", "base"))
        beyond = log_tail((held[0] - base[0], math.hypot(held[1], base[1]), held[2] + base[2]))
        learned = case.agreement(CHOICE, [], "learn")
        w = learned[1] ** -2, held[1] ** -2
        all_records = (w[0] * learned[0] + w[1] * held[0]) / sum(w)
        tail = log_tail((all_records - base[0], math.hypot(sum(w) ** -0.5, base[1]), learned[2] + held[2] + base[2]))
        alone = log_tail((held[0] - base[0], math.hypot(held[1], base[1]), held[2]))
        certain = log_tail(learned) <= OF_NAMES or (log_tail(learned) < OF_ONE and alone < OF_NAMES)
        expected = certain and beyond < OF_ONE and tail < OF_NAMES
        assert agrees_with_itself(case, CHOICE, []) == expected
        between += beyond < OF_ONE and tail >= OF_NAMES
    assert agrees_with_itself(evidences(rough(0.45), base=rough(0.0)), CHOICE, [])
    assert between or not agrees_with_itself(evidences(rough(0.45), base=rough(0.42)), CHOICE, [])


def test_what_the_held_out_records_tell_alone_is_certain_too():
    """One stretch of the learning records outweighs all others there; the held-out ones, which did not choose the size,
    agree with it in every stretch."""
    uneven = lambda k: 0.3 if k % 8 else 2.0
    for held, certain in ((lambda k: 0.5, True), (lambda k: 0.05, False)):
        case = evidences(uneven, held=held, base=lambda k: 0.0)
        for number, record in enumerate(row._channel for row in case._in_rows(None)._records):
            record.signal *= np.where((record.time / STRETCH).astype(int) == 3, 12.0, 1.0)
            noise = np.random.default_rng([9, number]).normal(size=len(record.time))
            record.residual = 0.5 * record.signal * np.where((record.time / STRETCH).astype(int) == 3, 0.7, 1.6) + 4.0 * noise
        made = Growing([row._channel for row in case._in_rows(None)._records], [EFFECT, OTHER], None)
        case.learn, case._in_rows = {"torque": made}, lambda channel: made
        assert log_tail(case.agreement(CHOICE, [], "learn")) > OF_NAMES
        assert agrees_with_itself(case, CHOICE, []) == certain


@pytest.mark.parametrize(("learned", "freedom", "certain"), [(3.0, 20.0, True), (1.9, 20.0, False), (3.0, 2.9, False)])
def test_few_stretches_of_the_held_out_records_are_not_certain_alone(learned, freedom, certain):
    """Six standard errors, but in as many stretches as on a healthy axis that was called a cable (2.9 degrees of freedom)."""
    sizes = {"learn": (learned, 1.0, 30.0), "held": (6.2, 1.0, freedom), "base": (0.0, 0.3, 30.0)}
    case = types.SimpleNamespace(agreement=lambda choice, others, group: sizes[group], signal=lambda *_: 100.0)
    assert log_tail(sizes["learn"]) > OF_NAMES and agrees_with_itself(case, CHOICE, []) == certain


class Stroke:
    """Friction of unit size times 1 + height·wave on a part of the stroke, in unit noise; `Mechanical`'s face."""

    def __init__(self, seed, height, phase=0.0, first=0.0):
        self.time = 0.01 * np.arange(3000)
        self.position = first + 1.0e-3 * (0.5 + 0.5 * np.sin(2.0 * np.pi * self.time / 7.0))
        self.friction = np.ones(3000)
        self.residual = height * WAVE(self.position, phase) + np.random.default_rng(seed).normal(size=3000)

    def whiten(self, matrix):
        return matrix, 0.0


def waved(base, phase=0.0, effect="position_dependent_friction"):
    """`Evidences` of a wave of an effect in the records, and of height ``base`` in the baseline."""
    def columns(channel, frame):
        angle = 2.0 * np.pi * channel.position / LONG
        return channel.friction[:, None] * np.stack([np.sin(angle), np.cos(angle)], axis=1)

    form = Form(effect, "torque", "wave 0.0005", columns)
    case = evidences(lambda k: 0.3, base=lambda k: 0.0)
    made = {group: Growing([Stroke([seed, n], height, turned) for n in range(count)], [form], Frame(None, 0.0, 1.0e-3, 30.0))
            for seed, (group, height, turned, count) in enumerate([("learn", 0.6, 0.0, 2), ("held", 0.6, 0.0, 1), ("base", base, phase, 1)])}
    case.learn, case.held, case.base = ({"torque": made[group]} for group in ("learn", "held", "base"))
    case._in_rows, case.forms = lambda channel: made["learn"], [form]
    return case, Choice(effect, (form,))


@pytest.mark.parametrize("effect", ["position_dependent_friction", "encoder_sde"])
@pytest.mark.parametrize("base, phase, there", [(0.0, 0.0, False), (0.6, 0.0, True), (0.6, 1.6, True), (0.6, np.pi, True), (0.1, 0.5, False)])
def test_a_wave_that_the_baseline_has_at_another_phase_is_the_axiss_own(effect, base, phase, there):
    case, choice = waved(base, phase, effect)
    assert in_baseline(case, choice, []) == there


def test_an_error_of_the_encoder_that_was_taken_out_of_the_baseline_hides_none_of_another_phase():
    case, choice = waved(0.0, effect="encoder_sde")
    case.raw = {"torque": waved(0.6, 1.6, "encoder_sde")[0].base["torque"]}
    assert not in_baseline(case, choice, [])


def test_friction_along_the_stroke_must_vary_more_than_the_healthy_axiss():
    case, choice = waved(0.0)
    spread = 0.6 / math.sqrt(2.0)
    for own, stands in ((0.0, True), (0.9 * spread / math.sqrt(5.0), True), (1.15 * spread / math.sqrt(5.0), False)):
        case.own_profile = own
        assert stroke_profile.uneven_as_ever(case, choice, []) != stands
        assert selection.acceptable(case, selection.best_forms(case, choice.effect, []), []) == stands
    assert not stroke_profile.uneven_as_ever(case, CHOICE, [])       # asked of no other effect


def test_a_wave_of_the_baseline_is_not_the_form_of_a_change():
    """Two waves of one size: the one that the baseline has as well does not compete. It gained more than the profile that
    was there, and was then dropped as the baseline's own (pairs, seed 9901, case 93)."""
    case, choice = waved(0.6)
    assert selection.best_forms(case, choice.effect, []) is None
    case.base["torque"] = waved(0.0)[0].base["torque"]
    assert selection.best_forms(case, choice.effect, []).gain > 300.0


def test_up_to_the_models_own_noise_nothing_stands_out():
    """A baseline at two fifths of the noise that the model predicts, as its rests lay in the middle of a count."""
    case = loud(lambda k: 1.3)
    quiet = Channel([4, 9], lambda k: 0.0)
    quiet.residual = 0.6 * quiet.residual
    case.base = {"torque": Growing([quiet], [EFFECT, OTHER], None)}
    assert judge.stands_out(case, []) == ["torque"]
    case.learn, case.held, case._in_rows = *(({"torque": made}) for made in [loud(lambda k: 0.95).learn["torque"]] * 2), None
    assert case.learn["torque"].energy() / case.learn["torque"].rows > judge.SCATTER * judge.usual_size(case, "torque")
    assert judge.stands_out(case, []) == []


def test_what_no_longer_agrees_with_itself_when_refined_goes():
    steady = evidences(lambda k: 0.3, base=lambda k: 0.0)
    assert judge.that_agree(steady, [CHOICE]) == [CHOICE]
    shown = evidences(lambda k: 0.3, base=lambda k: 0.29)
    assert judge.that_agree(shown, [CHOICE]) == []


def test_the_baseline_before_is_kept_apart():
    """`Collection.growing` of the group ``raw`` reads the balances before anything was taken out."""
    one = object.__new__(Collection)
    before, after = Channel(5, lambda k: 0.3), Channel(5, lambda k: 0.0)
    one.raw, one.channels, one.frame, one.spreads = [before], {"base": [{"position": after}]}, None, None
    one._noise = lambda channel: {}
    energies = [one.growing("position", [EFFECT], group).energy() for group in ("raw", "base")]
    assert energies[0] > 1.05 * energies[1]


class Swing:
    """Torque balance of a stage that swings 25 µm on a soft drive at 57 Hz, its motor ahead or behind, while it goes out
    and back; ``torque(channel)`` [N m] is in it beside noise."""

    def __init__(self, seed, torque):
        self.time = 2.0e-3 * np.arange(15_000)
        slow, angle = 1.0e-3 * np.abs((self.time + seed) % 2.0 - 1.0), 2.0 * np.pi * 57.0 * self.time
        self.position, self.place = slow + 8.0e-6 * np.cos(angle), slow - 25.0e-6 * np.sin(angle)
        self.friction = 1.3e-4 * np.sign(np.gradient(self.position))
        self.own, self.kept = np.zeros(len(self.time)), {"by limits": self.friction}
        self.prepared, self.mean = types.SimpleNamespace(position=self.position, time=self.time), lambda values: values
        self.residual = (torque(self) + 2.0e-6 * np.random.default_rng(seed).normal(size=len(self.time))) / 2.0e-6

    def whiten(self, matrix):
        return np.concatenate([matrix[:, :1], matrix[:, 1:] / 2.0e-6], axis=1), 0.0


def test_friction_that_waves_along_the_stroke_of_a_swinging_stage_is_no_ripple_of_the_motor():
    """Waves of 3 % of the friction, of one turn, gave a soft drive a ripple (single effects, seed 19011, cases 15 and 51)."""
    lever, n = 105.0e-6 / (2.0 * np.pi), 1.0
    waves = lambda c: 0.03 * c.friction * np.sin(n * c.place / lever)
    ripple = lambda c: 6.0e-6 * np.sin(n * c.position / lever + 0.4)
    form, frame = ripple_form((n,)), types.SimpleNamespace(drive=types.SimpleNamespace(lever=lever))
    choice = Choice("torque_ripple", (form,))
    for torque, is_wave in ((waves, True), (ripple, False), (lambda c: waves(c) + ripple(c), False)):
        learn, held = (Growing([Swing(seed, torque)], [form], frame) for seed in (1, 2))
        case = Evidences({"torque": learn}, {"torque": held}, {}, [form], {"torque": 1.0}, frame, lambda _, learn=learn: learn)
        assert case.gain([choice]) > 100.0 and case.held_gain([choice]) > 50.0       # it would be named
        assert stroke_profile.is_wave_of_friction(case, choice, []) is is_wave
    assert not stroke_profile.is_wave_of_friction(case, CHOICE, [])      # asked of no other effect
    learn, both = Growing([Swing(1, waves)], [form], frame), Choice("torque_ripple", (shaking_form((n,)), form))
    case = Evidences({"torque": learn}, {}, {}, [form], {"torque": 1.0}, frame, lambda _: learn)
    assert stroke_profile.is_wave_of_friction(case, both, [])            # the torque tells, whatever the ripple shakes
    case._in_rows, case._learn_rows = None, {}
    assert not stroke_profile.is_wave_of_friction(case, choice, [])      # nor where the rows were not kept


@pytest.mark.parametrize("wave", [False, True])
def test_a_ripple_that_is_a_wave_of_friction_stands_in_nobodys_way(monkeypatch, wave):
    trials = [Trial(Choice(effect, (Form(effect, "torque", "", None),)), gain, 1) for effect, gain in (("torque_ripple", 900.0), ("gravity_tilt", 300.0))]
    monkeypatch.setattr(selection, "acceptable", lambda evidences, one, choices: one is trials[1])
    monkeypatch.setattr(selection, "in_baseline", lambda *_: False)
    monkeypatch.setattr(selection, "is_wave_of_friction", lambda evidences, choice, choices: wave and choice.effect == "torque_ripple")
    case = types.SimpleNamespace(channel_gain=lambda channel, choices: 900.0 * len(choices))
    assert selection._first_acceptable(case, trials, []) is (trials[1] if wave else None)
