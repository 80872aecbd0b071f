"""Torque balance at the motor shaft, in means over blocks of some milliseconds.

    residual = k_M i − J dω/dt − M_f − (r/N) (F_g + c_g v + m dv/dt)          [N m]

with the frictions of the nominal model replayed on the measured motion. What the amplifier and the
winding do cannot enter: the current was measured. Noise: random friction (its two processes, scaled
by the nominal friction), what is not known of the state while blocks stick, and a white part that
follows the local scatter.
"""

import dataclasses
import functools
import math

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import minimize
from scipy.signal import upfirdn

from microstage_ros.diagnosis.preprocessing.friction_replay import replayed_force
from microstage_ros.diagnosis.preprocessing.motion import load_kernel
from microstage_ros.diagnosis.preprocessing.preparation import MOTOR_NOISE
from microstage_ros.diagnosis.preprocessing.smoothing import MEDIAN_SIZE
from microstage_ros.diagnosis.preprocessing.whitening import whiten_states
from microstage_ros.numerics.compiled import compiled

# periods; derived: the smoothed load is 1/Σw² = 18 periods wide (`motion.load_kernel` of the shipped axis): shorter
# blocks would read one load twice; and the next number that `friction.COARSE` divides
BLOCK = 20
# s, m: how long an unknown pre-sliding state is remembered; calibrated by: validation.variation --group sticking (half
# and double: the same answers)
STUCK_TIME, STUCK_TRAVEL = 0.5, 3.0e-6
# m: until then the record's unknown first friction state counts; calibrated by: validation.variation --group settling
# (half and double: the same answers)
SETTLING_TRAVEL = 8.0e-6
# m between the furthest places, within which what is left of that state is one torque; derived: each is four times the
# one before
FIRST_SPANS = (SETTLING_TRAVEL / 64.0, SETTLING_TRAVEL / 16.0, SETTLING_TRAVEL / 4.0, SETTLING_TRAVEL)
# m of travel in a block, below which the stage is not said to move; calibrated by: validation.variation --group white
# (half and double: the same answers)
LEAST_STEP = 5.0e-9
LOCAL = 101             # blocks over which the scatter is a median; calibrated by: the same
NEAR = 21               # blocks over which the scatter is a mean square; calibrated by: the same
MOST_SCATTER = 6.0      # medians that one block counts at most there; calibrated by: the same
# of the contact's static limit that the unknown state of sticking blocks leaves open; calibrated by: `fit_spreads` on
# healthy records of the shipped axis, 15 of 219 µN m; it measures it wherever a baseline is given
STUCK_SHARE = 0.07
# random friction of an axis file that states none: no friction repeats better than to a hundredth; source: EMPS, a real
# axis whose force differs by 0.34 N of 20 N between repetitions (docs/evidence/emps.md), the readings' noise included
LEAST_RELATIVE = 0.01
FURTHEST = 5.0  # standard deviations that a row counts at most; derived: noise comes so far once in 2·10⁶ rows
# standard deviations of the logarithms (of the odds, for the share) about the axis file's figures; derived: ln 2, as a
# figure of one significant digit is uncertain by a factor of two, and ln 10 for the time, which nobody has measured
PRIOR = {"relative": 0.7, "stuck": 0.7, "travel_length": 0.7, "share": 1.0, "time_length": 2.3}


