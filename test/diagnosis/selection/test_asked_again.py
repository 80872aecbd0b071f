"""A name is asked again once the others are known; and what the baseline does not clearly show decides nothing."""

import math
import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue.form import Form, one
from microstage_ros.diagnosis.residuals.evidence import Evidence
from microstage_ros.diagnosis.residuals.evidence_set import Choice, Evidences
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
