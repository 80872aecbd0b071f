"""From a column of times to one sampling period, or to the row where the times break."""

import math

import numpy as np

from microstage_ros.quantities.errors import InputError

STEP_TOLERANCE = 0.25
"""Largest deviation of one step from the period, as a share of the period.

Stamps may jitter and may be printed with few digits; a lost row is a deviation of 1."""


def constant_period(t_s, place, line_of=lambda row: f"row {row}"):
    """Sampling period of `t_s`, which must advance in equal steps.

    Parameters
    ----------
    t_s : times [s], shape (n,), n >= 2.
    place : the file, for the message.
    line_of : row number to the words that name its place in the file.

    Returns
    -------
    float : period [s]; rounded to what the times can tell when that gives a short number.

    Raises
    ------
    InputError : a missing time, a time that stands still or runs backwards, a gap; with its place.
    """
    if len(t_s) < 2:
        raise InputError(f"{place}: rows", len(t_s), "at least 2 rows, to know the sampling period")
    missing = np.flatnonzero(~np.isfinite(t_s))
    if missing.size:
        raise InputError(f"{place}: {line_of(missing[0])}, field t_s", float(t_s[missing[0]]),
                         "a time in seconds in every row")
    steps = np.diff(t_s)
    period = float(np.median(steps))
    if period <= 0.0:
        row = int(np.argmax(steps <= 0.0)) + 1
        raise InputError(f"{place}: {line_of(row)}, field t_s", float(t_s[row]),
                         f"a time later than that of the row before ({float(t_s[row - 1])!r} s)")
    bad = np.flatnonzero(np.abs(steps - period) > STEP_TOLERANCE * period)
    if bad.size:
        raise InputError(*_broken_step(t_s, int(bad[0]) + 1, period, place, line_of))
    return short_period((t_s[-1] - t_s[0]) / (len(t_s) - 1), np.spacing(abs(t_s[-1])) + 1e-7 * period)


def _broken_step(t_s, row, period, place, line_of):
    """Place, value and expectation for the first step that is not one period."""
    before, now = float(t_s[row - 1]), float(t_s[row])
    expected = f"{before + period:.9g} s (constant steps of {period:.6g} s)"
    if now > before and math.isfinite((now - before) / period):
        lost = round((now - before) / period) - 1
        if lost >= 1:
            expected += f"; {lost} rows are missing, write lost samples as rows with empty fields"
    return f"{place}: {line_of(row)}, field t_s", now, expected


def short_period(period, tolerance):
    """The shortest decimal number [s] within `tolerance` [s] of `period` [s]."""
    for digits in range(1, 12):
        rounded = float(f"{period:.{digits}g}")
        if abs(rounded - period) <= tolerance:
            return rounded
    return float(period)
