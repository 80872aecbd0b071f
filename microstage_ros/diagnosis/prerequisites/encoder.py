"""The encoder's interpolation error that the axis file states, as records of the healthy axis show it.

The file states an error of the encoder as no cause: it is taken out of every reading. Size and phase come from the
baseline where there is one: an encoder may be better or worse than its data sheet, and after another homing the phase
is another. What is stated and not there would otherwise be put in. Without a baseline the records themselves tell
whether what is stated is there at all; its size is then the file's, as a larger error may be the fault.
"""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.preprocessing.smoothing import REST_SPEED, triangle
from microstage_ros.diagnosis.prerequisites.periods import SLOW

# periods; derived: 10 nm of noise leave 0.05 µm/s of the slope's, far below `REST_SPEED`
SMOOTH = 201


def seen_interpolation(drive, baseline, records=()):
    """`Drive` with the interpolation error that the baseline shows.

    Parameters
    ----------
    drive : `prerequisites.drive.Drive`, with what the axis file states.
    baseline : list of `Record` of the healthy axis; may be empty.
    records : those to learn from, which are asked without a baseline: they have what the file states, with its size
        and phase, or nothing of it, whichever is nearer.

    Returns
    -------
    The drive unchanged where the file states no such error or no such record has both readings.
    """
    sizes = _waves(drive, baseline or records)
    if sizes is None:
        return drive
    if not baseline:
        stated = np.array(drive.interpolation)
        there = sizes[::2] @ stated > 0.5 * stated @ stated  # derived: as far from what is stated as from nothing
        return drive if there else dataclasses.replace(drive, interpolation=())
    return dataclasses.replace(drive, interpolation=tuple(float(v) for v in sizes[::2]),
                               interpolation_cosine=tuple(float(v) for v in sizes[1::2]))


def _waves(drive, baseline):
    """Sine and cosine [m] of each harmonic that the file states, in turn, as records show them; None if they cannot."""
    harmonics = len(drive.interpolation)
    usable = [r for r in baseline if "interferometer_m" in r and "encoder_m" in r]
    if not (any(drive.interpolation) and usable):
        return None
    count, travel = 2 * harmonics + 2, 0.0
    matrix, vector = np.zeros((count, count)), np.zeros(count)
    for record in usable:
        encoder, stage = (
            np.nan_to_num(record[name], nan=float(np.nanmean(record[name])))
            for name in ("encoder_m", "interferometer_m")
        )
        error = encoder - stage
        phase = 2.0 * np.pi * stage / drive.signal_period
        waves = [f(n * phase) for n in range(1, harmonics + 1) for f in (np.sin, np.cos)]
        speed = np.gradient(triangle(stage, SMOOTH), record.period_s)
        used = np.flatnonzero(np.abs(speed) > REST_SPEED)
        travel = max(travel, np.ptp(stage))
        # an error of the scale, or a late reading, is none of interpolation, and is left over at both ends of a move
        x = np.stack([(w - triangle(w, SLOW))[used] for w in (*waves, stage, speed)], axis=1)
        matrix += x.T @ x
        vector += x.T @ (error - triangle(error, SLOW))[used]
    size = np.sqrt(np.diag(matrix))
    # derived: of the sixteen digits ten are left; of a column of zeros none
    if travel < drive.signal_period or not size.all() or not np.linalg.cond(matrix / np.outer(size, size)) < 1e6:
        return None       # they hardly moved
    return np.linalg.solve(matrix / np.outer(size, size), vector / size)[:2 * harmonics] / size[:2 * harmonics]


def seen_count(drive, prepared):
    """`Drive` with the encoder's count that the records show, the largest where they differ.

    Parameters
    ----------
    drive : `prerequisites.drive.Drive`. prepared : {group: list of `preparation.Prepared`}.
    """
    counts = [one.count for group in prepared.values() for one in group if one.count]
    return dataclasses.replace(drive, encoder_resolution=max(counts)) if counts else drive
