"""Effects of piezo, stepper, voice coil and analog sensors are named and sized from closed-loop records; a healthy twin agrees."""

from pathlib import Path

import numpy as np
import pytest

from microstage_ros.control.runs.run_file import run_from_dict
from microstage_ros.control.runs.simulate import simulated_record
from microstage_ros.diagnosis.batch import diagnose_records
from microstage_ros.diagnosis.report.extended import extended_axis
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.effects import REGISTRY, effects_of
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.plant import make_plant

AXES = Path(__file__).resolve().parents[3] / "config" / "axes"
PROGRAMS = {
    "piezo": [{"move_to_m": way, "dwell_s": rest} for way, rest in ((5e-6, 0.5), (-5e-6, 0.5), (2e-6, 0.3), (-3e-6, 0.8))],
    "stepper": [{"scan": {"to_m": way, "speed_m_s": 2e-3}, "dwell_s": 0.2} for way in (1e-3, -1e-3)],
    "voice_coil": [*({"scan": {"to_m": way, "speed_m_s": speed}, "dwell_s": 0.1} for way, speed in ((8e-3, 0.02), (-8e-3, 0.05), (8e-3, 0.1))),
                   {"sine": {"amplitude_m": 4e-3, "frequency_hz": 4.0, "cycles": 1}}],
}
#: Microsteps are seen as well within a quarter of a millimetre.
SHORT = [{"scan": {"to_m": way, "speed_m_s": 2e-3}, "dwell_s": 0.05} for way in (2.5e-4, -2.5e-4)]
#: Steps that were lost are told from a drift by what comes after them: one more move.
AFTERWARDS = {"lost_steps": [{"scan": {"to_m": 1.5e-3, "speed_m_s": 2e-3}, "dwell_s": 0.2}]}
#: Axis, hidden effect, the parameter that is compared, and how near it has to be (relative).
HIDDEN = (
    ("piezo", {"piezo_creep": {"gain": 0.03, "time_s": 0.6}}, "gain", 0.05),
    ("piezo", {"piezo_hysteresis": {"change": 0.4}}, "change", 0.05),
    ("piezo", {"piezo_gain": {"change": -0.1}}, "change", 0.05),
    ("piezo", {"sensor_drift": {"rate_m_s": 3e-8}}, "rate_m_s", 0.05),
    ("stepper", {"lost_steps": {"steps": 4.0, "time_s": 0.8}}, "steps", 0.05),
    ("stepper", {"lvdt_nonlinearity": {"change": 2e-3}}, "change", 0.05),
    ("stepper", {"sensor_drift": {"rate_m_s": -2e-6}}, "rate_m_s", 0.05),
    ("voice_coil", {"force_constant_droop": {"droop_1_m2": 1500.0}}, "droop_1_m2", 0.05),
)


def _records(axis, seeds, effect="", program=()):
    program = program or PROGRAMS[axis.choices["drive.type"]] + AFTERWARDS.get(effect, [])
    return [simulated_record(axis, run_from_dict({"program": program}), seed) for seed in seeds]


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_healthy_twin_agrees(name):
    axis = load_axis(AXES / f"{name}.yaml")
    answer = diagnose_records(axis, _records(axis, (1,)), _records(axis, (2,)), _records(axis, (3,)), seed=0)
    assert (answer.verdict, answer.causes, answer.rivals) == ("agrees", (), ())


@pytest.mark.parametrize(("name", "effects", "parameter", "near"), HIDDEN, ids=[f"{name}-{next(iter(e))}" for name, e, _, _ in HIDDEN])
def test_a_hidden_effect_is_named_and_sized(name, effects, parameter, near):
    axis = load_axis(AXES / f"{name}.yaml")
    hidden = axis.with_effects(effects)
    (word, given), = effects.items()
    records = [_records(machine, (seed,), word) for seed, machine in enumerate((hidden, hidden, axis), 1)]
    answer = diagnose_records(axis, *records, seed=0)
    assert [cause.id for cause in answer.causes] == [word] and answer.verdict in ("explained", "partly_explained")
    assert answer.causes[0].parameters[parameter].value == pytest.approx(given[parameter], rel=near)
    assert answer.causes[0].share > 0.9 and answer.gain.after < 0.2 * answer.gain.before
    assert set(extended_axis(axis, answer).effects) == {word}


def test_uneven_microsteps_are_named():
    """Their size comes out too small: the field is held in a period, and the ripple within a microstep is seen through a 500 Hz filter."""
    axis = load_axis(AXES / "stepper.yaml")
    hidden = axis.with_effects({"detent_torque": {"extra_Nm": 0.15}})
    records = [_records(machine, (seed,), program=SHORT) for seed, machine in enumerate((hidden, hidden, axis), 1)]
    answer = diagnose_records(axis, *records, seed=0)
    assert answer.causes[0].id == "detent_torque" and answer.causes[0].parameters["extra_Nm"].value > 0.05


def test_effects_of_a_kind_are_offered_to_that_kind_only():
    kinds = {name: set(effects_of(load_axis(AXES / f"{name}.yaml"))) for name in PROGRAMS}
    own = {name for name, effect in REGISTRY.items() if effect.drives or effect.sensors}
    assert own & kinds["piezo"] == {"piezo_creep", "piezo_hysteresis", "piezo_gain", "sensor_drift"}
    assert own & kinds["stepper"] == {"lost_steps", "detent_torque", "lvdt_nonlinearity", "sensor_drift"}
    assert own & kinds["voice_coil"] == {"force_constant_droop"}


@pytest.mark.parametrize("word", sorted(name for name, effect in REGISTRY.items() if effect.drives or effect.sensors))
def test_a_drawn_effect_moves_the_machine_and_is_refused_elsewhere(word):
    """A drawn size changes where the stage goes under one and the same program, or what a tight loop commands to hold it
    there (a creeping stack stays within a few nanometres of its target); the shipped axis refuses it in one line."""
    effect = REGISTRY[word]
    name = next(name for name in PROGRAMS if effect.acts_on(load_axis(AXES / f"{name}.yaml")))
    axis = load_axis(AXES / f"{name}.yaml")
    drawn = effect.draw(np.random.default_rng(3), 1.0)
    program = {"program": PROGRAMS[name][:1], "effects": {word: drawn}}
    changed = simulated_record(axis, run_from_dict(program), 1)
    healthy = simulated_record(axis, run_from_dict({"program": PROGRAMS[name][:1]}), 1)
    moved = np.abs(changed["stage_m"] - healthy["stage_m"]).max()
    assert moved > 5e-9 or np.abs(changed["voltage_V"] - healthy["voltage_V"]).max() > 1e-2 * np.ptp(healthy["voltage_V"])
    with pytest.raises(InputError, match=f"effects: {word}"):
        make_plant(load_axis(AXES.parent / "axis.yaml"), effects={word: drawn})
