"""The rules on sizes and their scatter between stretches, on sizes that are written down: value, error, degrees of freedom."""

import math
import types

import pytest
from scipy.stats import norm
from scipy.stats import t as student

from microstage_ros.diagnosis.catalogue.form import Form
from microstage_ros.diagnosis.residuals.evidence_set import Choice
from microstage_ros.diagnosis.selection import agreement

CHOICE = Choice("gravity_tilt", (Form("gravity_tilt", "torque", "", None),))
MANY = 1e9      # degrees of freedom: a normal distribution


def case(learn=None, held=None, base=None, signal=0.0):
    """Evidences that tell these sizes of any effect."""
    sizes = {"learn": learn, "held": held, "base": base}
    return types.SimpleNamespace(agreement=lambda choice, others, group: sizes[group], signal=lambda *_: signal)


def test_two_sizes_are_pooled_by_their_precision():
    """1 ± 0.1 and 2 ± 0.2: weights 100 and 25."""
    assert agreement._pooled((1.0, 0.1, 10.0), (2.0, 0.2, 7.0)) == pytest.approx((1.2, 125.0**-0.5, 17.0))


@pytest.mark.parametrize(("one", "other"), [((1.0, 0.0, 5.0), (2.0, 0.1, 7.0)), ((1.0, 0.1, 5.0), (2.0, 0.0, 7.0))])
def test_a_size_without_an_error_is_pooled_with_none(one, other):
    assert agreement._pooled(one, other) == one


def test_what_is_beyond_the_baseline_has_both_errors():
    assert agreement.beyond((1.0, 0.3, 20.0), (0.25, 0.4, 6.0)) == pytest.approx((0.75, 0.5, 26.0))
    assert agreement.size_beyond_baseline(case((1.0, 0.1, 10.0), (2.0, 0.2, 7.0), (0.2, 0.3, 4.0)), CHOICE, []) == pytest.approx(
        (1.0, math.hypot(125.0**-0.5, 0.3), 21.0))
    assert agreement.size_beyond_baseline(case(held=(1.0, 0.1, 10.0)), CHOICE, []) is None


@pytest.mark.parametrize("base", [None, (math.nan, math.inf, 0.0)])
def test_a_baseline_that_does_not_tell_a_size_takes_nothing_from_it(base):
    assert agreement._of_baseline(case(base=base), CHOICE, []) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("learn", "held", "unsteady"), [
    ((1.0, 0.02, 30.0), (0.8, 0.04, 20.0), 0.05), ((0.5, 0.05, 30.0), (1.0, 0.04, 20.0), 0.1),
    ((0.0, 0.02, 30.0), (0.8, 0.04, 20.0), math.inf), ((1.0, 0.02, 30.0), (-0.5, 0.04, 20.0), math.inf),
    (None, (0.8, 0.04, 20.0), math.inf), ((1.0, 0.02, 30.0), None, math.inf),
])
def test_unsteadiness_is_the_larger_relative_error_of_both_groups(learn, held, unsteady):
    assert agreement.unsteadiness(case(learn, held), CHOICE, []) == pytest.approx(unsteady)


@pytest.mark.parametrize(("held", "two"), [
    ((0.49, 0.01, 20.0), True), ((0.51, 0.01, 20.0), False), ((1.49, 0.01, 20.0), False), ((1.51, 0.01, 20.0), True),   # half of it
    ((0.1, 0.28, 20.0), True), ((0.1, 0.30, 20.0), False),      # three errors of 0.1 and these
    (None, False),
])
def test_two_sizes_differ_by_more_than_half_and_three_errors(held, two):
    assert agreement.has_two_sizes(case((1.0, 0.1, 30.0), held), CHOICE, []) == two


def test_a_negative_size_has_a_half_too():
    assert not agreement.has_two_sizes(case((2.0, 0.01, 30.0), (1.1, 0.01, 20.0)), CHOICE, [])
    assert agreement.has_two_sizes(case((2.0, 0.01, 30.0), (0.9, 0.01, 20.0)), CHOICE, [])
    assert agreement.has_two_sizes(case((-1.0, 0.01, 30.0), (-0.4, 0.01, 20.0)), CHOICE, [])
    assert not agreement.has_two_sizes(case((-1.0, 0.01, 30.0), (-0.6, 0.01, 20.0)), CHOICE, [])


