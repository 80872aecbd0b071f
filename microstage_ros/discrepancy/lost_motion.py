"""Lost motion wide enough to be seen as such: found first, from stage against motor alone, and then taken into the model.

A wide gap lets a closed loop rattle from flank to flank; then the stage no longer tells where the motor is, and
every residual that takes it for granted is worthless. The gap is found by replaying the stage behind it
(`gap_replay`) and comparing with the measured stage; all else is prepared with the motor's own travel.
"""

import dataclasses

import numpy as np

from microstage_ros.discrepancy.catalogue import forms_of
from microstage_ros.discrepancy.channels.windup import Windup
from microstage_ros.discrepancy.evidence import gather
from microstage_ros.discrepancy.gap_replay import stage_behind_gap

STANDS_OUT = 3.0         # χ² per row over the baseline's from which the search is worth its time
EXPLAINS = 0.5           # share of what stands out that the gap must take away,
BETTER = 0.7             # and of the χ² that the best other name leaves
WIDTHS = (0.35, 0.6, 0.85, 1.1)   # of the spread of stage against motor, tried first
SLOW = 5000              # periods over which the spread is taken
LEAST = 1.0e-7           # m: smaller gaps are a matter of regression
STEPS = tuple(0.05 * n for n in range(-7, 8))   # of the width's logarithm around the best of these
FORM_ERROR = 0.03        # share of the width: flanks are not as hard as modelled, and rattle is not followed hit by hit
BOUND = 10.0             # medians above which a misfit counts as a rare stretch that the replay lost


@dataclasses.dataclass(frozen=True)
class Gap:
    """Lost motion at the stage [m] with its standard error, and χ² of the held-out records without and with it."""

    width: float
    stderr: float
    held_before: float
    held_after: float
    held_rows: int
    noise: float


def find_gap(prepared, frame):
    """`Gap` of the drive train, or None.

    ``prepared`` {"learn" | "held" | "base": [`Prepared`]}; ``frame`` of the catalogue.
    """
    if not all(p.has_current for p in (*prepared["learn"], *prepared["held"])):
        return None
    channels = {name: [Windup(p, frame.drive) for p in prepared[name]] for name in ("learn", "held", "base")}
    usual = max(_mean(_energy(c, c.residual) for c in channels["base"]), 1.0) if channels["base"] else 1.0
    without = _total(channels["learn"], 0.0)
    rows = sum(len(c.residual) for c in channels["learn"])
    if without < STANDS_OUT * usual * rows:
        return None
    spread = _spread(channels["learn"])
    start = min(WIDTHS, key=lambda share: _total(channels["learn"], share * spread)) * spread
    width, error = _refined(channels["learn"], start)
    left = _total(channels["learn"], width)
    if width < LEAST or without - left < EXPLAINS * (without - usual * rows):
        return None
    if left > BETTER * _best_other(channels["learn"], frame, without):
        return None
    held = _total(channels["held"], 0.0), _total(channels["held"], width)
    if held[0] - held[1] < 0.5 * EXPLAINS * (without - left) / without * held[0]:
        return None
    if channels["base"] and _total(channels["base"], width) < _total(channels["base"], 0.0):
        return None
    return Gap(width, error, *held, sum(len(c.residual) for c in channels["held"]),
               _mean(c.noise for c in channels["held"]))


def _spread(channels):
    """Range of stage against motor without its slow walk [m]."""
    ranges = []
    for channel in channels:
        raw = channel.prepared.stage - channel.prepared.angle
        rows = len(raw) // SLOW * SLOW
        pieces = raw[:rows].reshape(-1, SLOW)
        ranges.append(np.percentile(np.subtract(*np.percentile(pieces, [99.0, 1.0], axis=1)), 75.0))
    return float(np.mean(ranges))


def _refined(channels, start):
    """Width [m] of the least bounded misfit near ``start``, by a parabola through its logarithm, and its standard error."""
    logs = np.log(start) + np.array(STEPS)
    losses = np.array([sum(_bounded(c, _behind(c, float(np.exp(log)))) for c in channels) for log in logs])
    best = int(np.clip(np.argmin(losses), 2, len(logs) - 3))
    near = slice(best - 2, best + 3)
    bend, slope, _ = np.polyfit(logs[near] - logs[best], losses[near], 2)
    shift = float(np.clip(-0.5 * slope / bend, -0.1, 0.1)) if bend > 0 else 0.0
    width = float(np.exp(logs[best] + shift))
    return width, FORM_ERROR * width + 3.0e-9


def _bounded(channel, residual):
    white = np.abs(channel.whiten(residual[:, None])[0][:, 0])
    return float(np.minimum(white, BOUND * np.median(white)).sum())


def _behind(channel, gap):
    """Wind-up residual with the stage replayed behind a gap [m]."""
    p = channel.prepared
    residual = channel.mean(p.stage - p.angle - (stage_behind_gap(p.travel, gap, channel.drive, p.period) - p.travel))
    return residual - residual[0]


def _total(channels, gap):
    """χ² of the wind-up residual, as it is or with the stage replayed behind a gap [m]."""
    return sum(len(c.residual) * _energy(c, _behind(c, gap) if gap > 0.0 else c.residual) for c in channels)


def _energy(channel, residual):
    """χ² per row."""
    white, _ = channel.whiten(residual[:, None])
    return float(np.mean(white**2))


def _best_other(channels, frame, without):
    """χ² that the best other named form of the channel leaves."""
    forms = [form for form in forms_of(Windup.name) if form.named and form.effect != "backlash"]
    total = None
    for channel in channels:
        evidence = gather(channel, forms, frame)
        total = evidence if total is None else total + evidence
    return without - max(total.fit([form.key])[2] for form in forms)


def _mean(values):
    return float(np.mean(list(values)))
