"""What a Mesa card says of itself, word by word: registers, strides, clocks, pins, and every refusal."""

import re

import pytest

from microstage_ros.hardware.mesa import hostmot2 as hm
from microstage_ros.hardware.protocol import HardwareError

AT, MODULES, PINS = 0x0400, 0x40, 0x200  # of the description, and of its lists in it
CLOCKS = (100_000_000, 200_000_000)
STRIDES = (4, 0x40, 0x100, 0x10)  # of instances, of registers


class Memory:
    """Answers questions for registers from a dictionary, address [byte] to word."""

    def __init__(self):
        self.words, self.asked = {}, []

    def put(self, address, *words):
        self.words.update((address + 4 * k, word) for k, word in enumerate(words))

    def ask32(self, address, count=1):
        self.asked.append((address, count))
        return tuple(self.words[address + 4 * k] for k in range(count))


def word(text):
    return int.from_bytes(text.encode(), "little")


def module(gtag, version=0, clock=1, instances=1, base=0, strides=0x00, mask=0b11):
    return gtag | version << 8 | clock << 16 | instances << 24, base | strides << 24, mask


def described(*modules, kind=3, ports=3, width=72, port_width=24, clocks=CLOCKS):
    """A card's memory: 72 pins, of which number n has secondary function n."""
    card = Memory()
    card.put(hm.COOKIE, 0x55AACAFE, word("HOST"), word("MOT2"), AT | 0xABCD0000)
    card.put(AT, kind, MODULES, PINS, word("7I92"), word("T\0\0\0"), 0, 0, ports, width, port_width, *clocks, *STRIDES)
    for number, words in enumerate(modules):
        card.put(AT + MODULES + 12 * number, *words)
    card.put(AT + MODULES + 12 * len(modules), 0, 0, 0)
    for number in range(width):
        card.put(AT + PINS + 4 * number, (number & 1) << 23 | number << 16 | hm.PWM << 8 | number % 5)
    return card


def test_registers_and_names():
    assert (hm.COOKIE, hm.NAME, hm.IDROM) == (0x0100, 0x0104, 0x010C)
    assert hm.VERSIONS == {2: (0,), 3: (0,), 4: (2, 3, 0x83), 12: (3, 4, 0x84), 6: (0, 1)}
    assert set(hm.NAMES) == set(hm.VERSIONS) and (hm.MOST_MODULES, hm.MOST_PINS) == (32, 144)


def test_modules_with_their_clocks_and_strides():
    found = hm.discover(described(
        module(hm.WATCHDOG, base=0x0C00), module(99, 200, 9, 77, strides=0xFF), module(hm.PWM, 1, 2, 200, 0x4100, 0x10, 0x80000003),
        module(hm.ENCODER, 0x83, 1, 6, 0xF300, 0x01, 0b1)))
    assert found.board == "7I92T" and sorted(found.modules) == [hm.WATCHDOG, hm.ENCODER, hm.PWM]
    assert found.modules[hm.WATCHDOG] == hm.Module(hm.WATCHDOG, 0, CLOCKS[0], 1, 0x0C00, 0x100, 4, 0b11)
    assert found.modules[hm.PWM] == hm.Module(hm.PWM, 1, CLOCKS[1], 200, 0x4100, 0x100, 0x40, 0x80000003)
    assert found.modules[hm.ENCODER] == hm.Module(hm.ENCODER, 0x83, CLOCKS[0], 6, 0xF300, 0x10, 4, 0b1)
    with pytest.raises(AttributeError):
        found.modules[hm.PWM].base = 0


