"""Numbers that the backend mesa puts into registers and takes from them, one by one: no card, no emulator."""

import math
import struct

import pytest

from microstage_ros.hardware.mesa import hostmot2 as hm
from microstage_ros.hardware.mesa.card import MODES, OPTIONS, PET, MesaCard
from microstage_ros.hardware.mesa.lbp16 import RX_FRAMES, write32
from microstage_ros.hardware.protocol import HardwareError, Setup
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError

CLOCK = 100_000_000
BITS = 12


class Wire:
    """Keeps what is written; every question is answered with ``answer``."""

    def __init__(self):
        self.sent, self.answer, self.closed = [], None, False
        self.lost = self.stale = self.repeated = 0

    def write(self, *commands):
        self.sent.append(b"".join(commands))

    send = write

    def read(self, commands, size, wait):
        return self.answer or (bytes(size), True)

    def close(self):
        self.closed = True


def module(gtag, instances=4):
    return hm.Module(gtag, 0, CLOCK, instances, gtag << 12, 0x100, 4, 0b11)


def card(**options):
    """A card that is set up, and its wire."""
    made = MesaCard(Setup(load_axis(config_file("axis.yaml")), 1, options))
    made._link, made._bits, made._stamp_hz = Wire(), BITS, 2e6
    made._pwm, made._encoder, made._watchdog = module(hm.PWM, 2), module(hm.ENCODER), module(hm.WATCHDOG, 1)
    pins = (hm.Pin(0, 3, hm.PWM, 0, 0x81), hm.Pin(1, 5, hm.PWM, 1, 0x82), hm.Pin(0, 4, hm.ENCODER, 0, 1))
    made.layout = hm.Layout("7I92", {hm.IOPORT: module(hm.IOPORT, 2)}, pins)
    return made, made._link


def test_numbers_of_the_manual():
    assert (hm.WATCHDOG, hm.IOPORT, hm.ENCODER, hm.PWM, hm.MUXED_ENCODER) == (2, 3, 4, 6, 12)
    assert MODES == {"pwm_dir": 0, "up_down": 2, "pdm": 3, "offset": 0} and RX_FRAMES == 0x08
    assert OPTIONS["pwm_hz"] == 24e3


def test_a_register_lies_where_its_instance_has_its_own():
    own = hm.Module(hm.PWM, 0, CLOCK, 2, 0x4000, 0x100, 4, 0b00011)
    assert [own.address(register, 1) for register in (0, 1, 2, 4)] == [0x4004, 0x4104, 0x4200, 0x4400]


@pytest.mark.parametrize("mode, voltage, expected", [
    ("up_down", 0.0, 0), ("up_down", 5.0, 2048 << 16), ("up_down", -5.0, 2048 << 16 | 0x80000000), ("up_down", 25.0, 4095 << 16),
    ("offset", 0.0, 2048 << 16), ("offset", 10.0, 4095 << 16), ("offset", -10.0, 1 << 16), ("pwm_dir", 2.5, 1024 << 16),
])
def test_value_of_a_voltage(mode, voltage, expected):
    assert card(pwm_mode=mode)[0]._value(voltage) == expected
    assert card(pwm_mode=mode, direction=-1)[0]._value(-voltage) == expected


@pytest.mark.parametrize("output", [0, 1])
def test_a_voltage_goes_out_with_the_watchdog_petted(output):
    made, wire = card(output=output)
    made.write(3.0)
    assert wire.sent == [write32(made._pwm.address(0, output), made._value(3.0)) + write32(made._watchdog.address(2), PET)]
    made.enable(True)
    made.enable(False)
    assert wire.sent[1:] == [write32(made._pwm.address(4), 1 << output), write32(made._pwm.address(4), 0)]


@pytest.mark.parametrize("output", [0, 1])
def test_closing_sends_zero_output_off_and_a_watchdog_that_is_due(output):
    made, wire = card(output=output)
    made.write(3.0)
    made.close()
    end = write32(made._pwm.address(0, output), 0) + write32(made._pwm.address(4), 0) + write32(made._watchdog.address(0), 1)
    assert wire.sent[1:] == [end, end, end] and wire.closed
    made.close()


@pytest.mark.parametrize("seconds, ticks", [(0.01, 999_999), (1e-9, 1), (0.0, 0x7FFFFFFF), (1e6, 0x7FFFFFFF)])
def test_time_of_the_watchdog(seconds, ticks):
    made, wire = card(output=1)
    made.watchdog(seconds)
    port = made.layout.modules[hm.IOPORT]
    assert wire.sent[0] == (write32(made._watchdog.address(0), ticks) + write32(made._watchdog.address(1), 0)
                            + write32(made._watchdog.address(2), PET) + write32(port.address(2, 1), 1 << 5) + write32(port.address(1, 1), 1 << 5))


def test_an_output_without_a_pin_is_refused():
    made, _ = card(output=0)
    made.layout = hm.Layout("7I92", made.layout.modules, made.layout.pins[1:])
    with pytest.raises(HardwareError, match="no pin carries PWM output 0"):
        made.watchdog(0.1)


@pytest.mark.parametrize("name, instances", [("encoder", 4), ("output", 2)])
def test_an_instance_that_the_bit_file_has_not(name, instances):
    for number in (-1, instances):
        made, _ = card(**{name: number})
        with pytest.raises(HardwareError, match=f"{name} {number}, the bit file has {instances}"):
            made._instance(name, made._pwm if name == "output" else made._encoder)
    for number in (0, instances - 1):
        made, _ = card(**{name: number})
        made._instance(name, made._pwm if name == "output" else made._encoder)


@pytest.mark.parametrize("option, value", [("full_scale", "ten"), ("pwm_hz", True), ("watchdog_s", 0.0), ("wait_share", -1.0), ("patience_s", None)])
def test_options_that_are_no_numbers(option, value):
    with pytest.raises(InputError, match=option):
        card(**{option: value})


def answer(status, clock, count, converter=None):
    words = (status, clock, count) + (() if converter is None else (converter,))
    return struct.pack(f"<{len(words)}I", *words), True


def test_counts_times_and_current_of_two_answers():
    """Ten counts on in 4 ms; the converter 3000 counts in as long: (750 000 - 500 000) Hz times 2 uA/Hz."""
    made, wire = card(current_encoder=1, current_zero_hz=5e5, current_A_per_hz=2e-6)
    wire.answer = answer(0, 1000, 900 << 16 | 0xFFFB, 100)
    first = made.read()
    assert math.isnan(first.current)
    wire.answer = answer(0, 9000, 8900 << 16 | 0x0005, 3100)
    second = made.read()
    assert second.encoder - first.encoder == pytest.approx(10 * 25e-9)
    assert made.velocity == pytest.approx(10 * 25e-9 / 4e-3)
    assert second.current == pytest.approx((3000 / 4e-3 - 5e5) * 2e-6)


def test_losses_add_up_to_an_error_and_good_answers_take_them_back():
    made, wire = card()
    wire.answer = answer(0, 1000, 0)
    made.read()
    wire.read = lambda *_: None
    for _ in range(4):
        made.read()
    with pytest.raises(HardwareError, match="error level 10"):
        made.read()
    made._errors = 9
    wire.read = lambda *_: answer(0, 2000, 0)
    made.read()
    assert made._errors == 8


def test_a_watchdog_that_has_bitten_is_an_error():
    made, wire = card()
    wire.answer = answer(1, 1000, 0)
    with pytest.raises(HardwareError, match="watchdog has cut the output"):
        made.read()
