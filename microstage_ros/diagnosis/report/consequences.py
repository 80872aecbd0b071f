"""What the causes mean for the machine's work: tracking and positioning errors predicted with and without them.

The axis file and the extended one make the same moves and scans under the shipped controller, with the
same noise. Errors are those of the stage itself, not of what the encoder says.
"""

from dataclasses import dataclass

import numpy as np

from microstage_ros.control.runs.run_file import Run
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.control.trajectories.profiles import scan

MOVES = (2e-4, 2e-3, 2e-2)     # of the travel
DWELL_S, LAST_S = 0.3, 0.05    # wait after a move, and the part of it over which the position is taken
SCAN = 0.02                    # of the travel per second
SEED = 1


@dataclass(frozen=True)
class Consequence:
    """One error in the user's terms [m], predicted with the axis file and with the causes."""

    name: str
    before: float
    after: float


def consequences(axis, extended):
    """Predicted errors, a tuple of `Consequence`; empty for an axis without a shipped controller."""
    if axis.controller.get("type", "none") == "none":
        return ()
    reference, ends, scanning = _program(axis)
    found = []
    for model in (axis, extended):
        columns = simulate(
            model, Run(program=[{"reference": reference}], start_m=float(reference[0]), friction="relaxed"), SEED
        )
        error = columns["stage_m"] - reference
        last = max(int(LAST_S / axis.value("period")), 1)
        settled = [abs(float(np.mean(error[end - last: end]))) for end in ends]
        found.append(
            [float(np.mean(pair)) for pair in np.reshape(settled, (-1, 2))]
            + [float(np.sqrt(np.mean(error[scanning] ** 2)))]
        )
    names = [f"position after a move of {_plain(step)}" for step in _steps(axis)]
    names.append(f"tracking in a scan at {_plain(SCAN * _stroke(axis))}/s, rms")
    return tuple(Consequence(name, *pair) for name, pair in zip(names, zip(*found)))


def _stroke(axis):
    return axis.value("travel.maximum") - axis.value("travel.minimum")


def _steps(axis):
    return [float(f"{share * _stroke(axis):.1g}") for share in MOVES]


def _plain(metres):
    return f"{metres * 1e3:g} mm" if metres >= 1e-3 else f"{metres * 1e6:g} µm"


def _program(axis):
    """Reference [m], the rows where dwells end (there and back for every move), and the rows of the scan."""
    period, middle = axis.value("period"), 0.5 * (axis.value("travel.minimum") + axis.value("travel.maximum"))
    wait, speed = int(DWELL_S / period), SCAN * _stroke(axis)
    pieces, ends, rows, at = [np.full(wait, middle)], [], wait, middle
    for step in _steps(axis):
        for target in (middle + step, middle):
            motion = scan(at, target, min(speed, abs(target - at) / 0.05), period)
            pieces += [motion, np.full(wait, target)]
            rows += len(motion) + wait
            ends.append(rows)
            at = target
    motion = np.concatenate(
        [scan(middle, middle + 0.5 * speed, speed, period), scan(middle + 0.5 * speed, middle, speed, period)]
    )
    pieces.append(motion)
    return np.concatenate(pieces), ends, slice(rows, rows + len(motion))
