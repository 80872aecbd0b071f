"""Datagrams to a Mesa card byte by byte, and the registers of its set-up; the card is a socket of this process."""

import math
import socket
import struct
import time

import pytest
from test_mesa_registers import answer, card, module

from microstage_ros.hardware.mesa import hostmot2 as hm
from microstage_ros.hardware.mesa import lbp16
from microstage_ros.hardware.mesa.card import OPTIONS, PET, pwm_rate
from microstage_ros.hardware.mesa.lbp16 import Link, command, read32, write32
from microstage_ros.hardware.protocol import HardwareError
from microstage_ros.quantities.errors import InputError

COUNTERS = command(lbp16.TIMERS, 32, 0x10, 1, True), command(lbp16.TIMERS, 32, 0x10, 2)
WRITES = command(lbp16.TIMERS, 32, 0x14, 1, True)


@pytest.fixture
def pair():
    """A link, and the socket at its other end."""
    other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    other.bind(("127.0.0.1", 0))
    other.settimeout(20.0)
    link = Link("127.0.0.1", other.getsockname()[1], patience=0.01)
    yield link, other
    link.close()
    other.close()


def test_commands_of_every_size():
    assert (lbp16.PORT, lbp16.LARGEST) == (27181, 1400) and (lbp16.STATUS, lbp16.INFORMATION) == (6, 7)
    assert [command(0, size, 0x1234, 1).hex() for size in (8, 16, 32, 64)] == ["01403412", "01413412", "01423412", "01433412"]
    assert command(4, 32, 0x10, 2, True).hex() == "82d21000"
    assert command(0, 8, 0, 127).hex() == "ff400000"
    for count in (0, 128):
        with pytest.raises(ValueError, match=f"a count of {count}, expected 1 to 127"):
            command(0, 32, 0, count)
    assert write32(0x4100, 1, -1) == command(0, 32, 0x4100, 2, True) + bytes([1, 0, 0, 0, 255, 255, 255, 255])


def test_writes_are_numbered_and_repeated(pair):
    link, other = pair
    link.repeat_write()  # nothing was written yet
    assert link.repeated == 0
    for number in (1, 2):
        link.write(b"ab", b"cd")
        assert other.recv(2048) == b"abcd" + WRITES + struct.pack("<I", number)
    link.repeat_write()
    assert other.recv(2048) == b"abcd" + WRITES + struct.pack("<I", 2) and link.repeated == 1
    link._writes = 0xFFFFFFFF
    link.write()
    assert other.recv(2048) == WRITES + bytes(4)


def answers(other, link, *datagrams):
    for datagram in datagrams:
        other.sendto(datagram, link._socket.getsockname())


def test_an_answer_to_this_very_question(pair):
    link, other = pair
    link.write(b"")
    other.recv(2048)
    answers(other, link, b"data" + struct.pack("<II", 7, 1), b"dat" + struct.pack("<II", 1, 1), b"data" + struct.pack("<II", 1, 1))
    assert link.read(b"ask!", 4, 10.0) == (b"data", True) and (link.stale, link.lost) == (2, 0)
    assert other.recv(2048) == b"ask!" + COUNTERS[0] + struct.pack("<I", 1) + COUNTERS[1]
    answers(other, link, b"data" + struct.pack("<II", 2, 0))
    assert link.read(b"ask!", 4, 10.0) == (b"data", False)  # the write did not arrive
    link._reads = 0xFFFFFFFF
    answers(other, link, struct.pack("<II", 0, 1))
    assert link.read(b"", 0, 10.0) == (b"", True)


def test_before_any_write_nothing_is_missing(pair):
    link, other = pair
    answers(other, link, struct.pack("<II", 1, 99))
    assert link.read(b"", 0, 10.0) == (b"", True)


def test_no_answer_is_lost_in_time(pair):
    link, other = pair
    began = time.monotonic()
    assert link.read(b"", 0, 0.05) is None and time.monotonic() - began >= 0.049 and link.lost == 1
    with pytest.raises(HardwareError, match=r"Mesa card at 127.0.0.1:\d+ does not answer \(cable, address, firewall, power\)"):
        link.ask(b"", 0)
    assert link.lost == 6  # five tries
    link._patience = 20.0
    answers(other, link, struct.pack("<IIII", 3, 0xFFFFFFFF, 7, 0))
    assert link.ask32(0x0100, 2) == (3, 0xFFFFFFFF)
    for _ in range(6):
        other.recv(2048)
    assert other.recv(2048)[:4] == read32(0x0100, 2)


def test_a_host_that_cannot_be_reached():
    with pytest.raises(HardwareError, match="Mesa card at 255.255.255.255: "):
        Link("255.255.255.255")  # a broadcast, which a socket has to ask for
    link = Link("127.0.0.1", 9)
    link._socket.close()
    with pytest.raises(HardwareError, match="Mesa card at 127.0.0.1:9: "):
        link.send(b"x")


@pytest.mark.parametrize("frequency, clock, rate, bits", [
    (24e3, 100e6, 64425, 12), (100e6 / 65536 / 4096, 100e6, 1, 12), (100e6 / 4096, 100e6, 32768, 11), (100e6 * 65535 / 65536 / 512, 100e6, 65535, 9)])
