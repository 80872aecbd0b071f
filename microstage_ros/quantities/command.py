"""What a machine can be commanded with: quantity, unit, and the names of its columns in records."""

from collections.abc import Container
from typing import NamedTuple


class Command(NamedTuple):
    """A quantity that an amplifier, a driver or a current loop is commanded with.

    Attributes
    ----------
    quantity, unit, units : word, SI unit, and the unit in words.
    column : of a record: the command held during the period.
    disturbance : column of the part of it that was added on purpose after the controller.
    """

    quantity: str
    unit: str
    units: str
    column: str
    disturbance: str

    def as_dict(self) -> dict[str, str]:
        """What a record's or a bag's metadata says of it, under the key ``command``."""
        return {"column": self.column, "quantity": self.quantity, "unit": self.unit}


VOLTAGE = Command("voltage", "V", "volts", "voltage_V", "disturbance_V")
FORCE = Command("force", "N", "newtons", "force_N", "disturbance_N")
TORQUE = Command("torque", "N m", "newton metres", "torque_Nm", "disturbance_Nm")
CURRENT = Command("current", "A", "amperes", "current_command_A", "disturbance_A")
ANGLE = Command("angle", "rad", "radians", "angle_command_rad", "disturbance_rad")
POSITION = Command("position", "m", "metres", "position_command_m", "disturbance_m")
COMMANDS = (VOLTAGE, FORCE, TORQUE, CURRENT, ANGLE, POSITION)
COLUMNS = tuple(command.column for command in COMMANDS)
"""Names of the columns of which a record has one; the first that it has is its command."""


def command_of(names: Container[str]) -> Command | None:
    """The `Command` whose column stands among a record's columns, the first of `COMMANDS`; None if there is none."""
    return next((command for command in COMMANDS if command.column in names), None)
