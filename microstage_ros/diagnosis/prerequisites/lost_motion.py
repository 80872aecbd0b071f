"""Lost motion wide enough to be seen as such: found first, from stage against motor alone, and then taken into the
model.

A wide gap lets a closed loop rattle from flank to flank; then the stage no longer tells where the motor is, and
every residual that takes it for granted is worthless. Where it rattles, force over deflection tells the gap
(`characteristic`), and the drive train's stiffness with it. Elsewhere the stage is replayed behind it (`gap_replay`)
and compared with the measured one. An error of the lead goes with the place, and an amplifier's gain, offset or warm
winding with the voltage over time; they are linear in their sizes and free in every comparison, so that none of them
hides a gap or passes for one.
"""

import dataclasses
import math

import numpy as np

from microstage_ros.diagnosis.catalogue import FORMS
from microstage_ros.diagnosis.catalogue.form import Frame
from microstage_ros.diagnosis.preprocessing.gap_replay import stage_behind_gap
from microstage_ros.diagnosis.preprocessing.threads import side_by_side
from microstage_ros.diagnosis.preprocessing.transmitted_force import SIGMAS
from microstage_ros.diagnosis.prerequisites.characteristic import PULLED, SIZES, Windows, fit
from microstage_ros.diagnosis.prerequisites.resonant import DAMPING_ERROR, FAR, STIFFNESS_ERROR
from microstage_ros.diagnosis.residuals.transmission_deflection import BLOCK, Windup

# times the baseline's loss, or the force's noise, from which the search is worth its time; calibrated by:
# validation.margins (1.27 to 1.82)
STANDS_OUT = 1.4
# share of what stands out that the gap must take away; calibrated by: validation.margins --known --kind two --world
# second --effect backlash drive_compliance --seed 9813 --cases 12 (0.39 to 0.46),
EXPLAINS = 0.4
# already at the best of the first widths; calibrated by: the same (up to 0.38), and validation.margins (0.20 and more),
EXPLAINS_FIRST = 0.25
EXPLAINS_ALONE = 0.5     # or of every learning record alone, where the held-out ones are no nearer with it
# times the χ² of held-out records without the gap that a replay may leave there; derived: one that lost its place is on
# the wrong flank, and off by the gap where the model without one is off by half of it
LOST = 4.0
# mean size of a whitened residual that is noise; derived: of a Gaussian of unit variance
USUAL = math.sqrt(2.0 / math.pi)
# of the spread of stage against motor, tried first; derived: with `STEPS` on both sides no width between 0.25 and 1.5
# is left out
WIDTHS = (0.35, 0.6, 0.85, 1.1)
# periods over which the spread is taken; derived: in half a second the amplifier's noise of 1 mV walks the motor by
# 18 nm, 25 nm per √s, a fifth of the smallest gap `LEAST`
SLOW = 5000
# m: smaller gaps are a matter of regression; calibrated by: validation.margins (5.3e-9 to 9.2e-6)
LEAST = 1.0e-7
# of the width's logarithm around the best of these; derived: further than half way to the next one, ln(0.6/0.35)/2
STEPS = tuple(0.05 * n for n in range(-7, 8))
# share of the width: flanks are not as hard as modelled; calibrated by: microstage campaign --form-errors
# (0.00017 to 0.0013), and no less than `selection.sizes.LEAST_FORM_ERROR`
FORM_ERROR = 0.005
# and for every usual loss that rattle, not followed hit by hit, adds to it; calibrated by: validation.variation --group
# gap --world second (half and double: the same answers)
RATTLE_ERROR = 0.02
# m, of the width; calibrated by: microstage campaign --world second --kind single --effect backlash --seed 17001
# --cases 6 --strength 0.02, and 0.1 (the seven gaps of 0.1 to 0.9 µm found so are off by 2.9 nm rms)
LEAST_ERROR = 3.0e-9
# per cent of the rows, and of the pieces, between which stage against motor spreads; derived: spikes are outside, and a
# stage that goes one way stays on one flank for some of the pieces
ROWS, PIECES = (99.0, 1.0), 75.0
# usual sizes above which a misfit counts no more; calibrated by: validation.variation --group gap --alone BOUND
# --world second --cases 3 --strength 0.1 --seed 17001 (doubled the same answers; halved, one gap by 3 of its errors)
BOUND = 20.0
#: Effects whose forms are free beside a gap: they move the motor's travel with the place, or while it rests.
FREE = ("screw_pitch_error", "amplifier_offset", "amplifier_gain", "resistance_rise")
# share of what force over deflection leaves above its noise without a gap that the gap must take, in the learning and
# in the held-out records; the geometric mean of 0.58, of a motor's travel that is wrong by an amplifier's lag, and
# 0.89, of a gap under late readings; calibrated by: microstage campaign --world second --kind two, seed 9203, case 47,
# and seed 9401, case 53
CLEARLY = 0.72
# of a column's length that must be its own; derived: a column that others give to seven digits is rounding
OWN = 1.0e-7
ROUNDS = 20              # derived: six digits where a round halves the error
TINY = np.finfo(float).tiny


