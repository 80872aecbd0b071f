"""The compiled step as a whole: against an independent integration, against conservation, for itself."""

import numpy as np
import pytest

from microstage_ros.model.plant_record import PLANT, STATE
from microstage_ros.solver.ensembles.ensemble import respond_batch
from microstage_ros.solver.open_loop import COLUMNS, respond, run_open_loop
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work

from .brute_force import run as brute_force

TIME = np.arange(3000) * 1e-4
SIGNALS = {
    "step 0.5 V": 0.5 + 0 * TIME,
    "step 3 V": 3.0 + 0 * TIME,
    "ramp to 3 V": 10.0 * TIME,
    "hold below breakaway": 0.05 + 0 * TIME,
    "reversals 3 V": 3.0 * np.sign(np.sin(2 * np.pi * 7 * TIME + 1e-9)),
    "multi-sine": 1.2 * np.sin(44 * TIME) + 0.9 * np.sin(145 * TIME + 1) + 0.6 * np.sin(446 * TIME + 2),
    "small reversals": 0.06 * np.sin(30 * TIME) + 0.03 * np.sin(200 * TIME),
}


@pytest.mark.parametrize("name", SIGNALS)
def test_open_loop_within_a_nanometre_of_the_converged_solution(quiet, name):
    voltage = SIGNALS[name]
    coarse, fine = (brute_force(voltage, n, 1e-4, 1) for n in (400, 800))
    assert np.max(np.abs(coarse - fine)) < 1e-9          # the examiner itself has converged
    assert np.max(np.abs(respond(quiet(), voltage)["x"] - fine)) < 1e-9


def test_same_seed_same_bits_and_threads_do_not_matter(axis):
    plant = make_plant(axis)
    voltage = 0.3 * np.sin(40 * TIME)
    first, again, other = (respond(plant, voltage, seed)["encoder"] for seed in (5, 5, 6))
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    plants = np.zeros(6, PLANT)
    ends = []
    for threads in (1, 2):
        states = np.zeros(6, STATE)
        for k in range(6):
            plants[k], states[k] = plant, new_state(plant, k)
        respond_batch(plants, voltage, states, threads)
        ends.append(states["x"].copy())
    assert np.array_equal(*ends) and len(set(ends[0])) == 6


def test_axes_side_by_side_are_to_the_bit_what_each_is_alone(axis):
    """Different axes and voltages through rest, breakaway and sliding; some with noise or random friction, one with an effect, and a group not full."""
    noises = [NoiseSpec.none(), NoiseSpec(friction_relative=0.0), NoiseSpec()]
    plants = np.zeros(21, PLANT)
    for k in range(21):
        values = {"drive.resistance": 3.41 * (1.0 + 0.01 * k), "contacts.actuator.static": 219e-6 * (1.0 + 0.02 * k)}
        effects = {"direction_asymmetry": {"asymmetry": 0.1}} if k % 4 == 1 else {"cable_spring": {"stiffness_N_m": 50.0}} if k == 18 else {}
        plants[k] = make_plant(axis.with_values(values), noises[k % 3], effects)
    for name, voltage in SIGNALS.items():
        states, alone = np.zeros(21, STATE), np.zeros(21, STATE)
        for k in range(21):
            states[k] = alone[k] = new_state(plants[k], k)
        respond_batch(plants, voltage, states, 1)
        for k in range(21):
            run_open_loop(plants[k], alone[k], new_work(plants[k]), new_readings(), voltage, np.empty((0, len(COLUMNS))))
        assert _differences(states, alone) == [], name


def _differences(a, b, name=""):
    """Names of the fields in which two arrays of records differ."""
    if a.dtype.names:
        return [found for field in a.dtype.names for found in _differences(a[field], b[field], f"{name}.{field}")]
    return [] if np.array_equal(a, b, equal_nan=True) else [name]


def test_steady_sliding_balances_volts_and_newtons(quiet):
    end = {name: column[-1] for name, column in respond(quiet(), 2.0 + 0 * np.arange(8000.0)).items()}
    w = end["omega"] / 19
    friction = 125.6e-6 + 93.4e-6 * np.exp(-((w / 0.18) ** 0.9)) + 10.51e-6 * w
    guide = 0.9 + 20.0 * end["v"]
    lead = 2e-3 / (2 * np.pi) / 19
    assert 3.41 * end["current"] + 6.589014636e-3 * end["omega"] == pytest.approx(2.0, rel=1e-6)
    assert 6.59e-3 * end["current"] == pytest.approx(friction + lead * guide, rel=1e-6)
    assert end["torque_friction"] == pytest.approx(friction, rel=1e-6)


def test_free_axis_at_rest_stays_at_rest(quiet):
    assert np.all(np.abs(respond(quiet(), np.zeros(500))["x"]) < 1e-15)  # m: the last bits of the first state


def test_axis_gives_back_no_more_than_it_was_given(axis, quiet):
    """Electrical work done on the axis ≥ kinetic energy held, for a rough ride through all regimes."""
    rng = np.random.default_rng(4)
    voltage = np.repeat(rng.uniform(-2, 2, 100), 30)
    r = respond(quiet(), voltage)
    work = np.cumsum(voltage * r["current"]) * 1e-4
    kinetic = 0.5 * 1e-7 * r["omega"] ** 2 + 0.5 * 3.06 * r["v"] ** 2
    assert np.all(work - kinetic > -1e-6)


def test_a_period_that_holds_many_events_is_survived(quiet):
    rng = np.random.default_rng(1)
    r = respond(quiet(backlash={"width_rad": 0.01}), rng.uniform(-6, 6, 3000))
    assert all(np.all(np.isfinite(column)) for column in r.values())
    assert np.max(np.abs(r["v"])) < 0.02