def test_rate_and_bits_of_a_frequency(frequency, clock, rate, bits):
    assert pwm_rate(frequency, clock) == (rate, bits)


@pytest.mark.parametrize("frequency, rate", [(100e6 / 65536, 1), (50e6, 32768), (100e6 * 65535.9 / 65536, 65536)])
def test_rate_of_pulses(frequency, rate):
    assert pwm_rate(frequency, 100e6, pdm=True) == (rate, 12)


@pytest.mark.parametrize("frequency, pdm, words", [
    (0.3, False, "from 2.98 to 1.953e"), (100e6 / 512, False, "from 2.98 to 1.953e"), (1525.0, True, "a pulse rate below 1e.08 Hz"), (100e6, True, "a pulse rate")])
def test_a_frequency_that_no_register_gives(frequency, pdm, words):
    with pytest.raises(InputError, match=words):
        pwm_rate(frequency, 100e6, pdm)


@pytest.mark.parametrize("mode, at, rate, bits", [("up_down", 2, 64425, 3 | 2 << 3), ("pwm_dir", 2, 64425, 3), ("offset", 2, 64425, 3), ("pdm", 3, 16, 3 | 3 << 3)])
@pytest.mark.parametrize("filtered", [True, False])
def test_registers_of_the_set_up(mode, at, rate, bits, filtered):
    """Output value before its enable, directions of the pins last; 50 clocks between stamps are 2 MHz."""
    made, wire = card(pwm_mode=mode, output=1, encoder=2, filter=filtered)
    made._configure()
    pwm, dog, encoder, port = made._pwm, made._watchdog, made._encoder, made.layout.modules[hm.IOPORT]
    pet = write32(dog.address(2), PET)
    assert wire.sent == [
        write32(dog.address(0), 499_999) + write32(dog.address(1), 0) + write32(pwm.address(at), rate) + write32(pwm.address(1, 1), bits)
        + write32(pwm.address(0, 1), made._value(0.0)) + write32(encoder.address(2), 48) + write32(encoder.address(1, 2), 0x800 * filtered) + pet,
        write32(pwm.address(4), 0b10) + write32(port.address(2, 1), 1 << 5) + write32(port.address(1, 1), 1 << 5) + pet]
    assert made._stamp_hz == 2e6


def test_a_slow_clock_stamps_as_fast_as_it_can():
    made, _ = card()
    made._encoder = hm.Module(hm.ENCODER, 2, 3_000_000, 1, 0x3000, 0x100, 4, 0b11)
    made._configure()
    assert made._stamp_hz == 1.5e6


def test_pins_of_one_output_in_one_port_and_in_two():
    made, _ = card()
    port = made.layout.modules[hm.IOPORT]
    made.layout = hm.Layout("7I92", made.layout.modules, tuple(hm.Pin(*place, hm.PWM, 0, 0x81) for place in ((0, 3), (0, 5), (1, 2))))
    assert made._pins(0) == [write32(port.address(2, 0), 0b101000), write32(port.address(2, 1), 0b100),
                             write32(port.address(1, 0), 0b101000), write32(port.address(1, 1), 0b100)]


def test_a_set_up_is_sent_until_it_is_taken():
    made, wire = card()
    found, repeated = [None, (bytes(4), False), (bytes(4), True)], []
    wire.read = lambda commands, length, seconds: (repeated.append((commands, length, seconds)), found.pop(0))[1]
    wire.repeat_write = lambda: repeated.append("again")
    made._send_checked(b"x")
    ask = (read32(hm.COOKIE), 4, 0.2)
    assert repeated == [ask, "again", ask, "again", ask]
    wire.read = lambda *_: None
    repeated.clear()
    with pytest.raises(HardwareError, match="does not take its configuration"):
        made._send_checked(b"x")
    assert repeated == ["again"] * 5


def test_an_enable_that_is_lost_is_sent_again():
    made, wire = card()
    found, repeated = [None, (bytes(4), True)], []
    wire.read = lambda commands, length, seconds: (repeated.append(seconds), found.pop(0))[1]
    wire.repeat_write = lambda: repeated.append("again")
    made.enable(False)
    assert repeated == [0.02, "again", 0.02]  # within the periods of an axis at rest
    wire.read = lambda *_: None
    with pytest.raises(HardwareError, match="does not take its configuration"):
        made.enable(False)


def test_the_first_reading_is_asked_for_five_times():
    made, wire = card()
    asked, found = [], [None] * 4 + [answer(0, 0, 5)]
    wire.read = lambda *question: (asked.append(question), found.pop(0) if found else None)[1]
    made._first_reading()
    assert len(asked) == 5 and asked[0][1:] == (12, 0.2) and made.reading.encoder == 0.0
    with pytest.raises(HardwareError, match="answers no readings"):
        made._first_reading()
    assert len(asked) == 10


