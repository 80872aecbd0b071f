"""The backend mesa against an emulated card: registers, losses, watchdog, the axis over the wire."""

import contextlib
import json
import math
import struct
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from microstage_ros.control.laws.controller import Controller, controller_parameters
from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.mesa.card import pwm_rate
from microstage_ros.hardware.mesa.lbp16 import command, read32
from microstage_ros.hardware.protocol import HardwareError, Setup, instruments
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError

EMULATOR = Path(__file__).with_name("mesa_emulator.py")
PERIOD = 1e-3
AXIS = load_axis(config_file("axis.yaml")).with_values({"period": PERIOD}, source="derived").with_controller({"type": "self_tuning"})


class Emulated:
    """A running emulator; ``end()`` stops it and gives what became of the machine."""

    def __init__(self, **options):
        faults = json.dumps(options.pop("faults", {}))
        axis = str(options.pop("axis", config_file("axis.yaml")))
        words = [f"--{name}={value}" for name, value in options.items()]
        self._process = subprocess.Popen([sys.executable, str(EMULATOR), "--axis", axis, "--faults", faults, *words],
                                         stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.port = int(self._process.stdout.readline())

    def backend(self, **options):
        return make_hardware("mesa", Setup(AXIS, 1, {"host": "127.0.0.1", "port": self.port, "watchdog_s": 0.5, "wait_share": 200.0, "patience_s": 10.0, **options}))

    def end(self):
        if self._process.poll() is None:
            self._process.stdin.close()
            self._result = json.loads(self._process.stdout.readline())
            self._process.wait(120)
        return self._result


@pytest.fixture
def emulate():
    made = []

    def start(**options):
        made.append(Emulated(**options))
        return made[-1]

    yield start
    for emulated in made:
        emulated.end()


def test_vectors_of_the_manual():
    assert read32(0x0100).hex() == "01420001"
    assert read32(0x0400, 5).hex() == "85420004"
    assert command(7, 16, 0, 8).hex() == "885d0000"


def test_pwm_rates():
    rate, bits = pwm_rate(24e3, 200e6)
    assert bits == 12 and rate == round(24e3 * 65536 * 4096 / 200e6)
    assert pwm_rate(75e3, 100e6)[1] == 10
    with pytest.raises(InputError, match="pwm_hz"):
        pwm_rate(1e6, 100e6)


@pytest.mark.parametrize("bad, words", [
    ("cookie", "0100h reads 12345678h"), ("name", "HOSTCAR2"), ("idrom", "IDROM type 9"), ("width", "does not fit itself"), ("clock", "clock 9"),
    ("endless", "no end"), ("no_pwm", "no PWM"), ("version", "version 7")])
def test_a_card_that_does_not_fit_is_refused(emulate, bad, words):
    card = emulate(bad=bad).backend()
    with pytest.raises(HardwareError, match=words):
        card.open()


def test_nobody_answers():
    card = make_hardware("mesa", Setup(AXIS, 1, {"host": "127.0.0.1", "port": 9}))
    with pytest.raises(HardwareError, match="127.0.0.1"):
        card.open()
    with pytest.raises(InputError, match="colour"):
        make_hardware("mesa", Setup(AXIS, 1, {"colour": 1}))


def drive(card, seconds, target=2e-5):
    """Errors [m] of a move under the encoder-only law, over the wire."""
    controller = Controller("self_tuning", controller_parameters("self_tuning", AXIS, {}))
    errors = []
    for n in range(round(seconds / PERIOD)):
        reading = card.read()
        reference = min(n * PERIOD * 1e-4, target)
        errors.append(reference - reading.encoder)
        card.write(controller.step(reference, reading.encoder, 0.0))
    return np.array(errors)


def test_the_axis_over_the_wire(emulate):
    emulated = emulate(clock=PERIOD)
    card = emulated.backend()
    card.open()
    assert card.layout.board == "MESAEMUL"
    errors = drive(card, 1.0)
    card.close()
    found = emulated.end()
    assert np.abs(errors[-200:]).max() < 3e-7 and found["stage_m"] == pytest.approx(2e-5, abs=3e-7)
    assert found["volts"] == 0.0 and 0.02 < found["most_voltage"] < 6.0


@pytest.mark.parametrize("faults", [
    {"drop_reply": 0.05}, {"drop_request": 0.05}, {"duplicate": 0.3}, {"truncate": 0.05}, {"foreign": 0.2},
    {"delay": 0.03, "delay_s": 0.02}, {"drop_reply": 0.02, "drop_request": 0.02, "duplicate": 0.1, "truncate": 0.02}])
def test_losses_are_survived(emulate, faults):
    emulated = emulate(clock=PERIOD, faults={**faults, "after": 60}, seed=3)
    card = emulated.backend(wait_share=20.0)
    card.open()
    errors = drive(card, 0.8)
    card.close()
    assert np.abs(errors[-100:]).max() < 1e-6, np.abs(errors[-100:]).max()


def test_a_lost_write_is_sent_again(emulate):
    emulated = emulate(clock=PERIOD, faults={"drop_request": 0.1, "after": 60}, seed=5)
    card = emulated.backend(wait_share=20.0)
    card.open()
    drive(card, 0.3)
    assert card._link.repeated > 0
    card.close()


def test_a_dead_link_ends_in_an_error_and_the_watchdog_bites(emulate):
    emulated = emulate(faults={"drop_reply": 1.0, "after": 45})
    card = emulated.backend(watchdog_s=0.05, wait_share=5.0)
    card.open()
    with pytest.raises(HardwareError, match="error level"):
        for _ in range(200):
            card.write(0.05)
            card.read()
    time.sleep(0.2)
    assert emulated.end()["volts"] == 0.0 and emulated.end()["bites"] == 1


def test_the_watchdog_bites_when_the_program_is_silent(emulate):
    emulated = emulate()
    card = emulated.backend(watchdog_s=0.05)
    card.open()
    card.write(0.05)
    time.sleep(0.3)
    with pytest.raises(HardwareError, match="watchdog has cut"):
        card.read()
    assert emulated.end()["volts"] == 0.0


def test_a_watchdog_that_has_bitten_gives_the_output_back_when_it_is_armed_anew(emulate):
    """As the commissioning does between two runs, and the driver after a reset."""
    emulated = emulate()
    card = emulated.backend(watchdog_s=0.05)
    card.open()
    time.sleep(0.3)
    card.write(0.0)
    card.watchdog(0.0)
    time.sleep(0.2)
    card.read()
    card.write(0.05)
    card.read()
    assert emulated.end()["volts"] == pytest.approx(0.05, rel=0.05) and emulated.end()["bites"] == 1


def test_closed_means_zero(emulate):
    emulated = emulate(clock=PERIOD)
    card = emulated.backend()
    card.open()
    card.write(0.1)
    card.read()
    card.close()
    card.close()
    with pytest.raises(HardwareError, match="not open"):
        card.read()
    assert emulated.end()["volts"] == 0.0


def test_counts_are_summed_over_their_wrap():
    card = make_hardware("mesa", Setup(AXIS, 1, {}))
    card._before, card._stamp_hz, counts = None, 2e6, 0
    for n in range(100):
        counts += 1500 if n < 60 else -2500
        card._take(struct.pack("<III", 0, n * 2000 & 0xFFFF, (n * 2000 & 0xFFFF) << 16 | counts & 0xFFFF))
    first = 1500
    assert card.reading.encoder == pytest.approx((counts - first) * 25e-9) and math.isnan(card.reading.current)
    assert card.velocity == pytest.approx(-2500 * 25e-9 / 1e-3)


def test_counts_go_on_while_the_watchdog_has_cut_the_output():
    """The counter has 16 bit: a stage that is pushed by 1 mm until somebody resets was read 1.6 mm off."""
    card = make_hardware("mesa", Setup(AXIS, 1, {}))
    card._before, card._stamp_hz = None, 2e6
    card._take(struct.pack("<III", 0, 0, 0))
    for counts in range(0, 40001, 8000):
        with pytest.raises(HardwareError, match="its watchdog has cut the output"):
            card._take(struct.pack("<III", 1, 0, counts & 0xFFFF))
    card._take(struct.pack("<III", 0, 0, 40000 & 0xFFFF))
    assert card.reading.encoder == pytest.approx(40000 * 25e-9)


def test_a_card_is_followed_while_nobody_commands(monkeypatch):
    card, read = make_hardware("mesa", Setup(AXIS, 1, {})), []
    card.follow()  # it is not open, which the next read says
    monkeypatch.setattr(card, "read", lambda: read.append(1))
    instruments(card)["follow"]()
    assert read == [1]


def test_a_card_that_answers_again_is_believed_after_twelve_readings():
    card = make_hardware("mesa", Setup(AXIS, 1, {}))
    card._link = SimpleNamespace(lost=0, stale=0, repeated=0)
    for _ in range(100):
        with contextlib.suppress(HardwareError):
            card._loss("no answer")
    assert card._errors == 12
