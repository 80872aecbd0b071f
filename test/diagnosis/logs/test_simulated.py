"""Simulated machines that share no code with the project's model: right names, honest rivals, quiet when healthy."""

import dataclasses

import numpy as np
import pytest

from microstage_ros.diagnosis.logs.case import diagnose_logs
from microstage_ros.diagnosis.logs.selection import decide
from microstage_ros.diagnosis.logs.selection.course import change_points
from microstage_ros.diagnosis.logs.selection.sizes import widening
from microstage_ros.diagnosis.validation import foreign_machine as machines
from microstage_ros.diagnosis.validation import carried, log_campaign, simulated_logs


def machine_with(**values):
    """A plain machine: 100 N friction at top speed, cascade, trapezoids."""
    rng = np.random.default_rng(5)
    drawn = simulated_logs.draw_machine(rng)
    base = {"m": 20.0, "level": 60.0, "stribeck": 0.1, "vs": 0.002, "viscous": 300.0, "asym": 0.0, "const": 5.0, "wave1": 0.02, "wave2": 0.0, "ripple": 1.0,
            "order": 1.0, "ripple2": 0.0, "lead": 0.005, "middle": 0.05, "half": 0.05, "bump_at": 0.05, "bump_width": 0.005, "kp": 20.0, "kv": 2500.0, "ki": 15.0,
            "walk": 0.01}
    return dataclasses.replace(drawn, law="coulomb", controller="cascade", profile="trapezoid", low=0.0, high=0.1, top=0.1, sharp=0.5, dwell=0.4,
                               values={**drawn.values, **base, **values})


def logs_of(machine, runs=6, signals="reference position current", seed=3, rate=250.0):
    """One log of a machine and its description."""
    rng = np.random.default_rng(seed)
    names, signed = simulated_logs.SIGNALS[signals]
    degrade = {"names": names, "signed": signed, "rate": rate, "gain": 0.02, "noise": 1.0, "quantum": 0.0, "place_noise": 2e-6, "run": 0.005, "load_side": True,
               "temperature": 0.01, "ohmic": 0.7, "force_of_1_V": 60.0}
    return simulated_logs.log_of(machine, runs, 2, rng, degrade, {}, f"log_{seed}")


def describe(signals):
    """The description that goes with `logs_of`."""
    from microstage_ros.records.logs.description import description_of
    names, signed = simulated_logs.SIGNALS[signals]
    units = {"current": "A", "torque": "N m", "velocity": "m/s"}
    return description_of({"time": {"column": "t", "unit": "s"}, **{q: {"column": q, "unit": units.get(q, "m"), **({"signed": signed} if q == "current" else {})}
                                                                   for q in names}, "run": ["run"], "lead": {"value": 5, "unit": "mm"}}, "case")


def diagnosed(change, signals="reference position current", **options):
    """Diagnosis of a machine with changed values against itself."""
    healthy = machine_with()
    faulty = machine_with(**change)
    return diagnose_logs([logs_of(healthy, signals=signals, **options)], [logs_of(faulty, signals=signals, seed=9, **options)], describe(signals))


def told(result):
    """First name or group of rivals."""
    causes = [c.id for c in result.diagnosis.causes]
    return causes, [i for r in result.diagnosis.rivals for i in r.ids]


@pytest.mark.parametrize("change, name", [
    ({"level": 90.0}, "friction_level_change"), ({"viscous": 900.0}, "viscous_change"), ({"spring": 600.0}, "cable_spring"),
    ({"ripple": 20.0}, "torque_ripple"), ({"const": 40.0}, "gravity_tilt"), ({"m": 80.0}, "payload_change"), ({"wave1": 0.4}, "position_dependent_friction")])
def test_right_name_first_or_among_the_rivals(change, name):
    causes, rivals = told(diagnosed(change))
    assert causes[:1] == [name] or name in rivals, (causes, rivals)
    assert set(causes) <= {name, "floor_vibration"}      # a slower end of motion may ring on in the error at rest


