"""A gain above one gives no more than the amplifier's limit."""

import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue.electrical import LIMITED_GAIN, amplifier_gain, gain_within_the_limit

LIMIT = 6.0
TOLD = np.linspace(-LIMIT, LIMIT, 2001)
FRAME = types.SimpleNamespace(drive=types.SimpleNamespace(voltage_limit=LIMIT))


class Rows:
    """A record as the wind-up's forms see it, but for the integral."""

    prepared = types.SimpleNamespace(answered=TOLD)

    @staticmethod
    def integral(voltage):
        return voltage


@pytest.mark.parametrize("excess", [0.02, 0.094, 0.3])
def test_what_a_gain_adds_is_what_the_limit_leaves_of_it(excess):
    added = np.clip((1.0 + excess) * TOLD, -LIMIT, LIMIT) - TOLD
    form = LIMITED_GAIN.about(np.array([excess]))
    assert np.allclose(excess * form.columns(Rows, FRAME)[:, 0], added, atol=1e-12)
    assert added[-1] == 0.0 and np.abs(excess * amplifier_gain(Rows, FRAME)[:, 0] - added).max() == pytest.approx(excess * LIMIT)


def test_within_the_limit_both_forms_of_a_gain_are_one():
    small = types.SimpleNamespace(prepared=types.SimpleNamespace(answered=0.9 * TOLD), integral=lambda voltage: voltage)
    assert np.allclose(gain_within_the_limit()(small, FRAME), amplifier_gain(small, FRAME))


def test_it_is_a_gain_above_one():
    assert LIMITED_GAIN.accept(np.array([0.1])) and not LIMITED_GAIN.accept(np.array([-0.1]))
    assert LIMITED_GAIN.about(np.array([0.0])).variant == "within the limit, 0.001"
