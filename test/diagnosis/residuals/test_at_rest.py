"""What records of an axis that rests, or hardly moves, can tell: noise, and nothing of encoder, drive or friction."""

import dataclasses
import types

import numpy as np
import pytest

from microstage_ros.diagnosis.batch import diagnose_records
from microstage_ros.diagnosis.catalogue.measuring import encoder_sde, scale_error
from microstage_ros.diagnosis.preprocessing.preparation import prepare
from microstage_ros.diagnosis.prerequisites.encoder import seen_interpolation
from microstage_ros.diagnosis.prerequisites.periods import ALONG_STROKE, Way, periods, within_travel
from microstage_ros.diagnosis.residuals.evidence import free_of_nuisance
from microstage_ros.diagnosis.residuals.mechanical import FIRST_SPANS, Mechanical, remembered
from microstage_ros.diagnosis.residuals.position import Position, rounding_orders
from microstage_ros.diagnosis.residuals.resonance import Resonance
from test.diagnosis.cases.plain_programmes import records

SEED = 7300


@pytest.fixture(scope="module")
def at_rest(axis):
    """Records of 10 s at rest under the shipped law: two, one to judge on, a baseline."""
    return records(axis, "self_tuning_observer", "rest", {}, SEED)


@pytest.mark.parametrize("programme", ["rest", "tenths", "micrometres", "small sine"])
@pytest.mark.parametrize("law", ["self_tuning_observer", "pid"])
def test_a_healthy_axis_that_hardly_moves_agrees_without_a_baseline(axis, law, programme):
    """A soft drive, an error of the encoder and one of its scale were named, or the search for periods ended in an error."""
    learn, held, _ = records(axis, law, programme, {}, SEED)
    answer = diagnose_records(axis, learn, held, [], seed=0)
    assert not answer.causes and not answer.rivals


def test_noise_of_the_reading_is_no_error_of_the_encoder(drive, at_rest):
    """The place of a resting stage holds the reading's noise, which is in the residual, too: 1182 of χ² for a period of 0.6 µm."""
    channel = Position(prepare(at_rest[0][0], drive), drive)
    for columns in (encoder_sde(6e-7, 3)(channel, None), scale_error(channel, None)):
        white = free_of_nuisance(channel, np.column_stack([channel.residual, columns]))[0]
        size = np.linalg.lstsq(white[:, 1:], white[:, 0], rcond=None)[0]
        assert np.sum((white[:, 1:] @ size) ** 2) < 40.0


def test_where_the_motor_rests_its_noise_tells_nothing_of_the_drive(drive, at_rest):
    learn, _, _ = at_rest
    still = Resonance(prepare(learn[0], drive), drive)
    loud = Resonance(prepare(learn[0], drive), dataclasses.replace(drive, amplifier_noise=1e-6, converter_step=1e-6))
    assert np.mean(still.weight > 0.0) < 0.02 < 0.5 < np.mean(loud.weight > 0.0)


def test_a_first_state_is_forgotten_by_going_away_and_not_by_going_to_and_fro(axis, drive):
    fro, away = ((Mechanical(prepare(records(axis, "pid", name, {}, SEED)[0][0], drive), drive)) for name in ("tenths", "plain"))
    assert remembered(fro.span)[-1] == 1.0 and fro.nuisance().shape[1] <= len(FIRST_SPANS)
    assert remembered(away.span)[-1] < 1e-9 and np.flatnonzero(remembered(away.span) < 1e-3)[0] * 2e-3 < 6.0


def test_a_baseline_at_rest_is_left_out_and_said(axis, at_rest):
    """An encoder that shows no motion ended in a singular matrix."""
    _, _, still = at_rest
    learn, held, _ = records(axis, "self_tuning", "moves", {}, SEED)
    answer = diagnose_records(axis, learn, held, still, seed=0)
    assert answer.verdict == "agrees"
    assert any("Left out of the baseline" in note and "µm only" in note for note in answer.notes)


def test_interpolation_cannot_be_seen_without_motion(drive, at_rest):
    record = at_rest[0][0]
    exact = dataclasses.replace(record, columns={**record.columns, **dict.fromkeys(("encoder_m", "interferometer_m"), np.zeros(len(record)))})
    assert seen_interpolation(drive, [exact]) == drive == seen_interpolation(drive, [record])


def test_no_period_is_looked_for_in_less_than_three_of_the_shortest():
    generator = np.random.default_rng(0)
    assert periods([Way(generator.uniform(0.0, 2e-6, 1000), generator.normal(size=1000))], 0.8e-6, 4e-5) == []


@pytest.mark.parametrize("count, noise, orders", [(0.0, 1e-9, []), (25e-9, 8e-9, [1]), (25e-9, 25e-9, []), (50e-9, 3e-9, [1, 2, 3, 4])])
def test_orders_of_the_rounding_that_noise_leaves(count, noise, orders):
    assert rounding_orders(count, noise).tolist() == orders


@pytest.mark.parametrize("travel, shown", [(1e-6, 0), (9e-6, 5), (2e-5, 8), (5e-5, 9)])
def test_what_differs_along_the_stroke_needs_a_stroke(drive, travel, shown):
    """Of nine forms: four errors of the encoder by place, of periods up to 40 um, and five of friction, drive and forces."""
    stage = np.linspace(0.0, travel, 100)
    prepared = {group: [types.SimpleNamespace(stage_position=stage)] for group in ("learn", "held")}
    collection = types.SimpleNamespace(prepared=prepared, frame=types.SimpleNamespace(drive=drive))
    forms = [types.SimpleNamespace(effect=effect, channel="position", variant=variant) for effect, variant in (
        ("scale_error", ""), ("generic:position", ""), ("encoder_sde", "1e-06"), ("encoder_sde", "4e-05"))]
    forms += [types.SimpleNamespace(effect=effect, channel="torque", variant="") for effect in ALONG_STROKE]
    other = types.SimpleNamespace(effect="friction_level_change", channel="torque", variant="")
    assert within_travel([*forms, other], collection)[-1] is other
    assert len(within_travel(forms, collection)) == shown
