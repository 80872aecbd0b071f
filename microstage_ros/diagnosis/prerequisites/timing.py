"""Scatter of the encoder that grows with speed, and samples that stand twice: readings at the wrong time.

In blocks of some milliseconds: variance of (encoder − smoothed stage), by its third differences, = a + τ² v². τ is the
standard deviation of the random lateness |jitter · N(0, 1)|. A sample that was lost repeats the reading a period T
before; a share p of them adds p T² v², so τ is that of the blocks without one. The rounding of a coarse encoder is
smooth from sample to sample at some speeds and alternates at others, by the part of a count that the stage goes on in a
period: a is one number for each of some such parts.
"""

import dataclasses
import math

import numpy as np

from microstage_ros.diagnosis.preprocessing.smoothing import REST_SPEED, THIRD_DIFFERENCE

# parts of half a count, by which rounding differs; derived: its third differences go from nothing to 2.4 times their
# mean as the step goes from a whole to half a count, 0.3 of it a part
PARTS = 8
# periods; calibrated by: validation.variation --group scatter (half and double: the same answers)
BLOCK = 20
# of a block's mean square of n third differences of white noise; derived: n / (1 + 2 Σₖ (1 − k/n) ρₖ²) with their
# correlations ρ = −15/20, 6/20, −1/20
FREEDOM = BLOCK / (1.0 + 2.0 * sum((1.0 - k / BLOCK) * (r / 20.0) ** 2 for k, r in ((1, 15.0), (2, 6.0), (3, 1.0))))
# m/s: faster, smooth errors no longer drop out; derived: third differences pass (2π v T/p)³/√20 = 0.028 of an error of
# the encoder's signal period p = 10 µm at T = 0.1 ms, of the largest drawn (50 nm) an eighth of the reading's noise, of
# its variance a sixtieth
MOST_SPEED = 8.0e-3
# share of repeated samples; calibrated by: validation.margins (8e-5 to 1.6e-3)
LEAST_LOST = 5.0e-4
# standard deviations of two readings' difference; derived: a reading that steps back so far comes once in 700
STEP_BACK = 3.0
# of a block's speed, by which it may change within the block; calibrated by: test/diagnosis/prerequisites/
# test_timing.py (a third of it and three times it: the same jitter of 41 µs within 2 %, and none where none is, on
# programmes that hardly ever go at one speed)
STEADY = 0.3
# of the mean floor, below which no scatter counts more; derived: what rounding alone leaves in the quietest of `PARTS`
LEAST_FLOOR = 0.11
# of the lost samples, that the held-out records must show; derived: of the 50 that `LEAST_LOST` makes of 10⁵ rows a
# third is five standard errors less
LOST_AGAIN = 0.3
# of |N(0, 1)|: its mean and its standard deviation; source: the half-normal distribution
HALF_MEAN, HALF_SPREAD = math.sqrt(2.0 / math.pi), math.sqrt(1.0 - 2.0 / math.pi)
CLEAR = 6.0              # standard errors of a jitter's variance; derived: a chance of 10⁻⁹
TINY = 1.0e-12           # of a matrix's trace; derived: far below its entries, far above their rounding
LEAST_SCATTER = 1.0      # of the floor, at the fastest: an encoder without noise rounds differently at every speed


@dataclasses.dataclass(frozen=True)
class Timing:
    """Variance τ² of the random lateness [s²] with standard error, share of lost samples, and χ² that scatter which
    grows with speed explains; ``floor`` variance at rest, at least that of the encoder's rounding [m²], ``fastest``
    speed that was looked at [m/s]; ``samples`` among which lost ones were counted; mean square of scatter [m²] and of
    speed [m²/s²] over all blocks; ``growth``: τ² and what the lost samples add to it [s²], None where none was lost;
    ``chance`` share of samples that repeat the one before by the jitter's chance, and are not lost."""

    variance: float
    stderr: float
    lost: float
    gain: float
    floor: float
    fastest: float
    samples: int = 1
    mean_square: float = 0.0
    mean_speed_square: float = 0.0
    growth: float | None = None
    chance: float = 0.0

    def left(self, variance):
        """Mean square scatter of the encoder [m²] on these records when a growth of this variance [s²] is taken out."""
        return max(self.mean_square - variance * self.mean_speed_square, 0.0)

    @property
    def grown(self):
        """Growth of the scatter with the square of the speed, of jitter and lost samples together [s²]."""
        return max(self.variance if self.growth is None else self.growth, 0.0)

    @property
    def lost_stderr(self):
        """Standard error of the share of lost samples [1]: binomial, with one more lost than seen (Agresti's half), and
        with those that repeat by chance."""
        share = ((self.lost + self.chance) * self.samples + 0.5) / (self.samples + 1.0)
        return float(np.sqrt(share * (1.0 - share) / self.samples))

    @property
    def jitter(self):
        """τ [s]."""
        return float(np.sqrt(max(self.variance, 0.0)))

    @property
    def significance(self):
        """Standard errors [1] that the variance lies above zero."""
        return self.variance / self.stderr


