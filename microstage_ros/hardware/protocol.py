"""What an axis looks like from its driver: four calls, one reading.

A backend is any class with the methods of `Hardware`; it is added by writing one file and one line in
`hardware.BACKENDS`. The driver calls, once per control period,

    reading = read()      sensors at the start of the period
    write(voltage)        held from now on, until the next write

and `write(0.0)` whenever it has to be safe. Backends never see a voltage that is not finite.
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
    options: dict = None


class Hardware(Protocol):
    """The calls of a backend, in the order in which they come."""

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
