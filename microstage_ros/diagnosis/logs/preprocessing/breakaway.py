"""Break-away: the peak with which a motion begins after a rest, over the mean of its start."""

import numpy as np

from microstage_ros.diagnosis.logs.preprocessing.motion import STATES, STILL

START = STATES.index("start")
AROUND_S = 0.05         # s, before and after the beginning of motion, in which the peak is looked for
SMOOTH_S = 0.004        # s, mean over which the peak is taken: single samples are noise
MOST_STARTS = 60        # of a log, that an effect's trace is taken at
DWELL_S = 0.05          # s, at which rising static friction begins to grow (default of the effect)


def starts_of(motion):
    """Rows at which a motion begins after a rest, int array."""
    d = motion.direction
    first = np.flatnonzero((d[1:] != 0.0) & (d[:-1] == 0.0)) + 1
    return first[motion.dwell[first] > DWELL_S]


def resolved(motion, period):
    """Share [1] of a break-away that sampling at ``period`` [s] keeps: it lasts until the axis has left the speed of
    presliding, a = v / t."""
    lasts = STILL * motion.top_speed / max(motion.top_acceleration, 1e-300)
    return min(1.0, (lasts + SMOOTH_S) / period)


def breakaways(rows, values, signed):
    """{repetition: {(condition, "breakaway", direction): (peak over the mean of the start, decades of dwell that the
    sampling keeps)}}.

    ``values`` (n,) the channel relative to its scale; ``signed``: whether it turns with the motion.
    """
    found = {}
    for (number, *key), entries in _peaks(rows, values, signed).items():
        found.setdefault(number, {})[tuple(key)] = tuple(np.mean(entries, axis=0))
    return found


def trace(rows, columns, scale, signed):
    """{(condition, "breakaway", direction): (k,)}: what columns (n, k) of an effect put into the peak over the mean of
    the start.

    Taken as the column where motion begins less its mean over the start, relative to ``scale`` (n,); magnitudes are
    turned already.
    """
    m, out = rows.motion, {}
    for k in starts_of(m)[:MOST_STARTS]:
        stop = k + int(np.argmax(np.append(m.state[k:k + 100_000] != START, True)))
        if stop == k:
            continue
        part = (columns[k] - columns[k:stop].mean(axis=0)) * (m.direction[k] if signed else 1.0) / scale[k]
        out.setdefault((int(rows.condition[k]), "breakaway", int(m.direction[k])), []).append(part)
    return {key: np.mean(parts, axis=0) for key, parts in out.items()}


def _peaks(rows, values, signed):
    """{(repetition, *key): list of (peak, decades)} over all starts."""
    m, period = rows.motion, rows.log.period
    reach, width = max(2, int(round(AROUND_S / period))), max(1, int(round(SMOOTH_S / period)))
    gathered = {}
    for k in starts_of(m):
        window = slice(max(k - reach, 0), min(k + reach + 1, len(values)))
        inside = rows.log.piece[window] == rows.log.piece[k]
        ahead = slice(k, min(k + 20 * reach, len(values)))
        start = values[ahead][(m.stroke[ahead] == m.stroke[k]) & (m.state[ahead] == START)]
        turned = values[window][inside] * (m.direction[k] if signed else 1.0)
        start = start[np.isfinite(start)] * (m.direction[k] if signed else 1.0)
        if not len(start) or not np.isfinite(turned).all() or len(turned) < width + 2:
            continue
        smooth = np.convolve(turned, np.ones(width) / width, mode="valid") if width > 1 else turned
        decades = np.log10(1.0 + m.dwell[k] / DWELL_S) * resolved(m, period)
        key = (int(rows.repetition[k]), int(rows.condition[k]), "breakaway", int(m.direction[k]))
        gathered.setdefault(key, []).append((float(smooth.max() - start.mean()), decades))
    return gathered
