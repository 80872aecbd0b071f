"""A force-driven axis from its motion: mass, viscous and Coulomb friction, offset.

    F = M a + F_v v + F_c sgn v + F_0

linear in the four parameters (Janot, Gautier, Brunot 2019; Gautier 1997). Position is differentiated
without lag (zero-phase low-pass, central differences); then force and regressors pass one and the same
low-pass (the parallel filter), which leaves the equation true and takes the noise of the second
derivative away. The same equation with instruments from the reference, which carries no noise,
(instrumental variables) tells whether least squares is biased.
"""

from dataclasses import dataclass

import numpy as np
from scipy import signal

from microstage_ros.identification.estimators.estimate import Curve, Identification, from_interval
from microstage_ros.identification.estimators.intervals import block_covariance, correlation
from microstage_ros.model.actuators import actuator_of
from microstage_ros.numerics.filters import low_pass
from microstage_ros.quantities.errors import InputError

KEYS = ("stage.mass", "contacts.guideway.viscous", "contacts.guideway.coulomb", "stage.offset_force")
UNITS = ("kg", "N s/m", "N", "N")
MOST_LEFT = 0.5  # of the force: beyond it the record is not of such an axis
LEAST_ROWS = 50  # in motion, in each direction
POWER_SHARE = 0.999  # the band that carries this share of the force's power is fitted
EXPERIMENTS = (
    "a run with strong acceleration and deceleration would: its inertial force must exceed the friction",
    "constant-velocity runs at three or more speeds in both directions would",
    "moves in both directions at several speeds would",
    "moves in both directions would",
)


@dataclass(frozen=True)
class Bands:
    """Low-pass edges [Hz] of the position before differentiation and of the parallel filter."""

    position: float
    fit: float


def choose_bands(force, period):
    """The fitted band holds 99.9 % of the force's power; the position's edge lies an octave above.

    ``force`` [N], shape (n,); ``period`` [s]. Returns `Bands`, both below 0.4 of the sampling rate; InputError for a
    constant force.
    """
    if np.ptp(force) == 0.0:
        raise InputError("force", f"constant {float(force[0])!r} N", "a force that changes")
    frequency, power = signal.welch(force - force.mean(), 1.0 / period, nperseg=min(len(force), 8192))
    edge = frequency[np.searchsorted(np.cumsum(power) / power.sum(), POWER_SHARE)]
    edge = float(np.clip(edge, 10.0 * frequency[1], 0.2 / period))
    return Bands(2.0 * edge, edge)


def regressors(position, bands, period, rest_speed=0.0):
    """Columns (a, v, sgn v, 1), shape (n, 4), before the parallel filter; and v (n,) [m/s].

    ``position`` [m], shape (n,); ``bands``: `Bands`; ``period`` [s].
    Below ``rest_speed`` [m/s] the sign is graded, so that noise at rest is not friction of full size.
    """
    velocity = np.gradient(low_pass(position, bands.position, period), period)
    acceleration = np.gradient(velocity, period)
    direction = np.clip(velocity / rest_speed, -1.0, 1.0) if rest_speed > 0.0 else np.sign(velocity)
    return np.column_stack([acceleration, velocity, direction, np.ones_like(velocity)]), velocity


def rest_speed(resolution, bands, period):
    """Speed [m/s] that quantisation alone can show behind the position filter (three deviations).

    ``resolution``: one count [m]; ``period`` [s].
    """
    return 3.0 * resolution / np.sqrt(12.0) * 2.0 * np.pi * bands.position * np.sqrt(2.0 * bands.position * period)


def balance(position, force, reference, period, bands, resolution):
    """Filtered regressors, instruments and force of one record; rest and filter edges left out.

    ``position`` [m], ``force`` [N], ``reference`` [m], each (n,); ``period`` [s]; ``resolution``: one count [m].
    Returns W (m, 4), Z (m, 4), F (m,), all behind the parallel filter.
    """
    slow = rest_speed(resolution, bands, period)
    columns, velocity = regressors(position, bands, period, slow)
    lag = _lag(reference, position, period)
    delayed = np.interp(np.arange(len(position)) - lag, np.arange(len(position)), reference)
    instruments, _ = regressors(delayed, bands, period, slow)
    edge = int(2.0 / (bands.fit * period))
    moving = np.abs(velocity) > slow
    near = np.convolve(moving, np.ones(2 * edge + 1), "same") > 0
    near[:edge] = near[-edge:] = False
    filtered = [low_pass(values, bands.fit, period)[near] for values in (columns, instruments, force)]
    return tuple(filtered)


