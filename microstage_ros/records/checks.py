"""Is this record what its header says?  Plausibility against the numbers of the axis it came from.

A record can be whole and still lie: millimetres for metres, two columns in each other's place, a
sensor that was not connected, an amplifier at its limit, a few seconds where a minute is needed.
What cannot be true is refused (`InputError`); what may be true but weakens a result is returned as
a warning in words.
"""

from dataclasses import dataclass

import numpy as np

from microstage_ros.model.actuators import actuator_of
from microstage_ros.quantities.command import COLUMNS, FORCE, command_of
from microstage_ros.quantities.errors import InputError

UNITS = {1e3: "mm", 1e6: "µm", 1e9: "nm"}
PLAUSIBLE = {
    "air_temperature_K": (230.0, 340.0, "kelvin (20 °C is 293.15)"),
    "stage_temperature_K": (230.0, 400.0, "kelvin (20 °C is 293.15)"),
    "air_pressure_Pa": (3e4, 1.2e5, "pascal (1013.25 hPa is 101325)"),
    "air_humidity": (0.0, 1.0, "a share from 0 to 1"),
}
"""Column to the range that any place on earth keeps, and the words for what would be right."""

OFF_GRID = 0.05
"""Median distance from a whole count above which positions are not counts; chance gives 0.25."""

MOST_MISSING = 0.5
MIRRORED = -0.9  # correlation of two readings of one motion, of which one has the other sign
MEAN_OVER = 0.1  # s, of the voltage that drives a motion
OPPOSED = -0.5  # of rms voltage times rms current; a load that is lowered reaches it, too, and its steps do not
MOST_SATURATED = 0.9
"""An axis in a limit cycle drives its amplifier from one limit to the other, and is worth looking at."""

MOST_CLIPPED = 0.5
FEW_SATURATED = 0.02
FINEST = 1e-9
"""Taken for a count [m] of a sensor that counts nothing (capacitive)."""

MOST_COUNTS = 2.0**62
"""Counts that a whole number of 64 bits holds; readings beyond them are refused as beyond the travel."""

FEW_COUNTS = 20
"""Travel, in counts, under which ratios of positions mean nothing."""


@dataclass(frozen=True)
class Bounds:
    """The numbers of an axis that a record must agree with; None where the axis has no such number.

    Attributes
    ----------
    resolution_m : one count of the encoder, 0 where it counts nothing. travel_m : length of the travel.
    limit_V : where the amplifier clips, in the command's unit ``limit_unit``. resistance_ohm : of the winding. period_s
        : control period.
    """

    resolution_m: float
    travel_m: float
    limit_V: float
    resistance_ohm: float | None = None
    period_s: float | None = None
    limit_unit: str = "V"

    @classmethod
    def of_axis(cls, axis):
        """The bounds of an `model.axis_file.Axis`."""
        def number(key):
            return axis.value(key) if axis.has(key) else None
        return cls(
            number("sensors.encoder.resolution"),
            number("travel.maximum") - number("travel.minimum"),
            actuator_of(axis).command_limit(axis),
            number("drive.resistance"),
            number("period"),
            actuator_of(axis).command.unit,
        )


def check_record(record, bounds, minimum_s=1.0):
    """Check a record against an axis.

    Parameters
    ----------
    record : `Record`.
    bounds : `Bounds`, or an `Axis`.
    minimum_s : shortest record that is of use [s].

    Returns
    -------
    list of str : what weakens a result, one sentence each; the record's own remarks come first.

    Raises
    ------
    InputError : what cannot be true, with column, value and what would be right.
    """
    if not isinstance(bounds, Bounds):
        bounds = Bounds.of_axis(bounds)
    if record.duration_s < minimum_s:
        raise InputError(f"{record.source}: length", f"{record.duration_s:.4g} s", f"at least {minimum_s:g} s")
    warnings = list(record.remarks)
    for check in (_period, _missing, _ranges, _constants, _counts, _position_units, _companions, _signs, _command,
                  _current, _driven, _clipped):
        warnings += check(record, bounds)
    return warnings


