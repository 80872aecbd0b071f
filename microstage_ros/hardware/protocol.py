"""What an axis looks like from its driver: four calls, one reading.

A backend is any class with the methods of `Hardware`; it is added by writing one file and one line in
`hardware.BACKENDS`. The driver calls, once per control period,

    reading = read()      sensors at the start of the period
    write(voltage)        held from now on, until the next write

and `write(0.0)` whenever it has to be safe. Backends never see a voltage that is not finite.

Nothing else is asked of a backend. One whose machine has a drive enable, an emergency stop, limit switches or a
watchdog has one or more of the members of `SafetyMembers` too; the driver looks for each (`safety_members`) and uses
what is there.
Time stamps, temperature and index mark are members of `Instruments`, which `commission` reports.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol


class Reading(NamedTuple):
    """Sensors at the start of one control period; NaN where there is no such sensor (SI)."""

    encoder: float  # m
    current: float = math.nan  # A
    motor_angle: float = math.nan  # rad


class Truth(NamedTuple):
    """What only a simulated axis can tell, and what its simulated instruments see (SI)."""

    stage_position: float  # m
    stage_velocity: float  # m/s
    actuator_torque: float  # N m at the motor shaft
    guideway_force: float  # N
    interferometer: float  # m
    air_temperature: float  # K
    air_pressure: float  # Pa
    air_humidity: float  # 0 to 1
    stage_temperature: float  # K


class HardwareError(RuntimeError):
    """The hardware reported an error; the text says which, in its own words."""


@dataclass(frozen=True)
class Setup:
    """What a backend is opened with.

    Attributes
    ----------
    axis : `model.axis_file.Axis`: limits, resolutions, period.
    seed : of the random numbers of a simulated axis.
    options : name to value, what else the backend asks for (device names, noise, start position).
    """

    axis: object
    seed: int = 0
    options: dict | None = None


class Hardware(Protocol):
    """The calls of a backend, in the order in which they come. These five members and no others are required."""

    simulated: bool
    """True: time may be stepped, nothing moves."""

    def open(self) -> None:
        """Take hold of the device with the voltage at zero. Raises `HardwareError`."""

    def read(self) -> Reading:
        """Sensors now. Raises `HardwareError`."""

    def write(self, voltage: float) -> None:
        """Hold ``voltage`` [V] from now on. Raises `HardwareError`."""

    def close(self) -> None:
        """Voltage to zero and let go of the device; may be called twice."""


class SafetyMembers(Protocol):
    """Members that a backend may have beside those of `Hardware`, each for itself; all raise `HardwareError`.

    They are called by the driver's loop, in the thread and at the places where it calls `read` and `write`, apart from
    `outside_stop`, which is asked for once after `open`.
    """

    def enable(self, on: bool) -> None:
        """Switch the drive's enable output. On when the driver is activated, after ``write(0.0)``; off after
        ``write(0.0)`` when it is deactivated, on every fault, and on every way out. For a drive that holds a position
        (`Actuator.holds_on_fault`) the last command is written in place of zero, and a fault may leave the enable on
        (`Actuator.disables_on_fault`).
        """

    def e_stop(self) -> bool:
        """True while the emergency stop is pressed or its circuit is open. Called once per control period, after
        `read`, and while the driver is inactive; True is the fault ``e_stop``. The circuit itself has to take the power
        away without this program.
        """

    def limit_switches(self) -> tuple[bool, bool]:
        """True for the switch at the lower and at the upper end of the travel while it is actuated. Called once per
        control period, after `read`. At an actuated switch a voltage that drives towards it is the fault
        ``limit_switch``; one that drives away from it is let through.
        """

    def watchdog(self, seconds: float) -> None:
        """Arm the card's own watchdog: its output goes to zero by itself when no `write` comes for ``seconds`` [s]; 0
        disarms. Armed when the driver is activated and after a reset, with the backend's option ``watchdog_s`` or,
        where it has none, with what the watchdog's process has (4.5 ms by default); disarmed when it is deactivated,
        since it writes no more then. Not called for a drive that holds a position.
        """

    def outside_stop(self) -> tuple[str, dict]:
        """How another process takes the voltage away if this one hangs or is gone: ``("package.module:function",
        arguments)``. The function is called as ``function(**arguments)``, may be called again and again, and returns
        once the output is at zero; the arguments are plain values (JSON).
        """


class Instruments(Protocol):
    """Members that a backend may have beside those of `Hardware`, each for itself, that tell more of a reading.

    All raise `HardwareError`.
    """

    def reading_time(self) -> float:
        """The instant of the last reading by the card's own clock [s], from any zero.

        `commission` reports how even the readings are.
        """

    def temperature(self) -> float:
        """Temperature of the machine [K], NaN while there is none. Asked for now and then, beside no motion."""

    def index(self) -> float:
        """Encoder position at the index mark that was passed last [m], NaN before the first."""

    def follow(self) -> None:
        """Called every 50 ms while the driver is inactive, by a driver whose hardware is open: for a card whose counter
        would else wrap unseen while the stage is moved by hand. In the control periods `read` follows it."""


SAFETY = ("enable", "e_stop", "limit_switches", "watchdog", "outside_stop")
"""Names of the members of `SafetyMembers`."""


INSTRUMENTS = ("reading_time", "temperature", "index", "follow")
"""Names of the members of `Instruments`."""


def instruments(hardware):
    """The members of `Instruments` that a backend has, name to callable."""
    found = {name: getattr(hardware, name, None) for name in INSTRUMENTS}
    return {name: member for name, member in found.items() if callable(member)}


def safety_members(hardware):
    """The members of `SafetyMembers` that a backend has, name to callable."""
    found = {name: getattr(hardware, name, None) for name in SAFETY}
    return {name: member for name, member in found.items() if callable(member)}
