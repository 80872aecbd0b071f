"""Residual channels of a log: what the signals allow, each with the healthy model that its baseline gives.

effort   force, torque, current or voltage:  y = c + F sgn v + B v + M a + k x (+ a level of its own at rest)
error    following error (or speed error):   the same form in metres through the loop: a force passes a low-pass, and
         where the loop has an integrator a high-pass (E/F = s / ((s + 1/T1)(s + 1/T2)) for P position with PI speed),
         fitted to the baseline
voltage  u − R i − K v, where voltage and current are both there

A magnitude |y| is that of a signed effort whose sign is the direction of motion (friction outweighs the constant
force): its columns are the signed ones times the direction. `sign_is_open` tells where that cannot be decided.
"""

import dataclasses

import numpy as np
from scipy.signal import lfilter

from microstage_ros.diagnosis.logs.preprocessing.motion import Motion, smooth
from microstage_ros.records.logs.log import Log

BRAKE = 3               # index of braking in `motion.STATES`
SIGN_ROUNDS = 4         # of sign and fit in turn
SIGN_GAIN = 0.8         # of the mean square with the direction as sign, below which the signed effort is believed
FLUCTUATION = "fluctuation"     # kind of the channel of a position without set point: only its roughness tells
RIDGE = 1e-3            # of the columns' mean squares: numerical, keeps collinear columns small
FAINT = 1e-9            # the same for u = R i + K v, where a ridge would shift one size into the other
MOST_ROWS = 200_000     # rows that a healthy model is fitted to
TRIED_ROWS = 60_000     # rows at the beginnings of all logs, with which time constants are tried
LEAST_TRIED = 5_000     # of one log
MEMORIES = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)   # s, time constants of the loop's integrator that are tried
LAGS = (0.0, 0.007, 0.02, 0.05, 0.1)   # s, time constants of the loop's low-pass that are tried
FIRST_LAG = 0.02         # s, while the integrator's is looked for
LEAST_LEVEL = 0.1       # of the moving rms: the smallest scale that changes are judged against


@dataclasses.dataclass
class Rows:
    """One log with its motion and the number of the repetition of every row; ``condition``: global code per row."""

    log: Log
    motion: Motion
    repetition: np.ndarray
    condition: np.ndarray
    group: int


@dataclasses.dataclass
class Channel:
    """One residual channel.

    ``name`` effort, error or voltage; ``unit``; ``signed``. ``models``: condition code → coefficients of
    `base_columns`; ``scale``: condition code → size in ``unit`` that changes are judged against (the friction level;
    the error's rms); ``stderr``: condition code → standard errors. ``kind``: the quantity. ``memory``, ``lag``: time
    constants of the error's high-pass and low-pass [s].
    ``signs``: condition code → (constant, level, viscous, inertia) of the signed effort behind a magnitude.
    """

    name: str
    kind: str
    unit: str
    signed: bool
    models: dict = dataclasses.field(default_factory=dict)
    stderr: dict = dataclasses.field(default_factory=dict)
    scale: dict = dataclasses.field(default_factory=dict)
    memory: float = 0.1
    lag: float = 0.0
    signs: dict = dataclasses.field(default_factory=dict)

    def values(self, rows):
        """Signal of this channel for the rows of a log, shape (n,); NaN where there is none."""
        signals = rows.log.signals
        if self.name == "effort":
            return signals[self.kind]
        if self.name == "voltage":
            return signals["voltage"]
        if self.kind == "following_error":
            return signals["following_error"]
        if self.kind == FLUCTUATION:
            return signals["position"] - smooth(signals["position"], rows.log)
        return signals["reference_velocity"] - signals["velocity"]

    def orientation(self, rows):
        """What turns a signed column into this channel's, shape (n,): 1, or for a magnitude the sign of the effort
        behind it (1 at rest).

        That is the direction of motion, but where braking needs more than friction gives.
        """
        m = rows.motion
        if self.signed:
            return np.ones(len(rows.log))
        out = np.where(m.direction == 0.0, 1.0, m.direction)
        for code, (constant, level, viscous, inertia) in self.signs.items():
            own = (rows.condition == code) & (m.direction != 0.0)
            effort = constant + level * m.direction[own] + viscous * m.speed[own] + inertia * m.acceleration[own]
            out[own] = np.where(effort >= 0.0, 1.0, -1.0)
        return out

    def predicted(self, rows):
        """The healthy model's value, shape (n,)."""
        columns = base_columns(self, rows)
        out = np.zeros(len(rows.log))
        for code, coefficients in self.models.items():
            own = rows.condition == code
            if own.all():
                return columns @ coefficients
            out[own] = columns[own] @ coefficients
        return out


def channels_of(log):
    """The channels that the signals of a log allow."""
    found = []
    if log.effort:
        found.append(Channel("effort", log.effort, log.effort_unit, log.signed))
    if "following_error" in log.signals:
        found.append(Channel("error", "following_error", log.place_unit, True))
    elif "reference_velocity" in log.signals and "velocity" in log.signals:
        found.append(Channel("error", "velocity_error", f"{log.place_unit}/s", True))
    elif "position" in log.signals and log.effort:
        found.append(Channel("error", FLUCTUATION, log.place_unit, True))
    if "voltage" in log.signals and "current" in log.signals and log.effort != "voltage":
        found.append(Channel("voltage", "voltage", "V", True))
    return found