def test_questions_of_a_period():
    made, _ = card(encoder=1)
    words = read32(made._watchdog.address(1)) + read32(made._encoder.address(3)) + read32(made._encoder.address(0, 1))
    assert made._question() == (words, 12)
    made, _ = card(encoder=1, current_encoder=3)
    assert made._question() == (words + read32(made._encoder.address(0, 3)), 16)


def test_an_answer_is_waited_for_within_the_period():
    made, wire = card(wait_share=0.5)
    made.period, waits = 1e-3, []
    wire.read = lambda commands, size, wait: (waits.append(wait), answer(0, 0, 0) if len(waits) % 2 == 0 else None)[1]
    made.read()
    assert waits == pytest.approx([0.25e-3] * 2)  # asked once more
    made.period = 1e-5
    made.read()
    assert waits[2:] == pytest.approx([0.05e-3] * 2)  # never less than a tenth of a millisecond


def test_a_voltage_that_did_not_arrive_is_sent_again():
    made, wire = card()
    again = []
    wire.repeat_write = lambda: again.append(1)
    wire.answer = (answer(0, 0, 0)[0], False)
    made.read()
    assert again == [1] and made._errors == 2
    wire.lost, wire.stale, wire.repeated, made._errors = 3, 4, 5, 8
    with pytest.raises(HardwareError, match=r"a voltage did not arrive, error level 10 \(lost 3, stale 4, sent again 5\); its watchdog cuts the output"):
        made.read()


@pytest.mark.parametrize("counts_direction", [1, -1])
def test_speed_between_events_and_without_one(counts_direction):
    made, wire = card(counts_direction=counts_direction)
    for clock, count in ((100, 100 << 16 | 7), (2100, 2100 << 16 | 5)):
        wire.answer = answer(0, clock, count)
        made.read()
    assert made.velocity == pytest.approx(-counts_direction * 2 * 25e-9 / 1e-3)
    wire.answer = answer(0, 2100 + 800, 2100 << 16 | 5)  # 0.4 ms without a count: still less than one count in that time
    made.read()
    assert made.velocity == pytest.approx(-counts_direction * 50e-6)
    wire.answer = answer(0, 2100 + 4000, 2100 << 16 | 5)
    made.read()
    assert made.velocity == pytest.approx(-counts_direction * 25e-9 / 2e-3)
    wire.answer = answer(0, 2100 + 5000, 2100 << 16 | 6)
    made.read()
    assert made.velocity == 0.0  # a count without a time of its own
    assert made.reading.encoder == pytest.approx(-counts_direction * 25e-9)


def test_a_converter_without_time_between_gives_no_current():
    made, wire = card(current_encoder=1, current_A_per_hz=1.0)
    wire.answer = answer(0, 1000, 0, 0xFFFF)
    assert math.isnan(made.read().current) and math.isnan(made.read().current)
    wire.answer = answer(0, 3000, 0, 0x0001)  # two counts over the wrap in a millisecond
    assert made.read().current == pytest.approx(2e3)


def test_a_card_that_is_not_open():
    made, _ = card()
    made.close()
    for call in (made.read, lambda: made.write(0.0)):
        with pytest.raises(HardwareError, match="the Mesa card is not open"):
            call()
    made.enable(True)
    made.watchdog(0.1)  # nothing to do


def test_it_opens_at_the_stage_position(monkeypatch):
    from microstage_ros.hardware.mesa import card as module_of_the_card

    made, wire = card(position=1e-6, counts_direction=-1, encoder=0, host="10.0.0.9", port=1234, patience_s=0.5)
    given, layout = [], made.layout
    layout.modules.update({hm.PWM: module(hm.PWM, 2), hm.MUXED_ENCODER: module(hm.MUXED_ENCODER), hm.WATCHDOG: module(hm.WATCHDOG, 1)})
    monkeypatch.setattr(module_of_the_card, "Link", lambda *arguments: (given.append(arguments), wire)[1])
    monkeypatch.setattr(module_of_the_card.hm, "discover", lambda link: layout)
    made._errors, made._before = 9, (1, 2, 3)
    made.open()
    assert given == [("10.0.0.9", 1234, 0.5)] and made._errors == 0
    assert made._encoder.gtag == hm.MUXED_ENCODER and made.reading.encoder == pytest.approx(1e-6)
    del layout.modules[hm.PWM]
    with pytest.raises(HardwareError, match="no PWM"):
        made.open()
    assert wire.closed and made._link is None


def test_options_and_what_is_refused():
    assert OPTIONS["port"] == lbp16.PORT and OPTIONS["watchdog_s"] == 5e-3 and OPTIONS["filter"] is True and OPTIONS["wait_share"] == 0.8
    for options, words in (({"direction": 0}, "direction.*1 or -1"), ({"counts_direction": 2}, "counts_direction.*1 or -1"),
                           ({"pwm_mode": "sine"}, "one of pwm_dir, up_down, pdm, offset"), ({"colour": 1}, "option colour.*one of host, port")):
        with pytest.raises(InputError, match=words):
            card(**options)
    assert card(full_scale=2.0)[0]._limit == 2.0 and card(full_scale=1e3)[0]._limit == 6.0
    made, _ = card(full_scale=4)
    made.write(-9.0)
    assert made._voltage == -4.0 and not made.simulated
