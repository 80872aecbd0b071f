"""Drives that are commanded with a torque, a force or a voltage on a coil: from the least sketch on, with the same checks."""

import json
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from machines import Machine, random_axis

from microstage_ros.commands.operation import commission
from microstage_ros.commissioning import procedure
from microstage_ros.commissioning.estimation.known import moving_mass, split_mass
from microstage_ros.commissioning.estimation.parameters import draws
from microstage_ros.commissioning.estimation.plant_fit import resonance_of
from microstage_ros.commissioning.experiments.first_motion import first_motion
from microstage_ros.commissioning.experiments.machine import Machine as Hand
from microstage_ros.commissioning.experiments.short_pulses import ShortPulses
from microstage_ros.commissioning.experiments.sliding import Slide
from microstage_ros.commissioning.findings import Refused
from microstage_ros.commissioning.sketch import load_sketch
from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.protocol import Setup
from microstage_ros.identification.estimators.estimate import Estimate
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file

FILES = {"current_motor": "axes/current_motor.yaml", "force": "emps.yaml"}
LEAST = {"current_motor": "current_limit", "force": "voltage_limit"}


def sketched(folder, kind, seed):
    """A sketch with only what must be given, at 1 kHz, beside a machine within a factor of two of the shipped axis."""
    axis = load_axis(config_file(FILES[kind])).with_values({"period": 1e-3}, source="derived").with_controller({"type": "pid"})
    random_axis(axis, seed).save(folder / "truth.yaml")
    tree = axis.as_dict()
    transmission = {key: tree["transmission"][key] for key in ("type", "gear_ratio", "pitch") if key in tree["transmission"]}
    least = {"format": 1, "period": tree["period"], "travel": tree["travel"], "transmission": transmission,
             "drive": {"type": kind, LEAST[kind]: tree["drive"][LEAST[kind]]}, "sensors": {"encoder": {"resolution": tree["sensors"]["encoder"]["resolution"]}}}
    (folder / "sketch.yaml").write_text(yaml.safe_dump(least))


def run(folder, fault="", seed=1, **more):
    """(exit status, report) of the command."""
    (folder / "options.yaml").write_text(yaml.safe_dump({"truth": str(folder / "truth.yaml"), "fault": fault, **more}))
    status = commission.main(["--axis", str(folder / "sketch.yaml"), "--backend", "machines:Machine", "--backend-options",
                              str(folder / "options.yaml"), "--out", str(folder / "out"), "--seed", str(seed)])
    return status, json.loads((folder / "out" / "report.json").read_text())


def test_a_force_drive_is_ready(tmp_path):
    sketched(tmp_path, "force", 1)
    status, report = run(tmp_path)
    assert status == 0 and report["verdict"] == "ready" and report["used"]["time_s"] < 300.0
    axis, truth = load_axis(tmp_path / "out" / "axis.yaml"), load_axis(tmp_path / "truth.yaml")
    # The volts of the command tell their ratio to the gain. In 8 of 8 runs both came out 0.6 to 0.9 % too large.
    for key, within in (("stage.mass", 0.02), ("contacts.guideway.coulomb", 0.02)):
        assert axis.value(key) / axis.value("drive.gain") == pytest.approx(truth.value(key) / truth.value("drive.gain"), rel=within), key
    assert axis.value("travel.minimum") < report["used"]["travel_min_m"] < report["used"]["travel_max_m"] < axis.value("travel.maximum")
    assert report["margins"]["measured"] and not report["parameters"]["stage.mass"]["determined"]


def test_a_current_driven_motor_is_identified(tmp_path, monkeypatch):
    """As far as the proof of a law, which the force drive goes through.

    Of 31 runs of four machines 7 were refused (95 %: 10 to 41 %) while draws of stage and rotor did not keep their sum; since then 2 of
    32 of the same machines (machines 2, 3, 5 and 7, seeds 6000 to 6007; 1 to 21 %). Eleven in a row at 41 % come once in 10^4 times.
    """
    sketched(tmp_path, "current_motor", 2)
    proved = []
    monkeypatch.setattr(procedure, "_prove", lambda outcome, machine, axis, drawn, law, *rest: proved.append((axis, law, machine)))
    monkeypatch.setattr("microstage_ros.commissioning.report.write_answer", lambda *arguments: None)
    for seed in range(1, 12):
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "report.json").write_text('{"verdict": "stopped"}')
        status, _ = run(tmp_path, seed=seed)
        if proved:
            break
        assert status == 3
        shutil.rmtree(tmp_path / "out")
    (axis, law, machine), truth = proved[0], load_axis(tmp_path / "truth.yaml")
    assert status == 0 and law == "pid_feedforward"
    assert moving_mass(axis) == pytest.approx(moving_mass(truth), rel=0.05)
    assert axis.value("drive.torque_constant") == pytest.approx(truth.value("drive.torque_constant"), rel=0.01)
    assert axis.value("contacts.guideway.coulomb") == pytest.approx(truth.value("contacts.guideway.coulomb"), rel=0.06)
    sent = machine.last.command / truth.value("drive.torque_constant")
    assert "torque_Nm" in machine.last and np.abs(sent).max() <= 1.02 * axis.value("drive.current_limit")