@dataclasses.dataclass(frozen=True)
class Gap:
    """Lost motion at the stage [m] with its standard error, and χ² of the held-out records without and with it, rare
    stretches that the replay lost bounded.

    ``taken``: χ² that it takes from a learning record, on average; ``stiffness`` and ``damping``: factors on the drive
    train's, with the stiffness's standard error, where a rattle told them (`characteristic`), else 1 and None;
    ``held_loose``: χ² of the held-out records with the gap alone; ``pull``: force that pulls on the stage towards
    smaller x [N] and its standard error, as the rattle tells it, else 0."""

    width: float
    stderr: float
    held_before: float
    held_after: float
    held_rows: float
    noise: float
    taken: float
    stiffness: float = 1.0
    damping: float = 1.0
    stiffness_stderr: float | None = None
    held_loose: float = 0.0
    pull: float = 0.0
    pull_stderr: float = 0.0

    @property
    def rattles(self):
        """Whether force over deflection told the gap, and the drive train's stiffness and damping with it."""
        return self.stiffness_stderr is not None

    @property
    def far(self):
        """Whether the drive train behind the gap is far from the model's."""
        return self.rattles and max(self.stiffness, 1.0 / self.stiffness) >= FAR

    @property
    def scales(self):
        """Whether stiffness and damping are off by one factor, as another mass on the stage makes them seem."""
        return abs(math.log(max(self.damping, TINY) / self.stiffness)) < 2.0 * DAMPING_ERROR

    def added_mass(self, mass):
        """Mass M [kg] added to the stage of ``mass`` m [kg] that the stiffness, k times the stated one, stands for,
        m (1/k − 1), and its standard error."""
        error = math.hypot(self.stiffness_stderr or 0.0, STIFFNESS_ERROR * self.stiffness)
        return mass * (1.0 / self.stiffness - 1.0), mass * error / self.stiffness**2

    def drive(self, nominal):
        """`Drive` with these factors on ``nominal``, a `Drive`."""
        return dataclasses.replace(
            nominal, stiffness=nominal.stiffness * self.stiffness, damping=nominal.damping * self.damping
        )


class Deflection(Windup):
    """`Windup` of one record that is compared beside any error of the lead and of the amplifier, `FREE`.

    Its noise is that of what these leave: an error of the lead would pass for loads that turn round within a block.
    """

    def __init__(self, prepared, drive):
        super().__init__(prepared, drive)
        frame = Frame(drive, 0.0, 0.0, 0.0)
        free = [form for form in FORMS if form.channel == self.name and form.effect in FREE]
        columns = np.concatenate([form.columns(self, frame) for form in free], axis=1)
        columns = columns / np.maximum(np.linalg.norm(np.diff(columns, axis=0), axis=0), TINY)
        known = columns @ _sizes(np.diff(columns, axis=0), np.diff(self.residual))
        self.residual = self.residual - known + known[0]
        middle = BLOCK * (np.arange(len(known)) + 0.5)
        raw = self.deflection()
        self.walk, self.white = self._noise(raw - np.interp(np.arange(len(raw)), middle, known))
        white = self.whiten(columns)[0]
        basis, sizes, _ = np.linalg.svd(white / np.maximum(np.linalg.norm(white, axis=0), TINY), full_matrices=False)
        self._basis = basis[:, sizes > OWN * sizes[0]]

    def white_beside(self, residual):
        """Whitened ``residual`` (blocks,) [m] without what the forms that are free take of it."""
        white = self.whiten(residual[:, None])[0][:, 0]
        return white - self._basis @ (self._basis.T @ white)


