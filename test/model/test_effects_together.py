"""The catalogue's effects together, from files, on machines that lack something and on laws without blocks."""

import itertools

import numpy as np
import pytest

from microstage_ros.control.runs.run_file import run_from_dict
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.effects import effects_of
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.open_loop import respond
from microstage_ros.solver.plant import NoiseSpec, make_plant
from test.solver.conftest import CONFIG
from test.solver.test_step import with_law

from .test_effects import breakaway

EVERY = {
    "direction_asymmetry": {"asymmetry": 0.05}, "position_dependent_friction": {"amplitude": 0.1},
    "rising_static_friction": {"rate_per_decade": 0.05}, "frictional_lag": {"time_s": 1e-3},
    "presliding_creep": {"amplitude_m": 1e-9}, "viscous_change": {"factor": 1.2},
    "nonlinear_viscous": {"coefficient": 1e-6}, "friction_level_change": {"factor": 0.9},
    "backlash": {"width_rad": 0.005}, "drive_compliance": {"stiffness_factor": 0.5},
    "screw_pitch_error": {"amplitude_m": 1e-6}, "torque_ripple": {"amplitude_Nm": 5e-6},
    "payload_change": {"mass_kg": 1.0}, "gravity_tilt": {"angle_rad": 0.01}, "cable_spring": {"stiffness_N_m": 100.0},
    "amplifier_offset": {"offset_V": 0.01}, "amplifier_deadband": {"half_width_V": 0.01}, "amplifier_gain": {"factor": 1.02},
    "resistance_rise": {"initial": 0.05}, "transport_delay": {"delay_s": 1.3e-4}, "actuator_lag": {"time_s": 2e-4},
    "sampling_jitter": {"jitter_s": 1e-5, "lost_fraction": 0.01}, "encoder_sde": {"amplitude1_m": 1e-8},
    "scale_error": {"relative": 1e-6}, "thermal_drift": {"rate_m_s": 1e-9}, "refractive_index": {"pressure_rate_Pa_s": 1.0},
    "floor_vibration": {"frequencies_hz": 50.0, "amplitudes_m": 1e-8},
}


def test_all_effects_at_once_still_run(axis):
    assert set(EVERY) == set(effects_of(axis))
    r = respond(make_plant(axis, NoiseSpec(), EVERY), np.repeat([1.0, -1.0, 0.3], 1500), friction="random")
    assert all(np.all(np.isfinite(column)) for column in r.values()) and np.ptp(r["x"]) > 1e-5


def test_in_every_pair_each_effect_still_shows(axis):
    """What both do together is what neither does alone, in what the sensors or the physics say."""
    voltage = np.repeat([1.0, -0.6, 0.05, 0.8], 60)

    def ride(*names):
        plant = make_plant(axis, NoiseSpec.none(), {name: EVERY[name] for name in names})
        plant["quantum"] = plant["encoder_count"] = 0.0
        r = respond(plant, voltage)
        assert all(np.all(np.isfinite(column)) for column in r.values()), names
        return np.concatenate(list(r.values()))

    alone = {name: ride(name) for name in EVERY}
    for one, other in itertools.combinations(EVERY, 2):
        both = ride(one, other)
        assert not np.array_equal(both, alone[one]) and not np.array_equal(both, alone[other]), (one, other)


def test_the_flanks_of_a_gap_follow_the_error_of_the_lead(axis):
    """r φ + e(φ) − x is half of the gap on the flank that drives, and the wind-up, wherever the screw is and however
    large e is."""
    gap, size = 1.0e-6, 3.0e-6
    radius = axis.value("transmission.pitch") / (2.0 * np.pi)
    plant = make_plant(axis, NoiseSpec.none(), {"backlash": {"width_rad": gap / radius},
                                                "screw_pitch_error": {"amplitude_m": size, "phase_rad": 0.5}})
    r = respond(plant, np.repeat([2.5, -2.5], 12000))
    screw = r["theta"] / plant["gear"]
    ahead = radius * screw + size * np.sin(screw + 0.5) - r["x"]
    assert np.ptp(screw) > np.pi          # through more than half a turn: the error has both signs
    for part, sign in ((slice(500, 12000), 1.0), (slice(14000, None), -1.0)):
        assert ahead[part] * sign == pytest.approx(0.5 * gap, abs=0.15 * gap)


@pytest.mark.parametrize("name", sorted(EVERY))
def test_an_effect_is_the_same_from_axis_file_and_run_file(axis, tmp_path, name):
    axis.with_effects({name: EVERY[name]}).save(tmp_path / "axis.yaml")
    tree = {"program": [{"move_to_m": 1e-6}], "effects": {name: EVERY[name]}}
    by_run = make_plant(axis, NoiseSpec(), run_from_dict(tree).effects)
    assert make_plant(load_axis(tmp_path / "axis.yaml"), NoiseSpec()) == by_run != make_plant(axis, NoiseSpec())


@pytest.mark.parametrize("name", ["backlash", "drive_compliance", "screw_pitch_error", "resistance_rise", "direction_asymmetry",
                                  "position_dependent_friction", "rising_static_friction", "frictional_lag", "presliding_creep",
                                  "viscous_change", "friction_level_change"])
def test_an_effect_on_what_a_machine_has_not_is_refused(name):
    """The current-driven axis has no winding, no compliance, and no friction at an actuator."""
    with pytest.raises(InputError, match=f"effects: {name}"):
        make_plant(load_axis(CONFIG / "emps.yaml"), effects={name: EVERY[name]})


@pytest.mark.parametrize("law", ["lugre", "dahl"])
def test_friction_effects_act_on_a_law_without_blocks(axis, law):
    machine = with_law(axis, law)

    def ride(volts, periods=4000, **effects):
        return respond(make_plant(machine, NoiseSpec.none(), effects), np.full(periods, volts))

    def sliding(volts, **effects):
        r = ride(volts, **effects)
        w = r["omega"][-1] / 19
        return r["torque_friction"][-1], w, 125.6e-6 + 93.4e-6 * np.exp(-((abs(w) / 0.18) ** 0.9)) if law == "lugre" else 219e-6

    for volts in (2.0, -2.0):
        torque, w, top = sliding(volts, direction_asymmetry={"asymmetry": 0.1})
        assert torque == pytest.approx(np.sign(volts) * top * (1 + 0.1 * np.sign(volts)) + 10.51e-6 * w, rel=2e-3)
        torque, w, top = sliding(volts, friction_level_change={"factor": 1.3})
        assert torque == pytest.approx(1.3 * (np.sign(volts) * top + 10.51e-6 * w), rel=2e-3)
    # below the limit the same shape: 1.3 of the load goes as far, but for the guideway's share
    twice = {"friction_level_change": {"factor": 2.0}}
    softer = ride(0.05, 2000)["theta"][-1], ride(0.05, 2000, **twice)["theta"][-1]
    assert softer[1] < 0.6 * softer[0]
    aged = {"rising_static_friction": {"rate_per_decade": 0.2, "dwell_scale_s": 0.01, "release_m": 1e-4}}
    plain, grown = (breakaway(make_plant(machine, NoiseSpec.none(), e), 2.0) for e in ({}, aged))
    assert grown > 1.2 * plain
    for name in ("frictional_lag", "presliding_creep"):
        with pytest.raises(InputError, match=name):
            make_plant(machine, effects={name: EVERY[name]})
