"""What a proof makes of readings that are missing and of moves that do not settle, and what is said of a drive that takes no zero."""

import json
import math
import re
import types

import numpy as np
import pytest
import yaml

from microstage_ros.commissioning.estimation.frequency_response import multi_sine, responses
from microstage_ros.commissioning.experiments import proof, simulated_proof
from microstage_ros.commissioning.experiments.machine import Machine
from microstage_ros.commissioning.findings import Refused
from microstage_ros.commissioning.procedure import commission
from microstage_ros.commissioning.report import settling_words, write_answer
from microstage_ros.commissioning.sketch import load_sketch
from microstage_ros.commissioning.store import Store
from microstage_ros.hardware.protocol import HardwareError, Reading

SKETCH = {
    "period": {"value": 1.0e-3, "unit": "s"}, "travel": {"minimum": {"value": -0.025, "unit": "m"}, "maximum": {"value": 0.025, "unit": "m"}},
    "drive": {"type": "voltage_motor", "voltage_limit": {"value": 6.0, "unit": "V"}},
    "transmission": {"type": "screw", "gear_ratio": {"value": 19.0, "unit": "1"}, "pitch": {"value": 2.0e-3, "unit": "m"}},
    "sensors": {"encoder": {"resolution": {"value": 25.0e-9, "unit": "m"}}},
}


class Loop:
    """A loop whose stage follows its reference but for ``error`` [m], (rows) -> (rows,), and whose encoder misses readings."""

    law = "self_tuning"

    def __init__(self, error=lambda n: np.zeros(n), missing=()):
        self.machine = types.SimpleNamespace(position=0.0, count=25e-9, stroke=0.05, period=1e-3, noise=1e-9, periods=lambda s, least=1: max(round(s / 1e-3), least),
                                             rest=lambda seconds: None)
        self._error, self._missing = error, list(missing)

    def limits(self, velocity):
        from microstage_ros.control.trajectories.profiles import MotionLimits

        return MotionLimits(velocity, 0.15, 15.0)

    def follow(self, reference, **_):
        read = np.asarray(reference, float) + self._error(len(reference))
        read[[len(read) + k if k < 0 else k for k in self._missing]] = math.nan
        return {"encoder_m": read, "reference_m": np.asarray(reference, float)}


def kept(monkeypatch):
    monkeypatch.setattr(proof, "joined", lambda records: records)
    return lambda name, record: None


def test_one_missing_reading_does_not_pass_a_sine_that_is_off(monkeypatch):
    """The largest error was NaN, which no limit exceeds: the machine was ready."""
    off = Loop(lambda n: 5e-5 * np.sin(np.arange(n) * 1e-3), missing=[5000])
    sine = proof.slow_sine(off, kept(monkeypatch))
    assert sine == pytest.approx(5e-5, rel=0.1)
    monkeypatch.setattr(simulated_proof, "simulated_proof", lambda loop, seed: (2e-9, 2e-8, ""))
    monkeypatch.setattr(simulated_proof, "_beside", lambda *_: "")
    for wrong in (sine, math.nan):
        with pytest.raises(Refused):
            simulated_proof.judge_proof(off, 1e-9, wrong, 1)


def test_a_reading_that_is_missing_at_rest_ends_no_proof(monkeypatch):
    rows, figures = proof.moves(Loop(missing=[-20, -21]), kept(monkeypatch))
    assert all(math.isfinite(row["four_s_m"]) and row["settling_s"] == 0.0 for row in rows) and all(np.isfinite(list(figures.values())))


def test_a_move_that_never_settles_has_no_settling_time(monkeypatch):
    """It rests 0.4 µm beside its target: 0.3 s were stated, all that was waited."""
    rows, _ = proof.moves(Loop(lambda n: np.full(n, 4e-7)), kept(monkeypatch))
    assert all(math.isinf(row["settling_s"]) for row in rows) and settling_words(rows[0]["settling_s"]) == "–"
    late = Loop(lambda n: np.where(np.arange(n) < n - 200, 4e-7, 0.0))
    assert all(row["settling_s"] == pytest.approx(0.1, abs=0.02) for row in proof.moves(late, kept(monkeypatch))[0])


def test_a_frequency_response_survives_a_missing_reading():
    sine = multi_sine(1e-3, 1.0, 100.0, lambda frequency: 1.0, 1)
    rows = np.arange(4 * sine.rows + 1)
    disturbance = np.tile(sine.signal, 5)[: len(rows)]
    encoder = np.convolve(disturbance, [0.0, 0.5, 0.3, 0.1])[: len(rows)]
    whole = responses([(encoder, disturbance, disturbance)], sine, 1e-3, "rest")[0]
    encoder = encoder.copy()
    encoder[777] = math.nan
    holed = responses([(encoder, disturbance, disturbance)], sine, 1e-3, "rest")[0]
    assert np.isfinite(holed.value).all() and np.median(np.abs(holed.value / whole.value - 1.0)) < 0.1


class Card:
    """Stands at ``place`` [m]; after ``fails`` writes it takes none."""

    simulated = True

    def __init__(self, place=0.0, fails=math.inf):
        self._place, self._fails, self._writes = place, fails, 0

    def open(self):
        pass

    def read(self):
        return Reading(self._place, 0.0)

    def write(self, voltage):
        self._writes += 1
        if self._writes > self._fails:
            raise HardwareError("no answer from the card")

    def close(self):
        pass


@pytest.mark.parametrize("card, confirmed, read", [
    (Card(0.03), True, "encoder from 30 to 30 mm"), (Card(math.nan), True, "the encoder gave no number"), (Card(fails=50), False, "encoder from 0 to 0 mm"),
    (Card(fails=0), False, "the encoder gave no number")])
def test_the_page_says_whether_zero_volts_were_taken(tmp_path, card, confirmed, read):
    """"The machine is at zero voltage" stood below "the hardware refused zero volts"."""
    (tmp_path / "sketch.yaml").write_text(yaml.safe_dump(SKETCH))
    sketch, out = load_sketch(tmp_path / "sketch.yaml"), tmp_path / "out"
    machine = Machine(card, sketch.axis)
    outcome = commission(machine, sketch, Store(out, "one"), 1)
    for name in ("axis.yaml", "frequency_response.csv"):
        (out / name).write_text("of an earlier run\n")
    write_answer(outcome, machine, out, {"sketch": "sketch.yaml", "seed": 1, "backend": "card"})
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", (out / "report.html").read_text()))
    assert outcome.verdict != "ready" and read in text
    assert ("The machine is at zero voltage." in text) == confirmed and ("Zero voltage is NOT confirmed" in text) == (not confirmed)
    assert json.loads((out / "report.json").read_text())["axis"] is None and not (out / "axis.yaml").exists()
    assert not (out / "frequency_response.csv").exists()
