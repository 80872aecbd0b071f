"""Records cut into windows of motion."""

import sys

import numpy as np

LEAST_TRAVEL = 1.0e-4  # m of path: a window that hardly moves says nothing of friction or drive
STEP = 0.01  # s between the positions that make the path, so that rounding is no travel
DEFAULT_WINDOW = 20.0  # s: the time length of the shipped axis's random friction


def windows_of(record, window_s):
    """Windows of a record, (start [s], `Record`), one after the other, those in which the axis moved.

    What weakens the record is said on standard error.

    Parameters
    ----------
    record : `Record`. window_s : length of a window [s]; the rest at the end of the record is left out.
    """
    for remark in record.remarks:
        print(f"warning: {remark}", file=sys.stderr)
    rows = round(window_s / record.period_s)
    for first in range(0, len(record) - rows + 1, rows):
        part = record.rows(first, first + rows)
        if travelled(part) >= LEAST_TRAVEL:
            yield float(part["t_s"][0]), part


def travelled(record):
    """Length of the path [m] of the encoder, sampled every `STEP`."""
    every = max(round(STEP / record.period_s), 1)
    return float(np.nansum(np.abs(np.diff(record["encoder_m"][::every]))))
