"""A Mesa card that is none: LBP16 and the hostmot2 registers over UDP on the loopback, with the simulated axis behind them.

    python mesa_emulator.py --axis FILE [--clock PERIOD] [--faults '{"drop_reply": 0.05}'] [--seed N] [--bad NAME]

Prints its port, runs until its standard input closes, then prints what became of the machine as JSON. With ``--clock`` the
card's clock goes on by that period with each new question (a datagram that asks for counts), else by the wall clock.
Registers that can only be written read as something else; a watchdog that bites turns the pins into inputs, and the output
with them. Bad cards: cookie, name, idrom, width, clock, endless, no_pwm, version.
"""

import argparse
import contextlib
import json
import os
import select
import socket
import struct
import sys
import time

import numpy as np

from microstage_ros.hardware.protocol import Setup
from microstage_ros.hardware.simulated import SimulatedAxis
from microstage_ros.model.axis_file import load_axis

IDROM, MODULES, PINS = 0x0400, 0x0080, 0x0240
CLOCK_LOW, CLOCK_HIGH = 100_000_000, 200_000_000
REGISTER, INSTANCE = 0x0100, 0x0004  # strides, not those of every bit file
WATCHDOG, IOPORT, ENCODER, PWM = 0x0C00, 0x1000, 0x3000, 0x5000
ENCODERS, OUTPUTS, PORT_PINS, PORTS = 4, 2, 17, 2
WRITE_ONLY = 0xDEAD0000
SIZES = (1, 2, 4, 8)