def test_force_driven_rigid_axis_against_its_equation():
    from microstage_ros.model.axis_file import load_axis

    from .conftest import CONFIG

    axis = load_axis(CONFIG / "emps.yaml")
    plant = make_plant(axis, NoiseSpec.none())
    t = np.arange(1000) * 1e-3
    x = respond(plant, 2.0 + 0 * t)["x"]
    force, f, c, m = 2.0 * 35.150651 + 3.1648, 20.3935, 203.5034, 95.1089      # never reverses: closed form
    exact = (force - f) / c * (t - m / c * (1 - np.exp(-c * t / m)))
    assert np.max(np.abs(x - exact)) < 2e-6 and exact[-1] > 0.1


def test_coulomb_contact_holds_below_its_level_and_lets_go_above():
    from microstage_ros.model.axis_file import load_axis

    from .conftest import CONFIG

    plant = make_plant(load_axis(CONFIG / "emps.yaml"), NoiseSpec.none())
    hold = (20.3935 - 3.1648 - 0.5) / 35.150651
    assert np.ptp(respond(plant, np.full(2000, hold))["x"][1000:]) < 1e-9
    assert respond(plant, np.full(2000, hold + 1.0 / 35.15))["x"][-1] > 1e-3


LAWS = {
    "dahl": {"stiffness": (1.2, "N m/rad")},
    "lugre": {"stiffness": (1.2, "N m/rad"), "damping": (1e-5, "N m s/rad")},
    "elasto_plastic": {"stiffness": (1.2, "N m/rad"), "damping": (1e-5, "N m s/rad")},
    "leuven": {"stiffness": ([1.0, 0.2], "N m/rad"), "weight": ([0.6, 0.4], "1")},
    "hsieh_pan": {"stiffness": ([1.0, 0.2], "N m/rad"), "weight": ([0.6, 0.4], "1"), "creep_velocity": (1e-8, "rad/s"),
                  "sharpness": (8.0, "1"), "hardening": (0.2, "N m/rad")},
}


NO_DROP = ("dahl", "hsieh_pan")


def with_law(axis, law):
    """The paper's axis with another law at the actuator."""
    from microstage_ros.model.axis_file import axis_from_dict

    tree = axis.as_dict()
    curve = {k: v for k, v in tree["contacts"]["actuator"].items()
             if k in ("static", "viscous") or (law not in NO_DROP and k in ("coulomb", "stribeck_velocity", "stribeck_exponent"))}
    own = {k: {"value": v, "unit": unit, "source": "estimate"} for k, (v, unit) in LAWS[law].items()}
    tree["contacts"]["actuator"] = {"law": law, **curve, **own}
    return axis_from_dict(tree)


@pytest.mark.parametrize("law", LAWS)
def test_any_law_of_the_library_may_be_a_contact(axis, law):
    """Holds below its limit, slides at the friction its steady curve says, the same at half the chunk."""
    plant = make_plant(with_law(axis, law), NoiseSpec.none())
    r = respond(plant, np.concatenate([np.full(1000, 0.05), np.full(5000, 2.0)]))
    assert np.ptp(r["x"][700:1000]) < 3e-9
    w = r["omega"][-1] / 19
    top = 219e-6 if law in NO_DROP else 125.6e-6 + 93.4e-6 * np.exp(-((w / 0.18) ** 0.9))
    assert r["torque_friction"][-1] == pytest.approx(top + 10.51e-6 * w, rel=2e-3)
    plant["base_level"] = 6
    finer = respond(plant, np.concatenate([np.full(1000, 0.05), np.full(5000, 2.0)]))
    assert np.max(np.abs(finer["x"] - r["x"])) < 3e-8


@pytest.mark.parametrize("attraction", [300.0, 3e3, 3e6])
def test_a_guideway_may_have_generalised_blocks(axis, attraction):
    """In slip its force obeys df/dt = C (1 − f/s(v)) along the velocities that came out, for C slow to immediate."""
    from microstage_ros.model.axis_file import axis_from_dict

    tree = axis.as_dict()
    values = {"static": (1.8, "N"), "coulomb": (0.9, "N"), "stribeck_velocity": (2e-4, "m/s"), "stribeck_exponent": (1.0, "1"),
              "viscous": (20.0, "N s/m"), "attraction": (attraction, "N/s"), "stiffness": ([2e6, 4e5], "N/m"), "weight": ([0.6, 0.4], "1")}
    tree["contacts"]["guideway"] = {
        "law": "generalised_maxwell_slip", **{k: {"value": v, "unit": unit, "source": "estimate"} for k, (v, unit) in values.items()}}
    plant = make_plant(axis_from_dict(tree), NoiseSpec.none())
    for sign in (1.0, -1.0):
        r = respond(plant, sign * (0.7 + 0.3 * np.sin(90 * TIME)))
        v, friction = sign * r["v"][500:], sign * r["guide_friction"][500:] - 20.0 * sign * r["v"][500:]
        assert v.min() > 1e-4                      # all of it slides
        parts = 20
        force, expected = friction[0], []
        fine = np.interp(np.arange(parts * (len(v) - 1)) + 0.5, parts * np.arange(len(v)), v)
        for n, s in enumerate(0.9 + 0.9 * np.exp(-fine / 2e-4)):
            force = s + (force - s) * np.exp(-attraction / s * 1e-4 / parts)
            if n % parts == parts - 1:
                expected.append(force)
        np.testing.assert_allclose(friction[1:], expected, rtol=0, atol=1e-3 * np.ptp(friction))