@pytest.mark.parametrize("fault, check, farthest", [
    ("motor_polarity", "polarity", 1e-5), ("encoder_dead", "stuck", 3e-4), ("stuck", "stuck", 1e-5), ("current_polarity", "current_polarity", 1e-5)])
def test_a_fault_is_named(tmp_path, fault, check, farthest):
    """A torque cannot tell a dead encoder from a clamped stage: the sentence names both, and the stage is stopped in between."""
    sketched(tmp_path, "current_motor", 3)
    status, report = run(tmp_path, fault)
    failed = [c for c in report["checks"] if not c["passed"]]
    assert status == 3 and [c["id"] for c in failed] == [check]
    assert check != "stuck" or ("brake" in report["says"] and "encoder" in report["says"] and "N m" in report["says"])
    machine = Machine.made[-1]
    assert machine.highest - machine.lowest < farthest and machine._voltage == 0.0


def pulsed(folder, kind, seed, fault="", **changes):
    """(id of the check that failed or "", machine) of the first motion, the sketch complete, within a factor of two."""
    sketch = load_sketch(config_file(FILES[kind]))
    sketch = replace(sketch, axis=sketch.axis.with_values(changes, source="datasheet"))
    random_axis(sketch.axis, seed).save(folder / "truth.yaml")
    backend = make_hardware("machines:Machine", Setup(sketch.axis, seed, {"truth": str(folder / "truth.yaml"), "fault": fault}))
    backend.open()
    hand = Hand(backend, sketch.axis)
    hand.begin()
    try:
        first_motion(hand, sketch, lambda name, record: None)
    except Refused as end:
        return end.check.id, Machine.made[-1]
    return "", Machine.made[-1]


@pytest.mark.parametrize("seed", [3051, 3052, 3053])
@pytest.mark.parametrize("kind", FILES)
def test_a_dead_encoder_costs_ten_microns_where_the_sketch_tells_mass_and_friction(tmp_path, kind, seed):
    """And 0.1 s of motion, over all pulses: up to 460 µm and 1.2 s were needed when pulses rose until a live one had to slide."""
    for fault, named in (("", ""), ("encoder_dead", "stuck"), ("motor_polarity", "polarity")):
        found, machine = pulsed(tmp_path, kind, seed, fault)
        assert found == named and machine._voltage == 0.0
        assert machine.wrong < 1e-5 and machine.wrong_time < 0.1


def test_a_stage_that_only_comes_back_from_short_pulses_is_not_said_to_go_backwards(tmp_path):
    """Its friction lets go under the counterpart of each pulse, which the spring before sliding helps: the longer pulses decide."""
    for fault, named in (("", ""), ("motor_polarity", "polarity")):
        assert pulsed(tmp_path, "current_motor", 7818, fault, period=5e-4)[0] == named


@pytest.mark.parametrize("level", [1.5, 3.0, 8.0])
def test_the_way_of_a_short_pulse_is_that_of_a_mass_with_friction(level):
    """Integrated in steps of a thousandth: what is left of a pulse and its counterpart."""
    short = ShortPulses(inertia=2.0, spread=3.0, friction=1.0, threshold=1e-7, rate=np.inf, returns=np.inf, limit=10.0, period=1e-3)
    length, place, speed, step = 4e-3, 0.0, 0.0, 4e-6
    for n in range(6000):
        command = level if n < 1000 else -0.5 * level if n < 3000 else 0.0
        free = command / 6.0 - np.sign(speed or command) / 6.0
        if speed == 0.0 and abs(command) <= 1.0:
            continue
        before, speed = speed, speed + free * step
        speed = 0.0 if before * speed < 0.0 else speed
        place += speed * step
    assert short.way(level, length) == pytest.approx(place, rel=0.01)


def test_short_pulses_are_as_long_as_a_coarser_encoder_or_a_softer_train_asks():
    sketch = load_sketch(config_file(FILES["current_motor"]))
    usual = ShortPulses.of(sketch, 0.012, 2e-8, 0.5)
    coarse = ShortPulses.of(sketch, 0.012, 2e-6, 0.5)
    soft = replace(usual, rate=0.1 * usual.rate)
    assert coarse.rows > 4 * usual.rows and soft.rows > 4 * usual.rows
    for short in (usual, coarse, soft):
        length = short.rows * short.period
        assert short.way(short.highest, length) >= short.threshold and short.highest <= short.limit
        assert short.highest * length * short.rate >= 1.5 * short.friction * 0.999
    assert replace(usual, limit=0.02).highest == 0.02  # less than the largest friction: nothing can be proven


