"""Repetitions as short vectors: means over cells of like motion, amplitudes of ripple, roughness.

A cell holds rows of one condition, one phase of the move, one direction, one class of speed and one part of the stroke:
like is compared with like, whatever the programme was. Every column of every effect is reduced in the same way, so that
a fit to the vectors is a fit to the rows.
"""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.logs.preprocessing.breakaway import breakaways, trace
from microstage_ros.diagnosis.logs.preprocessing.motion import STATES

PLACES = (12, 6, 3, 1)      # parts of the stroke that are tried, the finest that the logs fill
OFTEN = (0.75, 0.5)         # of the repetitions (baseline, now) that fill a cell
AT_TIMES = (0.25, 0.1)      # the same where repetitions differ among themselves
KEYS = 1 << 40              # above every cell's key: repetition and key in one number
COVERED = 0.85              # share of the rows that must lie in cells which both sides have
STEADY = STATES.index("steady")
HARMONICS = 60              # highest harmonic of the turn
SLOWEST = 0.4               # cycles per sample up to which a ripple can be read
PHASES = 512                # parts of a turn that rows are gathered in before their harmonics are taken
SHIFTED = 0.05              # of the scale: what one constant per repetition may be, where repetitions still agree
FREE = 30.0                 # of the scale: standard deviation of a level that cannot be compared
LOW_ORDERS = 2              # harmonics that count as once per turn; the others make the second group
LEAST_ROWS = 40             # moving rows of one direction in a repetition for an amplitude


@dataclasses.dataclass
class Coordinates:
    """All repetitions of one channel as vectors of K coordinates, relative to the channel's scale.

    ``baseline``, ``now``: arrays (repetitions, K). ``group_baseline``, ``group_now``: number of the file of each
    repetition. ``condition``: code per coordinate. ``kind``: per coordinate: state name, ``ripple``, ``ripple high``,
    ``breakaway`` or ``rough``. ``direction``, ``place``: per coordinate. ``columns``: name → (K, k) array of every
    effect. ``count``: rows per coordinate and repetition, on average. ``shifted``: (K, m) what levels that were shifted
    afterwards may differ by, in standard deviations. ``grown``: (K,) variance of one repetition's mean by which faster
    fluctuations of now exceed those of the baseline.
    """

    channel: object
    baseline: np.ndarray
    now: np.ndarray
    group_baseline: np.ndarray
    group_now: np.ndarray
    condition: np.ndarray
    kind: np.ndarray
    direction: np.ndarray
    place: np.ndarray
    columns: dict
    count: np.ndarray
    shifted: np.ndarray
    spectrum: dict
    grown: np.ndarray


def cell_keys(rows, stroke, places, top):
    """Integer key of the cell of each row, shape (n,); −1 where the row belongs to none.

    ``stroke``: (lowest, highest) coordinate [unit of the position]; ``places``: of the division [1]; ``top``: usual top
    speed [unit of the position per s].
    """
    m = rows.motion
    size = np.abs(m.speed) / max(top, 1e-300)
    octave = np.log2(np.maximum(size, 1e-3))
    fine = np.clip(np.round(2.0 * octave), -8, 2) + 8
    coarse = np.clip(np.round(octave), -2, 1) + 2
    moving = m.direction != 0.0
    speed = np.where(m.state == STEADY, fine, np.where(moving, coarse, 0))
    low, high = stroke
    where = np.clip(((m.x - low) / max(high - low, 1e-300) * places).astype(int), 0, places - 1) if places > 1 else 0
    place = np.where(m.state == STEADY, where, 0)
    direction = np.where(moving, m.direction, m.last) + 1
    key = (((rows.condition * 5 + m.state) * 3 + direction) * 16 + speed) * 16 + place
    return np.where(rows.condition >= 0, key, -1).astype(int)


def unpack(keys):
    """(condition, state, direction, speed class, place) of cell keys."""
    place, rest = keys % 16, keys // 16
    speed, rest = rest % 16, rest // 16
    direction, rest = rest % 3 - 1, rest // 3
    return rest // 5, rest % 5, direction, speed, place


def stroke_of(everything):
    """Lowest and highest coordinate that most rows visit."""
    if not everything[0].motion.absolute:
        return 0.0, 1.0
    lows, highs = zip(*((np.quantile(r.motion.x, 0.002), np.quantile(r.motion.x, 0.998)) for r in everything))
    return float(np.median(lows)), float(np.median(highs))


def choose_cells(baseline, now, stroke, top):
    """(number of places, cells that both sides fill, share of the rows of now in them): the finest division that is
    filled.

    ``stroke``, ``top`` as in `cell_keys`, in the unit of the position and per s. Cells that most repetitions fill, or,
    where repetitions differ (one slow, one fast), those that enough of them fill.
    """
    fine = [[_filled_cells(rows, stroke, top) for rows in side] for side in (baseline, now)]
    tried = PLACES if all(r.motion.absolute for r in [*baseline, *now]) else (1,)
    usual = _cells(fine, tried, OFTEN)
    if usual[2] >= COVERED:
        return usual
    more = _cells(fine, tried, AT_TIMES)
    return more if more[2] > usual[2] + 0.1 else usual


