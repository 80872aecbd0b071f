"""Forms of the friction: an asymmetry that is one to the last, and no friction that would drive."""

import dataclasses
import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue import forms_of
from microstage_ros.diagnosis.catalogue.friction import COARSE
from microstage_ros.diagnosis.prerequisites.drive import drive_of
from microstage_ros.diagnosis.prerequisites.law import LAWS, contact_of
from microstage_ros.diagnosis.preprocessing.friction_replay import replay
from microstage_ros.diagnosis.residuals.mechanical import Mechanical

FRICTIONS = ("viscous_change", "friction_level_change", "position_dependent_friction")


class Replayed:
    """A channel of some reversals of a contact of Leuven's law; `Mechanical`'s face, without its smoothing."""

    coarse_friction = Mechanical.coarse_friction

    def __init__(self, axis):
        drive = drive_of(axis)
        law = next(one for one in LAWS if one.name == "leuven")
        self.drive, self._coarse = dataclasses.replace(drive, actuator=contact_of(law, drive.actuator, 8.0)), {}
        time = 1.0e-4 * np.arange(40000)
        speed = 3.0e-5 * np.sin(2.0 * np.pi * time) * (1.0 + 0.8 * np.sin(2.0 * np.pi * 0.7 * time))
        self.prepared = types.SimpleNamespace(contact_speed=speed, period=1.0e-4)
        self.friction = self.coarse_friction(COARSE)
        self.viscous = drive.actuator.viscous * speed[::COARSE] / drive.radius
        self.own = np.zeros(len(self.friction))

    def mean(self, values, coarse):
        return values


@pytest.mark.parametrize("asymmetry", [-0.2, 0.2])
def test_an_asymmetry_of_a_rate_equation_leaves_no_creep(axis, asymmetry):
    """What the derivative left of a fifth was called creep on three machines of Leuven's law (pairs, seed 10301, cases 23 and 47,
    and 10201, case 28)."""
    channel = Replayed(axis)
    speed = channel.prepared.contact_speed[::COARSE] / channel.drive.radius
    truth = replay(channel.drive.actuator, speed, COARSE * 1.0e-4, asymmetry)[0] - channel.friction
    left = {}
    for form in forms_of("torque"):
        if form.effect == "direction_asymmetry" and form.variant != "guideway":
            columns = form.columns(channel, types.SimpleNamespace(drive=channel.drive))
            beta = np.linalg.lstsq(columns, truth, rcond=None)[0]
            if form.possible(beta, None):
                left[form.variant] = np.std(truth - columns @ beta) / np.std(truth)
                assert abs(beta[0] - asymmetry) < 0.05 * abs(asymmetry) + 0.2 * left[form.variant]
    assert left[f"{asymmetry:g}"] < 1.0e-6 and left[f"{asymmetry:g},viscous"] < 1.0e-6
    assert left[""] > 0.02 and f"{-asymmetry:g}" not in left


@pytest.mark.parametrize("effect", FRICTIONS)
def test_no_friction_drives(effect):
    """A level of −0.085 and 4.25 times the viscosity stood for a dead band beside a soft drive (pairs, seed 10301, case 14), and one
    of 0.043 with 2.8 times the viscosity, and more, for 1.85 times the viscosity (seed 10701, case 54)."""
    forms = [form for form in forms_of("torque") if form.effect == effect]
    assert forms
    for form in forms:
        assert form.possible(np.array([-0.9]), None) and not form.possible(np.array([-1.085]), None)
        assert not form.possible(np.array([0.4, -1.085]), None) and not form.possible(np.array([-0.957]), None)