def test_lost_motion_shows_in_the_error_alone():
    result = diagnosed({"gap": 2e-4})
    causes, rivals = told(result)
    assert "backlash" in (causes or rivals)
    width = next((c.parameters["width_m"] for c in result.diagnosis.causes if c.id == "backlash"), None)
    assert width is None or width.value == pytest.approx(2e-4, abs=1.5e-4)


def test_without_a_sign_friction_and_asymmetry_stay_apart():
    causes, rivals = told(diagnosed({"level": 95.0}, "error |current|"))
    assert "friction_level_change" in causes + rivals


def test_healthy_agrees_and_lists_its_blind_spots():
    result = diagnosed({})
    assert result.diagnosis.verdict == "agrees" and not result.diagnosis.causes
    assert "refractive_index" in result.hidden and "resistance_rise" in result.hidden


def test_friction_is_sized():
    result = diagnosed({"level": 90.0, "stribeck": 0.1})
    sizes = [c.parameters["factor"] for c in result.diagnosis.causes if c.id == "friction_level_change"]
    for p in sizes:                  # relative to all of the friction at top speed: (90 − 60) / 90 of it more
        assert p.value == pytest.approx(1.0 + 30.0 / 90.0, abs=max(2.5 * p.stderr, 0.08))


def test_healthy_machines_are_left_in_peace():
    """Twelve drawn machines; a rate of false alarms of 1 in 60 gives two or more in fewer than two runs of a hundred."""
    outcomes = list(log_campaign.run(12, seed=101, kind="healthy"))
    assert sum(o.result == "alarm" for o in outcomes) <= 1


def test_an_empty_course_has_no_change_and_a_step_has_one():
    rng = np.random.default_rng(0)
    noise = 0.01 * rng.standard_normal(40)
    assert change_points(noise, np.full(40, 0.01)) == []
    stepped = noise + np.where(np.arange(40) >= 25, 0.1, 0.0)
    assert change_points(stepped, np.full(40, 0.01)) == [25]


def test_the_simulated_axis_obeys_newton():
    """At constant speed the force is friction: level · (1 + …) + viscous · v + const."""
    m = machine_with(ripple=0.0, wave1=0.0, walk=0.0, asym=0.0, const=5.0)
    rng = np.random.default_rng(1)
    reference = machines.reference_of("trapezoid", 0.0, 0.1, 0.1, 0.5, 0.4, 1, rng)
    out = machines.run(reference, machines.DT, m.vector(), 0, 0, 1)
    steady = (np.gradient(reference, machines.DT) > 0.099) & (np.abs(out[:, 1] - 0.1) < 5e-4)
    assert np.median(out[steady, 2]) == pytest.approx(60.0 + 30.0 + 5.0, rel=0.02)


def test_few_repetitions_widen_intervals():
    assert widening(3) == pytest.approx(3.182 / 1.96, rel=1e-3) and widening(1e6) == pytest.approx(1.0, rel=1e-3)


def test_a_peak_after_a_rest_is_rising_static_friction_or_an_unresolved_ripple():
    causes, rivals = told(diagnosed({"rise": 0.8}))
    assert "rising_static_friction" in causes + rivals, (causes, rivals)


def test_what_lies_behind_the_motor_is_not_looked_for_at_the_motor():
    description = dataclasses.replace(describe("reference position current"), position_at="motor")
    healthy, faulty = machine_with(), machine_with(gap=2e-4)
    result = diagnose_logs([logs_of(healthy)], [logs_of(faulty, seed=9)], description)
    causes, rivals = told(result)
    assert not {"backlash", "drive_compliance", "screw_pitch_error"} & {*causes, *rivals}
    assert "moved part" in result.hidden["backlash"]


