"""The columns of a record: name, what it holds, unit, and how finely a CSV file writes it.

The names are part of the outside face of the project; nothing else about a record is agreed
by name.  Rows follow one convention: row n holds the sensors as they were read at the start of
control period n and the voltage that was held during period n.
"""

from dataclasses import dataclass

from microstage_ros.quantities.command import COLUMNS
from microstage_ros.quantities.command import COMMANDS as COMMANDS_KNOWN


@dataclass(frozen=True)
class Column:
    """What one column holds.

    Attributes
    ----------
    unit : SI unit of the values.
    meaning : one line for a reader of the file.
    decimals : digits after the point in a CSV file; far below what any sensor here resolves.
    """

    unit: str
    meaning: str
    decimals: int


RECORD_COLUMNS = {
    "t_s": Column("s", "time of the row", 10),
    "encoder_m": Column("m", "encoder position at the start of the period", 13),
    "reference_m": Column("m", "position asked for", 13),
    "voltage_V": Column("V", "command sent to the amplifier, held during the period", 10),
    "force_N": Column("N", "command of a force-driven axis, held during the period", 9),
    "current_A": Column("A", "motor current at the start of the period", 10),
    "motor_angle_rad": Column("rad", "angle of the motor shaft at the start of the period", 10),
    "disturbance_V": Column("V", "part of voltage_V added on purpose after the controller", 10),
    "interferometer_m": Column("m", "interferometer position at the start of the period", 13),
    "air_temperature_K": Column("K", "air temperature along the beam", 7),
    "air_pressure_Pa": Column("Pa", "air pressure along the beam", 4),
    "air_humidity": Column("1", "relative humidity of the air, 0 to 1", 6),
    "stage_temperature_K": Column("K", "temperature of the stage", 7),
}
"""The columns of CONTRACT, in the order in which files are written."""

SIMULATED_COLUMNS = {
    "stage_m": Column("m", "true stage position (simulation only)", 13),
    "stage_velocity_m_s": Column("m/s", "true stage velocity (simulation only)", 13),
    "motor_speed_rad_s": Column("rad/s", "true speed of the motor shaft (simulation only)", 10),
    "actuator_friction_Nm": Column("N m", "true actuator friction at the motor shaft (simulation only)", 14),
    "guideway_friction_N": Column("N", "true friction of the guideways (simulation only)", 10),
    "actuator_level": Column("1", "true actuator friction limit relative to nominal (simulation only)", 8),
    "guideway_level": Column("1", "true guideway friction limit relative to nominal (simulation only)", 8),
}
"""What only a simulator knows; files may carry it, analysis never needs it."""

COMMAND_COLUMNS = {
    name: column
    for command in COMMANDS_KNOWN
    for name, column in (
        (command.column, Column(command.unit, f"command ({command.quantity}), held during the period", 13)),
        (
            command.disturbance,
            Column(command.unit, f"part of {command.column} added on purpose after the controller", 13),
        ),
    )
    if name not in RECORD_COLUMNS
}
"""Commands in other units than volts, beyond CONTRACT's; see `quantities.command`."""

FINE_COLUMNS = {
    "fine_position_m": Column(
        "m", "position of a fine stage on top, relative to the coarse one, by its own sensor", 13
    ),
    "fine_command_V": Column("V", "command of the fine stage's drive, held during the period", 10),
}
"""What a machine of two components has beside (`control.runs.coarse_fine`)."""

KNOWN_COLUMNS = {**RECORD_COLUMNS, **COMMAND_COLUMNS, **FINE_COLUMNS, **SIMULATED_COLUMNS}

SUFFIXES = (".csv", ".csv.gz", ".csv.xz")
"""Of files of text."""
ENDINGS = (".mcap", *SUFFIXES)
"""Of records that a command writes."""

REQUIRED = ("t_s", "encoder_m", "reference_m")
COMMANDS = COLUMNS
"""One of these must be in every record."""


def in_file_order(names):
    """`names` in the order of `KNOWN_COLUMNS`; names that are not known come last."""
    order = {name: place for place, name in enumerate(KNOWN_COLUMNS)}
    return sorted(names, key=lambda name: (order.get(name, len(order)), name))
