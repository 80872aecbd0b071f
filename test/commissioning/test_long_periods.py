"""Periods of 1 ms: what lies within one counts there, at 0.1 ms it hardly shows."""

import math
from dataclasses import replace

import numpy as np
import pytest
from machines import random_axis

from microstage_ros.commissioning.design.law_choice import slower
from microstage_ros.commissioning.estimation.frequency_response import Response, measured_margins
from microstage_ros.commissioning.estimation.known import known_axis
from microstage_ros.commissioning.estimation.whole_loop import SLIDING, whole_margins
from microstage_ros.commissioning.experiments import measured_loop
from microstage_ros.commissioning.experiments.closed_loop import Loop
from microstage_ros.commissioning.experiments.dead_encoder import EncoderWatch
from microstage_ros.commissioning.experiments.first_motion import FirstMotion, first_motion
from microstage_ros.commissioning.experiments.machine import Machine as Hand
from microstage_ros.commissioning.experiments.open_loop import fit_strokes, strokes
from microstage_ros.commissioning.sketch import load_sketch
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.tuning.margins import frequency_response, loop_margins, observer_loop, regimes
from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.protocol import Setup
from microstage_ros.model.transmission import motor_ratio
from microstage_ros.places import config_file
from microstage_ros.records.record import Record

SKETCH = load_sketch(config_file("axis.yaml"))
SLOW = replace(SKETCH, axis=SKETCH.axis.with_values({"period": 1e-3}, source="datasheet"))
FORCE = load_sketch(config_file("emps.yaml"))


def begun(tmp_path, seed):
    """(machine of a seed at 1 ms, what its strokes tell, the truth)."""
    truth = random_axis(SLOW.axis, seed)
    truth.save(tmp_path / "truth.yaml")
    backend = make_hardware("machines:Machine", Setup(SLOW.axis, seed, {"truth": str(tmp_path / "truth.yaml")}))
    backend.open()
    hand = Hand(backend, SLOW.axis)
    hand.begin()
    first, _ = first_motion(hand, SLOW, lambda name, record: None)
    return hand, strokes(hand, SLOW, first, lambda name, record: None)[0], truth


@pytest.mark.parametrize("seed", [464, 466])
def test_the_motors_constants_from_strokes(tmp_path, seed):
    """Time constants of 1.4 and 6 ms: with what the drive holds after a stroke, and one low-pass on all sides."""
    _, found, truth = begun(tmp_path, seed)
    assert found.resistance == pytest.approx(truth.value("drive.resistance"), rel=0.03)
    assert found.volts_per_speed == pytest.approx(truth.value("drive.back_emf") / motor_ratio(truth), rel=0.01)


def stroked(volts_per_speed, inertia, friction):
    """`Record` at 1 ms of a rigid motor with Coulomb friction, of 1 ohm, to and fro at constant voltages."""
    held = 1.6 * friction * np.repeat(np.outer([1.0, 1.5, 2.0, 1.0, 1.5], [-1.0, 1.0]).ravel(), 60)
    place, speed, step = [0.0], [0.0], 1e-5
    for voltage in held:
        x, v = place[-1], speed[-1]
        for _ in range(100):
            drive = voltage - volts_per_speed * v
            resist = math.copysign(friction, v) if v else min(max(drive, -friction), friction)
            end = v + step * (drive - resist) / inertia
            end = 0.0 if end * v < 0.0 and abs(drive) < friction else end
            x, v = x + 0.5 * step * (v + end), end
        place.append(x)
        speed.append(v)
    voltage = np.append(held, 0.0)
    current = np.concatenate([[0.0], held - volts_per_speed * np.array(speed[1:])])
    columns = {"encoder_m": np.array(place), "voltage_V": voltage, "current_A": current}
    return Record(1e-3, columns)


@pytest.mark.parametrize("kind, has_current", [("motor", True), ("motor", False), ("force", False)])
def test_the_inertia_from_strokes(kind, has_current):
    """The voltage and the current that move it are those over a whole period: with the mean of both ends 0.83."""
    sketch, volts_per_speed = (SLOW, 440.0) if kind == "motor" else (FORCE, 0.0)
    record = stroked(volts_per_speed, inertia=2.33, friction=0.5)
    first = FirstMotion(0.5, 1.0, 0.0, 0.0, has_current, 0.0, 0.0)
    found = fit_strokes(record, sketch, first, 1e-3)
    assert found.inertia == pytest.approx(2.33, rel=0.05)
    assert found.friction == pytest.approx(0.5, rel=0.1)