def span(record, name):
    """Largest minus smallest value of a column [unit of the column], 0 if it is absent or empty."""
    return float(np.nanmax(record[name]) - np.nanmin(record[name])) if name in record else 0.0


def _refuse(record, column, value, expected):
    raise InputError(f"{record.source}: column {column}", value, expected)


def _period(record, bounds):
    """Times in another unit look like a period a thousand times too long or short."""
    if bounds.period_s is None:
        return []
    ratio = record.period_s / bounds.period_s
    if ratio > 300 or ratio < 1 / 300:
        _refuse(record, "t_s", f"steps of {record.period_s:g}",
                f"seconds; the axis has a control period of {bounds.period_s:g} s")
    if abs(ratio - 1) > 0.01:
        return [f"{record.source}: sampled every {record.period_s:g} s, the axis every {bounds.period_s:g} s"]
    return []


def _missing(record, bounds):
    """Missing samples: a few are reported, half a column is no column."""
    remarks = []
    for name, values in record.columns.items():
        lost = int(np.isnan(values).sum())
        if name in ("encoder_m", *COLUMNS) and lost > MOST_MISSING * len(values):
            _refuse(record, name, f"{lost} of {len(values)} samples missing", "most samples present")
        if lost and name in record:
            remarks.append(f"{record.source}: {name} lacks {lost} of {len(values)} samples")
    return remarks


def _ranges(record, bounds):
    """Temperatures, pressure and humidity that no laboratory has are in another unit."""
    for name, (low, high, unit) in PLAUSIBLE.items():
        if name in record:
            smallest, largest = float(np.nanmin(record[name])), float(np.nanmax(record[name]))
            if smallest < low or largest > high:
                _refuse(record, name, smallest if smallest < low else largest, f"{low:g} to {high:g}: {unit}")
    return []


def _constants(record, bounds):
    """A sensor that never changes while the axis moves was not connected."""
    moved = span(record, "encoder_m") / (bounds.resolution_m or FINEST)
    if "encoder_m" not in record or moved == 0:
        _refuse(record, "encoder_m", "constant", "positions that change, by a count at least")
    command = command_of(record)
    commanded = span(record, command.column) if command is not None else 0.0
    if command is not None and moved > 100 and commanded == 0 and np.nanmax(np.abs(record[command.column])) == 0:
        _refuse(record, command.column, "0 throughout", f"the command that moved the axis {moved:.0f} counts")
    for name in ("interferometer_m", "motor_angle_rad"):
        if name in record and moved > 1000 and span(record, name) == 0:
            _refuse(record, name, "constant", f"readings that follow the encoder ({moved:.0f} counts), or no column")
    if "current_A" in record and span(record, "current_A") == 0 and commanded > 0.2 * bounds.limit_V:
        _refuse(record, "current_A", "constant", "the motor current, or no column")
    return []


def _position_units(record, bounds):
    """Positions beyond the travel are in another unit, or in another column's place."""
    for name in ("encoder_m", "reference_m", "interferometer_m"):
        covered = span(record, name)
        if covered > 1.05 * bounds.travel_m:
            unit = next((f"; divided by {factor:g} they would fit: {word} for m?" for factor, word in UNITS.items()
                         if covered / factor <= 1.05 * bounds.travel_m), "")
            _refuse(record, name, f"a span of {covered:.6g}", f"metres, within a travel of {bounds.travel_m:g} m{unit}")
    return []


def _counts(record, bounds):
    """Encoder readings are whole counts; a thousand counts at a time are another unit."""
    if not bounds.resolution_m:
        return []
    counts, off = _as_counts(record["encoder_m"], bounds.resolution_m)
    if off < OFF_GRID:
        step = int(np.gcd.reduce(np.unique(counts)))
        for factor, word in UNITS.items():
            if step and step % int(factor / 10) == 0 and step / factor <= 3:
                _refuse(record, "encoder_m", f"steps of {step * bounds.resolution_m:g}",
                        f"metres in steps of {bounds.resolution_m:g} m; {word} for m?")
        if step <= 1:
            return []
        return [f"{record.source}: encoder_m moves {step} counts of {bounds.resolution_m:g} m at a time; is that one?"]
    if ("reference_m" in record and len(np.unique(record["reference_m"])) > FEW_COUNTS
            and _as_counts(record["reference_m"], bounds.resolution_m)[1] < OFF_GRID):
        _refuse(record, "encoder_m", "no whole counts, while reference_m has them",
                "the two columns in each other's place")
    return [f"{record.source}: encoder_m is not in whole counts of {bounds.resolution_m:g} m"]


