"""What changes a contact's limits is replayed at its own size; motion and contact are those of the shipped axis."""

import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue import friction
from microstage_ros.diagnosis.catalogue.form import Form, Frame, splines
from microstage_ros.diagnosis.catalogue.friction import COARSE, FORMS, by_limits
from microstage_ros.diagnosis.preprocessing.friction_replay import replay
from microstage_ros.diagnosis.residuals.evidence import Evidence
from microstage_ros.diagnosis.residuals.evidence_set import Choice, Evidences
from microstage_ros.diagnosis.selection.refinement import about_their_sizes

PERIOD, REACH = 1e-4, 4e-4
TIME = np.arange(24000) * PERIOD
# two strokes that slide, then small ones that stick
POSITION = np.where(TIME < 2.0, REACH * np.sin(2.0 * np.pi * TIME), 1e-8 * np.sin(2.0 * np.pi * 5.0 * TIME))
SPEED = np.gradient(POSITION, PERIOD)


@pytest.fixture(scope="module")
def frame(drive):
    return Frame(drive, -REACH, REACH, TIME[-1])


class Rows:
    """A record's torque balance with a row per step of the candidates' replays."""

    def __init__(self, drive):
        self.prepared = types.SimpleNamespace(contact_speed=SPEED, stage_position=POSITION, time=TIME, period=PERIOD)
        self.place, self.kept, self._drive = POSITION[::COARSE], {}, drive
        self.friction = self.coarse_friction(COARSE)
        self.own, self.viscous = np.zeros(len(self.friction)), 1e-6 * SPEED[::COARSE]

    def coarse_friction(self, coarse):
        return self.replayed()

    def replayed(self, **how):
        return replay(self._drive.actuator, SPEED[::COARSE] / self._drive.radius, COARSE * PERIOD, **how)[0]

    @staticmethod
    def mean(values, coarse):
        return values

    @staticmethod
    def calm(columns):
        return columns


@pytest.fixture(scope="module")
def rows(drive):
    return Rows(drive)


def form_of(effect, variant):
    return next(form for form in FORMS if form.key == (effect, variant))


def off(columns, beta, truth):
    """RMS error of a form at its sizes, over the change that it stands for."""
    return np.std(columns @ beta - truth) / np.std(truth)


def test_friction_follows_its_limits_where_it_slides_and_not_where_it_sticks(rows, frame):
    derivative = by_limits(rows, frame)[:, 0]
    sliding, sticking = (np.abs(SPEED[::COARSE]) > 2e-3) & (TIME[::COARSE] > 0.1), TIME[::COARSE] > 2.1
    assert derivative[sliding] == pytest.approx(rows.friction[sliding], rel=0.02)
    still = rows.friction[sticking] - rows.friction[sticking].mean()
    assert np.std(derivative[sticking]) < 0.1 * np.std(still)
    replays = len(rows.kept)
    by_limits(rows, frame)
    assert "by limits" in rows.kept and len(rows.kept) == replays       # replayed once for the splines of every spacing
    rows.own = 0.1 * rows.friction                 # what the healthy axis has beyond the model slides alike
    assert by_limits(rows, frame)[sliding, 0] == pytest.approx(1.1 * rows.friction[sliding], rel=0.02)
    rows.own = np.zeros(len(rows.friction))


@pytest.mark.parametrize("size", [0.25, -0.25])
@pytest.mark.parametrize("variant", ["", "viscous"])
def test_an_asymmetry_is_exact_about_its_size(rows, frame, variant, size):
    form = form_of("direction_asymmetry", variant)
    beta = np.array([size, 0.1])[: 2 if variant else 1]
    truth = rows.replayed(asymmetry=size) - rows.friction + (0.1 * np.abs(rows.viscous) if variant else 0.0)
    about = form.about(beta)
    assert about.sizes is form.sizes and about.key != form.key and about.effect == form.effect
    assert off(about.columns(rows, frame), beta, truth) < 1e-6 < 0.004 < off(form.columns(rows, frame), beta, truth)


def test_friction_along_the_stroke_is_exact_about_its_profile(rows, frame):
    form = form_of("position_dependent_friction", "0.00025")
    pieces = form.columns(rows, frame).shape[1] - 3
    profile = lambda x: splines(x, frame.low, frame.high, pieces) @ beta
    beta = np.linspace(-0.2, 0.5, pieces + 3)
    truth = rows.replayed(factor=1.0 + profile(POSITION[::COARSE])) - rows.friction
    about = form.about(beta)
    assert about.prior == form.prior and about.sizes(beta, np.eye(len(beta)), frame)[0].keys() == {"rms"}
    assert off(about.columns(rows, frame), beta, truth) < 0.01 < 0.04 < off(form.columns(rows, frame), beta, truth)
    rows.own = 0.1 * rows.friction      # what the healthy axis has beyond the model counts once, without a change too
    assert form.about(0.0 * beta).columns(rows, frame) == pytest.approx(form.columns(rows, frame), rel=1e-9, abs=1e-12)
    rows.own = np.zeros(len(rows.friction))


def test_rest_and_creep_are_replayed_with_their_size(monkeypatch):
    asked = []
    monkeypatch.setattr(friction, "_changed", lambda channel, frame, **how: asked.append(how) or np.zeros((2, 1)))
    rest = types.SimpleNamespace(stuck=np.ones(4), position=np.zeros(4), period=0.1)
    channel = types.SimpleNamespace(prepared=rest, kept={})
    monkeypatch.setattr(friction, "_calm_speed", lambda prepared: np.zeros(4))
    form_of("rising_static_friction", "0.03,2e-06").about([0.2]).columns(channel, None)
    assert asked[-1]["factor"][-1] == pytest.approx(1.0 + 0.2 * np.log10(1.0 + 0.4 / 0.03))
    form_of("rising_static_friction", "0.03,2e-06").about([1e-5]).columns(channel, None)
    assert asked[-1]["factor"][-1] == pytest.approx(1.0 + friction.LEAST_STEP * np.log10(1.0 + 0.4 / 0.03))
    creep = form_of("presliding_creep", "0.06,2e-08")
    frame = types.SimpleNamespace(drive=types.SimpleNamespace(radius=1.0))
    flows = [form.columns(channel, frame) is not None and asked[-1]["flow"] for form in (creep, creep.about([6e-8]))]
    assert flows[1] == pytest.approx(3.0 * flows[0])


def test_sizes_beside_each_other_and_forms_that_do_not_depend_on_them():
    fixed = Form("gravity_tilt", "torque", "", None)
    seen = []
    curved = Form("direction_asymmetry", "torque", "", None, about=lambda beta: seen.append(beta) or fixed)
    gram = np.array([[9.0, 5.0, 4.0], [5.0, 4.0, 1.0], [4.0, 1.0, 2.0]])     # residual, tilt, asymmetry
    evidence = Evidence(gram, {fixed.key: slice(1, 2), curved.key: slice(2, 3)}, 100)
    choices = [Choice("gravity_tilt", (fixed,)), Choice("direction_asymmetry", (curved,))]
    evidences = Evidences({"torque": evidence}, {}, {}, [fixed, curved], {"torque": 1.0}, None)
    anew = about_their_sizes(evidences, choices)
    assert anew[0] == choices[0] and anew[1].forms == (fixed,)
    assert seen[0] == pytest.approx(np.linalg.solve(gram[1:, 1:], gram[1:, 0])[1:])