def test_a_loop_whose_gains_were_lowered_may_lag(tmp_path):
    """A third of the bandwidth asks for 0.4 mm of error before it makes the voltage of 2 mm/s: it gets there."""
    hand, found, _ = begun(tmp_path, 464)
    axis = known_axis(SLOW, found)
    rule = controller_parameters("self_tuning", axis, {})["pid"]
    gains = slower({name: float(rule[name]) for name in rule.dtype.names}, 0.33)
    place = hand.position + 1.5e-3
    loop = Loop(hand, axis, "self_tuning", found.friction, gains)
    assert loop.lag(2e-3) > 2e-4
    loop.go(place, 2e-3, gentle=True, dwell=0.6)
    assert abs(hand.position - place) < 1e-4


def test_the_way_of_the_motor_is_that_of_the_mean_speed():
    """A motor of 4 ms that is turned round: by the speeds at the ends of periods the way would be 2.5 µm wrong."""
    period, tau, resistance, volts_per_speed = 1e-3, 4e-3, 2.0, 500.0
    speed, place, kept = -2.5e-3, 0.0, math.exp(-period / tau)
    encoder, current, voltage = [place], [(-2.5e-3 * volts_per_speed - volts_per_speed * speed) / resistance], []
    for _ in range(9):
        held = 2.0 * 2.5e-3 * volts_per_speed
        end = held / volts_per_speed
        place += end * period + (speed - end) * tau * (1.0 - kept)
        speed = end + (speed - end) * kept
        encoder.append(place)
        voltage.append(held)
        current.append((held - volts_per_speed * speed) / resistance)
    watch = EncoderWatch(period, resistance, volts_per_speed)
    voltage.append(0.0)
    for row in (4, 9):
        watch.look(np.array(encoder), np.array(voltage), np.array(current), row)
    (_, before, _, x0), (_, after, _, x1) = watch._sums[-2:]
    assert after - before == pytest.approx(x1 - x0, abs=5e-8)


def test_margins_above_the_coherent_band_are_the_models():
    """At 1 ms the observer law's least margins lie above 200 Hz, where hardly anything may be added to the voltage."""
    axis = SLOW.axis.with_controller({"type": "self_tuning_observer"})
    parameters = controller_parameters("self_tuning_observer", axis, {})
    _, plant, slopes = next(regime for regime in regimes(axis) if regime[0] == SLIDING)
    loop = observer_loop(axis, plant, *slopes, parameters)
    truth = loop_margins(loop, 1e-3)
    frequency = np.arange(5.0, 125.0, 5.0)
    value = frequency_response(loop, 2.0 * math.pi * frequency, 1e-3)
    ones = np.ones(len(frequency))
    response = Response("loop", "sliding", frequency, value, ones, ones, 0.01 * ones)
    part = measured_margins(response)
    whole = whole_margins(response, axis, [axis, axis], "self_tuning_observer", {})
    assert part.phase_deg > truth.phase_deg + 10.0 and not math.isfinite(part.gain_dB)
    assert whole.phase_deg == pytest.approx(truth.phase_deg, abs=0.5)
    assert whole.gain_dB == pytest.approx(truth.gain_db, abs=0.1)
    assert whole.modelled == ("phase", "gain") and whole.crossover_Hz > whole.highest_Hz == 120.0


def test_lines_that_the_encoders_interpolation_reaches_are_left_out():
    """At 1 mm/s a signal period of 10 µm errs at 100 Hz and its multiples."""
    frequency = np.array([95.0, 100.0, 105.0, 200.0, 290.0, 300.0, 400.0, 500.0])
    kept = measured_loop.not_interpolated(frequency, 1e-3, SLOW.axis, 2.5)
    assert frequency[kept].tolist() == [95.0, 105.0, 290.0, 500.0]


def test_the_record_ends_with_what_the_drive_holds():
    """Between two runs that is nothing, unless the next one goes on."""

    class Card:
        simulated = True

        def read(self):
            return 0.0, 0.0, 0.0

        def write(self, voltage):
            self.voltage = voltage

    hand = Hand(Card(), SLOW.axis)
    hand.begin()
    ended = hand.run(np.zeros(4), lambda n, x, i: 0.5)
    assert ended.command.tolist() == [0.5, 0.5, 0.5, 0.0]
    assert hand.run(np.zeros(4), lambda n, x, i: 0.5, go_on=True).command.tolist() == [0.5] * 4