def _as_counts(positions, resolution):
    """Positions as whole counts from the first, and their median distance from whole counts."""
    seen = positions[np.isfinite(positions)]
    exact = np.clip((seen - seen[0]) / resolution, -MOST_COUNTS, MOST_COUNTS)
    counts = np.round(exact)
    moving = counts != 0
    off = float(np.median(np.abs(exact - counts)[moving])) if moving.any() else 0.0
    return counts.astype(np.int64), off


def _companions(record, bounds):
    """Reference and interferometer move as far as the encoder, or they are in another unit."""
    moved = span(record, "encoder_m")
    if moved < FEW_COUNTS * bounds.resolution_m:
        return []
    for name, most in (("interferometer_m", 30.0), ("reference_m", 100.0)):
        other = span(record, name)
        if other == 0 or name not in record:
            continue
        ratio = other / moved
        if not 1 / most <= ratio <= most:
            _refuse(record, name, f"a span of {other:.4g}", f"metres, like the span of encoder_m, {moved:.4g} m")
    return []


def _signs(record, bounds):
    """Encoder, motor, interferometer and reference move the same way, or one of them has the other sign."""
    if span(record, "encoder_m") < FEW_COUNTS * bounds.resolution_m:
        return []
    for name in ("motor_angle_rad", "interferometer_m", "reference_m"):
        if name not in record:
            continue
        readings = record["encoder_m"], record[name]
        if name == "reference_m":                 # fast sines are followed late and little
            readings = tuple(_means(record, values) for values in readings)
            encoder, asked = (float(np.ptp(np.append(one[np.isfinite(one)], 0.0))) for one in readings)
            if not 0.5 < asked / max(encoder, bounds.resolution_m) < 2.0:
                continue
        if _likeness(*readings) > MIRRORED:
            continue
        _refuse(record, f"{name} against encoder_m", "the opposite motion",
                "readings that grow together: one of the two columns has the other sign")
    return []


def _means(record, values):
    """Means of a column over each `MEAN_OVER` about their own mean, shape (blocks,): NaN with a missing sample, and a
    single zero of a record of less than ten."""
    rows = max(round(MEAN_OVER / record.period_s), 1)
    blocks = len(record) // rows
    means = values[: blocks * rows].reshape(-1, rows).mean(axis=1) if blocks >= 10 else np.zeros(1)
    return means - np.nanmean(means) if np.isfinite(means).any() else means


def _likeness(one, other):
    """Correlation of two columns over the rows that both have, 0 where one of them does not change."""
    both = np.isfinite(one) & np.isfinite(other)
    if not both.any() or np.ptp(one[both]) == 0.0 or np.ptp(other[both]) == 0.0:
        return 0.0
    one, other = (values[both] / np.ptp(values[both]) for values in (one, other))
    return float(np.corrcoef(one, other)[0, 1])


def _command(record, bounds):
    """Commands far beyond the amplifier are in another unit; commands at its limit say little."""
    command = command_of(record)
    if command is None or (command is FORCE and bounds.limit_unit != FORCE.unit):
        return []                   # a force column beside a drive that is commanded in volts has no limit of its own
    name, unit = command.column, command.unit
    size = np.abs(record[name])
    if np.nanmax(size) > 10 * bounds.limit_V:
        _refuse(
            record, name, float(np.nanmax(size)), f"{command.units}; the amplifier clips at {bounds.limit_V:g} {unit}"
        )
    share = float(np.nanmean(size >= 0.999 * bounds.limit_V))
    if share > MOST_SATURATED:
        _refuse(record, name, f"{share:.0%} of the time at the limit",
                f"a record that stays under {bounds.limit_V:g} {unit} most of the time")
    if share > FEW_SATURATED:
        return [f"{record.source}: {name} is at the limit of {bounds.limit_V:g} {unit} {share:.0%} of the time"]
    return []


