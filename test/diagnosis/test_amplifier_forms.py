"""Delay and lag as the settled current sees them, against the winding integrated in small steps."""

import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue.command import delay_form, delayed, lagged, weight_of_old, whole_delay_form

PERIOD, WINDING = 1.0e-4, 22.0e-6  # s
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
    channel = types.SimpleNamespace(command=command, winding=PERIOD / WINDING)
    sizes = np.array([1.0, weight_of_old(late - int(late), channel.winding)])
    one = delay_form(late, anyway=True).columns(channel, None)[:, 0]
    np.testing.assert_allclose(whole_delay_form(int(late)).columns(channel, None) @ sizes, one, atol=1e-12)
