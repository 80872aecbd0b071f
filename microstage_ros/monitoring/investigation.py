"""From an alarm to a cause: which moves are made, within which limits, and the diagnosis of what they show."""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.batch import diagnose_records
from microstage_ros.diagnosis.report.answer import write_answer
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import read_record

LENGTHS = (
    1.0e-5,
    1.5e-4,
    1.0e-3,
    5.0e-3,
)  # m: pre-sliding, breakaway, sliding, as the records of the validation have them
SPEEDS = (1.0e-4, 4.0e-4, 8.0e-4, 2.1e-3)  # m/s: over the Stribeck curve of the shipped axis
LEAST_WINDOWS = 2


@dataclasses.dataclass(frozen=True)
class Limits:
    """Travel ``low`` … ``high`` [m] and largest command ``voltage`` [V] of the moves."""

    low: float
    high: float
    voltage: float

    @classmethod
    def of(cls, axis, low, high, voltage):
        """The limits asked for, or None where no moves are (both ends 0).

        Raises
        ------
        InputError : limits beyond the axis's own, or in the wrong order.
        """
        if low == 0.0 and high == 0.0:
            return None
        least, most = axis.value("travel.minimum"), axis.value("travel.maximum")
        if not least <= low < high <= most:
            raise InputError(
                "investigate: travel_min, travel_max",
                (low, high),
                f"two places between {least:g} and {most:g} m, the smaller first",
            )
        if high - low < LENGTHS[0]:
            raise InputError("investigate: travel_max", high, f"at least {LENGTHS[0]:g} m above travel_min")
        own = axis.value("drive.voltage_limit")
        if not 0.0 <= voltage <= own:
            raise InputError("investigate: voltage_max", voltage, f"0 (the axis's own) to {own:g} V")
        return cls(low, high, voltage or own)


def targets(limits, seed):
    """(target [m], largest speed [m/s]) of move after move, without end: out and back by all lengths that fit.

    ``limits``: `Limits`; ``seed`` [1].
    """
    generator = np.random.default_rng([int(seed), 7])
    fitting = [length for length in LENGTHS if length <= limits.high - limits.low]
    while True:
        for number in generator.permutation(len(fitting)):
            length = fitting[number]
            start = generator.uniform(limits.low, limits.high - length)
            speed = float(generator.choice(SPEEDS))
            for place in (start, start + length, start):
                yield float(place), speed


def diagnose_windows(axis, windows, baseline, out, seed):
    """Diagnose windows (`Record`), the last one held out; write into ``out``, return report.json's mapping.

    Parameters
    ----------
    baseline : files of the healthy axis; may be empty.
    seed : of the random numbers [1].

    Raises
    ------
    InputError : fewer than `LEAST_WINDOWS` windows.
    """
    if len(windows) < LEAST_WINDOWS:
        raise InputError(
            "investigate: windows of motion",
            len(windows),
            f"at least {LEAST_WINDOWS}; let the axis move, or give limits for moves",
        )
    healthy = [read_record(name) for name in baseline]
    found = diagnose_records(axis, windows[:-1], windows[-1:], healthy, seed)
    sources = {"records": [w.source for w in windows[:-1]], "holdout": [windows[-1].source], "baseline": list(baseline)}
    return write_answer(found, axis, str(out), sources)
