"""The first voltages on machines with a fault: each is found, named, and hardly anything has moved."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from machines import Machine, random_axis

from microstage_ros.commissioning.findings import Refused, refused
from microstage_ros.commissioning.experiments.closed_loop import Loop
from microstage_ros.commissioning.experiments.dead_encoder import RIGID, EncoderWatch, standing
from microstage_ros.commissioning.experiments.first_motion import first_motion
from microstage_ros.commissioning.experiments.machine import Machine as Hand
from microstage_ros.commissioning.experiments.open_loop import strokes
from microstage_ros.commissioning.procedure import Outcome
from microstage_ros.commissioning.report import report_tree
from microstage_ros.commissioning.sketch import load_sketch
from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.protocol import Setup
from microstage_ros.model.transmission import motor_ratio
from microstage_ros.places import config_file
from microstage_ros.records.record import Record

SKETCH = load_sketch(config_file("axis.yaml"))


def begun(tmp_path, fault="", seed=1, **options):
    """A machine in hand, on a truth within a factor of two of the sketch."""
    random_axis(SKETCH.axis, seed).save(tmp_path / "truth.yaml")
    backend = make_hardware("machines:Machine", Setup(SKETCH.axis, seed, {"truth": str(tmp_path / "truth.yaml"), "fault": fault, **options}))
    backend.open()
    hand = Hand(backend, SKETCH.axis)
    hand.begin()
    return hand


def kept(name, record):
    """Records are not needed here."""


def test_a_good_machine(tmp_path):
    hand = begun(tmp_path)
    first, checks = first_motion(hand, SKETCH, kept)
    assert all(check.passed for check in checks) and first.has_current and first.delay == 0.0
    assert first.resistance == pytest.approx(Machine.made[-1].axis.value("drive.resistance"), rel=0.06)
    assert Machine.made[-1].highest - Machine.made[-1].lowest < 3e-6
    found, check = strokes(hand, SKETCH, first, kept)
    assert check.passed and found.resistance == pytest.approx(Machine.made[-1].axis.value("drive.resistance"), rel=0.03)


@pytest.mark.parametrize("fault, check", [
    ("motor_polarity", "polarity"), ("encoder_polarity", "polarity"), ("encoder_dead", "encoder_dead"), ("stuck", "stuck"),
    ("current_polarity", "current_polarity"), ("delay", "delay")])
def test_a_fault_is_named_before_anything_has_moved(tmp_path, fault, check):
    hand = begun(tmp_path, fault, seed=2)
    with pytest.raises(Refused) as caught:
        first_motion(hand, SKETCH, kept)
    machine = Machine.made[-1]
    assert caught.value.check.id == check and not caught.value.check.passed
    assert machine.highest - machine.lowest < 1e-5 and machine._voltage == 0.0


@pytest.mark.parametrize("fault", ["counts_quarter", "counts_fourfold"])
def test_an_encoder_that_counts_wrong(tmp_path, fault):
    hand = begun(tmp_path, fault, seed=3)
    first, _ = first_motion(hand, SKETCH, kept)
    with pytest.raises(Refused) as caught:
        strokes(hand, SKETCH, first, kept)
    assert caught.value.check.id == "encoder_scale"
    assert Machine.made[-1].highest - Machine.made[-1].lowest < 2e-3


def test_a_soft_drive_train_is_no_wrong_scale(tmp_path):
    """Its swing at 180 Hz is as long as the strokes' acceleration: the inertia has to come out all the same."""
    hand = begun(tmp_path, seed=28)
    first, _ = first_motion(hand, SKETCH, kept)
    found, check = strokes(hand, SKETCH, first, kept)
    truth = Machine.made[-1].axis
    ratio = motor_ratio(truth)
    inertia = truth.value("drive.rotor_inertia") + ratio**2 * truth.value("stage.mass")
    assert check.passed
    assert found.inertia * truth.value("drive.torque_constant") * ratio / truth.value("drive.resistance") == pytest.approx(inertia, rel=0.25)
    assert found.volts_per_speed * ratio == pytest.approx(truth.value("drive.back_emf"), rel=0.01)