def _lag(reference, position, period):
    """Delay of the position behind the reference [samples], from the least-squares slope."""
    slope = np.gradient(reference)
    power = np.dot(slope, slope)
    return float(np.clip(np.dot(slope, reference - position) / power, 0.0, 0.1 / period)) if power > 0 else 0.0


def identify_force_axis(records, axis, bands=None):
    """Mass, friction and offset of a force-driven axis, with intervals.

    Parameters
    ----------
    records : list of `Record` with ``encoder_m`` and ``force_N`` or ``voltage_V`` (times the gain).
    axis : `Axis` whose command is a force at the stage, with ``contacts.guideway.law: coulomb_viscous``.
    bands : `Bands`; by default chosen from the force (`choose_bands`).

    Returns
    -------
    `Identification` with the keys of `KEYS`.

    Raises
    ------
    InputError : the records hold no motion.
    """
    parts, resolution = [], axis.value("sensors.encoder.resolution")
    for record in records:
        force = applied_force(record, axis)
        chosen = bands or choose_bands(force, record.period_s)
        parts.append(balance(record["encoder_m"], force, record["reference_m"], record.period_s, chosen, resolution))
    w, z, f = (np.concatenate(column) for column in zip(*parts))
    for direction in (-1.0, 1.0):
        if np.sum(w[:, 2] * direction > 0.5) < LEAST_ROWS:
            raise InputError(
                f"{records[0].source}: encoder_m",
                f"no motion with velocity {'<' if direction < 0 else '>'} 0",
                "moves in both directions",
            )
    # condition: columns in comparable size before solving
    scale = np.linalg.norm(w, axis=0)
    values = np.linalg.lstsq(w / scale, f, rcond=None)[0] / scale
    instrumental = np.linalg.solve(z.T @ w, z.T @ f)
    residual = f - w @ values
    period = records[0].period_s
    covariance = block_covariance(w, residual, block=max(int(0.5 / period), 20))
    _refuse_nonsense(records, values, covariance, residual, f)
    rotor = actuator_of(axis).reflected_mass(axis)
    values[0], instrumental[0] = values[0] - rotor, instrumental[0] - rotor
    return _result(values, instrumental, covariance, residual, w, f)


def _refuse_nonsense(records, values, covariance, residual, force):
    """Force and motion that do not belong together: a size that is surely negative, a force left unexplained."""
    for key, unit, value, variance in zip(KEYS[:3], UNITS, values, np.diag(covariance)):
        if value + 3.0 * np.sqrt(variance) < 0.0:
            raise InputError(
                f"{records[0].source}: force against encoder_m",
                f"a {key} of {value:.4g} {unit}",
                "a force that accelerates its stage and overcomes its friction; wrong sign, unit or column?",
            )
    left = float(np.linalg.norm(residual) / np.linalg.norm(force))
    if left > MOST_LEFT:
        raise InputError(f"{records[0].source}: force against encoder_m", f"{left:.0%} of the force left unexplained",
                         f"at most {MOST_LEFT:.0%} by mass and friction; do the columns belong to one motion?")


def applied_force(record, axis):
    """Force on the stage [N], shape (n,): the column ``force_N``, or the command times its force."""
    return record["force_N"] if "force_N" in record else actuator_of(axis).command_as_force(axis, record)


def _result(values, instrumental, covariance, residual, w, f):
    result = Identification()
    floor = np.abs(values[2])  # an offset matters against the Coulomb friction
    spread = np.sqrt(np.diag(covariance))
    for i, key in enumerate(KEYS):
        result.add(from_interval(key, values[i], spread[i], UNITS[i], method="least squares, block sandwich",
                                 experiment=EXPERIMENTS[i], floor=floor if i == 3 else 0.0))
    result.correlations.append((KEYS, correlation(covariance)))
    rows = [(key, unit, f"{a:.6g}", f"{s:.2g}", f"{b:.6g}")
            for key, unit, a, s, b in zip(KEYS, UNITS, values, spread, instrumental)]
    result.tables.append(("Least squares beside instrumental variables",
                          ("parameter", "unit", "least squares", "stderr", "instrumental"), rows))
    relative = float(np.linalg.norm(residual) / np.linalg.norm(f))
    result.remarks.append(f"Inverse model: force residual {relative:.2%} of the force (rms {np.std(residual):.3g} N).")
    friction = f - w[:, 0] * values[0]
    result.curves.append(Curve("Friction force against velocity", "velocity [m/s]", "force − M·a [N]",
                               w[:, 1], friction, w[:, 1], w[:, 1:] @ values[1:], residual=residual))
    return result