def test_pins_of_every_port():
    card = described(module(hm.PWM))
    found = hm.discover(card)
    assert len(found.pins) == 72 and [pin for pin in card.asked if pin[0] >= AT + PINS] == [
        (AT + PINS, 32), (AT + PINS + 128, 32), (AT + PINS + 256, 8)]
    for number, pin in enumerate(found.pins):
        unit = number & 0x7F
        assert pin == hm.Pin(number // 24, number % 24, hm.PWM, unit, number % 5)
    assert hm.Pin(0, 0, hm.PWM, 0, 0x81).is_output and not hm.Pin(0, 0, hm.PWM, 0, 0x7F).is_output
    with pytest.raises(AttributeError):
        found.pins[0].port = 1


def test_pins_and_modules_that_are_asked_for():
    pins = (hm.Pin(0, 1, hm.PWM, 0, 0x81), hm.Pin(0, 2, hm.PWM, 1, 0x81), hm.Pin(0, 3, hm.ENCODER, 0, 1))
    modules = {hm.PWM: "output", hm.MUXED_ENCODER: "counter"}
    layout = hm.Layout("7I92", modules, pins)
    assert layout.pins_of(hm.PWM, 0) == [pins[0]] and layout.pins_of(hm.ENCODER, 1) == []
    assert layout.module(hm.ENCODER, hm.MUXED_ENCODER) == "counter" and layout.module(hm.PWM) == "output"
    with pytest.raises(HardwareError, match="Mesa card 7I92: its bit file has no encoder; load one that has"):
        layout.module(hm.ENCODER, hm.IOPORT)
    with pytest.raises(AttributeError):
        layout.board = ""


@pytest.mark.parametrize("kind", [2, 3])
def test_kinds_of_description(kind):
    assert hm.discover(described(module(hm.PWM), kind=kind, clocks=(1_000_000, 2_000_000))).modules[hm.PWM].clock == 1_000_000


def test_the_most_pins():
    assert len(hm.discover(described(ports=6, width=144)).pins) == 144


@pytest.mark.parametrize("shape", [(3, 71, 24), (0, 0, 24), (7, 168, 24), (145, 145, 1)])
def test_pins_that_do_not_fit(shape):
    ports, width, port_width = shape
    with pytest.raises(HardwareError, match=f"{width} I/O pins in {ports} ports of {port_width}: .* does not fit itself"):
        hm.discover(described(ports=ports, width=width, port_width=port_width))


@pytest.mark.parametrize("kind", [1, 4])
def test_a_kind_of_description_that_is_not_known(kind):
    with pytest.raises(HardwareError, match=f"IDROM type {kind}, expected 2 or 3"):
        hm.discover(described(kind=kind))


@pytest.mark.parametrize("clocks", [(999_999, CLOCKS[1]), (CLOCKS[0], 999_999)])
def test_a_clock_that_is_too_slow(clocks):
    with pytest.raises(HardwareError, match=f"clocks of {clocks[0]} and {clocks[1]} Hz, expected 1 MHz and more"):
        hm.discover(described(clocks=clocks))


@pytest.mark.parametrize("wrong, words", [
    (module(hm.PWM, version=2), "PWM of version 2, expected one of (0, 1)"),
    (module(hm.PWM, clock=0), "PWM with clock 0, expected 1 or 2"), (module(hm.PWM, clock=3), "PWM with clock 3, expected 1 or 2"),
    (module(hm.PWM, strides=0x20), "PWM with strides 20h"), (module(hm.PWM, strides=0x02), "PWM with strides 02h")])
def test_a_module_that_is_not_understood(wrong, words):
    with pytest.raises(HardwareError, match=re.escape(f"Mesa card 7I92T: {words}")):
        hm.discover(described(module(hm.WATCHDOG), wrong))


def test_a_list_of_as_many_modules_as_there_may_be():
    card = described(*[module(99)] * 31)
    assert hm.discover(card).modules == {}
    card.put(AT + MODULES + 12 * 31, *module(99))
    with pytest.raises(HardwareError, match="its list of modules has no end"):
        hm.discover(card)


def test_what_is_no_hostmot2():
    card = described()
    card.put(hm.COOKIE, 0x55AACAFF)
    with pytest.raises(HardwareError, match="register 0100h reads 55AACAFFh, expected 55AACAFEh"):
        hm.discover(card)
    card = described()
    card.put(hm.NAME, word("HOST"), word("CAR2"))
    with pytest.raises(HardwareError, match="named b'HOSTCAR2', expected HOSTMOT2"):
        hm.discover(card)