def _current(record, bounds):
    """More current than voltage and winding allow: another unit, or the columns swapped."""
    if bounds.resistance_ohm is None or "current_A" not in record or "voltage_V" not in record:
        return []
    volts = float(np.sqrt(np.nanmean(record["voltage_V"] ** 2)))
    drop = float(np.sqrt(np.nanmean(record["current_A"] ** 2))) * bounds.resistance_ohm
    if drop > 3 * volts + 0.03 * bounds.limit_V:
        _refuse(record, "current_A", f"rms {drop / bounds.resistance_ohm:.4g}",
                f"amperes, about {volts / bounds.resistance_ohm:.4g} for the voltage of this record through "
                f"{bounds.resistance_ohm:g} ohm; mA for A, or the two columns in each other's place?")
    voltage, current = record["voltage_V"][:-1], record["current_A"][1:]  # which answers the voltage of the row before
    power, steps = np.nanmean(voltage * current), np.nanmean(np.diff(voltage) * np.diff(current))
    if power < OPPOSED * volts * drop / bounds.resistance_ohm and steps < 0.0:
        _refuse(record, "current_A against voltage_V", f"a mean product of {power:.3g} W",
                "amperes in the direction of the voltage, which drives them: one of the two columns has the other sign")
    return []


def _driven(record, bounds):
    """A motor's voltage drives the encoder to larger positions, or one of the two has the other sign."""
    if bounds.resistance_ohm is None or "voltage_V" not in record:
        return []
    if span(record, "encoder_m") < FEW_COUNTS * bounds.resolution_m:
        return []  # what holds against a push moves against its voltage
    moved = _means(record, np.gradient(record["encoder_m"]))
    if _likeness(moved, _means(record, record["voltage_V"])) < MIRRORED:
        columns = "voltage_V and current_A" if "current_A" in record else "voltage_V"
        _refuse(record, f"{columns} against encoder_m", "motion against the voltage throughout",
                "a positive voltage that drives to larger positions: either side has the other sign")
    return []


def _clipped(record, bounds):
    """A sensor that stands at its largest or smallest value while what drives it goes on is at its end."""
    command = command_of(record)
    pairs = [("current_A", command.column, 0.1 * span(record, command.column))] if command is not None else []
    pairs += [
        ("interferometer_m", "encoder_m", 200 * bounds.resolution_m),
        ("encoder_m", "reference_m", 200 * bounds.resolution_m),
    ]
    remarks = []
    for name, driver, least in pairs:
        if name not in record or driver not in record or span(record, name) == 0:
            continue
        for extreme in (np.nanmin(record[name]), np.nanmax(record[name])):
            share, moved = _standing(record, name, driver, extreme)
            if share <= FEW_SATURATED or moved <= max(least, 0.1 * span(record, driver)):
                continue
            if share > MOST_CLIPPED and name != "encoder_m":
                _refuse(record, name, f"{extreme:.6g} for {share:.0%} of the time",
                        f"readings that follow {driver}; the sensor is at the end of its range")
            remarks.append(f"{record.source}: {name} stands at {extreme:.6g} for {share:.0%} of the time, while"
                           f" {driver} covers {moved:.3g}")
    return remarks


def _standing(record, name, driver, extreme):
    """Share of the rows in which a sensor stands at a value, and what its driver covers in them."""
    standing = np.flatnonzero(record[name] == extreme)
    before = record[driver][np.maximum(standing - (1 if name == "current_A" else 0), 0)]
    if len(standing) == 0 or np.isnan(before).all():
        return 0.0, 0.0
    return len(standing) / len(record), float(np.nanpercentile(before, 95) - np.nanpercentile(before, 5))