@pytest.mark.parametrize("after", [30000, 50000])
def test_an_encoder_that_freezes_in_motion(tmp_path, after):
    """Found by the back-EMF before the stage has gone 10 µm."""
    hand = begun(tmp_path, "encoder_frozen", seed=5, frozen_after=after)
    first, _ = first_motion(hand, SKETCH, kept)
    with pytest.raises(Refused) as caught:
        strokes(hand, SKETCH, first, kept)
    machine = Machine.made[-1]
    assert caught.value.check.id == "encoder_dead" and machine._voltage == 0.0
    assert machine.wrong < 1e-5 and machine.wrong_time < 0.1


@pytest.mark.parametrize("fault", ["no_current", "zero_current"])
def test_without_a_current_it_goes_on(tmp_path, fault):
    hand = begun(tmp_path, fault)
    first, checks = first_motion(hand, SKETCH, kept)
    assert not first.has_current and math.isnan(first.delay)
    assert {check.id: check.passed for check in checks}["current_missing"]


def test_what_a_backend_has_beside_its_sensors(tmp_path, monkeypatch):
    """Time stamps, temperature and index mark are asked for where they are, and are in the report."""
    monkeypatch.setattr(Machine, "reading_time", lambda self: 1.01e-4 * self.reads, raising=False)
    monkeypatch.setattr(Machine, "temperature", lambda self: 295.15, raising=False)
    monkeypatch.setattr(Machine, "index", lambda self: 1.5e-3, raising=False)
    hand = begun(tmp_path)
    hand.rest(0.01)
    hand.note_surroundings()
    assert hand.instruments["interval_s"] == pytest.approx([1.01e-4, 1.01e-4])
    assert hand.instruments["temperature_K"] == [295.15] and hand.instruments["index_m"] == 1.5e-3
    answer = report_tree(Outcome(), hand)
    assert answer["instruments"]["index_m"] == 1.5e-3


def test_a_heavy_drive_is_braked_when_the_encoder_freezes(tmp_path):
    """The watch alone: found within some periods, the motor stopped by pulses against it, no 10 µm in all."""
    hand = begun(tmp_path, "encoder_frozen", seed=9, frozen_after=2000)
    truth = Machine.made[-1].axis
    ratio = motor_ratio(truth)
    emf, resistance = truth.value("drive.back_emf"), truth.value("drive.resistance")
    inertia = (truth.value("drive.rotor_inertia") + ratio**2 * truth.value("stage.mass")) * resistance / truth.value("drive.torque_constant") / ratio
    hand.watch = EncoderWatch(hand.period, resistance, emf / ratio, 0.0, hand.count, inertia)
    with pytest.raises(Refused) as caught:
        hand.run(np.zeros(4000), lambda n, x, i: 1.5)
    machine, before = Machine.made[-1], hand.last["encoder_m"]
    assert caught.value.check.id == "encoder_dead" and machine._voltage == 0.0
    assert 0.7 < (before[1999] - before[1899]) / (100 * hand.period) / hand.watch.safe_speed(hand.limit) < 1.1  # as fast as is allowed
    hand.watch = None
    hand.rest(0.05)
    assert machine.wrong < 1e-5


COUNT = 1e-7  # of a coarse encoder [m]


def watched(encoder, speed, known, period=1e-4):
    """Way [m] of a motor at ``speed`` [m/s] until the watch refuses beside ``encoder`` [m]; None where it does not."""
    watch = EncoderWatch(period, 2.0, 500.0, count=COUNT, standing=known)
    for n, x in enumerate(encoder):
        try:
            watch.row(round(x / COUNT) * COUNT, 500.0 * speed, 0.0)
        except Refused as end:
            assert end.check.id == "encoder_dead"
            return n * period * abs(speed)
    return None


def test_a_stage_that_swings_on_a_soft_drive_train_stands_for_longer():
    """Its speed and acceleration come to zero together: seed 2018 was refused as `end_stop`."""
    known, speed = standing(SKETCH, COUNT), 1.5e-3
    assert known.softest == pytest.approx(SKETCH.axis.value("transmission.stiffness") / SKETCH.axis.value("stage.mass") / 4.0)
    t, rate = 1e-4 * np.arange(-100, 100), math.sqrt(known.softest)
    swinging = speed * t - speed / rate * np.sin(rate * t)
    assert watched(swinging, speed, RIGID) is not None and watched(swinging, speed, known) is None