def _filled_cells(rows, stroke, top):
    """Cells of the finest division by repetition in one log, repetition and key packed in one number; and the rows in
    each."""
    keys = cell_keys(rows, stroke, PLACES[0], top)
    inside = keys >= 0
    return np.unique(rows.repetition[inside].astype(np.int64) * KEYS + keys[inside], return_counts=True)


def _coarser(fine, places):
    """{cell: repetitions that fill it}, {cell: rows in it} of a side at a coarser division of the stroke."""
    met, rows_in = {}, {}
    for packed, number in fine:
        repetition, keys = packed // KEYS, packed % KEYS
        keys = keys - keys % 16 + (keys % 16) * places // PLACES[0]
        pairs, at = np.unique(repetition * KEYS + keys, return_inverse=True)
        for pair, count in zip((pairs % KEYS).tolist(), np.bincount(at, number).astype(int).tolist()):
            if count >= 2:
                met[pair] = met.get(pair, 0) + 1
                rows_in[pair] = rows_in.get(pair, 0) + count
    return met, rows_in


def _cells(fine, tried, least):
    """`choose_cells` with cells that the shares ``least`` of the repetitions (baseline, now) fill.

    ``fine``: by side and log, see `_filled_cells`.
    """
    best = None
    for places in tried:
        sides = [_coarser(side, places) for side in fine]
        codes = {key: int(unpack(np.array([key]))[0][0]) for key in {*sides[0][0], *sides[1][0]}}
        shares = [
            {code: max((m for k, m in met.items() if codes[k] == code), default=1) for code in set(codes.values())}
            for met, _ in sides
        ]
        kept = sorted(key for key in sides[0][0] if sides[0][0][key] >= least[0] * shares[0][codes[key]]
                      and sides[1][0].get(key, 0) >= least[1] * shares[1][codes[key]])
        covered = sum(sides[1][1][k] for k in kept) / max(sum(sides[1][1].values()), 1)
        if best is None or covered > best[2] + 0.1:
            best = (places, np.array(kept, int), covered)
        if covered >= COVERED:
            return places, np.array(kept, int), covered
    return best


def reduce(channel, baseline, now, cells, places, stroke, top, columns_of, turn):
    """`Coordinates` of one channel; ``columns_of(channel, rows)`` → {name: (n, k)} of effects in the channel's unit.

    ``cells``: keys of shape (k,); ``places``, ``stroke``, ``top``: as in `cell_keys`, in the unit of the position and
    per s; ``turn``: length of one turn in the unit of the position, 0 if unknown.
    """
    sides, spectra = [], []
    sums, weights = {}, np.zeros(len(cells))
    shifted, decades, fluctuations, traces = [], {}, {}, {}
    for side in (baseline, now):
        vectors, groups, extras, counts = [], [], [], []
        for rows in side:
            keys = cell_keys(rows, stroke, places, top)
            slot = np.searchsorted(cells, keys)
            slot = np.where((slot < len(cells)) & (cells[np.minimum(slot, len(cells) - 1)] == keys), slot, -1)
            y = channel.values(rows)
            scale = np.array([channel.scale.get(int(c), 1.0) for c in range(int(rows.condition.max()) + 1)] or [1.0])[
                np.maximum(rows.condition, 0)
            ]
            left = (y - channel.predicted(rows)) / scale
            good = (slot >= 0) & np.isfinite(left)
            _add(fluctuations, side is now, *_fluctuation(left, np.where(good, slot, -1), len(cells)))
            if side is now:
                for name, columns in columns_of(channel, rows).items():
                    part = np.stack(
                        [np.bincount(slot[good], c[good] / scale[good], len(cells)) for c in columns.T], axis=1
                    )
                    sums[name] = sums.get(name, 0.0) + part
                    traces.setdefault(name, []).append(trace(rows, columns, scale, channel.signed))
                weights += np.bincount(slot[good], minlength=len(cells))
            peaks = breakaways(rows, y / scale, channel.signed)
            for number, part in stretches_of(rows.repetition):
                own = good[part] & (rows.repetition[part] == number)
                if not own.any():
                    continue
                count = np.bincount(slot[part][own], minlength=len(cells))
                mean = np.bincount(slot[part][own], left[part][own], len(cells)) / np.where(count > 0, count, np.nan)
                vectors.append(mean)
                counts.append(count)
                groups.append(rows.group)
                extra, spectrum = _amplitudes(rows, part, own, left[part], slot[part], mean, turn)
                for key, (peak, grown) in peaks.get(number, {}).items():
                    extra[key] = peak
                    decades.setdefault(key, []).append(grown)
                extras.append(extra)
                spectra.append((side is now, spectrum))
                if rows.log.shift is not None and channel.name == "effort":
                    shifted.append(_shift_columns(rows.log.shift[part][own], slot[part][own], len(cells)))
        sides.append((np.array(vectors), np.array(groups), _aligned(extras), np.array(counts)))
    return _assembled(channel, cells, sides, sums, weights, shifted, spectra, (decades, traces), _growth(fluctuations))