def _sizes(columns, changes):
    """Sizes (k,) by which ``columns`` (n, k) follow ``changes`` (n,) with the least sum of absolute values, by
    iteratively reweighted least squares: the jumps of a gap are large and few."""
    weight = np.ones(len(changes))
    for _ in range(ROUNDS):
        sizes = np.linalg.lstsq(columns * weight[:, None], changes * weight, rcond=OWN)[0]
        left = np.abs(changes - columns @ sizes)
        weight = 1.0 / np.sqrt(np.maximum(left, max(float(np.median(left)), TINY)))
    return sizes


def find_gap(prepared, drive):
    """`Gap` of the drive train, or None.  ``prepared`` {"learn" | "held" | "base": [`Prepared`]}."""
    if not all(p.has_current for p in (*prepared["learn"], *prepared["held"])):
        return None
    return _rattling(prepared, drive) or _replayed(prepared, drive)


def _rattling(prepared, drive):
    """`Gap` by force over deflection, where flanks are hit from both sides in the records; else None."""
    records = {name: [Windows(p, drive) for p in group] for name, group in prepared.items()}
    without = fit(records["learn"], drive, SIZES[1:])
    found = fit(records["learn"], drive, PULLED) if without is not None else None
    if found is None or found.gap < max(LEAST, SIGMAS * found.gap_stderr):
        return None
    loose = dataclasses.replace(found, stiffness=drive.stiffness, damping=drive.damping)
    held, base = ([fit(records[name], drive, (), one) for one in (without, found, loose)] for name in ("held", "base"))
    noise = min(record.noise for record in records["learn"] if len(record))
    for before, after in ((without, found), held[:2]):
        if before is None or before.left < STANDS_OUT * noise:
            return None
        if before.left**2 - after.left**2 < CLEARLY * (before.left**2 - noise**2):
            return None
    if base[0] is not None and base[1].left < base[0].left:
        return None

    def chi2(one, rows):
        return rows * (one.left / found.left) ** 2

    share = FORM_ERROR + RATTLE_ERROR * max(found.left / noise - 1.0, 0.0)
    return Gap(
        width=found.gap, stderr=math.hypot(share * found.gap, found.gap_stderr),
        held_before=chi2(held[0], held[0].rows), held_after=chi2(held[1], held[0].rows), held_rows=held[0].rows,
        noise=found.left / found.stiffness,
        taken=(chi2(without, found.rows) - chi2(found, found.rows)) / len(records["learn"]),
        stiffness=found.stiffness / drive.stiffness, damping=found.damping / drive.damping,
        stiffness_stderr=float(found.stiffness_stderr / drive.stiffness), held_loose=chi2(held[2], held[0].rows),
        pull=found.pull, pull_stderr=found.pull_stderr,
    )


def shows_no_gap(prepared, drive):
    """Whether force over deflection is one straight line down to its noise: the drive train swings, and has no gap.

    Asked of the learning and of the held-out records; a line in which no gap of `LEAST` could hide. ``prepared``
    {"learn" | "held": [`Prepared`]}, ``drive``: `Drive` of the axis.
    """
    for name in ("learn", "held"):
        records = [Windows(p, drive) for p in prepared[name] if p.has_current]
        found = fit(records, drive)
        if found is None or found.gap + SIGMAS * found.gap_stderr > LEAST:
            return False
        if found.left > STANDS_OUT * min(record.noise for record in records if len(record)):
            return False
    return True


