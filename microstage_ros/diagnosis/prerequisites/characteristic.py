"""Force over deflection of a drive train whose flanks are hit from both sides: gap, stiffness and damping at once.

    LP[m dv/dt + F_g + c v + P] = K LP[z] + D LP[ḋ 1_c],   z = d − d₀ − sgn(d − d₀) b/2

where |d − d₀| > b/2 (1_c), else 0, with d = (r/N) θ − x from the back-EMF and the stage's reading, and one running mean
LP on both sides, so that it biases nothing. Noise stands on the left alone (two differences of the reading), the
deflection is known to nanometres. Fitted by Gauss–Newton: b, K, D, how late the stage is read against the motor, and,
where a gap is fitted, a force P that pulls on the stage all the time, over all windows of a tenth of a second in which
the force is clear both ways; each has an offset d₀ and a drift of its own, as the back-EMF walks. A stage that no flank
touches falls by P alone. Nothing is integrated, so a rattle of thousands of hits leaves no place to lose, and a soft
drive with a gap is told from either.

Source: the dead zone of a compliant drive train, M. Nordin, P.-O. Gutman, Automatica 38 (2002) 1633.
"""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.preprocessing.smoothing import triangle
from microstage_ros.diagnosis.preprocessing.transmitted_force import SIGMAS, force_noise, transmitted_force
from microstage_ros.numerics.compiled import compiled

# periods; derived: half a millisecond, a sixth of a cycle of the drive train's resonance against the stage
WIDTH = 5
# s; derived: of a walk of 25 nm per √s (1 mV of the amplifier's noise) it holds 8 nm, and some ten cycles of a rattle
WINDOW = 0.1
MOST = 100      # windows of a record; derived: a tenth of its error from a tenth of the rows
LEAST = 4       # windows in all; derived: as many as there are sizes
CLEAR_SHARE = 0.02      # of a window's rows in each direction; derived: twice the smoothing
ROUNDS = 24     # derived: a factor of thirty on the stiffness, by at most a half each, and some to settle
# relative change of the stiffness, and m of the gap, that end the search; derived: a tenth of what is stated as error
SETTLED, SETTLED_GAP = 1.0e-3, 2.0e-9
FIRST_GAP = 1.0e-6      # m, by which a gap may grow in the first step; derived: a fifth of a usual one
# of a row's stiffness squared, that keeps an offset that nothing tells; derived: rounding
RIDGE = 1.0e-9
# share of a period's neighbours in a second difference; derived: B. Numerov's x'' + T²/12 d²x''/dt², to order T⁴
NUMEROV = 1.0 / 12.0
SIZES = ("gap", "stiffness", "damping", "late")
#: And what pulls on the stage [N]: without a gap it is but an offset.
PULLED = (*SIZES, "pull")


@dataclasses.dataclass(frozen=True)
class Characteristic:
    """What fits best: ``gap`` [m] and its standard error, ``stiffness`` [N/m] with its error and ``damping`` [N s/m],
    and the force's root mean square that is left [N]; ``rows`` that count; ``pull``: P [N] with its error, 0 where it
    was not fitted."""

    gap: float
    gap_stderr: float
    stiffness: float
    stiffness_stderr: float
    damping: float
    left: float
    rows: float
    pull: float = 0.0
    pull_stderr: float = 0.0


