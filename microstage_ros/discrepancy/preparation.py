"""A record made ready for the residuals: gaps closed, the converter's rounding applied, motion smoothed.

All arrays have shape (n,), one entry per control period, SI.
"""

import dataclasses

import numpy as np

from microstage_ros.axis.errors import InputError
from microstage_ros.discrepancy.friction_replay import replay
from microstage_ros.discrepancy.motion import smooth_motion

LEAST_ROWS = 5000
ENCODER_NOISE = 8.0e-9  # before rounding; MODEL.md


@dataclasses.dataclass
class Prepared:
    """One record and what the nominal model says about its motion.

    ``answered`` is the voltage that current[n] answers (row n − 1, rounded as the converter rounds);
    ``settled`` the current after the winding's time constant, ``(i[n] − a i[n−1]) / (1 − a)``;
    ``actuator`` and ``guideway`` the nominal frictions without viscosity [N m at the motor, N], ``stuck`` the
    share of the actuator's blocks that stick;
    ``lost`` marks samples that repeat the one before or were missing.
    """

    name: str
    period: float
    time: np.ndarray
    encoder: np.ndarray
    interferometer: np.ndarray
    reference: np.ndarray
    answered: np.ndarray
    current: np.ndarray
    settled: np.ndarray
    position: np.ndarray
    speed: np.ndarray
    load: np.ndarray
    actuator: np.ndarray
    stuck: np.ndarray
    guideway: np.ndarray
    lost: np.ndarray
    off: np.ndarray
    air: dict

    @property
    def stage(self):
        """The position reading nearest to the truth: interferometer if there is one, else encoder."""
        return self.encoder if self.interferometer is None else self.interferometer


def prepare(record, drive):
    """`Prepared` from a `Record`.  Raises InputError for a record that is too short or lacks what is needed."""
    n = len(record)
    if n < LEAST_ROWS:
        raise InputError(record.source, n, f"at least {LEAST_ROWS} rows")
    period = record.period_s
    columns, lost = {}, np.zeros(n, bool)
    for name in ("encoder_m", "voltage_V", "current_A", "interferometer_m", "reference_m"):
        if name in record:
            columns[name], gaps = _filled(record[name], f"{record.source}: {name}")
            lost |= gaps
    if "voltage_V" not in columns:
        raise InputError(f"{record.source}: voltage_V", "missing", "the commanded voltage")
    rounded = np.round(columns["voltage_V"] / drive.converter_step) * drive.converter_step
    rounded = np.clip(rounded, -drive.voltage_limit, drive.voltage_limit)
    answered = np.concatenate([rounded[:1], rounded[:-1]])
    keep = np.exp(-period * drive.resistance / drive.inductance)
    stage = columns.get("interferometer_m", columns["encoder_m"])
    noise = reading_noise(stage)
    if "current_A" in columns:
        current = columns["current_A"]
        settled = (current - keep * np.concatenate([current[:1], current[:-1]])) / (1.0 - keep)
    else:
        speed = np.gradient(_boxcar(stage, 61), period)
        current = settled = (answered - drive.back_emf / drive.lever * speed) / drive.resistance
    motion = smooth_motion(stage, settled, drive, period, noise)
    screw_speed = motion.speed / drive.radius
    actuator, stuck = replay(drive.actuator, screw_speed, period)
    guideway, _ = replay(drive.guideway, motion.speed, period)
    air = {name: _filled(record[name], name)[0] for name in
           ("air_temperature_K", "air_pressure_Pa", "air_humidity", "stage_temperature_K") if name in record}
    return Prepared(
        name=record.source, period=period, time=record["t_s"] - record["t_s"][0], encoder=columns["encoder_m"],
        interferometer=columns.get("interferometer_m"), reference=columns.get("reference_m", stage),
        answered=answered, current=current, settled=settled,
        position=motion.position, speed=motion.speed, load=motion.load,
        actuator=actuator, stuck=stuck, guideway=guideway,
        lost=lost, off=(rounded == 0.0) & (answered == 0.0), air=air,
    )


def reading_noise(reading):
    """Standard deviation of a position reading's white noise from its third differences, robustly [m]."""
    differences = np.diff(reading, 3)
    spread = np.subtract(*np.percentile(differences, [75.0, 25.0])) / 1.349
    return max(spread / np.sqrt(20.0), 1.0e-10)


def _filled(values, place):
    """Values with missing samples bridged in a straight line, and where they were missing."""
    missing = ~np.isfinite(values)
    if missing.mean() > 0.5:
        raise InputError(place, f"{100 * missing.mean():.0f} % missing", "at least half of the samples")
    if not missing.any():
        return np.asarray(values, float), missing
    rows = np.arange(len(values))
    return np.interp(rows, rows[~missing], values[~missing]), missing


def _boxcar(values, width):
    """Centred running mean of odd ``width``, ends padded with the end values."""
    padded = np.pad(values, width // 2, mode="edge")
    sums = np.cumsum(np.concatenate([[0.0], padded]))
    return (sums[width:] - sums[:-width]) / width
