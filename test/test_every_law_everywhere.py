"""Every friction law of the library, at every contact, under every controller, in every program that reads an axis file.

A combination runs and gives finite numbers, or is refused in one line that names the law.
"""

import itertools
import math
import pathlib

import numpy as np
import pytest

from microstage_ros.control.laws.registry import LAWS as CONTROLLERS
from microstage_ros.control.friction_observer import FrictionObserver
from microstage_ros.control.runs.run_file import run_from_dict
from microstage_ros.control.runs.simulate import simulate, simulated_record
from microstage_ros.control.tuning.margins import regimes
from microstage_ros.diagnosis.result import VERDICTS
from microstage_ros.identification.pipeline import identify
from microstage_ros.model.axis_file import axis_from_dict, load_axis
from microstage_ros.model.friction.blocks import virgin_curve
from microstage_ros.model.friction.contact import OTHER_LAWS, blocks_of, limit_of
from microstage_ros.model.friction.equivalent import equivalent_blocks
from microstage_ros.model.friction.registry import law_named, run_law
from microstage_ros.model.schema import CONTACT_LAWS
from microstage_ros.quantities.errors import InputError

ROOT = pathlib.Path(__file__).resolve().parents[1]
CONTACTS = ("actuator", "guideway")
PAPER = load_axis(ROOT / "config" / "axis.yaml")
PRODUCT = list(itertools.product(CONTACT_LAWS, CONTACTS))


def axis_with(law, contact):
    """The shipped axis with another law at one contact: same limit and elastic stiffness."""
    tree = PAPER.as_dict()
    stiffness, weight = blocks_of(PAPER, contact)
    angular, limit = contact == "actuator", limit_of(PAPER, contact)
    speed = 0.18 if angular else 3e-4
    all_values = {
        "stiffness": float(stiffness.sum()), "static": limit, "coulomb": 0.6 * limit, "stribeck_velocity": speed,
        "stribeck_exponent": 0.9, "viscous": 1e-5 if angular else 20.0, "attraction": 1.0 if angular else 500.0,
        "damping": 1e-6 if angular else 10.0, "exponent": 2.0, "breakaway_share": 0.7, "creep_velocity": 1e-4 * speed,
        "sharpness": 5.0, "hardening": 0.05 * float(stiffness.sum()),
    }
    blocks = {"stiffness": stiffness.tolist(), "weight": weight.tolist()}
    section = {"law": law}
    for name, spec in CONTACT_LAWS[law].items():
        value = blocks[name] if spec.is_list else all_values[name]
        unit = spec.unit
        if not angular:
            from microstage_ros.model.schema import linear_unit
            unit = linear_unit(unit)
        section[name] = {"value": value, "unit": unit, "source": "estimate"}
    tree["contacts"][contact] = section
    return axis_from_dict(tree, f"{law} at {contact}")


def short_run(controller, seconds=0.03):
    return run_from_dict({"controller": {"type": controller}, "program": [{"move_to_m": 1e-6, "dwell_s": seconds}]}, "run")


@pytest.mark.parametrize(("law", "contact"), PRODUCT)
def test_every_controller_moves_an_axis_with_this_law(law, contact):
    axis = axis_with(law, contact)
    for controller in CONTROLLERS:
        columns = simulate(axis, short_run(controller), seed=1)
        for name in ("encoder_m", "voltage_V", "current_A"):
            assert np.isfinite(columns[name]).all(), (controller, name)
        limit = axis.value("drive.voltage_limit")
        assert np.abs(columns["voltage_V"]).max() <= limit + 1e-9
        off = abs(columns["stage_m"][-1] - 1e-6)
        if controller not in ("none", "cascade"):   # P beside P, of force drives: friction keeps it where it stood
            assert off < 5e-7, controller           # on its way there, not anywhere else
        elif controller == "cascade":
            assert off < 1.5e-6