class Windows:
    """Windows of one record in which the force on the stage is clear both ways; ``noise`` [N] of that force."""

    def __init__(self, prepared, drive):
        p = prepared
        stage, angle, period = p.stage, p.angle, p.period
        length, edge = round(WINDOW / period), 2 * WIDTH
        force = transmitted_force(stage, drive, period, WIDTH)
        self.noise = force_noise(stage, drive, period, WIDTH)
        pieces = force[: len(force) // length * length].reshape(-1, length)
        clear = [np.mean(sign * pieces > SIGMAS * self.noise, axis=1) > CLEAR_SHARE for sign in (1.0, -1.0)]
        number = np.flatnonzero(clear[0] & clear[1])
        number = number[(number > 0) & (number < len(pieces) - 1)]
        number = number[:: max(-(-len(number) // MOST), 1)]
        rows = number[:, None] * length + np.arange(-edge, length + edge)
        self.force = pieces[number]
        deflection = angle - stage
        self.deflection = deflection[rows]
        self.rate = np.gradient(triangle(deflection, WIDTH), period)[rows]
        self.speed = np.gradient(triangle(angle, WIDTH), period)[rows]
        self.time = np.linspace(-1.0, 1.0, rows.shape[1])
        self.start()

    def start(self):
        """Forget the offsets: each window's middle between its extremes, and no drift."""
        middle = 0.5 * (self.deflection.max(axis=1, initial=-np.inf) + self.deflection.min(axis=1, initial=np.inf))
        self.offset, self.drift = middle, np.zeros(len(middle))

    def __len__(self):
        return len(self.force)

    def mean(self, values):
        """What the running mean and the two differences make of ``values`` (..., rows), (..., rows of ``force``)."""
        spare = (values.shape[-1] - 2 * WIDTH - self.force.shape[1]) // 2
        flat = np.ascontiguousarray(values).reshape(-1, values.shape[-1])
        means = _means(flat, WIDTH, NUMEROV, spare, self.force.shape[1])
        return means.reshape(*values.shape[:-1], self.force.shape[1])

    def columns(self, gap, stiffness, damping, pull=0.0):
        """What is left of the force [N] (windows, rows), its derivatives by `PULLED` (windows, 5, rows), and what
        offset and drift take of both, (windows, 2, 5) and (windows, 2), and is gone from them.

        At a ``gap`` [m], ``stiffness`` [N/m], ``damping`` [N s/m] and ``pull`` [N].
        """
        deflection = self.deflection - self.offset[:, None] - self.drift[:, None] * self.time
        closed = (np.abs(deflection) > 0.5 * gap).astype(float)
        side = np.sign(deflection) * closed
        wound = deflection * closed - 0.5 * gap * side
        rate = self.rate * closed
        parts = (-stiffness * closed, -stiffness * closed * self.time,                          # of offset and drift
                 -0.5 * stiffness * side, wound, rate, -stiffness * self.speed * closed, -np.ones_like(wound),
                 stiffness * wound + damping * rate)
        means = self.mean(np.stack(parts, axis=1))
        free, derivatives = means[:, :2], means[:, 2:-1]
        left = self.force + pull - means[:, -1]
        normal = free @ free.transpose(0, 2, 1)
        inverse = np.linalg.inv(normal + RIDGE * stiffness**2 * self.force.shape[1] * np.eye(2))
        of_sizes = inverse @ (free @ derivatives.transpose(0, 2, 1))
        of_left = (inverse @ (free @ left[:, :, None]))[:, :, 0]
        derivatives = derivatives - of_sizes.transpose(0, 2, 1) @ free
        return left - (of_left[:, None] @ free)[:, 0], derivatives, of_sizes, of_left

    def follow(self, change, of_sizes, of_left):
        """Move the offsets along with a ``change`` (5,) of the sizes; the largest step [m] of them.

        ``of_sizes`` (windows, 2, 5) and ``of_left`` (windows, 2): from `columns`.
        """
        step = of_left - of_sizes @ change
        self.offset, self.drift = self.offset + step[:, 0], self.drift + step[:, 1]
        return float(np.abs(step).max())


def fit(records, drive, free=SIZES, start=None):
    """`Characteristic` of some `Windows`, or None where they tell none.

    Parameters
    ----------
    records : list of `Windows`. drive : `Drive` to start from.
    free : names of the sizes that are fitted, of `PULLED`; the gap is 0 where it is not among them and not given.
    start : `Characteristic` to start from, and to keep where a size is not fitted.
    """
    records = [record for record in records if len(record)]
    if sum(map(len, records)) < LEAST:
        return None
    for record in records:
        record.start()
    gap, stiffness, damping, pull = (start.gap, start.stiffness, start.damping, start.pull) if start else (
        0.0, drive.stiffness, drive.damping, 0.0)
    which = [PULLED.index(name) for name in free]
    for _ in range(ROUNDS):
        parts = [record.columns(gap, stiffness, damping, pull) for record in records]
        change, errors, left = _solve(parts, which)
        if change is None:
            return None
        moved = max(record.follow(change, *part[2:]) for record, part in zip(records, parts))
        factor = 1.0 + float(np.clip(change[1] / stiffness, -0.5, 1.0))
        wider = max(gap + float(np.clip(change[0], -0.5 * gap, 0.5 * gap + FIRST_GAP)), 0.0)
        settled = abs(factor - 1.0) < SETTLED and max(abs(wider - gap), moved) < SETTLED_GAP
        gap, stiffness, damping, pull = wider, stiffness * factor, damping + change[2], pull + change[-1]
        if settled:
            break
    rows = sum(record.force.size for record in records) / (2 * WIDTH - 1)
    return Characteristic(gap, errors[0], stiffness, errors[1], float(damping), left, rows,
                          float(pull), errors[-1])


def _solve(parts, which):
    """(change of `PULLED` (5,), standard errors by how windows disagree (5,), root mean square that is left [N])."""
    change, errors = np.zeros(len(PULLED)), np.zeros(len(PULLED))
    left = np.concatenate([part[0] for part in parts])
    columns = np.concatenate([part[1] for part in parts])[:, which]
    if which:
        normal = np.sum(columns @ columns.transpose(0, 2, 1), axis=0)
        scale = np.sqrt(np.diag(normal))
        if not np.all(scale > 0.0):
            return None, None, None
        inverse = np.linalg.pinv(normal / np.outer(scale, scale)) / np.outer(scale, scale)
        change[which] = inverse @ np.sum(columns @ left[:, :, None], axis=0)[:, 0]
        left = left - change[which] @ columns
        scores = (columns @ left[:, :, None])[:, :, 0]
        errors[which] = np.linalg.norm(inverse @ scores.T, axis=1)
    return change, errors, float(np.sqrt(np.mean(left**2)))


@compiled
def _means(values, width, share, spare, rows):
    """`Windows.mean` of each row of ``values``: so many ``rows`` of it, from ``spare`` on."""
    out = np.empty((len(values), rows))
    middle = np.empty(values.shape[1] - 2)
    for n in range(len(values)):
        series = values[n]
        for i in range(middle.size):
            middle[i] = share * (series[i] + series[i + 2]) + (1.0 - 2.0 * share) * series[i + 1]
        count = middle.size
        for _ in range(2):
            count -= width - 1
            for i in range(count):
                total = middle[i]
                for j in range(1, width):
                    total += middle[i + j]
                middle[i] = total / width
        for i in range(rows):
            out[n, i] = middle[spare + i]
    return out