def base_names(channel):
    """Names of the healthy model's coefficients."""
    if channel.name == "voltage":
        return ("constant", "resistance", "per speed")
    names = ("constant", "level", "viscous", "inertia", "spring", "rest", "rest after motion")
    return (*names, "level transient", "viscous transient", "inertia transient") if channel.name == "error" else names


def base_columns(channel, rows):
    """Columns of the healthy model, shape (n, k); see `base_names`."""
    m = rows.motion
    if channel.name == "voltage":
        current = np.nan_to_num(rows.log.signals["current"])
        return np.stack([np.ones(len(current)), current, m.speed], axis=1)
    still = (m.direction == 0.0).astype(float)
    moving = 1.0 - still
    x = m.x if m.absolute else np.zeros(len(m.x))
    forced = [m.direction, m.speed * moving, m.acceleration * moving]
    if channel.name == "error":
        forced = [low_pass(force, channel.lag, rows.log.period) for force in forced]
    columns = [moving, *forced, x * moving, still, still * m.last]
    if channel.name == "error":
        columns += [high_pass(force, channel.memory, rows.log.period) for force in forced]
    if not channel.signed:
        turned = channel.orientation(rows)
        columns = [column * turned for column in columns]
    return np.stack(columns).T           # by columns in memory: a log may have millions of rows


def high_pass(values, memory, period):
    """First-order high-pass of ``values`` (n,) at a ``period`` [s], settled at the first one: what an integrator of
    time constant ``memory`` [s] leaves of it."""
    share = memory / (memory + period)
    return lfilter([share, -share], [1.0, -share], values - values[0])


def low_pass(values, lag, period):
    """First-order low-pass of ``values`` (n,) at a ``period`` [s], of time constant ``lag`` [s], at rest at the
    first."""
    if lag <= 0.0:
        return values
    share = period / (lag + period)
    return lfilter([share], [1.0, share - 1.0], values, zi=[(1.0 - share) * values[0]])[0]


def through_loop(channel, rows, force):
    """What a force of the baseline's friction level times ``force`` (n,) makes of the error, in the channel's unit,
    shape (n,)."""
    models = np.array(
        [channel.models.get(int(c), np.zeros(len(base_names(channel)))) for c in range(int(rows.condition.max()) + 1)]
    )
    own = models[np.maximum(rows.condition, 0)]
    passed = low_pass(force, channel.lag, rows.log.period)
    return own[:, 1] * passed + own[:, 7] * high_pass(passed, channel.memory, rows.log.period)