class Mechanical:
    """Residual of one record in blocks, with the signals that candidates build their columns from.

    Attributes (all shape (blocks,)): ``residual`` [N m], ``time``, ``position``, ``speed`` (the motor's, as travel of
    the stage, SI), ``place`` (the stage's own position [m], by which friction varies),
    ``friction`` (nominal actuator friction without viscosity), ``guideway`` and ``inertial`` (force of the
    stage's mass) [N m at the shaft],
    ``stuck``, ``span`` (distance between the furthest places so far [m]), ``torque`` (k_M i − J dω/dt), ``own`` (what
    the healthy axis's friction is beyond the model's, zero until it is taken out), ``random`` (standard deviation of
    the friction that varies along the stroke, over `Spreads`' [1]; one until `healthy.rescale_random_friction`).
    ``kept`` {name: array}: what several candidates need.
    """

    name, unit = "torque", "N m"
    random = 1.0

    def __init__(self, prepared, drive):
        self.prepared, self.drive, self._coarse, self.kept = prepared, drive, {}, {}
        p = prepared
        self.time, self.position, self.speed, self.torque = (
            _means(v, BLOCK) for v in (p.time, p.position, p.speed, p.load)
        )
        self.place = _means(p.stage_position, BLOCK)
        guideway = drive.lever * (p.guideway + drive.guideway.viscous * p.stage_speed)
        viscous = drive.actuator.viscous * p.speed / drive.radius
        inertial = drive.lever * drive.mass * np.gradient(p.stage_speed, p.period)
        forces = self.mean(np.stack([p.actuator, viscous, guideway, inertial], axis=1))
        self.residual = self.torque - forces.sum(axis=1)
        self._stays = _stays(self.position)
        _, self.viscous, self.guideway, self.inertial = forces.T
        self.friction, self.stuck = self.calm(np.stack([forces[:, 0], self.mean(p.stuck)], axis=1)).T
        self.own = np.zeros(len(self.residual))
        step = np.abs(np.diff(self.position, prepend=self.position[0]))
        self.step = np.where(step > LEAST_STEP, step, 0.0)
        self.span = span_of(self.position)
        self.white = self._white()

    def take_out(self, torque):
        """Take a torque (blocks,) [N m] that the healthy axis shows, too, out of the residual."""
        self.residual = self.residual - torque
        self.own = self.own + torque
        self.white = self._white()

    def nuisance(self):
        """Columns (blocks, k) that are free: what the contacts held at the record's first row [1], `first_state`, and
        behind a gap a torque [N m per period] by which the stage's force comes late: at every hit it turns by some ten
        times the friction; half a period of it is a matter of stamps, and would be friction.
        """
        drive, p = self.drive, self.prepared
        held = first_state(self.span)
        if p.closed is not None:
            late = self.mean(drive.lever * drive.mass * np.gradient(np.gradient(p.stage_speed)) / p.period)
            held = np.column_stack([held, late])
        return held

    def mean(self, values, coarse=1):
        """Block means of a torque, ``values`` (n,) or (n, k), with one row per ``coarse`` periods, as `Prepared.load`
        would show it.

        The load is smoothed over some milliseconds (`motion.load_kernel`); so is what it is compared with.
        """
        block = BLOCK // coarse
        rows = len(self.prepared.time) // BLOCK * block
        weights = _weights(self.drive, self.prepared.period, coarse)
        reach = (len(weights) - block) // 2
        lead = -(len(weights) - 1) % block  # so that the filter's outputs fall on the blocks
        edges = ((reach + lead, reach), *((0, 0),) * (values.ndim - 1))
        out = upfirdn(weights, np.pad(values[:rows], edges, mode="edge"), down=block, axis=0)
        first = (lead + len(weights) - 1) // block
        return out[first:first + rows // block]

    def calm(self, columns):
        """``columns`` (blocks, k) with their mean as long as the motor stays within `LEAST_STEP` of a place.

        At rest a replayed friction has the reading's noise, and so has the residual, with the other sign: a friction
        in proportion to it would seem to be there, and to change sign at the next reversal.
        """
        counts = np.diff(np.append(self._stays, len(columns)))
        return np.repeat(np.add.reduceat(columns, self._stays, axis=0) / counts[:, None], counts, axis=0)

    def coarse_friction(self, coarse):
        """Nominal actuator friction replayed with one step per ``coarse`` [1] periods (kept, many candidates need
        it)."""
        if coarse not in self._coarse:
            speed = self.prepared.contact_speed[::coarse] / self.drive.radius
            self._coarse[coarse] = replayed_force(self.drive.actuator, speed, coarse * self.prepared.period)
        return self._coarse[coarse]

    def _white(self):
        """Variance of each block's white part: local scatter of block to block, and the unknown first state."""
        change = np.diff(self.residual, prepend=self.residual[0])
        static = self.drive.actuator.static
        scatter = np.minimum(np.abs(change), 2.0 * static)      # no friction changes by more than from limit to limit
        local = median_filter(scatter, LOCAL, mode="nearest") / MEDIAN_SIZE / np.sqrt(2.0)
        smooth = (
            np.convolve(np.pad(np.minimum(scatter, MOST_SCATTER * local), NEAR // 2, mode="edge") ** 2,
                        np.ones(NEAR) / NEAR, "valid") / 2
        )
        # derived: a divisor, never nothing: (1 µN m)²
        white = np.maximum(local**2, smooth) + (1.0e-6) ** 2
        return white + (static / math.sqrt(3.0) * remembered(self.span)) ** 2      # anywhere between the limits

    def whiten(self, matrix, spreads=None):
        """Unit-variance innovations of ``matrix`` (blocks, k), and Σ ln S; ``spreads``: `Spreads`, those of the axis
        file by default."""
        spreads = spreads or stated_spreads(self.drive)
        period = BLOCK * self.prepared.period
        ahead = np.append(self.step[1:], 0.0)
        keeps = np.stack([
            np.exp(-ahead / spreads.travel_length), np.full(len(ahead), np.exp(-period / spreads.time_length)),
            np.exp(-period / STUCK_TIME - ahead / STUCK_TRAVEL),
        ], axis=1)
        gains = np.stack([self.friction * self.random, self.friction, self.stuck], axis=1)
        return whiten_states(matrix, gains, keeps, spreads.deviations, self.white)


@dataclasses.dataclass(frozen=True)
class Spreads:
    """Random friction as the whitening knows it: relative standard deviation, its share of variance with travel,
    lengths [m, s]; ``stuck`` [N m]: standard deviation of the state of sticking blocks."""

    relative: float
    share: float
    travel_length: float
    time_length: float
    stuck: float

    @property
    def deviations(self):
        """Standard deviations of the three processes: with travel, with time [1], of the sticking state [N m]."""
        return (self.relative * math.sqrt(self.share), self.relative * math.sqrt(1.0 - self.share), self.stuck)


def stated_spreads(drive):
    """`Spreads` by the axis file."""
    v = drive.variability
    return Spreads(
        max(v.relative, LEAST_RELATIVE),
        # derived: the logarithm of the odds, which is fitted, stays within ±3
        min(max(v.travel_share, 0.05), 0.95),
        v.travel_length,
        v.time_length,
        STUCK_SHARE * drive.actuator.static,
    )


@compiled
def _stays(position):
    """Rows (k,) in which the motor first is further than `LEAST_STEP` from where it was in the one before; the first is
    0."""
    starts = np.zeros(position.size, np.int64)
    count = 1
    for k in range(1, position.size):
        if abs(position[k] - position[starts[count - 1]]) > LEAST_STEP:
            starts[count] = k
            count += 1
    return starts[:count]


def span_of(position):
    """Distance between the furthest places so far [m], shape as ``position`` (n,) [m]: a state that is not known is
    forgotten by going away from it, not by going to and fro about it."""
    return np.maximum.accumulate(position) - np.minimum.accumulate(position)


def remembered(span):
    """Share [1] of the contacts' first state that is not forgotten at a ``span`` (n,) [m], same shape."""
    return np.exp(-np.maximum(span / SETTLING_TRAVEL - 2.0, 0.0) * 3.0)


def first_state(span):
    """Columns (n, k) [1] by which it shows at a ``span`` (n,) [m]: what is left of it stands still while the stage goes
    to and fro where it has been, so one for each of `FIRST_SPANS`."""
    level, left = np.digitize(span, FIRST_SPANS), remembered(span)
    return np.column_stack([np.where(level == k, left, 0.0) for k in np.unique(level)])


def _means(values, block):
    """Means over blocks of so many periods of a signal (n,)."""
    rows = len(values) // block * block
    return values[:rows].reshape(-1, block).mean(axis=1)


# derived: memory alone, no result depends on it
@functools.lru_cache(maxsize=64)
def _weights(drive, period, coarse):
    """Symmetric weights of the rows around a block in its mean as the smoothed load shows it; sum 1."""
    kernel = load_kernel(drive, period, MOTOR_NOISE)
    reach = len(kernel) // 2 // coarse
    bins = np.round(np.arange(-(len(kernel) // 2), len(kernel) // 2 + 1) / coarse).astype(int)
    rows = np.bincount(np.clip(bins, -reach, reach) + reach, weights=kernel)
    return np.convolve(rows, np.ones(BLOCK // coarse) * coarse / BLOCK)


def fit_spreads(channels):
    """`Spreads` that healthy channels show, by maximum a posteriori about the axis file's figures.

    Size, share, lengths and sticking state are fitted. A time length far beyond the record's is the prior's. One far
    shorter than the file's must not stay there: what changes within a second would then be taken for the start of
    changes of tens of per cent in twenty, and a friction that is another by a fifth for nothing.
    """
    stated = stated_spreads(channels[0].drive)
    middle = np.array([math.log(stated.relative), math.log(stated.stuck), math.log(stated.travel_length),
                       math.log(stated.share / (1.0 - stated.share)), math.log(stated.time_length)])
    spread = np.array([PRIOR[name] for name in ("relative", "stuck", "travel_length", "share", "time_length")])

    # along the last coordinate the size grows with the root of the time: the change from block to block stays the same
    def sized(point):
        return point + np.array([0.5 * (point[-1] - middle[-1]), *np.zeros(len(point) - 1)])

    def at(point):
        relative, stuck, length, odds, time = map(float, np.exp(sized(point)))
        return Spreads(relative, odds / (1.0 + odds), length, time, stuck)

    def cost(point):
        total = 0.0
        for channel in channels:
            out, determinant = channel.whiten(channel.residual[:, None], at(point))
            total += np.minimum(out[:, 0] ** 2, FURTHEST**2).sum() + determinant
        return total + float((((sized(point) - middle) / spread) ** 2).sum())

    # derived: the first steps, of the spreads' own size
    simplex = np.concatenate([middle[None], middle + np.diag([0.5, 0.5, 0.4, 0.6, -1.0])])
    # derived: a twentieth of the smallest spread, half of what one standard error costs, fifty steps each
    options = {"xatol": 0.03, "fatol": 0.5, "maxiter": 240, "initial_simplex": simplex}
    best = minimize(cost, middle, method="Nelder-Mead", options=options)
    return at(best.x)
