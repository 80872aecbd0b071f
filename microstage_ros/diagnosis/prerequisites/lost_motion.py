"""Lost motion wide enough to be seen as such: found first, from stage against motor alone, and then taken into the
model.

A wide gap lets a closed loop rattle from flank to flank; then the stage no longer tells where the motor is, and
every residual that takes it for granted is worthless. The gap is found by replaying the stage behind it
(`gap_replay`) and comparing with the measured stage; all else is prepared with the motor's own travel.
"""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.preprocessing.gap_replay import stage_behind_gap
from microstage_ros.diagnosis.preprocessing.threads import side_by_side
from microstage_ros.diagnosis.residuals.transmission_deflection import Windup

STANDS_OUT = 1.4         # times the baseline's loss from which the search is worth its time
EXPLAINS = 0.4           # share of what stands out that the gap must take away (other causes: a tenth at most),
# already at the best of the first widths (found gaps: 0.5 and more; other causes: 0.15 at most),
EXPLAINS_FIRST = 0.25
EXPLAINS_HELD = 0.1      # and of the held-out records, where another cause may stand out more,
EXPLAINS_ALONE = 0.5     # or of every learning record alone
# times the χ² of held-out records without the gap that a replay may leave there; derived: one that lost its place is on
# the wrong flank, and off by the gap where the model without one is off by half of it
LOST = 4.0
USUAL = 0.7              # mean size of a whitened residual that is noise
# of the spread of stage against motor, tried first; derived: with `STEPS` on both sides no width between 0.25 and 1.5
# is left out
WIDTHS = (0.35, 0.6, 0.85, 1.1)
SLOW = 5000              # periods over which the spread is taken
LEAST = 1.0e-7           # m: smaller gaps are a matter of regression
# of the width's logarithm around the best of these; derived: further than half way to the next one, ln(0.6/0.35)/2
STEPS = tuple(0.05 * n for n in range(-7, 8))
FORM_ERROR = 0.015       # share of the width: flanks are not as hard as modelled,
RATTLE_ERROR = 0.02      # and for every usual loss that rattle, not followed hit by hit, adds to it
MOST_ERROR = 0.08
BOUND = 20.0             # usual sizes above which a misfit counts no more


@dataclasses.dataclass(frozen=True)
class Gap:
    """Lost motion at the stage [m] with its standard error, and χ² of the held-out records without and with it.

    ``taken``: χ² that it takes from a learning record, on average."""

    width: float
    stderr: float
    held_before: float
    held_after: float
    held_rows: int
    noise: float
    taken: float