def timing_of(prepared, sde=None):
    """`Timing` of some prepared records together, the encoder's sub-divisional error ``sde`` (effect entry) taken
    out."""
    spreads, speeds, parts, clean, rounding = [], [], [], [], 0.0
    repeated = samples = missing = rows = 0
    chances = []
    for p in prepared:
        place = _place(p)
        error = p.encoder - place - _subdivisional(place, sde or {})
        # third differences: what is smooth from sample to sample drops out
        rough = np.diff(error, 3) / np.sqrt(THIRD_DIFFERENCE)
        used = len(rough) // BLOCK * BLOCK
        speed = np.abs(p.speed[:used].reshape(-1, BLOCK))
        mean = np.sqrt((speed**2).mean(axis=1))
        good = (np.ptp(speed, axis=1) < STEADY * mean + REST_SPEED) & (mean > REST_SPEED) & (mean < MOST_SPEED)
        spreads.append((rough[:used].reshape(-1, BLOCK) ** 2).mean(axis=1)[good])
        speeds.append(mean[good])
        parts.append(_part_of_count(speeds[-1] * p.period, p.count))
        rounding = max(rounding, (0.5 * p.count) ** 2 / 3.0)     # uniform within half a count
        same = p.repeated[1:] & (p.current[1:] != 0.0)
        # behind a gap the motor moves while the stage, and its encoder, stand
        moving = np.minimum(np.abs(p.speed), np.abs(p.stage_speed))[1:] > repeat_speed(
            p.count, float(np.sqrt(np.median(spreads[-1]))) if len(spreads[-1]) else 0.0, p.period
        )
        repeated, samples = repeated + int((same & moving).sum()), samples + int(moving.sum())
        alike = np.mean(p.current[1:][moving] == p.current[:-1][moving]) if moving.any() else 0.0
        chances.append((alike * p.count, np.abs(p.speed)[1:][moving], p.period))
        missing, rows = missing + int(p.lost.sum()), rows + len(p.lost)
        # a slow encoder may repeat itself by chance, too
        clean.append(~_touched(np.append(False, same) | p.lost, len(rough))[good])
    lost = repeated / max(samples, 1) + missing / max(rows, 1)
    spread, square, part = np.concatenate(spreads), np.concatenate(speeds) ** 2, np.concatenate(parts)
    if not _enough(square):
        return Timing(0.0, math.inf, lost, 0.0, 0.0, 0.0, max(samples, 1))
    floors, growth, stderr = _fitted(spread, square, part)
    explained = float(max(growth, 0.0) * (square / floors[part]).sum() * FREEDOM)
    all_blocks = Timing(growth, stderr, lost, explained, max(float(floors[part].mean()), rounding),
                        float(np.sqrt(square.max())), max(samples, 1), float(spread.mean()), float(square.mean()))
    without = np.concatenate(clean)
    if without.all() or lost == 0.0:
        return all_blocks
    jitter = 0.0, math.inf
    if _enough(square[without]):
        jitter = _fitted(spread[without], square[without], part[without])[1:]
    timing = dataclasses.replace(all_blocks, variance=jitter[0], stderr=jitter[1], growth=growth)
    if timing.significance < CLEAR:
        return timing
    chance = sum(float(_by_chance(timing.jitter / HALF_SPREAD, *one).sum()) for one in chances) / max(samples, 1)
    return dataclasses.replace(timing, lost=max(lost - chance, 0.0), chance=chance)


def _by_chance(jitter, count, speed, period):
    """Chance (n,) [1] that a reading repeats the one before because it came ``period`` T [s] less late.

    The latenesses differ by |a| − |b| of two Gaussians of ``jitter`` σ [s], of density e^(−T²/4σ²) erfc(T/2σ)/(σ√π) at
    T, and the readings are alike within a ``count`` [m] at ``speed`` (n,) [m/s]; the count times the share of rows in
    which the current is alike, too."""
    ratio = period / (2.0 * jitter)
    return count / speed * math.exp(-(ratio**2)) * math.erfc(ratio) / (jitter * math.sqrt(math.pi))


def _enough(square):
    """Whether blocks of these squares of speed (n,) [m²/s²] tell jitter from noise: one speed alone cannot."""
    # derived: from a hundred values a variance is known to √(2/100) = 14 %
    return len(square) >= 100 and not np.isclose(square.min(), square.max())


