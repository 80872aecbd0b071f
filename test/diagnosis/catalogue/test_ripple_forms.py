"""A ripple of the motor's torque shakes the stage: what the current, by which fast motion is known, does not hold."""

import types

import numpy as np
import pytest
from scipy.signal import lfilter

from microstage_ros.diagnosis.catalogue.drive import shaken_by_ripple, shaking_form, torque_ripple
from microstage_ros.diagnosis.preprocessing.motion import smooth_motion
from microstage_ros.diagnosis.preprocessing.preparation import TRAVEL_NOISE, stage_filter
from microstage_ros.diagnosis.residuals.resonance import Resonance

PERIOD, ROWS, CYCLES = 1.0e-4, 20_000, 16.0
SIZES = np.array([2.0e-5, -1.0e-5])         # N m of sine and cosine


@pytest.mark.parametrize("frequency", [150.0, 250.0, 320.0])
def test_the_columns_are_the_motion_that_travel_by_current_and_back_emf_misses(drive, frequency):
    """A motor that a ripple shakes about a steady speed, without any change of its current, behind the true two-mass filter."""
    time = PERIOD * np.arange(ROWS)
    speed = frequency * 2.0 * np.pi * drive.lever / CYCLES          # m/s of the stage: the ripple's frequency
    angle, omega = speed * time / drive.lever, 2.0 * np.pi * frequency
    torque = SIZES[0] * np.sin(CYCLES * angle) + SIZES[1] * np.cos(CYCLES * angle)
    shaken = speed * time - drive.lever / drive.inertia * torque / omega**2          # its steady state
    seen = smooth_motion(shaken, np.zeros(ROWS), drive, PERIOD, TRAVEL_NOISE).position
    channel = types.SimpleNamespace(drive=drive, block=1, prepared=types.SimpleNamespace(time=time, period=PERIOD, position=speed * time))
    channel.passed_on = lambda travel: Resonance.passed_on(channel, travel)
    missed = shaken_by_ripple((CYCLES,))(channel, types.SimpleNamespace(drive=drive)) @ SIZES
    truth = lfilter(*stage_filter(drive, PERIOD), shaken - seen)
    inner = slice(ROWS // 2, -2000)
    assert np.std(missed[inner]) > 1.0e-9           # m; an interferometer sees it
    assert np.std((missed - truth)[inner]) < 0.05 * np.std(missed[inner])


def test_the_torque_tells_the_sizes(drive):
    """The resonance states none, as near it they are the damping's."""
    form = shaking_form((2.0, CYCLES))
    assert (form.effect, form.channel, form.variant) == ("torque_ripple", "resonance", "2,16")
    assert form.sizes(np.ones(4), np.eye(4), None) == ({}, {})
    channel = types.SimpleNamespace(prepared=types.SimpleNamespace(position=np.array([0.0, 0.5 * np.pi * drive.lever])), mean=lambda v: v)
    assert torque_ripple((1.0,))(channel, types.SimpleNamespace(drive=drive)) == pytest.approx(-np.eye(2)[::-1], abs=1e-12)   # a balance lacks it
