"""Sizes that logs give are those of the catalogue: their sign, their sense, and an axis file that can be simulated."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from microstage_ros.commands.__main__ import main
from microstage_ros.diagnosis.logs.report.answer import SHAPELESS, _effect_of
from microstage_ros.diagnosis.logs.report.page import size_of
from microstage_ros.diagnosis.logs.selection.sizes import Fitted, parameters_of
from microstage_ros.diagnosis.result import Parameter
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.effects import REGISTRY
from microstage_ros.places import config_file
from microstage_ros.solver.plant import make_plant

STEP_S = 0.005
LOG = """time: {column: time, unit: s}
reference: {column: set, unit: mm}
following_error: {column: err, unit: mm}
current: {column: cur, unit: A}
voltage: {column: volt, unit: V}
lead: {value: 2, unit: mm}
"""


def write_log(path, seed, gain=1.0, offset=0.0):
    """A log of a stage whose motor gets gain u + offset: the loop asks for the u that the motor needs."""
    generator, place = np.random.default_rng(seed), []
    for speed in (10.0, 40.0, 20.0, 80.0):
        way = np.linspace(0.0, 40.0, int(40.0 / speed / STEP_S))
        place += [*way, *[40.0] * 60, *way[::-1], *[0.0] * 60]
    window = np.hanning(21) / np.hanning(21).sum()
    wanted = np.convolve(np.r_[np.zeros(20), place, np.zeros(20)], window, "same")
    speed = np.gradient(wanted, STEP_S)
    current = (1.0 + 0.01 * generator.standard_normal()) * (0.8 * np.tanh(speed / 0.5) + 0.006 * speed) + 4e-4 * np.gradient(speed, STEP_S)
    current += 5e-3 * generator.standard_normal(len(wanted))
    volts = (2.0 * current + 0.05 * speed - offset) / gain + 3e-3 * generator.standard_normal(len(wanted))
    error = 1e-3 * speed + 5e-4 * generator.standard_normal(len(wanted))
    rows = zip(np.arange(len(wanted)) * STEP_S, wanted, error, current, volts)
    path.write_text("time,set,err,cur,volt\n" + "".join("{:.3f},{:.5f},{:.6f},{:.5f},{:.5f}\n".format(*row) for row in rows))
    return str(path)


def test_an_offset_has_the_sign_of_the_catalogue(tmp_path):
    """+0.3 V that the amplifier adds were stated as −300 mV, and simulated so by extended.yaml."""
    (tmp_path / "LOG.yaml").write_text(LOG)
    base = [write_log(tmp_path / f"base{k}.csv", k) for k in range(6)]
    now = [write_log(tmp_path / f"now{k}.csv", 200 + k, offset=0.3) for k in range(4)]
    out = tmp_path / "answer"
    assert main(["diagnose", "--log", str(tmp_path / "LOG.yaml"), "--baseline", *base, "--axis", str(config_file("axis.yaml")), "--out", str(out), *now]) == 0
    found = load_axis(out / "extended.yaml").effects["amplifier_offset"]["offset_V"]
    assert found == pytest.approx(0.3, abs=0.03)
    text = (out / "report.html").read_text()
    assert "−300 mV" not in text and "-300 mV" not in text
    # a trend would replace report.json: it is asked for, too
    assert main(["diagnose", "--log", str(tmp_path / "LOG.yaml"), "--baseline", *base, "--over-time", "--out", str(out), *now]) == 2


class Context:
    """What sizes need of the records."""

    stroke, top_speed, place_unit, facts = 0.1, 0.1, "m", {}

    def __init__(self, scale, unit):
        self.channels, self._scale = {"effort": SimpleNamespace(unit=unit)}, scale

    def scale(self, shown):
        return self._scale


def fitted(beta, sigma, scale=1.0, unit="V"):
    """`Fitted` of one column."""
    return Fitted(["gain"], np.array([beta]), np.array([[sigma**2]]), Context(scale, unit), "effort")


def test_a_weak_amplifier_has_a_gain_below_one():
    """It is asked for 1.25 times as much at 0.8 of its gain."""
    factor = parameters_of("amplifier_gain", fitted(0.25, 0.0125))["factor"]
    assert factor.value == pytest.approx(0.8) and factor.stderr == pytest.approx(0.0125 / 1.25**2)
    assert parameters_of("amplifier_offset", fitted(-0.1, 0.01, 3.0))["offset_V"].value == pytest.approx(0.3)


def test_a_reading_too_short_is_a_positive_scale_error():
    """Interferometer less encoder, over the place: x (1 − 2e-4) read over 0.1 m adds 10 µm to the error at either end."""
    relative = parameters_of("scale_error", fitted(1e-5, 1e-7, 1.0, "m"))["relative"]
    assert relative.value == pytest.approx(2e-4)


def cause_of(name):
    """A cause with every parameter that the effect has."""
    numbers = {key: Parameter(spec.default if isinstance(spec.default, float) else min(0.1, 0.5 * spec.maximum), 0.01, spec.unit)
               for key, spec in REGISTRY[name].parameters.items()}
    return SimpleNamespace(id=name, parameters=numbers)


@pytest.mark.parametrize("file", ["axis.yaml", "emps.yaml", "axes/voice_coil.yaml"])
@pytest.mark.parametrize("name", [name for name, effect in REGISTRY.items() if not effect.drives and not effect.sensors])
def test_what_goes_into_an_extended_axis_can_be_simulated(name, file):
    """Of a force drive the friction went to a contact that it has not, and a log's friction along the stroke got a period that nobody measured."""
    axis = load_axis(config_file(file))
    effect = _effect_of(cause_of(name), axis)
    assert (effect is None) if name in SHAPELESS else True
    if effect:
        make_plant(axis.with_effects({name: effect}))
    elif file == "axis.yaml" and name not in SHAPELESS and effect is None:
        pytest.fail(f"{name} could be on this axis")


@pytest.mark.parametrize("value, stderr, unit, name, says", [
    (2.0e-4, 1.0e-6, "1", "relative", "0.0200 %, 95 %: 0.0198 … 0.0202 %"), (0.83, 0.02, "1", "factor", "-17 %, 95 %: -21 … -13 %"),
    (0.3, 0.03, "1", "asymmetry", "30 %, 95 %: 24 … 36 %"), (1.004, 5e-4, "1", "coulomb_factor", "+0.40 %, 95 %: +0.30 … +0.50 %"), (0.5, 0.0, "1", "share", "50 %")])
def test_a_share_has_the_decimals_that_its_interval_needs(value, stderr, unit, name, says):
    """A scale error of 0.02 % was stated as "-0 %, 95 %: -0 … -0 %"."""
    assert size_of({"parameters": {name: {"value": value, "stderr": stderr, "unit": unit}}}).startswith(says)
    assert math.isfinite(value)
