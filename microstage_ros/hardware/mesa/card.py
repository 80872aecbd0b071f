"""The backend ``mesa``: an encoder and a ±10 V output by PWM on a Mesa Ethernet card, paced by the computer at 1 to 2
kHz.

Every `write` sends the voltage and pets the card's watchdog; every `read` asks for count, time stamp and watchdog. A
lost answer is asked for once more within the period, then the last reading stands; a lost write is noticed by the next
read and sent again. The error level rises by 2 with each loss and falls by 1 with each good period; at `MOST_ERRORS`
the backend gives up, falls silent, and the card's watchdog takes the pins away. No card was at hand: this is tested
against an emulator of the registers only.
"""

import math
import struct
from contextlib import suppress

from microstage_ros.hardware.mesa import hostmot2 as hm
from microstage_ros.hardware.mesa.lbp16 import PORT, Link, read32, write32
from microstage_ros.hardware.protocol import HardwareError, Reading
from microstage_ros.quantities.errors import InputError

OPTIONS = {
    "host": "192.168.1.121",
    "port": PORT,
    "encoder": 0,
    "output": 0,
    "full_scale": 10.0,
    "pwm_hz": 24e3,
    "pwm_mode": "up_down",
    "direction": 1,
    "counts_direction": 1,
    "position": 0.0,
    "watchdog_s": 5e-3,
    "wait_share": 0.8,
    "filter": True,
    "patience_s": 0.2,
    "current_encoder": None,
    "current_zero_hz": 0.0,
    "current_A_per_hz": 0.0,
}
"""Options with their defaults. ``encoder``, ``output``: instances. ``full_scale``: volts at the amplifier for full
output. ``direction``, ``counts_direction``: 1 or -1. ``position``: of the stage at `open` [m]. ``watchdog_s``: the card
cuts the output after so long without a write. ``wait_share``: of the period, for the answer. ``patience_s``: for an
answer while the card is set up [s]. ``current_encoder``: instance in up/down mode
that counts a voltage-to-frequency converter (THCAD), with its frequency at no current and amperes per hertz."""

MODES = {"pwm_dir": 0, "up_down": 2, "pdm": 3, "offset": 0}
"""Mode bits 4 and 3 of the PWM generator; ``offset``: 50 % is zero volts."""

LOSS, MOST_ERRORS = 2, 10
STAMP_DIVIDER_HZ = 2e6
PET = 0x5A000000