def test_every_effect_of_the_catalogue_is_examined():
    from microstage_ros.diagnosis.logs.selection.effects import NEVER, SIGNATURES
    assert set(simulated_logs.EFFECTS) == {*NEVER, *SIGNATURES}


def test_the_signals_carry_what_exceeds_the_scatter_of_healthy_logs():
    """Half as much friction again is carried by a current; the refractive index by no signal of a loop closed on its own reading."""
    found = {}
    for effect in ("friction_level_change", "refractive_index"):
        case = simulated_logs.draw_case(1, 5, "one", effect, "reference position current")
        found[effect] = carried.distance(case, 0)
    assert found["friction_level_change"] > carried.LIMIT > found["refractive_index"] == 0.0


def test_what_makes_the_reading_rough_shows_without_a_set_point():
    case = simulated_logs.draw_case(1, 7, "one", "floor_vibration", "position |current|")
    causes, rivals = told(diagnose_logs(list(case.baseline), list(case.now), case.description))
    assert "floor_vibration" in causes + rivals, (causes, rivals)


def test_every_rival_that_was_tried_has_a_size():
    result = diagnosed({"level": 90.0, "viscous": 450.0})
    ids, sizes = result.diagnosis.rivals[0].ids, result.rival_sizes[0]
    assert "friction_level_change" in ids and sizes["friction_level_change"]["factor"].value == pytest.approx(1.5, abs=0.12)
    assert set(sizes) <= set(ids) and all(sizes.values())


def test_a_delay_is_no_change_of_the_forces():
    """Forces go with the motion: a set point that acts 20 ms later is no friction, whatever else the error may mean."""
    causes, rivals = told(diagnosed({"delay": 0.02}))
    assert (causes or rivals)[0] == "transport_delay" and not {*causes, *rivals} & {"friction_level_change", "viscous_change"}, (causes, rivals)


def test_what_is_named_or_open_is_not_listed_as_not_visible(monkeypatch):
    from microstage_ros.diagnosis.logs.selection import effects, verdict
    monkeypatch.setattr(verdict, "hidden_effects", lambda seen, context: dict.fromkeys(effects.SIGNATURES, "more"))
    result = diagnosed({"level": 90.0, "viscous": 450.0})
    causes, rivals = told(result)
    assert rivals and not {*causes, *rivals} & set(result.hidden) and "screw_pitch_error" in result.hidden


def test_the_gain_is_of_repetitions_that_neither_chose_nor_sized_the_cause(monkeypatch):
    """Each half of the six is judged by what the other three choose alone; what they do not choose gains nothing."""
    choose, seen = decide.choose, []

    def watched(problem, *options):
        seen.append(problem.difference)
        return choose(problem, *options)

    monkeypatch.setattr(decide, "choose", watched)
    found = diagnosed({"spring": 600.0}).diagnosis
    assert "chosen and sized on the other" in found.gain.metric
    assert found.gain.after < 0.5 * found.gain.before and found.causes[0].share > 0.8
    effort = [difference for difference in seen if len(difference) == len(seen[0])]
    whole, even, odd = effort[0], *effort[-2:]
    assert not np.allclose(even, odd) and np.allclose(0.5 * (even + odd), whole, atol=1e-6)

    monkeypatch.setattr(decide, "choose", lambda *given: [] if len(seen) == 2 else seen.append(0) or choose(*given))
    seen.clear()
    alone = diagnosed({"spring": 600.0}).diagnosis
    assert [cause.id for cause in alone.causes] == ["cable_spring"] and alone.causes[0].share == 0.0
    assert alone.gain.after == alone.gain.before and any("would not name" in note for note in alone.notes)


def test_the_gain_of_a_single_repetition_says_that_it_is_none_on_others():
    found = diagnosed({"spring": 600.0}, runs=1).diagnosis
    assert [cause.id for cause in found.causes] == ["cable_spring"]
    assert "no gain on others" in found.gain.metric and any("one repetition of now only" in note for note in found.notes)
