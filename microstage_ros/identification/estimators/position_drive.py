"""A drive that is commanded with a position, from its motion: the recorded command through the model, open loop.

    y(n) = x̂(n; u(0 … n − 1), θ) + y_0 + e(n),        θ: one factor for each of `Actuator.identified`

The factors are those of least squared error e, means over `MEAN_S`, over all records at once; a constant y_0 per
record takes the sensor's zero and the drive's history before the record. The means leave out the drive's resonance:
its noise comes back to the command through the loop, and an output error that hangs together with its input is biased
(0.8 % of the stroke per volt, eight pairs of records of the shipped stage). The model is the compiled one of the
simulator, with its sensor and without noise.

Source: output error method, L. Ljung, System Identification (1999).
"""

import math

import numpy as np
from scipy.optimize import least_squares

from microstage_ros.identification.estimators.estimate import Curve, Estimate, Identification
from microstage_ros.identification.estimators.intervals import LEVEL, block_covariance, correlation
from microstage_ros.model.actuators import actuator_of
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.open_loop import respond
from microstage_ros.solver.plant import NoiseSpec, make_plant

MEAN_S = 1e-3  # s, over which errors are averaged: two periods of the shipped stage's resonance
# s, over which the error hangs together: creep. Calibrated on twelve pairs of records of the shipped fine stage, whose
# stroke per volt was off by 1.2 times the stated standard error, rms (1.8 with 0.1 s)
BLOCK_S = 1.0
LEAST, MOST = 0.05, 20.0        # factors that are tried
PERIOD_TOLERANCE = 1e-3         # between a record's period and the axis's, as for run files
TELLS = 1e-9  # least slope of the error over a factor, of the largest one: less is rounding
DETERMINED_SHARE = 0.5  # a factor is determined by the records if its 95 % interval is no wider than ± this share
SHOWN = 4000                    # points of the curve
EXPERIMENT = "slow loops over several strokes, and steps held for ten times the longest creep time, would"


def identify_position_drive(records, axis):
    """Stroke per volt [m/V], hysteresis [1] and creep [1] of a piezo axis, with 95 % intervals.

    Parameters
    ----------
    records : list of `Record` with the command and the encoder. axis : `Axis`, first guess and shape of what is scaled.

    Returns
    -------
    `Identification`; keys and units are those of `Actuator.identified`.

    Raises
    ------
    InputError : no record; a drive of which a record of command and position tells nothing; a command that stands
        still.
    """
    actuator = actuator_of(axis)
    keys = [key for key in actuator.identified if np.any(np.atleast_1d(axis.value(key)))]
    if not keys:
        raise InputError(
            f"{axis.place}: drive.type",
            actuator.name,
            f"a drive whose motion tells something of it: the {actuator.name} goes where its "
            f"{actuator.command.quantity} "
            "says, whatever its torque and its load are; they are found with a weight, not with a record",
        )
    if not records:
        raise InputError("records", 0, "at least one record")
    for record in records:
        if abs(record.period_s / axis.value("period") - 1.0) > PERIOD_TOLERANCE:
            raise InputError(f"{record.source}: sampling period", f"{record.period_s:g} s",
                             f"{axis.value('period'):g} s, the control period of {axis.place}: the model answers every "
                             "command of the record for one period")
        if np.ptp(record[actuator.command.column]) == 0.0:
            raise InputError(f"{record.source}: column {actuator.command.column}", "constant", "a command that changes")

    def residual(factors):
        trial = axis.with_values({key: scaled(axis, key, f) for key, f in zip(keys, factors)})
        return np.concatenate([_error(trial, record, actuator) for record in records])

    start = np.ones(len(keys))
    scale = float(np.std(np.concatenate([record["encoder_m"] for record in records]))) or 1.0
    fit = least_squares(
        lambda f: residual(f) / scale, start, diff_step=1e-3, bounds=(LEAST * start, MOST * start), x_scale=0.1 * start
    )
    block = max(int(BLOCK_S / axis.value("period")) // averaged(records[0]), 10)
    covariance = block_covariance(fit.jac, fit.fun, block)
    tells = np.any(np.abs(fit.jac) > TELLS * np.abs(fit.jac).max(), axis=0)
    spread = np.where(tells, np.sqrt(np.diag(covariance)), math.inf)  # a stroke within the least radius has no loop
    result = Identification()
    for key, factor, stderr in zip(keys, fit.x, spread):
        result.add(_estimate(axis, key, float(factor), float(stderr)))
    result.correlations.append((tuple(keys), correlation(covariance)))
    before, after = (float(np.sqrt(np.mean(residual(f) ** 2))) for f in (start, fit.x))
    result.remarks.append(
        f"Position by the model from the recorded command, open loop: error {before * 1e9:.3g} nm rms with the axis "
        "file, "
        f"{after * 1e9:.3g} nm with what was identified."
    )
    result.remarks.append(
        "Lists (hysteresis, creep) keep the axis file's shape: one factor scales all of their numbers."
    )
    result.curves.append(
        _curve(records[0], axis.with_values({k: scaled(axis, k, f) for k, f in zip(keys, fit.x)}), actuator)
    )
    return result


def scaled(axis, key, factor):
    """The axis's value of ``key`` times ``factor`` [1]: a float, or a list of floats, SI."""
    value = axis.value(key)
    return [float(v * factor) for v in value] if isinstance(value, (list, tuple, np.ndarray)) else float(value * factor)


def _simulated(axis, record, actuator):
    """Encoder [m], shape (n,), that the model reads under the recorded command."""
    plant = make_plant(axis, NoiseSpec.none())
    return respond(plant, record[actuator.command.column], position=float(record["encoder_m"][0]))["encoder"]


def averaged(record):
    """Rows of a ``record`` of which one mean is taken [1]."""
    return max(min(round(MEAN_S / record.period_s), len(record) // 10), 1)


def _error(axis, record, actuator):
    rows, error = averaged(record), record["encoder_m"] - _simulated(axis, record, actuator)
    error = error[: len(error) // rows * rows].reshape(-1, rows).mean(axis=1)
    return error - error.mean()


def _estimate(axis, key, factor, stderr):
    half = 1.96 * stderr
    determined = bool(np.isfinite(half) and half <= DETERMINED_SHARE * factor)
    value, spread, low, high = (scaled(axis, key, f) for f in (factor, stderr, factor - half, factor + half))
    shown = f"factor {factor:.3g} ± {half:.2g}" if np.isfinite(half) else "they show nothing of it"
    remark = "" if determined else f"not determined by these records ({shown}); {EXPERIMENT}"
    return Estimate(
        key,
        value,
        axis.quantity(key).unit,
        spread,
        low,
        high,
        determined,
        f"open-loop output error, block sandwich ({LEVEL:.0%})",
        remark,
    )


def _curve(record, axis, actuator):
    command, position, model = record[actuator.command.column], record["encoder_m"], _simulated(axis, record, actuator)
    model = model + float(np.mean(position - model))
    pick = np.linspace(0, len(command) - 1, min(len(command), SHOWN)).astype(int)
    return Curve(
        "Position against command",
        f"{actuator.command.quantity} [{actuator.command.unit}]",
        "position [m]",
        command[pick],
        position[pick],
        command[pick],
        model[pick],
        residual=(position - model)[pick],
    )