def _touched(marked, count):
    """Which blocks of `BLOCK` third differences, ``count`` in all, hold a ``marked`` sample (n,)."""
    # derived: a third difference is one of four samples
    near = np.convolve(marked, np.ones(4), "full")[3:3 + count] > 0.0
    return near[:count // BLOCK * BLOCK].reshape(-1, BLOCK).any(axis=1)


def _fitted(level, square, part):
    """Floors of all parts (`PARTS`,) [m²], slope over the ``square`` of the speed [s²], and its standard error [s²].

    ``level``: scatters (n,) [m²]. ``square``: of their speeds, (n,) [m²/s²]. ``part``: which floor each has, (n,).
    Parts without a block have the mean floor.
    """
    usual, scale = float(np.median(level)), float(square.mean())
    level, square = level / usual, square / scale
    visited, own = np.unique(part, return_inverse=True)
    design = np.column_stack([own[:, None] == np.arange(len(visited)), square])
    weight = np.ones(len(level))
    for _ in range(3):
        normal = design.T @ (design * weight[:, None])
        inner = np.linalg.inv(normal + TINY * np.trace(normal) * np.eye(len(normal)))
        sizes = inner @ (design.T @ (level * weight))
        model = design @ np.append(sizes[:-1], max(sizes[-1], 0.0))
        weight = 1.0 / np.maximum(model, LEAST_FLOOR * np.abs(sizes[:-1]).mean()) ** 2
    floors = np.full(PARTS, sizes[:-1][own].mean())
    floors[visited] = sizes[:-1]
    return floors * usual, float(sizes[-1]) * usual / scale, math.sqrt(inner[-1, -1] * 2.0 / FREEDOM) * usual / scale


def _part_of_count(step, count):
    """Which of `PARTS` each ``step`` (n,) [m] in a period belongs to, by its distance from whole counts [m], of half a
    ``count`` [m]; the first where the encoder shows no count."""
    if count == 0.0:
        return np.zeros(len(step), int)
    away = np.abs(step / count - np.round(step / count))
    return np.minimum((2.0 * PARTS * away).astype(int), PARTS - 1)


def _place(prepared):
    """Where the stage is [m], (n,), to within what is smooth from sample to sample.

    Behind a gap the replayed stage is rough where it meets a flank, the faster the rougher, and is no yardstick for a
    reading; another reading is.
    """
    behind_gap = prepared.behind is not None and prepared.interferometer is not None
    return prepared.interferometer if behind_gap else prepared.stage_position


def repeat_speed(count, noise, period):
    """Speed [m/s] above which no reading repeats the one before by chance, be the current the same or not.

    The stage goes a whole count [m] and `STEP_BACK` standard deviations √2 ``noise`` [m] of two readings' difference in
    a ``period`` [s]: slower, a coarse encoder stands still although the stage moves.
    """
    return (count + STEP_BACK * math.sqrt(2.0) * noise) / period


def _subdivisional(position, sde):
    """Error of an encoder, as `model.effects` has it: Σ amplitude_n sin(2π n x / period + phase_n), same shape as
    position."""
    error = np.zeros(len(position))
    for n in (1, 2, 3):
        if sde.get(f"amplitude{n}_m"):
            error += sde[f"amplitude{n}_m"] * np.sin(
                2.0 * np.pi * n * position / sde["period_m"] + sde[f"phase{n}_rad"]
            )
    return error


def with_scatter(collection, evidences, sde=None):
    """`Evidences` whose position channel knows the noise of readings at random times and of lost ones, τ² v² and p T²
    v², where these stand out; the very same ``evidences`` else. ``sde``: as in `timing_of`."""
    learn, held, base = (collection.prepared[group] for group in ("learn", "held", "base"))
    late = readings_late(learn, held, base, sde)
    if late is None:
        return evidences
    tables = {group: dict(getattr(evidences, group)) for group in ("learn", "held")}
    forms = [form for form in evidences.forms if form.channel == "position"]
    for group, how in (("learn", collection.gather), ("held", collection.growing)):
        for channels in collection.channels[group]:
            channels["position"].growth = late[0].grown
        tables[group]["position"] = how("position", forms, group)
    return evidences.with_tables(tables["learn"], tables["held"])


def readings_late(learn, held, base, sde=None):
    """(`Timing` of the learning records, of the held-out ones) if jitter or lost samples stand out, else None.

    Where lost samples alone stand out, the variance of the learning records' lateness is set to zero."""
    taught, again = timing_of(learn, sde), timing_of(held, sde)
    healthy = timing_of(base) if base else None
    # a coarse encoder's rounding differs from speed to speed, and makes it seem of either sign
    usual = abs(healthy.variance) if healthy else 0.0
    usual_lost = healthy.lost if healthy else 0.0
    scattered = (taught.significance > CLEAR and again.significance > 2.0 and taught.variance > 2.0**2 * usual
                 and taught.jitter * taught.fastest > np.sqrt(LEAST_SCATTER * taught.floor))
    lost = taught.lost > LEAST_LOST + 3.0 * usual_lost and again.lost > LOST_AGAIN * taught.lost
    if not (scattered or lost):
        return None
    return (taught if scattered else dataclasses.replace(taught, variance=0.0, growth=taught.grown)), again