def find_gap(prepared, drive):
    """`Gap` of the drive train, or None.  ``prepared`` {"learn" | "held" | "base": [`Prepared`]}."""
    if not all(p.has_current for p in (*prepared["learn"], *prepared["held"])):
        return None
    channels = {name: [Windup(p, drive) for p in prepared[name]] for name in ("learn", "held", "base")}
    usual = max(_mean(_loss(c, c.residual) for c in channels["base"]), USUAL) if channels["base"] else USUAL
    without = _losses(channels["learn"], 0.0)
    if without < STANDS_OUT * usual:
        return None
    spread = _spread(channels["learn"])
    first = min((share * spread for share in WIDTHS), key=lambda width: _followed(channels["learn"], width))
    if _explained(channels["learn"], first, _losses, usual) < EXPLAINS_FIRST:
        return None
    width = _refined(channels["learn"], first)
    if width < LEAST or _explained(channels["learn"], width, _losses, usual) < EXPLAINS:
        return None
    if _wound_up(channels["learn"]) < _losses(channels["learn"], width):
        return None
    # a record that crosses the gap a few times only may lose its place in it: then the others must agree one by one
    alone = (
        min(_explained([c], width, _losses, usual) for c in channels["learn"]) if len(channels["learn"]) > 1 else 0.0
    )
    again = max(_explained(channels["held"], width, *how) for how in ((_losses, usual), (_squares, 1.0)))
    if again < EXPLAINS_HELD and alone < EXPLAINS_ALONE:
        return None
    if channels["base"] and _losses(channels["base"], width) < _losses(channels["base"], 0.0):
        return None
    held = [sum(len(c.residual) * _energy(c, gap) for c in channels["held"]) for gap in (0.0, width)]
    if held[1] > LOST * held[0]:
        return None
    taken = _mean(len(c.residual) * (_energy(c, 0.0) - _energy(c, width)) for c in channels["learn"])
    rattle = max(_losses(channels["learn"], width) / usual - 1.0, 0.0)
    error = min(FORM_ERROR + RATTLE_ERROR * rattle, MOST_ERROR) * width + 3.0e-9
    return Gap(width, error, *held, sum(len(c.residual) for c in channels["held"]),
               _mean(c.noise for c in channels["held"]), taken)


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
    """Width [m] of the least loss near ``start``, by a parabola through the width's logarithm."""
    logs = np.log(start) + np.array(STEPS)
    losses = np.array([_followed(channels, float(np.exp(log))) for log in logs])
    best = int(np.clip(np.argmin(losses), 1, len(logs) - 2))
    # three points: in a rattle the loss is no parabola further out
    before, least, after = losses[best - 1: best + 2]
    bend = before - 2.0 * least + after
    shift = float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend > 0 else 0.0
    return float(np.exp(logs[best] + shift * (logs[1] - logs[0])))


def _behind(channel, gap):
    """Wind-up residual as it is, or with the stage replayed behind a gap [m]."""
    if gap == 0.0:
        return channel.residual
    p = channel.prepared
    residual = channel.mean(p.stage - p.angle - (stage_behind_gap(p.travel, gap, channel.drive, p.period) - p.travel))
    return residual - residual[0]


def _wound_up(channels):
    """Loss with a drive train that only winds up more, or less, under the guideways' friction and the stage's inertia.

    So does a soft drive, or one with a payload: it hangs back as behind a gap of twice friction over stiffness.
    """
    more, product, square = [], 0.0, 0.0
    for channel in channels:
        p, drive = channel.prepared, channel.drive
        force = p.guideway + drive.guideway.viscous * p.stage_speed + drive.mass * np.gradient(p.stage_speed, p.period)
        more.append(channel.mean(force / drive.stiffness))
        residual, column = channel.whiten(np.stack([channel.residual, more[-1]], axis=1))[0].T
        product, square = product + column @ residual, square + column @ column
    return _mean(_loss(c, c.residual - product / square * column) for c, column in zip(channels, more))


def _explained(channels, gap, loss, usual):
    """Share of what a loss has above its usual size that the gap takes away."""
    before, after = (loss(channels, width) for width in (0.0, gap))
    return (before - after) / max(before - usual, 1e-9)


def _squares(channels, gap):
    return _mean(_energy(c, gap) for c in channels)


def _losses(channels, gap):
    return _mean(side_by_side(lambda c: _loss(c, _behind(c, gap)), channels))


def _followed(channels, gap):
    """Loss over the loss without a gap of the record that is followed best: where a replay loses its place says nothing
    of the gap."""
    return min(side_by_side(lambda c: _loss(c, _behind(c, gap)) / _loss(c, c.residual), channels))


def _loss(channel, residual):
    """Mean size of the whitened residual; rare stretches that a replay lost count no more than `BOUND` usual ones."""
    own = np.median(np.abs(channel.whiten(channel.residual[:, None])[0]))
    white = np.abs(channel.whiten(residual[:, None])[0][:, 0])
    return float(np.minimum(white, BOUND * max(own, USUAL)).mean())


def _energy(channel, gap):
    """χ² per row."""
    return float(np.mean(channel.whiten(_behind(channel, gap)[:, None])[0] ** 2))


def _mean(values):
    return float(np.mean(list(values)))
