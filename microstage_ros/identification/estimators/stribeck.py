"""Stribeck curves by direction of motion: bounded, robust least squares (paper Eq. 10).

    |M|(w) = M_C + (M_s − M_C) exp(−|w / w_S|^δ) + σ |w|

fitted to the mean friction of steady runs.
The exponent δ and w_S together shape one knee; without speeds well below w_S neither they nor M_s can be
determined, and the fit says so.
"""

import numpy as np
from scipy.optimize import least_squares

from microstage_ros.model.friction import curve
from microstage_ros.quantities.errors import InputError

NAMES = ("static", "coulomb", "stribeck_velocity", "stribeck_exponent", "viscous")
ROBUST_SCALE = 3.0  # residuals beyond three deviations count linearly
EXPONENT_BOUNDS = (0.3, 2.5)


def stribeck_curve(parameters, speed):
    """|M| [F] of Eq. 10 at ``speed`` [q/s], any shape, for ``parameters`` (M_s, M_C, w_S, δ, σ), shape (5,)."""
    static, coulomb, knee, exponent, viscous = parameters
    speed = np.abs(speed)
    return curve.stribeck_curve(speed, static, coulomb, knee, exponent) + viscous * speed


def point_spread(speed, friction):
    """Standard deviation of each point [F], from the scatter of the repeats at like speeds.

    ``speed`` [q/s] and ``friction`` [F], both (n,).
    Points are grouped by direction and speed (5 %); a group of fewer than three takes the median relative
    scatter of the others, or 5 %.
    """
    group = np.round(np.log(np.abs(speed)) / 0.05) * np.sign(speed + 1e-300) + 1e4 * (speed > 0)
    labels, member = np.unique(group, return_inverse=True)
    relative = np.full(len(labels), np.nan)
    for label in range(len(labels)):
        values = friction[member == label]
        if len(values) >= 3:
            relative[label] = np.std(values, ddof=1) / abs(values.mean())
    known = relative[np.isfinite(relative)]
    relative[~np.isfinite(relative)] = np.median(known) if len(known) else 0.05
    typical = np.median(relative)
    return np.clip(relative, 0.3 * typical, None)[member] * np.abs(friction)


def fit_stribeck(speed, friction, spread, first=None):
    """Parameters of one direction (or of both pooled, by their magnitudes).

    Parameters
    ----------
    speed, friction, spread : magnitudes, shape (n,): [q/s], [F], standard deviation of a point [F].
    first : start values, shape (5,).

    Returns
    -------
    values : (M_s, M_C, w_S, δ, σ), shape (5,), in F and q.
    fit : scipy's result; ``fit.fun`` are the weighted residuals.

    Raises
    ------
    InputError : fewer than five different speeds.
    """
    speed, friction = np.abs(speed), np.abs(friction)
    if len(np.unique(np.round(np.log(np.maximum(speed, 1e-12)), 2))) < 5:
        raise InputError("Stribeck curve", f"{len(np.unique(speed))} speeds", "steady runs at five or more speeds")
    scale = _scale(speed, friction)
    low = np.array([0.2, 0.05, 0.2 * speed.min() / scale[2], EXPONENT_BOUNDS[0], 0.0])
    high = np.array([5.0, 3.0, 3.0 * speed.max() / scale[2], EXPONENT_BOUNDS[1], 50.0])

    def residual(parameters):
        return (friction - stribeck_curve(parameters * scale, speed)) / spread

    starts = [np.asarray(first) / scale] if first is not None else _starts(scale, speed)
    fits = [least_squares(residual, np.clip(start, low + 1e-9, high - 1e-9), loss="soft_l1", bounds=(low, high),
                          f_scale=ROBUST_SCALE, max_nfev=60) for start in starts]
    fit = min(fits, key=lambda candidate: candidate.cost)
    return fit.x * scale, fit


def _scale(speed, friction):
    """Sizes of the parameters: largest low-speed friction, least friction, a middle speed, 1, a slope."""
    slow = friction[speed <= np.quantile(speed, 0.2)]
    top = max(np.median(slow), friction.min())
    return np.array([top, friction.min(), np.exp(np.mean(np.log(speed[[speed.argmin(), speed.argmax()]]))) * 0.3, 1.0,
                     max(np.ptp(friction) / speed.max(), 1e-3 * top / speed.max())])


def _starts(scale, speed):
    return [
        np.array([1.05, 0.95, knee / scale[2], 1.0, 1.0])
        for knee in np.geomspace(2.0 * speed.min(), 0.2 * speed.max(), 4)
    ]
