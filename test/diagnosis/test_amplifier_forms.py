"""Delay and lag as the settled current sees them, against the winding integrated in small steps."""

import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue.command import FORMS, delay_form, delayed, lagged, weight_of_old, whole_delay_form
from microstage_ros.diagnosis.prerequisites.amplifier import _corrected, _refine, _usual, _within_a_period
from microstage_ros.diagnosis.residuals.evidence import Evidence

PERIOD, WINDING = 1.0e-4, 22.0e-6  # s


def of_known_speed(**given):
    """A channel whose motor's speed takes nothing of the voltage."""
    return types.SimpleNamespace(beside_speed=lambda voltage: voltage[:, None], **given)


STEPS = 2000


def settled_current(command, follow):
    """R i, without the winding's memory, at the end of each period; ``follow(n, k)`` gives the voltage's target and rate."""
    a = np.exp(-PERIOD / WINDING)
    h = PERIOD / STEPS
    voltage = current = command[0]
    out = []
    for n in range(len(command)):
        first = current
        for k in range(STEPS):
            voltage = follow(n, k, voltage, h)
            current += (voltage - current) * (1.0 - np.exp(-h / WINDING))
        out.append((current - a * first) / (1.0 - a))
    return np.array(out)


@pytest.fixture
def command():
    return np.cumsum(np.random.default_rng(0).standard_normal(25))


def test_lag(command):
    time = 3.0e-4
    keep = np.exp(-PERIOD / STEPS / time)
    truth = settled_current(command, lambda n, k, v, h: command[n] + (v - command[n]) * keep)
    np.testing.assert_allclose(lagged(command, time, PERIOD, PERIOD / WINDING), truth, atol=2e-3)


@pytest.mark.parametrize("late", [0.4, 1.0, 1.7])
def test_delay(command, late):
    def follow(n, k, v, h):
        return command[max(int(np.floor(n + (k + 0.5) / STEPS - late)), 0)]

    truth = settled_current(command, follow)
    np.testing.assert_allclose(delayed(command, late, PERIOD / WINDING)[3:], truth[3:], atol=2e-3)


@pytest.mark.parametrize("late", [0.3, 1.0, 2.0 + 1e-9, 4.96])
def test_one_pair_of_columns_serves_every_delay_within_a_period(command, late):
    channel = of_known_speed(command=command, winding=PERIOD / WINDING)
    sizes = np.array([1.0, weight_of_old(late - int(late), channel.winding)])
    one = delay_form(late, anyway=True).columns(channel, None)[:, 0]
    np.testing.assert_allclose(whole_delay_form(int(late)).columns(channel, None) @ sizes, one, atol=1e-12)


@pytest.mark.parametrize("late", [0.35, 0.775, 0.97])
def test_a_delay_within_a_period_is_tried_at_its_own_time(late):
    """Of a delay of 78 µs the grid's sizes were 15.6, 3.8 and 0.36, none of them right, and it was called a lag (singles at half size,
    seed 10312, case 38)."""
    walk = np.cumsum(np.random.default_rng(1).standard_normal(500))
    channel = of_known_speed(command=walk, winding=PERIOD / WINDING, prepared=types.SimpleNamespace(period=PERIOD))
    residual = delayed(walk, late, channel.winding) - walk

    def alone(form):
        rows = np.column_stack([residual, form.columns(channel, None)])
        return Evidence(rows.T @ rows, {form.key: slice(1, rows.shape[1])}, len(rows))

    learn = types.SimpleNamespace(alone=alone)
    accepted = [form for form in FORMS if form.effect == "transport_delay"
                and form.accept(alone(form).fit([form.key])[0])]
    (form,) = _within_a_period(learn, channel.winding)
    beta, _, gain = alone(form).fit([form.key])
    assert not accepted or late != 0.775
    assert form.accept(beta) and abs(float(form.variant) - late) < 1.0e-3
    _, effect, time, _ = _refine(learn, (gain, form, float(beta[0])), PERIOD, WINDING)
    assert effect == "transport_delay" and abs(time - late * PERIOD) < 2.0e-3 * PERIOD
    residual = walk - delayed(walk, late, channel.winding)     # what comes early is not late
    assert _within_a_period(learn, channel.winding) == []


@pytest.mark.parametrize("late", [1.64, 2.2, 3.07, 4.48])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_a_delay_is_known_as_well_as_the_weight_of_the_command_before(late, share):
    """The feigned part of the weight is in the delay by none of it, by half or by all; where it is half the delay is right."""
    feigned, winding = -0.025, PERIOD / WINDING
    weight = late // 1 + weight_of_old(late % 1, winding) + share * feigned
    seen = weight // 1 + 1.0 + np.log(np.exp(-winding) + weight % 1 * (1.0 - np.exp(-winding))) / winding
    found, error = _corrected(seen, winding, feigned)
    assert abs(found - late) < (1.0e-9 if share == 0.5 else 2.0 * error)
    assert _corrected(late, winding, 0.0)[0] == pytest.approx(late) and _corrected(late, winding, 0.0)[1] < error


def test_what_is_not_explained_is_no_noise():
    """A record of twice the baseline's noise leaves a quarter of its rows to it."""
    noises = {"held": (2e-3, 1e-3), "base": (1e-3,)}
    channels = {name: [{"command": types.SimpleNamespace(noise=noise, residual=np.zeros(1000))} for noise in some] for name, some in noises.items()}
    assert _usual(types.SimpleNamespace(channels=channels)) == pytest.approx(1250.0)
    assert _usual(types.SimpleNamespace(channels={**channels, "base": []})) == pytest.approx(2000.0)
