"""What noise makes of the records of a re-simulation: the floor of the residual, and how far chance goes beyond it.

The noise of a drive that sets a position lasts: a hysteresis keeps what noise has moved, for longer than the blocks by
which a residual is resampled. A record of a few seconds then holds no more than a few independent values of it. What
the axis file's noise makes of the model's own loop tells how far they scatter, however long they last.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import signal

from microstage_ros.diagnosis.resimulation.folds import repetition
from microstage_ros.model.actuators import actuator_of

FAST = 0.1                     # of the sampling rate: motion and loop are slower
# s after a disturbance has ended until the loop has forgotten it: 16 time constants of a position loop
# with a gain of 160 1/s (config/emps.yaml), e^-16 of a pulse of 175 N
SETTLING = 0.1
ENOUGH_ALIKE = 0.05            # of the repeated rows that must have been alike for the repetitions to say what noise is
AT_THE_FLOOR = 1.25            # residual over noise up to which there is nothing to explain, and more where it scatters
BY_CHANCE = 2.6                # standard deviations; derived: a normal variable exceeds them once in 200 times
DRAWN = 30                     # records drawn; derived: their standard deviation is known to 1/√(2·30), 13 %


@dataclass(frozen=True)
class Noise:
    """What noise leaves of records that an axis explains.

    ``floor``: its rms [unit of the residual]. ``limit``: rms that chance alone may leave. ``seen``: rms up to which no
    cause is looked for. ``drawn``: residuals that the stated noise alone makes, shape (draws, rows), or None where none
    is known.
    """

    floor: float
    limit: float
    seen: float
    drawn: np.ndarray | None = None

    @classmethod
    def of(cls, floor):
        """Noise of which only the ``floor`` is known [unit of the residual]."""
        return cls(floor, AT_THE_FLOOR * floor, AT_THE_FLOOR * floor)


def noise_of(axis, loop, folds, healthy):
    """`Noise` of the records of a `ClosedLoop` on an `Axis`.

    Parameters
    ----------
    folds : `Folds`. healthy : rms that a record of the healthy axis leaves [unit of the residual], 0 without one.
    """
    floor = max(noise_floor(loop.parts, loop.residual(axis)), healthy)
    drawn = loop.stated_noise(axis, DRAWN)
    stated = _rms(drawn[:, loop.tells])
    if not healthy:
        floor = max(floor, stated)
    factor, _, _ = actuator_of(axis).judged(axis)
    floor = math.hypot(floor, factor * actuator_of(axis).command_step(axis) / math.sqrt(12.0))
    # what a drive that sets a position leaves is noise or a cause; a force holds what its model misfits, too
    seen = 0.0 if actuator_of(axis).holds_position else AT_THE_FLOOR * floor
    if not stated > 0.0:
        return Noise(floor, AT_THE_FLOOR * floor, AT_THE_FLOOR * floor)
    # what is judged scatters, and so does a floor that is one record's
    scatter = [float(np.std(np.log(_rms(drawn[:, rows], 1)))) for rows in (folds.held, loop.tells)]
    limit = floor * max(AT_THE_FLOOR, math.exp(BY_CHANCE * (math.hypot(*scatter) if healthy else scatter[0])))
    return Noise(floor, limit, seen, drawn * max(healthy / stated, 1.0))


def _rms(values, along=None):
    return np.sqrt(np.mean(values**2, axis=along))


def noise_floor(parts, residual):
    """Rms of the force that no model of the motion can explain [N].

    What differs between repetitions of a record's own motion, on rows where nothing else differed: a disturbance that
    was added on purpose in one repetition and not in the other (`Measured.disturbance`) makes them differ without any
    noise, and goes on for `SETTLING` in the loop. Without repetition, or with less than `ENOUGH_ALIKE` of it left, what
    lies above `FAST` of the sampling rate in the ``residual`` (measured minus simulated, the records one after the
    other), where neither the loop nor the motion reaches: the encoder's noise through the controller.
    """
    repeated = [(part, rows) for part, rows in ((part, repetition(part.reference)) for part in parts) if rows]
    if repeated:
        alike = np.concatenate([_between_repetitions(part, rows) for part, rows in repeated])
        if len(alike) >= ENOUGH_ALIKE * sum(len(part) - rows for part, rows in repeated):
            return float(np.sqrt(np.mean(alike**2) / 2.0))
    sections = signal.butter(4, 2.0 * FAST, "highpass", output="sos")
    tells = np.concatenate([part.tells for part in parts])
    fast = signal.sosfiltfilt(sections, residual)[tells] / np.sqrt(1.0 - 2.0 * FAST)
    return float(np.sqrt(max(np.mean([part.law**2 for part in parts]), np.mean(fast**2))))


def _between_repetitions(part, period_rows):
    """Difference of the force between one repetition and the next [N], on rows that both went through undisturbed or
    alike."""
    change = part.force[period_rows:] - part.force[:-period_rows]
    unlike = part.disturbance[period_rows:] != part.disturbance[:-period_rows]
    reach = max(int(round(SETTLING / (part.time[1] - part.time[0]))), 1)
    # a row counts if the disturbances agreed on it and on all rows within `reach` before it
    since = np.convolve(unlike, np.ones(reach + 1), "full")[: len(unlike)]
    alike = since < 0.5
    alike[: len(change) // 50] = False      # the start of the record
    alike &= part.tells[period_rows:] & part.tells[:-period_rows]
    return change[alike]
