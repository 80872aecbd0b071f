"""Hysteretic laws from prescribed motion: exact recovery, the measured damper, cross-amplitude prediction."""

import numpy as np
import pytest

from microstage_ros.identification.estimators.hysteresis import LADDER, fit_maxwell_slip
from microstage_ros.model.friction.positions import maxwell_slip_force
from microstage_ros.quantities.errors import InputError


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def motion(amplitude, n=4000):
    phase = np.linspace(0.0, 6.0 * np.pi, n)
    return amplitude * np.sin(phase), amplitude * np.cos(phase)


def test_blocks_of_a_maxwell_slip_law_predict_another_amplitude():
    stiffness, limits = np.array([4e5, 5e4, 1e4]), np.array([0.4, 0.3, 0.2])
    x, v = motion(4e-5)
    law = fit_maxwell_slip(x, v, maxwell_slip_force(x, stiffness, limits))
    other, speed = motion(1.5e-5)
    truth = maxwell_slip_force(other, stiffness, limits)
    assert rms(law.force(other, speed) - truth) < 0.03 * rms(truth)


def test_no_motion_is_refused():
    with pytest.raises(InputError, match="reverses"):
        fit_maxwell_slip(np.zeros(100), np.zeros(100), np.ones(100))


@pytest.mark.parametrize("law, limit", [("maxwell_slip", 1511.0), ("lost_motion", 1000.0)])
def test_damper_second_half(damper, law, limit):
    """At least as good as seven Maxwell-slip blocks (1511 N); Coulomb and viscous leave 6055 N."""
    x, v, force = damper["0.5"]
    half = len(x) // 2
    fitted = LADDER[law](x[:half], v[:half], force[:half])
    assert rms((fitted.force(x, v) - force)[half:]) < limit


@pytest.mark.parametrize("law, limit", [("maxwell_slip", 2157.0), ("lost_motion", 1400.0)])
def test_damper_cross_amplitude(damper, law, limit):
    """Fitted at 0.5 in, predicts 1.5 in (2157 N; Coulomb and viscous 10 567 N), and the other way round."""
    for fit_on, tell in (("0.5", "1.5"), ("1.5", "0.5")):
        fitted = LADDER[law](*damper[fit_on])
        x, v, force = damper[tell]
        assert rms(fitted.force(x, v) - force) < limit


def test_damper_coulomb_viscous_baseline(damper):
    x, v, force = damper["0.5"]
    half = len(x) // 2
    fitted = LADDER["coulomb_viscous"](x[:half], v[:half], force[:half])
    assert rms((fitted.force(x, v) - force)[half:]) == pytest.approx(6055.0, rel=0.01)