class Card:
    """Registers, clock, watchdog, pins, and the axis that they drive."""

    def __init__(self, axis, seed, clock, bad, full_scale=10.0):
        self.axis, self.bad, self.full_scale = axis, bad, full_scale
        self._machine = SimulatedAxis(Setup(axis, seed, {}))
        self._machine.open()
        self.step, self.count_m = axis.value("period"), axis.value("sensors.encoder.resolution")
        self._manual, self._began, self.time, self._stepped = clock, time.monotonic(), 0.0, 0.0
        self.reading = self._machine.read()
        self.counts, self.stamp_time = round(self.reading.encoder / self.count_m), 0.0
        self.status = [0] * 16   # of space 6
        self.scratch = bytearray(0x20)
        self.reboot()
        self.bites, self.most_voltage, self.volts_log = 0, 0.0, 0.0

    def reboot(self):
        """As after power-up: counters 0, pins inputs, watchdog idle."""
        self.source, self.direction = [0] * PORTS, [0] * PORTS
        self.pwm = {"value": [0] * OUTPUTS, "mode": [0] * OUTPUTS, "rate": 0, "pdm": 0, "enable": 0}
        self.divider, self.control = 0, [0] * ENCODERS
        self.timer, self.due, self.bitten = 0xFFFFFFFF, None, 0
        self.zero = self.counts

    # --- time ----------------------------------------------------------------------------------------------

    def go_on(self, new_question=False):
        """Let the card's clock run; the axis follows in steps of its own period, the watchdog bites when it is due."""
        self.time = self.time + (self._manual if new_question else 0.0) if self._manual else time.monotonic() - self._began
        while self._stepped + self.step <= self.time:
            self._stepped += self.step
            if self.due is not None and self._stepped >= self.due:
                self._bite()
            volts = self.volts()
            self.most_voltage = max(self.most_voltage, abs(volts))
            self._machine.write(volts)
            self.reading = self._machine.read()
            counts = round(self.reading.encoder / self.count_m)
            if counts != self.counts:
                self.counts, self.stamp_time = counts, self._stepped
        if self.due is not None and self.time >= self.due:
            self._bite()

    def _bite(self):
        self.bitten, self.due = 1, None
        self.direction = [0] * PORTS
        self.bites += 1

    def volts(self):
        """At the amplifier: only through enabled output, source and direction of its pins."""
        if not self.pwm["enable"] & 1 or self.direction[0] & 0b11 != 0b11 or self.source[0] & 0b11 != 0b11:
            return 0.0
        bits = 9 + (self.pwm["mode"][0] & 3)
        value = self.pwm["value"][0]
        share = (value >> 16 & 0x7FFF) / ((1 << bits) - 1)
        if self.pwm["rate"] == 0:
            return 0.0
        return (-1.0 if value >> 31 else 1.0) * min(share, 1.0) * self.full_scale

    # --- registers -----------------------------------------------------------------------------------------

    def stamp(self, seconds):
        """The stamp counter at a time of the card."""
        return int(seconds * CLOCK_LOW / (self.divider + 2)) & 0xFFFF

    def read32(self, address):
        """One register of hostmot2."""
        constant = self._constant(address)
        if constant is not None:
            return constant
        register, instance = (address & 0xF00) // REGISTER, (address & 0xFF) // INSTANCE
        base = address & 0xF000 if address >= 0x1000 else address & 0xFC00
        if base == WATCHDOG:
            left = 0xFFFFFFFF if self.due is None else max(int((self.due - self.time) * CLOCK_LOW), 0)
            return (left, self.bitten, WRITE_ONLY)[min((address - WATCHDOG) // REGISTER, 2)]
        if base == IOPORT:
            return (0x1FFFF, self.direction[instance % PORTS])[register] if register < 2 else WRITE_ONLY
        if base == ENCODER and register == 0:
            counts = self.counts - self.zero if instance == 0 else 0
            return self.stamp(self.stamp_time) << 16 | counts & 0xFFFF
        if base == ENCODER and register == 3:
            return self.stamp(self.time)
        return WRITE_ONLY

    def _constant(self, address):
        bad = self.bad
        if address in (0x100, 0x104, 0x108, 0x10C):
            name = b"HOSTCAR2" if bad == "name" else b"HOSTMOT2"
            return {0x100: 0x55AACAFE if bad != "cookie" else 0x12345678, 0x104: int.from_bytes(name[:4], "little"),
                    0x108: int.from_bytes(name[4:], "little"), 0x10C: 0x7000_0000 | IDROM}[address]
        if IDROM <= address < IDROM + 0x40:
            board = [int.from_bytes(b"MESAEMUL"[k:k + 4], "little") for k in (0, 4)]
            width = PORTS * PORT_PINS + (1 if bad == "width" else 0)
            return [9 if bad == "idrom" else 3, MODULES, PINS, *board, 0, 0, PORTS, width, PORT_PINS, CLOCK_LOW, CLOCK_HIGH, INSTANCE, 0x40,
                    REGISTER, 0x4][(address - IDROM) // 4]
        if IDROM + MODULES <= address < IDROM + PINS:
            number, word = divmod((address - IDROM - MODULES) // 4, 3)
            return self._module(number)[word]
        if IDROM + PINS <= address < IDROM + PINS + 4 * PORTS * PORT_PINS:
            pin = (address - IDROM - PINS) // 4
            function = {0: (0x81, 6, 0), 1: (0x82, 6, 0), 2: (1, 4, 0), 3: (2, 4, 0)}.get(pin, (0, 0, 0))
            return function[0] | function[1] << 8 | function[2] << 16 | 3 << 24
        return None

    def _module(self, number):
        version = 7 if self.bad == "version" else 2
        modules = [(2, 0, 1, 1, WATCHDOG, 3, 0), (3, 0, 1, PORTS, IOPORT, 5, 0x1F), (4, version, 9 if self.bad == "clock" else 1, ENCODERS, ENCODER, 5, 0x03)]
        if self.bad != "no_pwm":
            modules.append((6, 0, 2, OUTPUTS, PWM, 5, 0x03))
        if number >= len(modules):
            return (128 | 1 << 16 | 1 << 24, 0x0200, 0) if self.bad == "endless" else (0, 0, 0)
        gtag, version, clock, instances, base, registers, mask = modules[number]
        return gtag | version << 8 | clock << 16 | instances << 24, base | registers << 16, mask

    def write32(self, address, value):
        """One register of hostmot2."""
        register, instance = (address & 0xF00) // REGISTER, (address & 0xFF) // INSTANCE
        base = address & 0xF000 if address >= 0x1000 else address & 0xFC00
        if base == WATCHDOG:
            register = (address - WATCHDOG) // REGISTER
            if register == 0:
                if value & 0x80000000 and self.due is not None:
                    self._bite()
                self.timer = value
            elif register == 1:
                self.bitten = value & 1
            elif value == 0x5A000000 and not self.timer & 0x80000000:
                self.due = self.time + (self.timer + 1) / CLOCK_LOW
        elif base == IOPORT and register in (1, 2):
            (self.direction if register == 1 else self.source)[instance % PORTS] = value
        elif base == ENCODER:
            if register == 0 and instance == 0:
                self.zero = self.counts
            elif register == 2:
                self.divider = value
            elif register == 1:
                self.control[instance % ENCODERS] = value
        elif base == PWM:
            name = ("value", "mode", "rate", "pdm", "enable")[min(register, 4)]
            if register < 2:
                self.pwm[name][instance % OUTPUTS] = value
            else:
                self.pwm[name] = value


class Parser:
    """LBP16: runs the commands of a datagram in order; an error ends it there, unanswered."""

    def __init__(self, card):
        self.card, self._pointers = card, [0] * 8

    def run(self, data):
        """The answer, None for none."""
        card, place, answer = self.card, 0, b""
        card.status[4] += 1  # frames received (08h)
        while place + 2 <= len(data):
            (word,) = struct.unpack_from("<H", data, place)
            place += 2
            write, space, size, count = word >> 15, word >> 10 & 7, SIZES[word >> 8 & 3], word & 127
            if word & 0x4000:
                if place + 2 > len(data):
                    return self._error()
                (self._pointers[space],) = struct.unpack_from("<H", data, place)
                place += 2
            if count == 0 or space == 5 or (space == 0 and size != 4) or (write and space == 7) or (space in (1, 2, 7) and size != 2):
                return self._error()
            address = self._pointers[space]
            for k in range(count):
                at = address + (k * size if word & 0x80 else 0)
                if write:
                    chunk = data[place:place + size].ljust(size, b"\xa5")  # short data: what lies in the buffer
                    place += size
                    self._write(space, at, int.from_bytes(chunk, "little"), size)
                else:
                    answer += self._read(space, at, size)
            if word & 0x80:
                self._pointers[space] = address + count * size & 0xFFFF
            if len(answer) > 1472:
                return self._error()
        card.status[5] += 1
        return answer or None

    def _error(self):
        self.card.status[0] |= 1
        self.card.status[1] += 1

    def _read(self, space, at, size):
        card = self.card
        if space == 0:
            value = card.read32(at)
        elif space == 4:
            value = int.from_bytes(card.scratch[at - 0x10:at - 0x10 + size], "little") if at >= 0x10 else int(card.time * 1e6)
        elif space == 6:
            value = card.status[(at >> 1) & 15]
        elif space == 7:
            value = int.from_bytes(b"MESAEMUL\0\0\0\0\0\0\0\0"[at:at + 2], "little")
        else:
            value = 0
        return (value & (1 << 8 * size) - 1).to_bytes(size, "little")

    def _write(self, space, at, value, size):
        if space == 0:
            self.card.write32(at, value)
        elif space == 4 and at >= 0x10:
            self.card.scratch[at - 0x10:at - 0x10 + size] = (value & (1 << 8 * size) - 1).to_bytes(size, "little")


def serve(card, faults, seed):
    """Answer until standard input closes."""
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("127.0.0.1", 0))
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    parser, rng = Parser(card), np.random.default_rng(seed)
    print(link.getsockname()[1], flush=True)
    held, questions = [], 0

    def happens(name):
        return rng.random() < faults.get(name, 0.0)

    while True:
        card.go_on()
        ready = select.select([link, sys.stdin], [], [], 0.001)[0]
        for due, data, peer in [entry for entry in held if entry[0] <= time.monotonic()]:
            link.sendto(data, peer)
            held.remove((due, data, peer))
        if link not in ready:
            if sys.stdin in ready and not sys.stdin.readline():
                return
            continue
        data, peer = link.recvfrom(2048)
        asks = len(data) > 20 and data[1] & 0x80 == 0
        questions += asks
        if questions > faults.get("after", 0):
            if happens("drop_request"):
                continue
            if happens("reboot"):
                card.reboot()
        card.go_on(asks)
        answer = parser.run(data)
        if answer is None:
            continue
        if questions > faults.get("after", 0):
            if happens("drop_reply"):
                continue
            if happens("truncate"):
                answer = answer[:-3]
            if happens("foreign"):
                stranger.sendto(b"\0" * len(answer), peer)
            if happens("delay"):
                held.append((time.monotonic() + faults.get("delay_s", 0.01), answer, peer))
                continue
            if happens("duplicate"):
                link.sendto(answer, peer)
        link.sendto(answer, peer)


def main():
    """Run the card."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--axis", required=True)
    parser.add_argument("--clock", type=float, default=0.0)
    parser.add_argument("--faults", type=json.loads, default={})
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--bad", default="")
    parser.add_argument("--priority", type=int, default=0, help="real-time, where it is permitted: a card does not wait for other processes")
    arguments = parser.parse_args()
    if arguments.priority:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(arguments.priority))
    card = Card(load_axis(arguments.axis), arguments.seed, arguments.clock, arguments.bad)
    serve(card, arguments.faults, arguments.seed)
    card.go_on()
    print(json.dumps({"volts": card.volts(), "bites": card.bites, "most_voltage": card.most_voltage, "time": card.time,
                      "stage_m": card._machine.truth.stage_position, "errors": card.status[1]}), flush=True)


if __name__ == "__main__":
    main()
