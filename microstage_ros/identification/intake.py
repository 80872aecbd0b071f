"""Records on their way in: refused, mended where that is harmless, or let through with a warning."""

from dataclasses import replace

import numpy as np

from microstage_ros.model.actuators import actuator_of
from microstage_ros.quantities.command import COLUMNS
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.checks import check_record
from microstage_ros.signals.rows import bridged, longest_gap

SHORTEST = 1.0  # seconds of record that are of any use
LONGEST_GAP = 5  # missing samples in a row that are bridged by a straight line
MOST_SATURATED = 0.1  # share of the record at the amplifier's limit that is bridged over with a warning
USED = ("encoder_m", "reference_m", *COLUMNS, "current_A")
OPTIONAL = ("motor_angle_rad", "interferometer_m")  # better than the encoder where they are whole; else left out


def take_in(record, axis):
    """A record fit for identification, and the warnings about it.

    Refuses (InputError, naming place, value and what would be right) what `records.checks` refuses, gaps
    longer than five samples, a record of another kind of drive than the axis file's, and a record that is at the
    amplifier's limit for more than a tenth of its time (there the motor does not get what the column says).

    Parameters
    ----------
    record : `Record`. axis : `Axis`.

    Returns
    -------
    `Record` without missing samples in the columns that are used, and a list of sentences.
    """
    _drive(record, axis)
    names = [
        n
        for n in record.columns
        if n == "t_s" or n in USED or (n in OPTIONAL and longest_gap(record[n])[1] <= LONGEST_GAP)
    ]
    record = replace(record, columns={name: record.columns[name] for name in names})
    warnings = check_record(record, axis, SHORTEST)
    _saturation(record, axis)
    columns = {name: _bridge(record, name) for name in names if name in record}
    if actuator_of(axis).estimation == "motor":
        moved = np.ptp(columns["encoder_m"]) / max(axis.value("sensors.encoder.resolution"), 1e-15)
        if moved < 100:
            raise InputError(
                f"{record.source}: column encoder_m",
                f"{moved:.0f} counts of motion",
                "at least 100 counts: a record in motion",
            )
    return replace(record, columns=columns), warnings


def _drive(record, axis):
    """The command column must be the drive's: volts for a motor, newtons or volts for a force."""
    actuator = actuator_of(axis)
    if actuator.estimated(axis, "identify") == "motor":
        for name in ("voltage_V", "current_A"):
            if name not in record:
                raise InputError(
                    f"{record.source}: column {name}",
                    "missing",
                    f"{name}, since {axis.place} has a voltage-driven motor",
                )
    elif actuator.holds_position and actuator.command.column not in record:
        raise InputError(f"{record.source}: column {actuator.command.column}", "missing",
                         f"{actuator.command.column}, since {axis.place} has a drive of type {actuator.name}")
    elif "force_N" not in record and actuator.command.column not in record:
        raise InputError(f"{record.source}: column {actuator.command.column}", "missing",
                         f"{actuator.command.column} or force_N, since {axis.place} is driven by a force")


def _saturation(record, axis):
    command = actuator_of(axis).command
    if command.column not in record:
        return
    limit = actuator_of(axis).command_limit(axis)
    share = float(np.nanmean(np.abs(record[command.column]) >= 0.999 * limit))
    if share > MOST_SATURATED:
        raise InputError(
            f"{record.source}: column {command.column}",
            f"{share:.0%} of the time at the limit",
            f"a record that stays under {limit:g} {command.unit} nine tenths of the time; slower moves would",
        )


def _bridge(record, name):
    """Column with short gaps bridged; InputError for a long one, with its row."""
    values = record[name]
    start, length = longest_gap(values)
    if length > LONGEST_GAP:
        raise InputError(f"{record.source}: column {name}, row {start + 1} ({record['t_s'][start]:.6g} s)",
                         f"{length} samples missing in a row",
                         f"gaps of {LONGEST_GAP} samples at most; microstage cut writes what lies before and after")
    return bridged(values)
