"""How a log moves: coordinate, speed, acceleration, direction, and where in its move each row lies."""

import dataclasses

import numpy as np
from scipy.signal import savgol_filter

from microstage_ros.quantities.errors import InputError

STILL = 0.03            # share of the usual top speed below which an axis counts as at rest
ACCELERATING = 0.25     # share of the usual top acceleration above which a row belongs to start or braking
MOST_LATE = 0.2         # s, lag beyond the baseline's that is taken for one
CUT = 0.2               # share of the top speed with which a motion that the log shows from its start cannot begin
STATES = ("rest", "start", "steady", "brake", "settled")
SMOOTH_S = 0.02         # s, window of the derivative of a measured position
SMOOTH_TWICE_S = 0.08   # s, of the derivative of a measured speed: noise grows with the square of the rate
LEAST_WINDOW = 5        # samples
ENDLESS = 8.0 * np.pi   # rad, travel from which on an angle counts as endless: no place of a stroke


@dataclasses.dataclass
class Motion:
    """Per row of a log, all of shape (n,).

    ``x`` coordinate [m or rad]; ``speed``; ``acceleration``; ``direction`` −1, 0, 1; ``last`` direction of the last
    motion (held at rest); ``state`` index into `STATES`; ``since`` time since motion or rest began [s]; ``dwell`` rest
    before this motion [s]; ``stroke`` number of the motion. ``absolute``: whether x is the same place in every log.
    """

    x: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    direction: np.ndarray
    last: np.ndarray
    state: np.ndarray
    since: np.ndarray
    dwell: np.ndarray
    stroke: np.ndarray
    absolute: bool
    top_speed: float
    top_acceleration: float


def speed_of(log):
    """Coordinate, speed and acceleration of a log, and whether the coordinate is absolute.

    The reference's derivative is used where there is one, for it has no noise; else the speed asked for, the measured
    one, the smoothed derivative of the position. Without any position the coordinate is the speed's integral from each
    piece's start.

    Raises InputError: the log has no signal of motion.
    """
    signals = log.signals
    has = [name for name in ("reference", "position") if name in signals]
    if "reference" in signals:
        v = derivative(signals["reference"], log)
    elif "reference_velocity" in signals:
        v = signals["reference_velocity"]
    elif "velocity" in signals:
        v = smooth(signals["velocity"], log)
    elif "position" in signals:
        v = derivative(signals["position"], log, smoothed=True)
    else:
        raise InputError(log.source, "no signal of motion", "reference, position, velocity or reference_velocity")
    asked = "reference" in signals or "reference_velocity" in signals
    a = derivative(v, log, smoothed=not asked, seconds=SMOOTH_TWICE_S)
    if has:
        x = signals[has[0]]
        if np.isnan(x).any():
            x = _filled(x)
    else:
        x, has = _integrated(np.nan_to_num(v), log)
    endless = log.place_unit == "rad" and float(np.ptp(x)) > ENDLESS
    return x, np.nan_to_num(v), np.nan_to_num(a), bool(has) and not endless


def _integrated(v, log):
    """Place as the integral of the speed, from the middle of each piece's travel, and whether that is the same place in
    every piece.

    It is where pieces go back and forth; what the integral drifts over a piece is taken out as a straight line.
    """
    x, both = np.zeros(len(v)), True
    for start, stop in _bounds(log.piece):
        own = np.cumsum(v[start:stop]) * log.period
        reversals = np.sum(np.diff(np.sign(v[start:stop][np.abs(v[start:stop]) > STILL * np.abs(v).max()])) != 0)
        both &= bool(reversals)
        if reversals > 2:
            steps = np.arange(stop - start) - 0.5 * (stop - start)
            own = own - steps * np.polyfit(steps, own, 1)[0]
        x[start:stop] = own - 0.5 * (own.max() + own.min())
    return x, both


def derivative(values, log, smoothed=False, seconds=SMOOTH_S):
    """Derivative in time of ``values`` (n,) within pieces, shape (n,); smoothed over ``seconds`` [s] if asked for."""
    out = np.zeros(len(values))
    values = _filled(values)
    window = _window(log.period, seconds)
    for start, stop in _bounds(log.piece):
        count = stop - start
        if count < 3:
            continue
        if smoothed and count > window:
            out[start:stop] = savgol_filter(values[start:stop], window, 2, deriv=1, delta=log.period)
        else:
            out[start:stop] = np.gradient(values[start:stop], log.period)
    return out


def smooth(values, log):
    """Quadratic smoothing of ``values`` (n,) over `SMOOTH_S` within pieces."""
    out = _filled(values).copy()
    window = _window(log.period)
    for start, stop in _bounds(log.piece):
        if stop - start > window:
            out[start:stop] = savgol_filter(out[start:stop], window, 2)
    return out