def _replayed(prepared, drive):
    """`Gap` by the stage replayed behind it, which asks for no rattle; or None."""
    channels, usual = _deflections(prepared, drive)
    if _losses(channels["learn"], 0.0) < STANDS_OUT * usual:
        return None
    spread = _spread(channels["learn"])
    first = min((share * spread for share in WIDTHS), key=lambda width: _followed(channels["learn"], width))
    if _explained(channels["learn"], first, _losses, usual) < EXPLAINS_FIRST:
        return None
    width = _refined(channels["learn"], first)
    if width < LEAST or _explained(channels["learn"], width, _losses, usual) < EXPLAINS:
        return None
    if _wound_up(channels["learn"]) < max(_losses(channels["learn"], width), usual):
        return None     # more wind-up explains it better, or leaves nothing for a gap to explain
    # a record that crosses the gap a few times only may lose its place in it: then the others must agree one by one
    alone = (
        min(_explained([c], width, _losses, usual) for c in channels["learn"]) if len(channels["learn"]) > 1 else 0.0
    )
    again = max(_explained(channels["held"], width, *how) for how in ((_losses, usual), (_squares, 1.0)))
    if again <= 0.0 and alone < EXPLAINS_ALONE:
        return None
    if channels["base"] and _losses(channels["base"], width) < _losses(channels["base"], 0.0):
        return None
    lost = [sum(len(c.residual) * _energy(c, gap) for c in channels["held"]) for gap in (0.0, width)]
    if lost[1] > LOST * lost[0]:
        return None
    before, after = (
        sum(float(np.sum(_bounded(c, _behind(c, gap)) ** 2)) for c in channels["held"]) for gap in (0.0, width)
    )
    taken = _mean(len(c.residual) * (_energy(c, 0.0) - _energy(c, width)) for c in channels["learn"])
    rattle = max(_losses(channels["learn"], width) / usual - 1.0, 0.0)
    error = (FORM_ERROR + RATTLE_ERROR * rattle) * width + LEAST_ERROR
    return Gap(width, error, before, after, sum(len(c.residual) for c in channels["held"]),
               _mean(c.noise for c in channels["held"]), taken)


def _deflections(prepared, drive):
    """{group: [`Deflection`]} of ``prepared`` records, and the usual loss, which is the baseline's."""
    channels = {name: [Deflection(p, drive) for p in prepared[name]] for name in ("learn", "held", "base")}
    return channels, max(_mean(_loss(c, c.residual) for c in channels["base"]), USUAL) if channels["base"] else USUAL


def stands_out(prepared, drive):
    """Whether stage against motor, beside what may be free, shows more than noise in the learning records: something
    for a gap to explain.  ``prepared``, ``drive``: as in `find_gap`."""
    channels, usual = _deflections(prepared, drive)
    return _losses(channels["learn"], 0.0) >= STANDS_OUT * usual


def _spread(channels):
    """Range of stage against motor without its slow walk [m]."""
    ranges = []
    for channel in channels:
        raw = channel.prepared.stage - channel.prepared.angle
        rows = len(raw) // SLOW * SLOW
        pieces = raw[:rows].reshape(-1, SLOW)
        ranges.append(np.percentile(np.subtract(*np.percentile(pieces, ROWS, axis=1)), PIECES))
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
        residual, column = channel.white_beside(channel.residual), channel.white_beside(more[-1])
        product, square = product + column @ residual, square + column @ column
    return _mean(_loss(c, c.residual - product / square * column) for c, column in zip(channels, more))


def _explained(channels, gap, loss, usual):
    """Share of what a loss has above its usual size that the gap takes away."""
    before, after = (loss(channels, width) for width in (0.0, gap))
    return (before - after) / max(before - usual, TINY)


def _squares(channels, gap):
    return _mean(_energy(c, gap) for c in channels)


def _losses(channels, gap):
    return _mean(side_by_side(lambda c: _loss(c, _behind(c, gap)), channels))


def _followed(channels, gap):
    """Loss over the loss without a gap of the record that is followed best: where a replay loses its place says nothing
    of the gap."""
    return min(side_by_side(lambda c: _loss(c, _behind(c, gap)) / _loss(c, c.residual), channels))


def _loss(channel, residual):
    """Mean size of the whitened residual, `_bounded`."""
    return float(_bounded(channel, residual).mean())


def _bounded(channel, residual):
    """Sizes (blocks,) of the whitened residual; rare stretches that a replay lost count no more than `BOUND` usual
    ones."""
    own = np.median(np.abs(channel.white_beside(channel.residual)))
    return np.minimum(np.abs(channel.white_beside(residual)), BOUND * max(own, USUAL))


def _energy(channel, gap):
    """χ² per row."""
    return float(np.mean(channel.white_beside(_behind(channel, gap)) ** 2))


def _mean(values):
    return float(np.mean(list(values)))