def test_an_encoder_that_stands_ends_the_slide():
    """A speed loop on a dead encoder would push without end; one on a stage that sticks gets it moving again."""
    axis = load_axis(config_file(FILES["current_motor"]))
    machine = SimpleNamespace(position=0.0, period=1e-3, count=5e-8, periods=lambda s, least=1: max(round(s / 1e-3), least),
                              command=actuator_of(axis).command)
    slide = Slide(machine, SimpleNamespace(inertia=0.06, friction=0.01, volts_per_speed=0.1, viscous=0.0, offset=0.0), actuator_of(axis))
    command = slide.command(2e-3)
    pushes = [command(n, 2e-6 * n, 0.0) for n in range(100)]  # at speed: what friction takes, and no more
    assert not slide.held and pushes[-1] == pytest.approx(slide.base(2e-3), rel=1e-3)
    pushed = []
    with pytest.raises(Refused, match="stands for 40 ms") as end:
        for n in range(100, 200):
            pushed.append(command(n, 2e-4, 0.0))
    assert end.value.check.id == "encoder_dead" and n <= 152
    assert min(pushed[:38]) > 0.0 > max(pushed[42:])  # 40 ms on its way, 10 ms back
    command = slide.command(2e-3)
    pushes = [command(n, min(2e-6 * n, 2e-4), 0.0) for n in range(142)]
    assert pushes[-1] == pytest.approx(-slide.base(2e-3) - 0.01)  # friction 0.01 N m and what it may be more
    on = [command(142 + n, 2e-4 - 2e-7 * min(n, 2), 0.0) for n in range(30)]
    assert on[0] < 0.0 < on[5] and on[-1] == pytest.approx(slide.base(2e-3) + 0.01 + 20.0 * 0.06 * 2e-3, rel=0.01)


def test_what_moves_is_shared_out_by_what_is_known():
    """The motion tells the sum: a rotor of a data sheet stays, and the load takes the difference; their doubts are those of the sketch."""
    from microstage_ros.commissioning.sketch import sketch_from_dict

    tree = load_axis(config_file(FILES["current_motor"])).with_controller({"type": "pid"}).as_dict()
    tree["drive"]["rotor_inertia"]["tolerance"], tree["stage"]["mass"]["tolerance"] = 0.01, 1.0
    sketch = sketch_from_dict(tree)
    total = moving_mass(sketch.axis) + 10.0
    found = split_mass(sketch, total, 0.5)
    shared = sketch.axis.with_values({key: value for key, (value, _) in found.items()}, source="estimate")
    assert moving_mass(shared) == pytest.approx(total)
    assert found["stage.mass"][0] == pytest.approx(30.0, abs=0.3)
    rotor = actuator_of(sketch.axis).reflected_mass(sketch.axis) * sketch.spread("drive.rotor_inertia")
    assert found["stage.mass"][1] == pytest.approx(np.hypot(rotor, 0.5), rel=0.05)


def test_draws_keep_what_is_measured_together():
    """Stage and rotor known to 0.4 and 0.13 apart, to 0.02 together: drawn apart, their sum was off by up to 40 %, no gains had the
    margins on all of the draws, and good machines were refused at 1 ms."""
    axis, sketch = load_axis(config_file(FILES["current_motor"])), load_sketch(config_file(FILES["current_motor"]))
    axis = axis.with_values({"transmission.stiffness": 5e7}, source="identified", stderr={"transmission.stiffness": 5e5})

    def estimate(key, value, stderr):
        return Estimate(key, value, "1", stderr, value - stderr, value + stderr, stderr < 0.25 * value, "fit", "")

    total, rotor = moving_mass(axis), axis.value("drive.rotor_inertia")
    estimates = {e.key: e for e in (estimate("moving mass", total, 0.02 * total), estimate("stage.mass", 20.0, 8.0),
                                    estimate("drive.rotor_inertia", rotor, 0.13 * rotor), estimate("transmission.stiffness", 5e7, 2e7))}
    drawn = draws(axis, estimates, 40, 1, sketch)
    assert np.std([moving_mass(each) / total for each in drawn]) == pytest.approx(0.02, rel=0.4)
    assert np.std([resonance_of(each) / resonance_of(axis) for each in drawn]) < 0.02
    loads = np.array([each.value("stage.mass") for each in drawn])
    assert loads.std() > 4.0 and loads.min() >= 10.0 and loads.max() <= 40.0  # as the sketch allows
    free = draws(axis, estimates, 40, 1)
    assert max(each.value("stage.mass") for each in free) > 40.0
