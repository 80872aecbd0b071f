"""The mass that the torque balance tells, by the load on the guideways and by the inertia, and that of the resonance."""

import math
import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue.drive import INERTIA
from microstage_ros.diagnosis.catalogue.form import Form
from microstage_ros.diagnosis.residuals.evidence_set import Choice
from microstage_ros.diagnosis.selection import mass_or_drive
from microstage_ros.diagnosis.selection.sizes import CAUTION

MASS, LOAD, OF_INERTIA = 3.0, 0.25, 0.5
SCATTER = 4.0
COVARIANCE = np.array([[9.0, 0.0, 0.0], [0.0, 4.0, 1.0], [0.0, 1.0, 2.0]]) * 1e-4


class Balance:
    """Torque balance in which two sizes are fitted beside one other, with a covariance that is written down."""

    asked = None

    def fit(self, keys):
        self.asked = keys
        return np.array([7.0, LOAD, OF_INERTIA]), COVARIANCE, None


def case(*effects):
    """Evidences with these forms of the torque balance."""
    return types.SimpleNamespace(
        learn={"torque": Balance()}, scatter={"torque": SCATTER}, frame=types.SimpleNamespace(drive=types.SimpleNamespace(mass=MASS)),
        forms=[Form(effect, "torque", "", None) for effect in effects])


def test_two_masses_of_the_load_and_of_load_and_inertia_with_their_errors():
    """The variance of a sum is that of both and twice their covariance; the scatter of the channel is in it, and its caution."""
    found, other = case("payload_change", INERTIA, "viscous_change"), Choice("viscous_change", (Form("viscous_change", "torque", "", None),))
    load, inertia = mass_or_drive.mass_of_inertia(found, [other])
    error = MASS * CAUTION["torque"] * math.sqrt(SCATTER)
    assert load == pytest.approx((MASS * LOAD, error * math.sqrt(4e-4)))
    assert inertia == pytest.approx((MASS * (LOAD + OF_INERTIA), error * math.sqrt((4.0 + 2.0 + 2.0) * 1e-4)))
    assert found.learn["torque"].asked == [("viscous_change", ""), ("payload_change", ""), (INERTIA, "")]


@pytest.mark.parametrize("effects", [("payload_change",), (INERTIA,), ()])
def test_no_two_masses_where_one_of_the_forms_is_missing(effects):
    assert mass_or_drive.mass_of_inertia(case(*effects), []) is None


def test_no_two_masses_without_a_torque_balance():
    found = case("payload_change", INERTIA)
    found.learn = {}
    assert mass_or_drive.mass_of_inertia(found, []) is None


@pytest.mark.parametrize(("mass", "other", "one"), [(2.0, 4.9, True), (2.0, 5.1, False), (4.9, 2.0, True), (5.1, 2.0, False), (-2.0, 2.0, False)])
def test_two_masses_down_to_two_fifths_are_one(mass, other, one):
    assert mass_or_drive.alike(mass, other) == one


@pytest.fixture
def sizes(monkeypatch):
    """Mass and its error [kg] by channel."""
    known = {"torque": (2.0, 0.5), "resonance": (2.4, 0.2), "windup": (2.6, 0.1)}
    monkeypatch.setattr(mass_or_drive, "sizes_of", lambda evidences, choice, others, form: ({"mass_kg": (*known[form.channel], "kg")}, {}))
    return known


def payload(*channels):
    return Choice("payload_change", tuple(Form("payload_change", channel, "", None) for channel in channels))


@pytest.mark.parametrize(("channels", "expected"), [
    (("resonance", "torque"), (2.0, 0.5, 2.4, 0.2)), (("windup",), (2.0, 0.5, 2.6, 0.1)),
    (("resonance", "windup"), (2.0, 0.5, 2.6, 0.1)),        # of the two the one that is told better
])
def test_the_mass_of_the_torque_beside_the_one_that_the_resonance_tells_best(sizes, channels, expected):
    assert mass_or_drive.torque_mass(case("payload_change"), payload(*channels), []) == expected


def test_no_mass_is_compared_where_a_channel_is_missing(sizes):
    assert mass_or_drive.torque_mass(case("payload_change"), payload("torque"), []) is None
    assert mass_or_drive.torque_mass(case("viscous_change"), payload("windup"), []) is None
    found = case("payload_change")
    found.learn = {}
    assert mass_or_drive.torque_mass(found, payload("windup"), []) is None


@pytest.mark.parametrize(("soft", "mass", "stderr", "said"), [
    (0.5, 2.0, 0.4, True),           # of 3 kg that a drive of half the stiffness stands for, five errors
    (0.5, 2.0, 0.6, False),          # three and a third
    (0.5, 0.76, 0.1, True), (0.5, 0.74, 0.1, False),        # a quarter
    (0.5, 7.4, 0.1, True), (0.5, 7.6, 0.1, False),          # five halves
    (0.25, 2.0, 0.4, False),         # 9 kg
])
def test_a_soft_drive_shows_no_inertia_in_the_torque(monkeypatch, soft, mass, stderr, said):
    known = {"torque": {"mass_kg": (mass, stderr, "kg")}, "resonance": {"stiffness_factor": (soft, 0.01, "1")}}
    monkeypatch.setattr(mass_or_drive, "sizes_of", lambda evidences, choice, others, form: (known[form.channel], {}))
    drive = Choice("drive_compliance", tuple(Form("drive_compliance", channel, "", None) for channel in ("resonance", "windup")))
    assert mass_or_drive._mass_of_a_soft_drive(case("payload_change"), drive, []) == said
    assert not mass_or_drive._mass_of_a_soft_drive(case(), drive, [])
    assert not mass_or_drive._mass_of_a_soft_drive(case("payload_change"), Choice("drive_compliance", drive.forms[1:]), [])


@pytest.mark.parametrize(("channels", "behind"), [(("windup",), True), (("windup", "resonance"), False), (("torque",), False), (("torque", "windup"), True)])
def test_behind_a_gap_the_deflection_is_kept_and_no_resonance(channels, behind):
    assert mass_or_drive.behind_gap(types.SimpleNamespace(learn=dict.fromkeys(channels))) == behind
