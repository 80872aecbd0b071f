"""Nameless shapes of what a growth of the friction, or a slow amplifier, leaves where it is not known to the last."""

import dataclasses
import types

import numpy as np
import pytest

from microstage_ros.diagnosis.prerequisites import growth, lateness
from microstage_ros.diagnosis.residuals.evidence import Evidence

SPEED = np.linspace(-7.0, 7.0, 4001)       # rad/s, of a stroke at 2.2 mm/s
CHANNEL = types.SimpleNamespace(prepared=types.SimpleNamespace(speed=SPEED), mean=lambda values: values, calm=lambda columns: columns)
FRAME = types.SimpleNamespace(drive=types.SimpleNamespace(radius=1.0))


def grown(power, ends=0.0):
    return growth.nonlinear_viscous(power, ends)(CHANNEL, FRAME)


def collection(torque):
    """Learning records of one torque balance (blocks, 1) with noise of 1."""
    def alone(form):
        columns = np.concatenate([torque, form.columns(CHANNEL, FRAME)], axis=1)
        return Evidence(columns.T @ columns, {form.key: slice(1, 2)}, len(SPEED))
    return types.SimpleNamespace(names=["torque"], growing=lambda *_: types.SimpleNamespace(alone=alone))


@pytest.mark.parametrize("power", [1.83, 2.2])
def test_what_is_left_of_a_growth_where_its_power_is_off_is_the_shape_beside_it(power):
    """The power is fitted; one that is off by a hundredth leaves that shape, to second order."""
    form, other = growth.power_forms(collection(20.0 * grown(power)))
    assert float(form.variant) == pytest.approx(power, rel=3e-3) and other.effect == growth.OTHER_POWER and not other.named
    off = grown(power + 0.01) - grown(power)
    both = np.concatenate([form.columns(CHANNEL, FRAME), other.columns(CHANNEL, FRAME)], axis=1)
    left = [off - columns @ np.linalg.lstsq(columns, off, rcond=None)[0] for columns in (both[:, :1], both)]
    assert np.linalg.norm(left[1]) < 0.05 * np.linalg.norm(left[0])


@pytest.mark.parametrize("torque", [20.0 * grown(1.0), 0.01 * grown(2.0)])
def test_a_viscous_friction_and_a_faint_growth_have_no_form_of_their_own(torque):
    assert growth.power_forms(collection(torque)) == []


@dataclasses.dataclass(frozen=True)
class Slow:
    time: float = 3.0e-4
    lag: float = 0.0


@dataclasses.dataclass(frozen=True)
class Known:
    slow: object

    def prepare(self, groups, drive, prepared):
        return {group: [self.slow.time**2 * one for one in prepared[group]] for group in ("learn", "held")}


def test_what_an_amplifier_of_another_time_leaves_is_the_change_of_the_residual(monkeypatch):
    """r = τ² f: ∂r/∂ln τ = 2 r; the baseline, whose amplifier is prompt, has none of it."""
    monkeypatch.setattr(lateness, "Mechanical", lambda prepared, drive: types.SimpleNamespace(residual=prepared))
    shapes = {group: np.random.default_rng(number).normal(size=50) for number, group in enumerate(("learn", "held", "base"))}
    channels = {group: [{"torque": types.SimpleNamespace(residual=Slow().time**2 * shape)}] for group, shape in shapes.items()}
    case = types.SimpleNamespace(names=["torque"], channels=channels, prepared={g: [s] for g, s in shapes.items()},
                                 frame=types.SimpleNamespace(drive=None))
    (form,) = lateness.forms_of_slowness({}, None, Known(Slow()), case)
    for group in ("learn", "held"):
        own = channels[group][0]["torque"]
        assert form.columns(own, None)[:, 0] == pytest.approx(2.0 * own.residual)
    assert not form.columns(channels["base"][0]["torque"], None).any() and not form.named
    assert lateness.forms_of_slowness({}, None, Known(None), case) == []
