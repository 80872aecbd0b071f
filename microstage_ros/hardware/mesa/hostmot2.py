"""What a hostmot2 bit file contains: modules, their registers, the pins, found out from the card's own description
(IDROM)."""

from dataclasses import dataclass

from microstage_ros.hardware.protocol import HardwareError

COOKIE, NAME, IDROM = 0x0100, 0x0104, 0x010C
WATCHDOG, IOPORT, ENCODER, PWM, MUXED_ENCODER = 2, 3, 4, 6, 12
NAMES = {WATCHDOG: "watchdog", IOPORT: "I/O port", ENCODER: "encoder", PWM: "PWM", MUXED_ENCODER: "muxed encoder"}
VERSIONS = {WATCHDOG: (0,), IOPORT: (0,), ENCODER: (2, 3, 0x83), MUXED_ENCODER: (3, 4, 0x84), PWM: (0, 1)}
MOST_MODULES, MOST_PINS = 32, 144


@dataclass(frozen=True)
class Module:
    """One kind of module: ``gtag``, version, clock [Hz], number of instances, and where its registers lie."""

    gtag: int
    version: int
    clock: int
    instances: int
    base: int
    register_stride: int
    instance_stride: int
    per_instance: int

    def address(self, register, instance=0):
        """Address [byte] of ``register``, its number [1]; of one ``instance`` [1] where every instance has its own."""
        own = instance if self.per_instance >> register & 1 else 0
        return self.base + register * self.register_stride + own * self.instance_stride


@dataclass(frozen=True)
class Pin:
    """One I/O pin: number in its port, the port, and the module that may drive or read it (``function``: which of its
    pins)."""

    port: int
    number: int
    gtag: int
    unit: int
    function: int

    @property
    def is_output(self):
        """The module drives it."""
        return bool(self.function & 0x80)


@dataclass(frozen=True)
class Layout:
    """A card: name, modules by gtag, pins."""

    board: str
    modules: dict
    pins: tuple

    def module(self, *gtags):
        """The first of the modules that the card has. Raises `HardwareError`."""
        for gtag in gtags:
            if gtag in self.modules:
                return self.modules[gtag]
        raise HardwareError(f"Mesa card {self.board}: its bit file has no {NAMES[gtags[0]]}; load one that has")

    def pins_of(self, gtag, unit):
        """The `Pin` of one instance, all of them: module ``gtag`` [1], instance ``unit`` [1]."""
        return [pin for pin in self.pins if pin.gtag == gtag and pin.unit == unit]


def discover(link):
    """`Layout` of the card behind ``link`` (`lbp16.Link`). Raises `HardwareError` for what is no hostmot2."""
    (cookie,) = link.ask32(COOKIE)
    if cookie != 0x55AACAFE:
        raise HardwareError(f"Mesa card: register 0100h reads {cookie:08X}h, expected 55AACAFEh of a hostmot2 bit file")
    name = b"".join(word.to_bytes(4, "little") for word in link.ask32(NAME, 2))
    if name != b"HOSTMOT2":
        raise HardwareError(f"Mesa card: its configuration is named {name!r}, expected HOSTMOT2")
    idrom = link.ask32(IDROM)[0] & 0xFFFF
    words = link.ask32(idrom, 16)
    if words[0] not in (2, 3):
        raise HardwareError(f"Mesa card: IDROM type {words[0]}, expected 2 or 3")
    board = b"".join(word.to_bytes(4, "little") for word in words[3:5]).decode("ascii", "replace").strip("\0 ")
    modules_at, pins_at, ports, width, port_width = words[1], words[2], words[7], words[8], words[9]
    if width != ports * port_width or not 0 < width <= MOST_PINS:
        raise HardwareError(
            f"Mesa card {board}: {width} I/O pins in {ports} ports of {port_width}: the description does not fit itself"
        )
    clocks, instance_strides, register_strides = {1: words[10], 2: words[11]}, words[12:14], words[14:16]
    if min(clocks.values()) < 1_000_000:
        raise HardwareError(f"Mesa card {board}: clocks of {words[10]} and {words[11]} Hz, expected 1 MHz and more")
    modules = _modules(link, idrom + modules_at, board, clocks, instance_strides, register_strides)
    pins = []
    for first in range(0, width, 32):
        found = link.ask32(idrom + pins_at + 4 * first, min(32, width - first))
        for offset, word in enumerate(found):
            number = first + offset
            pins.append(
                Pin(number // port_width, number % port_width, word >> 8 & 0xFF, word >> 16 & 0x7F, word & 0xFF)
            )
    return Layout(board, modules, tuple(pins))


def _modules(link, place, board, clocks, instance_strides, register_strides):
    found: dict[int, Module] = {}
    for number in range(MOST_MODULES):
        first, second, mask = link.ask32(place + 12 * number, 3)
        gtag, version, clock, instances = first & 0xFF, first >> 8 & 0xFF, first >> 16 & 0xFF, first >> 24 & 0xFF
        if gtag == 0:
            return found
        if gtag in VERSIONS:
            if version not in VERSIONS[gtag]:
                raise HardwareError(
                    f"Mesa card {board}: {NAMES[gtag]} of version {version}, expected one of {VERSIONS[gtag]}"
                )
            if clock not in clocks:
                raise HardwareError(f"Mesa card {board}: {NAMES[gtag]} with clock {clock}, expected 1 or 2")
            strides = second >> 24
            if (strides & 0xF) > 1 or (strides >> 4) > 1:
                raise HardwareError(
                    f"Mesa card {board}: {NAMES[gtag]} with strides {strides:02X}h, expected 0 or 1 in each half"
                )
            found[gtag] = Module(
                gtag,
                version,
                clocks[clock],
                instances,
                second & 0xFFFF,
                register_strides[strides & 0xF],
                instance_strides[strides >> 4],
                mask,
            )
    raise HardwareError(f"Mesa card {board}: its list of modules has no end")