def _window(period, seconds=SMOOTH_S):
    return max(LEAST_WINDOW, int(round(seconds / period)) // 2 * 2 + 1)


def _filled(values):
    bad = ~np.isfinite(values)
    if not bad.any() or bad.all():
        return np.nan_to_num(values)
    out = values.copy()
    out[bad] = np.interp(np.flatnonzero(bad), np.flatnonzero(~bad), values[~bad])
    return out


def _bounds(piece):
    edges = np.flatnonzero(np.diff(piece)) + 1
    return list(zip(np.concatenate([[0], edges]), np.concatenate([edges, [len(piece)]])))


def tops(logs):
    """Top speed and top acceleration that are usual: 95th percentile over moving rows, third quartile over accelerating
    ones."""
    speeds, accelerations = [], []
    for log in logs:
        _, v, a, _ = speed_of(log)
        size = np.abs(v)
        moving = size > STILL * np.quantile(size, 0.98)
        speeds.append(np.quantile(size[moving], 0.95) if moving.any() else 0.0)
        sharp = np.abs(a)
        real = sharp > 0.02 * np.quantile(sharp, 0.999)
        accelerations.append(np.quantile(sharp[real], 0.75) if real.any() else 0.0)
    return float(np.median(speeds)), float(np.median(accelerations))


def lag_of(log):
    """Time by which the position follows the set point [s]: the error in proportion to the speed; 0 where one is not
    logged."""
    signals = log.signals
    if "reference" not in signals or "following_error" not in signals:
        return 0.0
    v = derivative(signals["reference"], log)
    good = np.isfinite(signals["following_error"]) & (np.abs(v) > STILL * np.quantile(np.abs(v), 0.98))
    return float(np.mean(signals["following_error"][good] * v[good]) / np.mean(v[good] ** 2)) if good.any() else 0.0


def later(values, log, rows):
    """The ``values`` (n,) as they were ``rows`` rows before (after, where negative), held at the ends of pieces, shape
    (n,)."""
    index, edges = np.arange(len(values)) - rows, _bounds(log.piece)
    first, last = (np.repeat([edge[k] for edge in edges], [stop - start for start, stop in edges]) for k in (0, 1))
    return values[np.clip(index, first, last - 1)]


def motion_of(log, top_speed, top_acceleration, lag=0.0):
    """`Motion` of a log, with what counts as moving and as accelerating decided by the baseline's usual tops,
    ``top_speed`` and ``top_acceleration``, in the units of the log's speed and acceleration.

    ``lag``: time by which the axis follows its set point later than in the baseline [s]: forces go with the motion, not
    with its order.
    """
    x, v, a, absolute = speed_of(log)
    rows = int(round(lag / log.period))
    if rows:
        x, v, a = (later(values, log, rows) for values in (x, v, a))
    direction = np.where(np.abs(v) > STILL * max(top_speed, 1e-300), np.sign(v), 0.0)
    n = len(v)
    change = np.concatenate([[True], (np.diff(direction) != 0) | (np.diff(log.piece) != 0)])
    number = np.cumsum(change) - 1
    first = np.flatnonzero(change)
    length = np.diff(np.append(first, n))
    kind = direction[first]
    new_piece = np.concatenate([[True], np.diff(log.piece[first]) != 0])
    last, dwell, before, rested = np.zeros(len(first)), np.zeros(len(first)), 0.0, 0.0
    for k in range(len(first)):
        if new_piece[k]:
            before, rested = 0.0, 0.0
        if kind[k] == 0.0:
            last[k], rested = before, length[k] * log.period
        else:
            last[k], dwell[k] = kind[k], rested
            before, rested = kind[k], 0.0
    since = (np.arange(n) - first[number]) * log.period
    took = length[number] * log.period
    state = np.full(n, STATES.index("steady"))
    moving = direction != 0.0
    pushing = a * direction
    limit = ACCELERATING * max(top_acceleration, 1e-300)
    early = since < np.maximum(2.5 * log.period, np.minimum(0.08 * took, 0.5))
    cut = new_piece & (np.abs(v[first]) > CUT * max(top_speed, 1e-300))     # begins within a motion: no start of one
    early &= ~cut[number]
    state[moving & ((pushing > limit) | early)] = STATES.index("start")
    state[moving & (pushing < -limit) & ~early] = STATES.index("brake")
    state[~moving] = STATES.index("settled")
    state[~moving & (since < np.maximum(2.5 * log.period, 0.3 * took))] = STATES.index("rest")
    return Motion(
        x, v, a, direction, last[number], state, since, dwell[number], number, absolute, top_speed, top_acceleration
    )