@pytest.mark.parametrize(("law", "contact"), PRODUCT)
def test_observer_and_margins_know_the_axis(law, contact):
    axis = axis_with(law, contact)
    observer = FrictionObserver(axis)
    for n in range(50):
        estimate = observer.step(1e-9 * n, 0.1, 0.01)
    assert all(np.isfinite(np.asarray(value, float)).all() for value in estimate)
    for _, plant, slopes in regimes(axis):
        assert all(math.isfinite(value) for value in slopes)
        assert np.isfinite(plant.poles()).all()


@pytest.mark.parametrize(("law", "contact"), PRODUCT)
def test_diagnose_answers_or_refuses_in_one_line(law, contact):
    from microstage_ros.diagnosis.case import diagnose_case

    axis = axis_with(law, contact)
    run = run_from_dict({"controller": {"type": "pid"}, "program": [
        {"scan": {"to_m": 1e-4, "speed_m_s": 4e-4}}, {"scan": {"to_m": 0.0, "speed_m_s": 4e-4}}, {"move_to_m": 2e-6, "dwell_s": 0.3}]}, "run")
    records = [simulated_record(axis, run, seed) for seed in range(3)]
    if law == "none" and contact == "actuator":
        with pytest.raises(InputError, match=r"contacts\.actuator\.law") as refused:
            diagnose_case(axis, records[:1], records[1:2], records[2:])
        assert "\n" not in str(refused.value)
        return
    answer = diagnose_case(axis, records[:1], records[1:2], records[2:])
    assert answer.verdict in VERDICTS and math.isfinite(answer.gain.before)


@pytest.mark.parametrize(("law", "contact"), PRODUCT)
def test_identify_answers_or_refuses_in_one_line(law, contact):
    axis = axis_with(law, contact)
    refused = contact == "actuator" and law != "generalised_maxwell_slip"
    run = run_from_dict({"controller": {"type": "pid"}, "program": [
        {"sine": {"amplitude_m": 2e-4, "frequency_hz": 10.0 if refused else 1.0, "cycles": 2}}]}, "run")
    record = simulated_record(axis, run, 3)
    if refused:
        with pytest.raises(InputError, match=r"contacts\.actuator\.law") as refusal:
            identify([record], axis)
        assert law in str(refusal.value) and "\n" not in str(refusal.value)
        return
    result = identify([record], axis)
    assert all(math.isfinite(float(np.ravel(e.value)[0])) for e in result.estimates.values() if e.determined)


SHAPES = {"dahl": {}, "lugre": {"damping": 1e-3, "coulomb": 0.6, "stribeck_velocity": 0.2},
          "elasto_plastic": {"coulomb": 0.6, "stribeck_velocity": 0.2, "breakaway_share": 0.7}}


@pytest.mark.parametrize(("name", "more"), [*SHAPES.items(), ("dahl", {"exponent": 2.0}), ("dahl", {"exponent": 0.5})])
def test_equivalent_blocks_follow_the_first_loading(name, more):
    """Within 6 % of the limit everywhere, and the closed form 1 − exp(−kx/F) of Dahl and LuGre within 2 %."""
    values = {"stiffness": 100.0, "static": 1.0, **more}
    stiffness, weight = equivalent_blocks(name, values)
    assert len(stiffness) <= 8 and (stiffness > 0).all() and weight.sum() == pytest.approx(1.0)
    law, x = law_named(name), np.linspace(0.0, 0.12, 2001)
    velocity = np.full(len(x), 1e-8)
    velocity[0] = 0.0
    force = run_law(law, law.pack({**values, "viscous": 0.0}), velocity, (x[1] - x[0]) / 1e-8)
    assert np.abs(virgin_curve(stiffness, weight * force[-1], x) - force).max() < 0.06
    if more.get("exponent", 1.0) == 1.0 and name != "elasto_plastic":
        assert np.abs(virgin_curve(stiffness, weight, x) - (1.0 - np.exp(-100.0 * x))).max() < 0.025


def test_the_table_of_other_laws_is_complete():
    """A law that a file may name is made of blocks, is Coulomb friction, or is one of `OTHER_LAWS`."""
    assert set(CONTACT_LAWS) == {"none", "coulomb_viscous", "coulomb_viscous_stribeck", "maxwell_slip", "generalised_maxwell_slip", *OTHER_LAWS}