@pytest.mark.parametrize(("held", "shown"), [((4.4, 1.0, MANY), True), ((3.0, 1.0, MANY), False), (None, False)])
def test_the_held_out_records_show_a_size_with_the_certainty_of_all_names(held, shown):
    assert norm.logsf(3.0) > agreement.OF_NAMES > norm.logsf(4.4)
    assert agreement.held_out_records_show(case(held=held), CHOICE, []) == shown


def test_levels_are_one_in_a_hundred_of_one_name_and_of_all_and_one_of_two_names_in_twenty():
    assert math.exp(agreement.OF_ONE) == pytest.approx(0.01)
    assert math.exp(agreement.OF_NAMES) * len(agreement.REGISTRY) == pytest.approx(0.01)
    assert 1.0 / (1.0 + math.exp(agreement.LEADING_ODDS)) == pytest.approx(0.05)


@pytest.mark.parametrize(("learn", "held", "base", "signal", "agrees"), [
    ((1.0, 0.2, MANY), (1.0, 0.3, MANY), None, 0.0, True),
    ((1.0, 0.35, MANY), (1.0, 0.3, MANY), None, 0.0, False),     # 2.9 errors are not the 3.5 of all names
    ((1.0, 0.2, MANY), (1.0, 0.45, MANY), None, 0.0, False),     # 2.2 are not the 2.3 of one
    ((1.0, 0.35, MANY), (1.0, 0.2, MANY), None, 0.0, True),      # the held-out records have them alone
    ((1.0, 0.45, MANY), (1.0, 0.2, MANY), None, 0.0, False),     # but the learning records not even those of one
    ((1.0, 0.2, MANY), (1.0, 0.2, MANY), (0.5, 0.1, MANY), 40.0, False),    # 2.2 beyond the baseline by the held-out ones
    ((1.0, 0.2, MANY), (1.0, 0.2, MANY), (0.4, 0.1, MANY), 60.0, True),     # 3.46 by both together
    ((1.0, 0.2, MANY), (1.0, 0.2, MANY), (0.45, 0.1, MANY), 60.0, False),   # 3.2 are not the 3.44 of all names
    ((1.0, 0.2, MANY), (1.0, 0.2, MANY), (0.45, 0.1, MANY), 40.0, True),    # but enough for one, the noise as modelled: 0.2² 40 < 2
])
def test_an_effect_agrees_with_itself_beyond_its_scatter_and_the_baseline(learn, held, base, signal, agrees):
    assert agreement.agrees_with_itself(case(learn, held, base, signal), CHOICE, []) == agrees


def test_what_was_not_kept_is_not_asked():
    assert agreement.agrees_with_itself(case(), CHOICE, [])
    assert agreement.shortfall(case(), CHOICE, []) == 0.0


@pytest.mark.parametrize(("learn", "base"), [((1.0, 0.2, 12.0), None), ((1.0, 0.2, 12.0), (0.4, 0.1, 9.0)), ((1.0, 0.2, 12.0), (-0.4, 0.1, 9.0))])
def test_a_shortfall_is_the_square_of_the_size_that_is_just_certain_over_the_one_found(learn, base):
    alone = student.isf(math.exp(agreement.OF_NAMES), learn[2]) * learn[1] / learn[0]
    more = 0.0
    if base is not None:
        size, error, freedom = learn[0] - base[0], math.hypot(learn[1], base[1]), learn[2] + base[2]
        more = student.isf(math.exp(agreement.OF_NAMES), freedom) * error / size
    assert agreement.shortfall(case(learn, base=base), CHOICE, []) == pytest.approx(max(alone, more) ** 2)


def test_a_size_of_nothing_or_less_falls_short_by_far_and_not_without_end():
    assert 1e6 < agreement._shortfall((-0.5, 1.0, MANY)) < 2e7


@pytest.mark.parametrize(("amplitude", "raw", "there"), [
    ((0.6, 0.4), None, True), ((0.6, 0.6), None, False), ((0.45, 0.1), None, True), ((0.45, 0.3), None, False),
    ((0.25, 0.01), None, False), ((0.31, 0.01), None, True),
    ((0.0, 0.1), (0.6, 0.4), True), ((0.0, 0.1), (0.6, 0.6), False), ((0.0, 0.1), (0.45, 0.1), False),
])
def test_the_baseline_shows_an_effect_at_half_its_size_or_clearly_at_three_tenths(amplitude, raw, there):
    found = types.SimpleNamespace(raw={} if raw is None else {"torque": None},
                                  amplitude_in_base=lambda choice, others, raw_=None, **given: raw if given.get("raw") else amplitude)
    assert agreement.in_baseline(found, CHOICE, []) == there