def only_rough(coordinates):
    """The coordinates of fluctuation alone, or None where there are none."""
    own = coordinates.kind == "rough"
    if not own.any():
        return None
    per_coordinate = ("condition", "kind", "direction", "place", "count", "shifted", "grown")
    return dataclasses.replace(
        coordinates, baseline=coordinates.baseline[:, own], now=coordinates.now[:, own],
        columns={name: column[own] for name, column in coordinates.columns.items()},
        **{name: getattr(coordinates, name)[own] for name in per_coordinate})


def stretches_of(repetition):
    """Pairs (number, slice from its first row to its last) of every repetition: a log of a million rows may have
    hundreds."""
    numbers, first = np.unique(repetition, return_index=True)
    last = len(repetition) - np.unique(repetition[::-1], return_index=True)[1]
    return [(int(number), slice(int(a), int(b))) for number, a, b in zip(numbers, first, last)]


def _amplitudes(rows, part, own, left, slot, mean, turn):
    """Amplitudes of ripple by direction and roughness by state of one repetition: {(condition, kind, direction):
    value}.

    ``part``: slice of its rows; ``own``, ``left``, ``slot`` are of that slice.
    """
    m, found, spectrum = rows.motion, {}, {}
    condition, state, directions, x = rows.condition[part], m.state[part], m.direction[part], m.x[part]
    inside = own & (slot >= 0)
    fluctuation = np.where(inside, left - np.nan_to_num(mean)[np.maximum(slot, 0)], 0.0)
    for code in np.unique(condition[inside]):
        here = inside & (condition == code)
        for direction in (-1, 1):
            use = here & (state == STEADY) & (directions == direction)
            if use.sum() < LEAST_ROWS:
                continue
            r = fluctuation[use]
            found[(int(code), "rough", direction)] = float(0.5 * np.log(np.mean(np.diff(r, 2) ** 2) + 1e-14))
            if turn:
                r = _detrended(x[use], left[use])
                orders = _orders(m.speed[part][use], turn, rows.log.period)
                if len(orders):
                    bins = np.floor(np.mod(x[use] / turn, 1.0) * PHASES).astype(int) % PHASES
                    c = 2.0 * np.fft.fft(np.bincount(bins, r, PHASES))[orders] / len(r) / np.sinc(orders / PHASES)
                    power = np.maximum(np.abs(c) ** 2 - 4.0 * np.var(r) / len(r), 0.0)
                    spectrum[(int(code), direction)] = (orders, np.abs(c))
                    low = orders <= LOW_ORDERS
                    found[(int(code), "ripple", direction)] = float(np.sqrt(power[low].sum()))
                    if (~low).any():
                        found[(int(code), "ripple high", direction)] = float(np.sqrt(power[~low].sum()))
        still = here & (state == STATES.index("settled"))
        if still.sum() >= LEAST_ROWS:
            found[(int(code), "rough", 0)] = float(0.5 * np.log(np.mean(np.diff(fluctuation[still], 2) ** 2) + 1e-14))
    return found, spectrum


def _fluctuation(left, slot, size):
    """Sum and number, per cell, of the variance of white noise that second differences within the cell tell of: two
    arrays (size,)."""
    inside = (slot[1:-1] >= 0) & (slot[1:-1] == slot[:-2]) & (slot[1:-1] == slot[2:])
    square = (left[2:] - 2.0 * left[1:-1] + left[:-2])[inside] ** 2 / 6.0
    return np.bincount(slot[1:-1][inside], square, size), np.bincount(slot[1:-1][inside], minlength=size)


def _add(totals, key, power, number):
    """Add the sums of one file to those of its side."""
    before = totals.get(key, (0.0, 0))
    totals[key] = (before[0] + power, before[1] + number)


def _growth(fluctuations):
    """Variance per row by which now fluctuates more than the baseline, per cell (size,)."""
    base, now = (
        (power + 1e-300) / np.maximum(number, 1) for power, number in (fluctuations[False], fluctuations[True])
    )
    return np.maximum(now - base, 0.0)


def _detrended(x, values):
    """Values less a cubic of the place: ripple is distinguished from what is slow along the stroke, not from cells
    narrower than a turn."""
    u = (x - x.mean()) / max(float(np.std(x)), 1e-300)
    columns = np.stack([np.ones(len(u)), u, u**2, u**3], axis=1)
    return values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]


