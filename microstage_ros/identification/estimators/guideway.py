"""Incremental loading of the guideways: holds, first loading, return loops, breakaway (paper section 4.2)."""

from dataclasses import dataclass

import numpy as np

from microstage_ros.identification.estimators.inverse_dynamics import applied_force
from microstage_ros.identification.estimators.virgin_curve import Loading
from microstage_ros.quantities.errors import InputError

SHORTEST_HOLD = 0.05  # a load counts as held if it stays for so long [s]
SLIP_SPEED = 2e-5  # faster than this at the end of a hold [m/s] the guideway slides; slower, it still settles


# derived: the last third of a hold has two halves to tell a speed by; a virgin curve is compared from its third point
LEAST_ROWS, LEAST_LEVELS = 6, 3
TOO_FEW = f"a load that holds at {LEAST_LEVELS} or more levels before the stage slides, and rises from one to the next"


@dataclass(frozen=True)
class GuidewayRepeat:
    """One repeat of incremental loading.

    `loading`: first loading, one point per new load; `loops`: list of (displacement [m], force [N]) of the
    return loops; `breakaway`: (last load held, load that slid) [N], the second infinite if none slid.
    """

    loading: Loading
    loops: list
    breakaway: tuple


def extract_loading(record, axis):
    """`GuidewayRepeat` of a record of a force-driven axis whose force goes up in steps.

    Displacement is the interferometer's where there is one, else the encoder's. Raises InputError if the
    force holds fewer than eight levels.
    """
    force = applied_force(record, axis)
    position = record["interferometer_m"] if "interferometer_m" in record else record["encoder_m"]
    holds = _holds(force, record.period_s)
    if len(holds) < 8:
        raise InputError(
            f"{record.source}: force", f"{len(holds)} levels held", "a load that goes up in steps (eight or more)"
        )
    levels, places, speeds = np.array([_settled(force, position, hold, record.period_s) for hold in holds]).T
    slid = np.flatnonzero(np.abs(speeds) > SLIP_SPEED)
    last = slid[0] if len(slid) else len(levels)
    if last < LEAST_LEVELS:
        raise InputError(f"{record.source}: force", f"{last} levels held before it slides", TOO_FEW)
    breakaway = (float(levels[:last].max()), float(levels[last]) if last < len(levels) else np.inf)
    levels, places = levels[:last] - levels[0], places[:last] - places[0]
    highest = np.maximum.accumulate(levels)
    first = np.concatenate([[False], levels[1:] > highest[:-1] + 1e-9])
    if np.sum(first) < LEAST_LEVELS:
        raise InputError(f"{record.source}: force", f"{np.sum(first)} rising levels held before it slides", TOO_FEW)
    return GuidewayRepeat(Loading(places[first], levels[first]), _loops(levels, places, highest), breakaway)


def _holds(force, period):
    """(start, stop) of the stretches in which the force does not change, long enough for a speed in their last
    third."""
    still = np.concatenate([[False], np.abs(np.diff(force)) < 1e-9, [False]])
    edges = np.flatnonzero(np.diff(still.astype(int))).reshape(-1, 2)
    return [(a, b) for a, b in edges if (b - a) * period >= SHORTEST_HOLD and b - a >= LEAST_ROWS]


def _settled(force, position, hold, period):
    """Load, position and speed over the last third of a hold."""
    rows = slice(hold[1] - (hold[1] - hold[0]) // 3, hold[1])
    x = position[rows]
    half = len(x) // 2
    return float(force[hold[0]]), float(np.mean(x)), float(np.mean(x[half:]) - np.mean(x[:half])) / (half * period)


def _loops(levels, places, highest):
    """The stretches below the highest load so far, with the point from which they left."""
    below = levels < highest - 1e-9
    edges = np.flatnonzero(np.diff(np.concatenate([[False], below, [False]]).astype(int))).reshape(-1, 2)
    return [(places[a - 1 : b + 1], levels[a - 1 : b + 1]) for a, b in edges if a > 0 and b - a >= 3]


def elastic_slope(loop):
    """Slope of a return loop [N/m]: least squares of force on displacement."""
    displacement, force = loop
    centred = displacement - displacement.mean()
    return float(centred @ force / (centred @ centred))
