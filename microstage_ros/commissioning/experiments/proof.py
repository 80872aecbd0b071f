"""Proof of a law on the machine: repeated moves, a slow sine."""

import math

import numpy as np

from microstage_ros.commissioning.experiments.closed_loop import LOOSE
from microstage_ros.commissioning.experiments.first_motion import joined
from microstage_ros.commissioning.findings import Refused, refused
from microstage_ros.control.trajectories.profiles import jerk_limited_move, sine
from microstage_ros.metrology.iso230 import iso230
from microstage_ros.metrology.repeatability import repeatability
from microstage_ros.signals.rows import bridged

TARGETS = (1e-6, 1e-5, 1e-4, 1e-3)
REPEATS = 10
ISO_FIGURES = (
    "reversal",
    "repeatability_up",
    "repeatability_down",
    "repeatability",
    "systematic",
    "mean_deviation",
    "accuracy",
)
DWELL, JUDGED = 0.3, 0.1  # rest after a move, and its last part over which the error is the mean [s]
BAND_COUNTS, BAND = 2.0, 5e-8  # settled: within so many counts, or metres
SINE = {"amplitude": 1e-5, "frequency": 0.1, "cycles": 1.0}
OFF = 2e-6  # beside the target 0.2 to 0.3 s after a move: not at rest there [m]
SWING = 6e-7  # peak to peak in the judged part that is an oscillation [m]


def moves(loop, keep):
    """Repeated moves from one place to each target and back; in every second one also on to twice the target, and to it
    from above.

    Returns (rows of report.json, figures of ISO 230-2 over all targets [m]). Raises Refused (runaway).
    """
    machine, records, rows, swing = loop.machine, [], [], 0.0
    start, fresh, sides = machine.position, True, []
    band = max(BAND_COUNTS * machine.count, BAND)
    for target in TARGETS:
        if abs(target) > 0.15 * machine.stroke:
            continue
        errors, times = {"up": [], "down": [], "back": []}, []
        for k in range(REPEATS):
            begin, ways = (
                start,
                [("up", target), ("back", 0.0)]
                if k % 2
                else [("up", target), ("back", 2.0 * target), ("down", target), ("back", 0.0)],
            )
            for side, way in ways:
                place = start + way
                move = jerk_limited_move(begin, place, machine.period, loop.limits(6e-3))
                record = loop.follow(
                    np.append(move, np.full(machine.periods(DWELL), place)), error=LOOSE, fresh=fresh, go_on=True
                )
                begin, fresh = place, False
                records.append(record)
                read = bridged(record["encoder_m"])
                judged = read[-machine.periods(JUDGED) :]
                swing = max(swing, swing_of(judged))
                errors[side].append(float(np.mean(judged)) - place)
                try:
                    _at_rest(loop, swing, errors[side][-1])
                except Refused:
                    keep("moves", joined(records))
                    raise
                if side == "up":
                    times.append(_settling(np.abs(read - place) > band, len(move)) * machine.period)
        found = repeatability(errors["up"])
        one = iso230([0.0], [errors["up"]], [errors["down"]])
        sides.append((target, errors))
        rows.append(
            {
                "target_m": target,
                "n": REPEATS,
                "bias_m": found.bias,
                "four_s_m": found.four_s,
                "settling_s": max(float(np.median(times)), 0.0),  # not finite: half of them did not settle
                "four_s_interval_m": list(found.four_s_interval),
                "worst_m": float(np.abs(errors["up"]).max()),
                "n_down": len(errors["down"]),
                "reversal_m": float(one.reversals[0]),
                "bidirectional_m": one.repeatability,
            }
        )
    machine.rest(0.0)
    keep("moves", joined(records))
    return rows, _iso_figures(sides)


def _settling(beyond, planned):
    """Rows from the end of the reference, ``planned`` rows long, until ``beyond``, (rows,), is False for good; infinite
    where it never is."""
    last = np.flatnonzero(beyond)
    if len(last) and last[-1] == len(beyond) - 1:
        return math.inf
    return float(last[-1]) + 1 - planned if len(last) else 0.0


def most_beside(machine):
    """How far beside its target [m] a move may end on a ``machine``, `Machine`."""
    return max(OFF, 40.0 * machine.count)


def worst_of(rows):
    """Largest 4s or mean error [m]. ``rows``: those of `moves`, 4s and mean error of each [m]."""
    return max(max(row["four_s_m"], abs(row["bias_m"])) for row in rows)


def _at_rest(loop, swing, error):
    """Refuse a law that swings at rest, or does not come to rest at its target, at the first move that shows it."""
    machine, said = loop.machine, ""
    if swing > max(SWING, 16.0 * machine.count, 12.0 * machine.noise):
        said, value = f"the stage swings by {swing * 1e6:.3g} µm at rest", swing
    elif abs(error) > most_beside(machine):
        said, value = f"the stage rests {error * 1e6:.3g} µm beside its target", error
    if said:
        machine.rest(0.0)
        raise refused("runaway", value, "m", f"under {loop.law} {said}")


def _iso_figures(sides):
    """Reversal B, repeatabilities R↑, R↓, R, systematic deviation E, mean deviation M and accuracy A [m] over all
    targets."""
    targets = np.array([target for target, _ in sides])
    found = iso230(
        targets, *(targets[:, None] + np.array([errors[side] for _, errors in sides]) for side in ("up", "down"))
    )
    return {name: getattr(found, name) for name in ISO_FIGURES}


def swing_of(positions):
    """Peak to peak [m] of an oscillation of ``positions`` [m], shape (n,), about a straight line; 0 where the
    positions turn round fewer than four times."""
    rows = np.arange(len(positions))
    left = positions - np.polyval(np.polyfit(rows, positions, 1), rows)
    size = float(np.ptp(left))
    crossings = np.count_nonzero(np.diff(np.sign(left[np.abs(left) > 0.2 * size])))
    return size if crossings >= 4 else 0.0


def slow_sine(loop, keep):
    """Largest following error [m] of a slow sine after its first quarter."""
    machine = loop.machine
    reference = sine(machine.position, period=machine.period, limits=loop.limits(6e-3), **SINE)
    record = loop.follow(reference, fresh=False)
    keep("slow_sine", record)
    error = bridged(record["encoder_m"]) - record["reference_m"]
    return float(np.abs(error[len(error) // 4 :]).max())


def prove(loop, keep):
    """(rows of the moves, ISO 230-2 figures, slow sine's largest error). Raises Refused (runaway) where the law swings
    at rest or does not reach its target."""
    rows, figures = moves(loop, keep)
    return rows, figures, slow_sine(loop, keep)