class MesaCard:
    """An axis on a Mesa card.

    Parameters
    ----------
    setup : `protocol.Setup`; options as in `OPTIONS`.
    """

    simulated = False

    def __init__(self, setup):
        given = dict(setup.options or {})
        for name in given:
            if name not in OPTIONS:
                raise InputError(f"Mesa card: option {name}", given[name], "one of " + ", ".join(OPTIONS))
        self.options = {**OPTIONS, **given}
        self._check()
        self.period = setup.axis.value("period")
        self._count = setup.axis.value("sensors.encoder.resolution")
        self._limit = min(setup.axis.value("drive.voltage_limit"), float(self.options["full_scale"]))
        self._link: Link | None = None
        self.layout: hm.Layout          # what the card holds: from `open` on
        self._errors, self._voltage = 0, 0.0
        self._counts = 0
        self._before: tuple[int, int, int] | None = None
        self.velocity = 0.0

    def _check(self):
        for name in ("direction", "counts_direction"):
            if self.options[name] not in (1, -1):
                raise InputError(f"Mesa card: option {name}", self.options[name], "1 or -1")
        if self.options["pwm_mode"] not in MODES:
            raise InputError("Mesa card: option pwm_mode", self.options["pwm_mode"], "one of " + ", ".join(MODES))
        for name in ("full_scale", "pwm_hz", "watchdog_s", "wait_share", "patience_s"):
            if not (_is_number(self.options[name]) and self.options[name] > 0.0):
                raise InputError(f"Mesa card: option {name}", self.options[name], "a number above 0")
        for name in ("position", "current_zero_hz", "current_A_per_hz"):
            if not _is_number(self.options[name]):
                raise InputError(f"Mesa card: option {name}", self.options[name], "a number")
        for name in ("port", "encoder", "output", "current_encoder"):
            value, may_miss = self.options[name], OPTIONS[name] is None
            if (isinstance(value, bool) or not isinstance(value, int)) and not (value is None and may_miss):
                raise InputError(f"Mesa card: option {name}", value, "a whole number")

    @property
    def _wire(self):
        """The link to the card; raises `HardwareError` while there is none."""
        if self._link is None:
            raise HardwareError("the Mesa card is not open")
        return self._link

    # --- set-up ------------------------------------------------------------------------------------------------

    def open(self):
        """Find the card, set it up with the output at zero volts, arm the watchdog. Raises `HardwareError`."""
        self._link = Link(str(self.options["host"]), int(self.options["port"]), float(self.options["patience_s"]))
        try:
            self.layout = layout = hm.discover(self._link)
            self._watchdog = layout.module(hm.WATCHDOG)
            self._encoder = layout.module(hm.ENCODER, hm.MUXED_ENCODER)
            self._pwm = layout.module(hm.PWM)
            self._instance("encoder", self._encoder)
            self._instance("output", self._pwm)
            self._configure()
            self._errors, self._before = 0, None
            self._counts = round(float(self.options["position"]) / self._count) * int(self.options["counts_direction"])
            self._first_reading()
        except HardwareError:
            self._wire.close()
            self._link = None
            raise

    def _instance(self, name, module):
        if not 0 <= int(self.options[name]) < module.instances:
            raise HardwareError(
                f"Mesa card {self.layout.board}: {name} {self.options[name]}, the bit file has {module.instances}"
            )

    def _configure(self):
        """All registers, output value before its enable, directions last."""
        unit, pwm, watchdog, encoder = int(self.options["output"]), self._pwm, self._watchdog, self._encoder
        rate, self._bits = pwm_rate(float(self.options["pwm_hz"]), pwm.clock, self.options["pwm_mode"] == "pdm")
        mode = self._bits - 9 | MODES[self.options["pwm_mode"]] << 3
        divider = max(round(encoder.clock / STAMP_DIVIDER_HZ) - 2, 0)
        self._stamp_hz = encoder.clock / (divider + 2)
        control = 0x800 if self.options["filter"] else 0
        self._send_checked(
            write32(watchdog.address(0), round(float(self.options["watchdog_s"]) * watchdog.clock) - 1),
            write32(watchdog.address(1), 0),
            write32(pwm.address(2 if self.options["pwm_mode"] != "pdm" else 3), rate),
            write32(pwm.address(1, unit), mode),
            write32(pwm.address(0, unit), self._value(0.0)),
            write32(encoder.address(2), divider),
            write32(encoder.address(1, int(self.options["encoder"])), control),
            write32(watchdog.address(2), PET),
        )
        self._send_checked(write32(pwm.address(4), 1 << unit), *self._pins(unit), write32(watchdog.address(2), PET))

    def _pins(self, unit):
        """Source and direction of the pins that the output needs; all others stay inputs."""
        port = self.layout.module(hm.IOPORT)
        masks: dict[int, int] = {}
        for pin in self.layout.pins_of(hm.PWM, unit):
            if pin.is_output:
                masks[pin.port] = masks.get(pin.port, 0) | 1 << pin.number
        if not masks:
            raise HardwareError(f"Mesa card {self.layout.board}: no pin carries PWM output {unit}")
        sources = [write32(port.address(2, number), mask) for number, mask in masks.items()]
        return sources + [write32(port.address(1, number), mask) for number, mask in masks.items()]

    def _send_checked(self, *commands, wait=0.2):
        """Writes of the set-up, sent until the card has taken them; ``wait`` for each answer [s]."""
        link = self._wire
        link.write(*commands)
        for _ in range(5):
            found = link.read(read32(hm.COOKIE), 4, wait)
            if found is not None and found[1]:
                return
            link.repeat_write()
        raise HardwareError("the Mesa card does not take its configuration")

    def _first_reading(self):
        for _ in range(5):
            found = self._wire.read(*self._question(), 0.2)
            if found is not None:
                self._take(found[0])
                return
        raise HardwareError("the Mesa card answers no readings")

    # --- every period ------------------------------------------------------------------------------------------

    def _question(self):
        """(read commands, bytes of their data) of one period: watchdog, clock of the stamps, counts."""
        encoder = self._encoder
        commands = (
            read32(self._watchdog.address(1))
            + read32(encoder.address(3))
            + read32(encoder.address(0, int(self.options["encoder"])))
        )
        if self.options["current_encoder"] is not None:
            return commands + read32(encoder.address(0, int(self.options["current_encoder"]))), 16
        return commands, 12

    def read(self):
        """Encoder, and current where a converter counts it. Raises `HardwareError`: watchdog, or too many losses."""
        link = self._wire
        wait = max(float(self.options["wait_share"]) * self.period, 1e-4)
        found = link.read(*self._question(), 0.5 * wait) or link.read(*self._question(), 0.5 * wait)
        if found is None:
            self._loss("no answer")
            return self.reading
        data, written = found
        if not written:
            link.repeat_write()
            self._loss("a voltage did not arrive")
        else:
            self._errors = max(self._errors - 1, 0)
        self._take(data)
        return self.reading

    def follow(self):
        """Read, while nobody commands: the counter has 16 bit. What is wrong with the card the next `read` says."""
        with suppress(HardwareError):
            self.read()

    def _loss(self, what):
        self._errors = min(self._errors + LOSS, MOST_ERRORS + LOSS)  # a card that answers again is soon believed
        if self._errors >= MOST_ERRORS:
            raise HardwareError(
                f"Mesa card: {what}, error level {self._errors} (lost {self._wire.lost}, stale {self._wire.stale}, "
                f"sent again {self._wire.repeated}); its watchdog cuts the output"
            )

    def _take(self, data):
        """Counts and stamps of one answer; the 16-bit counter is summed up by signed differences."""
        status, clock, count, *current = struct.unpack(f"<{len(data) // 4}I", data)
        stamp, now = count >> 16, clock & 0xFFFF
        if self._before is not None:
            moved = ((count & 0xFFFF) - self._before[0] + 0x8000 & 0xFFFF) - 0x8000
            self._speed(moved, stamp, now, self._before[1])
            self._counts += moved
        self._before = (count & 0xFFFF, stamp, now)
        sign = int(self.options["counts_direction"])
        self.reading = Reading(
            sign * self._counts * self._count, self._current(current[0], now) if current else math.nan
        )
        if status & 1:  # after the counts: the stage may be moved by hand until somebody resets
            raise HardwareError(
                "Mesa card: its watchdog has cut the output (no write for "
                f"{float(self.options['watchdog_s']) * 1e3:g} ms)"
            )

    def _speed(self, moved, stamp, now, stamp_before):
        """Speed by counts over the time between their events; without an event at most one count over the time
        since."""
        tick = 1.0 / self._stamp_hz
        since = ((now - stamp) & 0xFFFF) * tick
        if moved:
            between = ((stamp - stamp_before) & 0xFFFF) * tick
            self.velocity = (
                int(self.options["counts_direction"]) * moved * self._count / between if between > 0.0 else 0.0
            )
        elif since > 0.0:
            most = self._count / since
            self.velocity = math.copysign(min(abs(self.velocity), most), self.velocity)

    def _current(self, count, now):
        """Current [A] by counts of a converter over the time between two readings."""
        before, self._converter = getattr(self, "_converter", None), (count & 0xFFFF, now)
        if before is None:
            return math.nan
        counted, seconds = (count & 0xFFFF) - before[0] & 0xFFFF, ((now - before[1]) & 0xFFFF) / self._stamp_hz
        if seconds <= 0.0:
            return math.nan
        return (counted / seconds - float(self.options["current_zero_hz"])) * float(self.options["current_A_per_hz"])

    def write(self, voltage):
        """Hold ``voltage`` [V] at the amplifier and pet the watchdog; `HardwareError` if the card is not open."""
        link = self._wire
        self._voltage = min(max(float(voltage), -self._limit), self._limit)
        unit = int(self.options["output"])
        link.write(
            write32(self._pwm.address(0, unit), self._value(self._voltage)), write32(self._watchdog.address(2), PET)
        )

    def _value(self, voltage):
        """The PWM generator's value register for a voltage."""
        share = int(self.options["direction"]) * voltage / float(self.options["full_scale"])
        share = min(max(share, -1.0), 1.0)
        if self.options["pwm_mode"] == "offset":
            half = 1 << self._bits - 1
            return round(half + share * (half - 1)) << 16
        return round(abs(share) * ((1 << self._bits) - 1)) << 16 | (0x80000000 if share < 0.0 else 0)

    def enable(self, on):
        """The card's own enable output of the channel, sent until the card has taken it. Raises `HardwareError`."""
        if self._link is not None:
            self._send_checked(write32(self._pwm.address(4), 1 << int(self.options["output"]) if on else 0), wait=0.02)

    def watchdog(self, seconds):
        """Arm the card's watchdog with another time, ``seconds`` [s]; 0 for the longest it can be. One that has cut the
        output gives it back: the caller has written zero volts."""
        if self._link is not None:
            ticks = round(seconds * self._watchdog.clock) - 1 if seconds > 0.0 else 0x7FFFFFFF
            self._send_checked(
                write32(self._watchdog.address(0), min(max(ticks, 1), 0x7FFFFFFF)),
                write32(self._watchdog.address(1), 0),
                write32(self._watchdog.address(2), PET),
                *self._pins(int(self.options["output"])),
            )

    def close(self):
        """Zero volts, output off, watchdog due at once; may be called twice."""
        link, self._link = self._link, None
        if link is None:
            return
        try:
            unit, off = int(self.options["output"]), write32(self._watchdog.address(0), 1)
            for _ in range(3):  # nothing tells whether one arrived
                link.send(write32(self._pwm.address(0, unit), self._value(0.0)), write32(self._pwm.address(4), 0), off)
        finally:
            link.close()


def _is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def pwm_rate(frequency, clock, pdm=False):
    """(rate register, bits) for a PWM ``frequency`` [Hz]: the most bits that the ``clock`` [Hz] allows.

    Raises `InputError` for a frequency that no register value gives.
    """
    if pdm:
        rate = frequency * 65536.0 / clock
        if not 1.0 <= rate < 65536.0:
            raise InputError("Mesa card: option pwm_hz", frequency, f"a pulse rate below {clock:g} Hz")
        return round(rate), 12
    for bits in (12, 11, 10, 9):
        rate = frequency * 65536.0 * 2**bits / clock
        if 1.0 <= rate < 65535.5:
            return round(rate), bits
    raise InputError(
        "Mesa card: option pwm_hz", frequency, f"from {clock / 65536.0 / 512.0:.3g} to {clock / 512.0:.4g} Hz"
    )