def fit_models(channel, baseline):
    """Fit the healthy model per condition to the baseline; fills ``models``, ``stderr``, ``scale`` and the error's
    ``memory``."""
    if channel.name == "error" and channel.kind != FLUCTUATION:
        channel.lag, part = (
            FIRST_LAG,
            [beginning(rows, max(TRIED_ROWS // len(baseline), LEAST_TRIED)) for rows in baseline],
        )
        channel.memory = min(MEMORIES, key=lambda memory: _left(channel, part, memory=memory))
        channel.lag = min(LAGS, key=lambda lag: _left(channel, part, lag=lag))
    if channel.name == "effort" and not channel.signed:
        channel.signs = _signs(channel, baseline)
    _fit(channel, baseline)


def beginning(rows, count):
    """The first ``count`` [1] rows of a log, as a log of their own."""
    if len(rows.log) <= count:
        return rows
    cut = {name: values[:count] for name, values in vars(rows.motion).items() if isinstance(values, np.ndarray)}
    motion = dataclasses.replace(rows.motion, **cut)
    return Rows(rows.log.rows(slice(0, count)), motion, rows.repetition[:count], rows.condition[:count], rows.group)


def _left(channel, baseline, **constants):
    """Mean square that a fit with other time constants leaves."""
    for name, value in constants.items():
        setattr(channel, name, value)
    return _fit(channel, baseline)


def _signs(channel, baseline):
    """Signed effort behind a magnitude, per condition, where it fits the baseline better than the direction of motion
    does."""
    found = {}
    for code in sorted({int(c) for rows in baseline for c in np.unique(rows.condition) if c >= 0}):
        parts = [
            (
                np.stack(
                    [np.ones(len(rows.log)), rows.motion.direction, rows.motion.speed, rows.motion.acceleration], axis=1
                )[own],
                channel.values(rows)[own],
                rows.motion.state[own],
            )
            for rows in baseline
            for own in [(rows.condition == code) & (rows.motion.direction != 0.0)]
            if own.any()
        ]
        columns, y, state = (np.concatenate([p[k] for p in parts]) for k in range(3))
        good = np.isfinite(y)
        step = max(1, int(good.sum() // MOST_ROWS))
        columns, y, state = columns[good][::step], y[good][::step], state[good][::step]
        pushing = state != BRAKE
        if pushing.sum() < 20 or (~pushing).sum() < 10:
            continue
        scaled = columns / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
        fit = lambda turned, rows_used: np.linalg.lstsq(
            (scaled * turned[:, None])[rows_used], y[rows_used], rcond=None
        )[0]
        turned = columns[:, 1].copy()
        plain = float(np.mean((y - scaled @ fit(turned, slice(None)) * turned) ** 2))
        beta = fit(turned, pushing)
        for _ in range(SIGN_ROUNDS):
            turned = np.where(scaled @ beta >= 0.0, 1.0, -1.0)
            beta = fit(turned, slice(None))
        if float(np.mean((y - scaled @ beta * turned) ** 2)) < SIGN_GAIN * plain:
            found[code] = tuple(beta / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300))
    return found


def _fit(channel, baseline):
    """One fit; returns the mean square that is left over all conditions."""
    total = 0.0
    codes = sorted({int(c) for rows in baseline for c in np.unique(rows.condition) if c >= 0})
    for code in codes:
        columns, y, direction, shifted = _fitted_rows(channel, baseline, code)
        size = np.sqrt(np.mean(columns**2, axis=0))
        used = np.where(size > 0.0, size, 1.0)
        scaled = columns / used
        gram = scaled.T @ scaled + (FAINT if channel.name == "voltage" else RIDGE) * len(y) * np.eye(len(used))
        beta = np.linalg.solve(gram, scaled.T @ y)
        left = y - scaled @ beta
        total += float(np.mean(left**2))
        covariance = np.linalg.inv(gram) * max(np.var(left), 1e-300)
        channel.models[code] = np.where(size > 0.0, beta / used, 0.0)
        channel.stderr[code] = np.sqrt(np.diag(covariance)) / used
        channel.scale[code] = _scale(channel, channel.models[code], y, direction, shifted, columns)
    return total


def _fitted_rows(channel, baseline, code):
    """Columns (n, k), values (n,), direction (n,) of at most about `MOST_ROWS` rows of one condition, and whether
    levels were shifted."""
    good = [np.flatnonzero((rows.condition == code) & np.isfinite(channel.values(rows))) for rows in baseline]
    step = max(1, sum(map(len, good)) // MOST_ROWS)
    before = np.cumsum([0, *map(len, good)])
    kept = [index[-first % step:: step] for index, first in zip(good, before)]
    parts = [(base_columns(channel, rows)[index], channel.values(rows)[index], rows.motion.direction[index])
             for rows, index in zip(baseline, kept) if len(index)]
    columns, y, direction = (np.concatenate([p[k] for p in parts]) for k in range(3))
    return columns, y, direction, any(rows.log.shift is not None for rows in baseline if (rows.condition == code).any())


def _scale(channel, model, y, direction, shifted, columns):
    """The size that changes are judged against, in the channel's unit."""
    moving = direction != 0.0
    if channel.name == "voltage":
        return float(np.sqrt(np.mean(y**2))) or 1.0
    rms = float(np.sqrt(np.mean(y[moving] ** 2))) if moving.any() else float(np.std(y))
    if channel.name == "error":
        return max(rms, 1e-12)
    at_speed = float(np.median(np.abs(columns[moving, 2]))) if moving.any() else 0.0
    level = abs(model[1]) + abs(model[2]) * at_speed
    if shifted and (~moving).any() and moving.any():
        level = abs(float(np.mean(y[moving])) - float(np.mean(y[~moving])))
    return max(level, LEAST_LEVEL * rms, 1e-12)


def sign_is_open(channel, baseline):
    """Whether a magnitude could as well be that of a force that outweighs the friction.

    Friction F and a constant force L give |F + L| out and |F − L| back: F and L may change places. What decides is
    inertia: starting adds to the magnitude in both directions if friction outweighs (L < F), in one only if it does
    not. Returns (open, ratio of the directions' levels).
    """
    if channel.signed or channel.name != "effort":
        return False, 1.0
    steady, starts = {1.0: [], -1.0: []}, {1.0: [], -1.0: []}
    for rows in baseline:
        y, m = channel.values(rows), rows.motion
        for sign in (1.0, -1.0):
            own = (m.direction == sign) & np.isfinite(y)
            steady[sign].append(y[own & (m.state == 2)])
            starts[sign].append(y[own & (m.state == 1)])
    levels = {s: np.concatenate(v) if v else np.array([]) for s, v in steady.items()}
    peaks = {s: np.concatenate(v) if v else np.array([]) for s, v in starts.items()}
    if min(len(levels[1.0]), len(levels[-1.0])) < 10:
        return True, 1.0
    mean = {s: float(np.mean(v)) for s, v in levels.items()}
    ratio = min(mean.values()) / max(max(mean.values()), 1e-300)
    if min(len(peaks[1.0]), len(peaks[-1.0])) >= 10:
        rise = {s: float(np.quantile(peaks[s], 0.9) - mean[s]) for s in mean}
        if min(rise.values()) > 2.0 * max(float(np.std(levels[s])) for s in mean):
            return False, ratio
    return ratio < 0.8, ratio