@pytest.mark.parametrize(("effect", "variant", "usual", "wave"), [
    ("position_dependent_friction", "wave 3", 0.26, True), ("position_dependent_friction", "wave 3", 0.24, False),
    ("encoder_sde", "", 0.26, True), ("encoder_sde", "", 0.24, False),
    ("position_dependent_friction", "grid", 0.9, False), ("torque_ripple", "wave", 0.9, False),
])
def test_a_wave_of_half_the_height_at_any_phase_is_the_baselines(effect, variant, usual, wave):
    asked = {}
    def usual_size(channel, key, raw):
        asked["raw"] = raw
        return usual
    found = types.SimpleNamespace(usual=usual_size, more=lambda channel, keys, key: 1.0)
    assert agreement.is_wave_of_baseline(found, Form(effect, "torque", variant, None), []) == wave
    assert asked.get("raw") in (None, effect == "position_dependent_friction")      # what the healthy model took counts for friction


@pytest.mark.parametrize(("size", "clear"), [
    ((1.0, 0.6, 5.0), (0.64, 0.48, 5.0)), ((-1.0, 0.6, 5.0), (-0.64, 0.48, 5.0)), ((0.5, 0.6, 5.0), (0.0, 0.0, 5.0)), ((0.0, 0.6, 5.0), (0.0, 0.0, 5.0)),
])
def test_the_clear_part_of_a_size(size, clear):
    """James and Stein's positive part."""
    assert agreement.clear_part(size) == pytest.approx(clear)


def test_odds_of_two_names_by_how_far_a_factor_is_from_one_and_from_nothing():
    """A factor ½ + lead of one is the first name, of nothing the second; the error is at least the way to the first."""
    assert agreement.log_odds((0.0, 0.2, MANY)) == pytest.approx(0.0)
    assert agreement.log_odds((0.3, 0.2, MANY)) == pytest.approx(norm.logpdf(1.0) - norm.logpdf(4.0), rel=1e-6)
    assert agreement.log_odds((-0.3, 0.2, MANY)) == pytest.approx(norm.logpdf(1.0) - norm.logpdf(0.25), rel=1e-6)
    assert agreement.log_odds((0.3, 0.2, 12.0)) == pytest.approx(student.logpdf(1.0, 12.0) - student.logpdf(4.0, 12.0))
    assert agreement.log_odds((0.5, 0.25, MANY)) == pytest.approx(norm.logpdf(0.0) - norm.logpdf(4.0), rel=1e-6)
    assert agreement.log_odds((0.5, 0.0, MANY)) == math.inf
    assert agreement.log_odds((2.5, 0.25, MANY)) == pytest.approx(norm.logpdf(1.0) - norm.logpdf(1.5), rel=1e-6)   # no name is right: an error of 2


@pytest.mark.parametrize(("lead", "base", "first"), [
    ((0.5, 0.1, MANY), (0.0, 0.0, 0.0), True), ((0.5, 0.5, MANY), (0.0, 0.0, 0.0), False), ((-0.5, 0.1, MANY), (0.0, 0.0, 0.0), False),
    ((0.9, 0.1, MANY), (0.0, 0.0, 0.0), True),      # certain
    ((0.9, 0.1, MANY), (-0.8, 0.0, MANY), False),   # the healthy axis shows as much of the difference, of whichever sign
])
def test_a_lead_is_certain_or_nineteen_times_as_likely(lead, base, first):
    assert agreement.leads(lead, base) == first


@pytest.mark.parametrize(("lead", "base", "first"), [
    ((0.5, 0.1, MANY), (0.0, 0.0, 0.0), True), ((0.5, 0.2, MANY), (0.0, 0.0, 0.0), False), (None, (0.0, 0.0, 0.0), False),
    ((0.81, 0.1, MANY), (0.0, 0.0, 0.0), False),        # more than three errors from one half
    ((0.79, 0.1, MANY), (0.0, 0.0, 0.0), True), ((0.5, 0.1, MANY), (0.4, 0.01, MANY), False), ((0.5, 0.1, MANY), (0.04, 0.05, MANY), True),
])
def test_the_first_of_two_names_leaves_nothing_of_the_difference(lead, base, first):
    found = types.SimpleNamespace(lead=lambda *_: lead, lead_of_baseline=lambda *_: base)
    assert agreement.is_the_first(found, CHOICE, CHOICE, []) == first