def _orders(speed, turn, period):
    """Harmonics of the turn that the sampling resolves and of which the repetition sees one and a half periods or
    more."""
    travel = np.abs(speed)
    usual = float(np.median(travel))
    if float(np.sum(travel) * period) < 1.5 * turn:
        return np.array([], int)
    highest = int(min(HARMONICS, SLOWEST * turn / max(usual * period, 1e-300)))
    return np.arange(1, highest + 1)


def _aligned(extras):
    """Amplitude coordinates of all repetitions: (keys, array of repetitions × keys with NaN where one lacks it)."""
    keys = sorted({key for extra in extras for key in extra}, key=str)
    return keys, np.array([[extra.get(key, np.nan) for key in keys] for extra in extras]).reshape(
        len(extras), len(keys)
    )


def _shift_columns(classes, slot, size):
    """Share of every cell's rows that has each of the constants of a shifted level: (K, classes)."""
    count = np.bincount(slot, minlength=size)
    return np.stack([np.bincount(slot, classes == c, size) / np.maximum(count, 1) for c in np.unique(classes)], axis=1)


def _assembled(channel, cells, sides, sums, weights, shifted, spectra, starts, growth):
    (base, groups_base, extra_base, counts), (now, groups_now, extra_now, _) = sides
    common = [key for key in extra_base[0] if key in extra_now[0]]
    pick = lambda extra: (
        extra[1][:, [extra[0].index(key) for key in common]] if common else np.zeros((len(extra[1]), 0))
    )
    condition, state, direction, _, place = unpack(cells)
    kinds = np.array([*(STATES[s] for s in state), *(key[1] for key in common)], dtype=object)
    basis = np.hstack(
        [_range_of(shifted, condition == code) for code in np.unique(condition)] or [np.zeros((len(cells), 0))]
    )
    decades, traces = starts
    columns = {
        name: np.concatenate(
            [total / np.maximum(weights, 1)[:, None], _at_starts(traces[name], common, total.shape[1])]
        )
        for name, total in sums.items()
    }
    columns["breakaway"] = np.concatenate([np.zeros(len(cells)), [np.mean(decades.get(key, [0.0])) for key in common]])[
        :, None
    ]
    return Coordinates(
        channel,
        np.hstack([base, pick(extra_base)]),
        np.hstack([now, pick(extra_now)]),
        groups_base,
        groups_now,
        np.array([*condition, *(key[0] for key in common)], int),
        kinds,
        np.array([*direction, *(key[2] for key in common)], float),
        np.array([*place, *([0] * len(common))], int),
        columns,
        np.concatenate([counts.mean(axis=0), np.full(len(common), np.nan)]),
        np.concatenate([basis, np.zeros((len(common), basis.shape[1]))]),
        _mean_spectrum(spectra),
        np.concatenate([growth / np.maximum(counts.mean(axis=0), 1.0), np.zeros(len(common))]),
    )


def _at_starts(traces, keys, width):
    """Columns of an effect at the coordinates of amplitudes, (len(keys), width): zero but for break-aways."""
    out = np.zeros((len(keys), width))
    for k, key in enumerate(keys):
        met = [trace[key] for trace in traces if key in trace]
        if met:
            out[k] = np.mean(met, axis=0)
    return out


def _range_of(shifted, own):
    """What the shifts span in the cells ``own`` (K,) of one condition, each direction times its standard deviation: (K,
    m).

    Constants that change within a repetition make levels incomparable (`FREE`); one constant per repetition, where
    repetitions still agree, is `SHIFTED` of the scale.
    """
    size = len(own)
    parts = [w * own[:, None] for w in shifted]
    parts = [w[:, np.abs(w).max(axis=0) > 0.0] for w in parts if np.abs(w * own[:, None]).max(initial=0.0) > 0.0]
    if not parts:
        return np.zeros((size, 0))
    values, vectors = np.linalg.eigh(sum(w @ w.T for w in parts) / len(parts))
    within = any(w.shape[1] > 1 for w in parts)
    return vectors[:, values > 0.02 * values[-1]] * (FREE if within else SHIFTED * np.sqrt(own.sum()))


def _mean_spectrum(spectra):
    """{(now?, condition, direction): (orders, rms amplitude)} over repetitions."""
    gathered = {}
    for is_now, spectrum in spectra:
        for (code, direction), (orders, size) in spectrum.items():
            gathered.setdefault((is_now, code, direction), []).append((orders, size))
    return {
        key: (
            entries[0][0],
            np.sqrt(
                np.mean([s[: len(entries[0][0])] ** 2 for o, s in entries if len(s) >= len(entries[0][0])], axis=0)
            ),
        )
        for key, entries in gathered.items()
    }