@pytest.mark.parametrize("speed", [1e-3, 3e-3, -3e-3])
def test_a_dead_encoder_is_found_in_the_way_that_a_live_one_may_take(speed):
    """And in a micron where it stood all at once, as no stage on its drive train does."""
    known = standing(SKETCH, COUNT)
    still = watched(np.zeros(200), speed, known)
    assert known.way(abs(speed)) <= still < known.way(abs(speed)) / 0.95 + 3e-4 * abs(speed)
    frozen = watched(np.minimum(np.arange(-5, 100), 0) * 1e-4 * speed, speed, known) - 5e-4 * abs(speed)
    assert 1e-6 <= frozen < 1e-6 / 0.95 + 3e-4 * abs(speed) or known.last_step(abs(speed), 1e-4) > 1e-4 * abs(speed)
    assert 1e-6 == RIGID.way(abs(speed)) <= known.way(1e-5) < known.way(1e-3) < known.way(3e-3) <= 3e-6


def test_at_long_periods_a_softer_drive_train_is_driven_more_slowly():
    """Where a reading takes as long as the stage takes to stop, a dead encoder is found later."""
    for period, slower in ((1e-4, False), (5e-4, True)):
        hard, soft = (EncoderWatch(period, 2.0, 500.0, 0.0, 25e-9, 3.0, 0.1, standing=s) for s in (RIGID, standing(SKETCH, 25e-9)))
        speed, slowing = soft.safe_speed(6.0), 0.85 * 0.9 * 6.0 / 3.0
        way = soft.standing.way(speed) if slower else 1e-6
        assert way + 4.0 * period * speed + speed**2 / 2.0 / slowing == pytest.approx(8e-6, rel=1e-4)
        assert (speed < hard.safe_speed(6.0)) == slower


def test_the_cards_watchdog_is_armed_while_voltages_are_written():
    """Between two runs something is computed at zero volts: a card that cuts its output then would end everything."""
    calls = []

    class Card:
        simulated = True

        def read(self):
            calls.append("read")
            return 0.0, 0.0, 0.0

        def write(self, voltage):
            calls.append("write")

        def watchdog(self, seconds):
            calls.append(seconds)

    hand = Hand(Card(), SKETCH.axis)
    hand.begin()
    assert calls.index(0.0) < calls.index("read")
    del calls[:]
    hand.rest(3e-4)
    assert calls[0] == pytest.approx(0.1) and calls[-2:] == ["write", 0.0] and calls.count("read") == 3


def test_a_stage_that_runs_on_past_its_target_is_not_blocked(tmp_path):
    """The reference has come to its end and stands, the stage goes on at 2 mm/s: it does not follow."""
    hand = begun(tmp_path)
    loop = Loop(hand, SKETCH.axis, "self_tuning", 0.1)
    n, period = 400, hand.period
    beyond = 1e-4 + 2e-3 * period * np.arange(n)
    table = {"encoder_m": beyond, "reference_m": np.zeros(n), "voltage_V": np.full(n, 1.6)}
    with pytest.raises(Refused, match="does not follow") as end:
        loop._explain(Record(period, table), 1e-4)
    assert end.value.check.id == "runaway"


def test_a_stage_that_swings_wide_gets_softer_gains_until_it_rests():
    """A wide swing ends the motion as one that the motor does not share; it is a swing all the same (seed 214)."""

    class Swinging(Loop):
        def follow(self, reference):
            if self.share > 0.7:
                raise refused("runaway", 7e-6, "m", "in closed loop the stage swings")
            still = np.full(len(reference), 1e-8)
            return Record(1e-4, {"encoder_m": still, "reference_m": reference, "voltage_V": reference})

    machine = SimpleNamespace(position=0.0, count=25e-9, noise=8e-9, failed="a record",
                              periods=lambda s: round(s / 1e-4), rest=lambda s: None)
    loop = Swinging(machine, SKETCH.axis)
    assert len(loop.settle()) == 5000 and loop.share == pytest.approx(0.64) and machine.failed is None
