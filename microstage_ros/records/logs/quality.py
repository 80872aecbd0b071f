"""What is odd about a log's signals: stamps, gaps, outliers, saturation, quantisation, levels shifted afterwards.

Each finder returns what it found and leaves it to `log` to act on it and to say so.
"""

import numpy as np

GAP = 3.0                # times the usual period, from which on a step of time is a gap
UNEVEN = 0.2             # of the usual period: steps further off count as uneven
UNEVEN_SHARE = 0.05      # share of uneven steps above which pieces are resampled
OUTLIER = 12.0           # robust standard deviations of a sample from both its neighbours' median
SATURATED_RUN = 4        # equal samples at the extreme, in a row, that make saturation
WINDOW = 20              # samples in which the remainder of a shifted level must be one and the same
DECIMALS = range(2, 8)   # digits to which drives and sheets round


def pieces_of(time, restarts):
    """Number of the continuous piece of every row, and what was met.

    Parameters
    ----------
    time : shape (n,) [s].
    restarts : whether the file is known to begin its time anew with every cycle.

    Returns
    -------
    piece : int array, shape (n,). kept : bool array, rows with a stamp of their own. notes : list of sentences.
    """
    n = len(time)
    step = np.diff(time)
    kept = np.ones(n, bool)
    notes = []
    forward = step[step > 0.0]
    if not len(forward):
        return np.zeros(n, int), kept, ["time does not advance"]
    usual = float(np.median(forward))
    repeated = step == 0.0
    if repeated.any():
        kept[1:] = ~repeated
        notes.append(f"{int(repeated.sum())} rows repeat the stamp before them and are left out")
    wide = np.quantile(forward, 0.95)
    limit = max(GAP * usual, 4.0 * wide if wide > 2.0 * usual else 0.0)
    back, gap = step < 0.0, step > limit
    piece = np.concatenate([[0], np.cumsum(back | gap)])
    if back.any():
        notes.append(f"time begins again {int(back.sum())} times" + ("" if restarts else "; taken as new pieces"))
    if gap.any():
        notes.append(f"{int(gap.sum())} gaps, the longest of {float(step.max()):.3g} s; nothing is read across them")
    return piece, kept, notes


def outliers(values, piece):
    """Samples that stand alone far from both neighbours: bool array, shape (n,).

    ``values`` and ``piece``, the number of each row's continuous piece, both of shape (n,).
    """
    if len(values) < 8:
        return np.zeros(len(values), bool)
    before, after = np.roll(values, 1), np.roll(values, -1)
    middle = 0.5 * (before + after)
    deviation = np.abs(values - middle)
    between = np.abs(after - before)
    scale = float(np.nanquantile(deviation, 0.95)) / 1.96 + 1e-300
    found = (deviation > OUTLIER * scale) & (between < 0.2 * deviation)
    same = (piece == np.roll(piece, 1)) & (piece == np.roll(piece, -1))
    return found & same


def saturation(values):
    """Rows of ``values`` (n,) at a limit: bool array (n,).

    True where the extreme value repeats `SATURATED_RUN` times or more in a row.

    Only values beyond four fifths of the largest magnitude count, so that zeros at rest are none.
    """
    found = np.zeros(len(values), bool)
    finite = values[np.isfinite(values)]
    if len(finite) < 50 or len(np.unique(finite[:5000])) < 8:
        return found
    largest = float(np.max(np.abs(finite)))
    for extreme in {float(finite.max()), float(finite.min())}:
        if abs(extreme) < 0.8 * largest:
            continue
        at = (values == extreme).astype(int)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], at, [0]])))
        for start, stop in zip(edges[::2], edges[1::2]):
            if stop - start >= SATURATED_RUN:
                found[start:stop] = True
    return found if found.mean() < 0.5 else np.zeros(len(values), bool)


def quantum(values):
    """Smallest step between ``values`` (n,) that occur, in their unit, where they are visibly quantised; else 0."""
    levels = np.unique(values[np.isfinite(values)][:20_000])
    if len(levels) < 3 or len(levels) > 0.2 * min(len(values), 20_000):
        return 0.0
    step = np.diff(levels)
    smallest = float(np.min(step))
    return smallest if np.median(np.abs(step / smallest - np.round(step / smallest))) < 0.05 else 0.0


def shifts(values):
    """Pieces whose level was shifted by a constant after the recording, recognised by the digits.

    ``values``: one signal, shape (n,).
    A signal rounded to some decimals and then shifted keeps one remainder per constant. Where the remainder is constant
    over stretches and differs between them, levels of different stretches cannot be compared.

    Returns
    -------
    Remainder class of every row, int array of shape (n,), or None where the digits show nothing of the kind.
    """
    finite = np.isfinite(values)
    if finite.sum() < 5 * WINDOW:
        return None
    for decimals in DECIMALS:
        remainder = np.mod(np.where(finite, values, 0.0) * 10.0**decimals, 1.0)
        classes = _constant_stretches(remainder)
        if classes is not None:
            return classes
    return None


def _constant_stretches(remainder):
    """Class of each row if remainders are constant over stretches of at least `WINDOW` rows and differ between them."""
    tolerance = 1e-4
    turn = np.exp(2j * np.pi * remainder)
    change = np.abs(np.diff(turn)) > 2.0 * np.pi * tolerance
    starts = np.concatenate([[0], np.flatnonzero(change) + 1, [len(remainder)]])
    length = np.diff(starts)
    inside = length >= WINDOW
    if length[inside].sum() < 0.9 * len(remainder) or inside.sum() < 2:
        return None
    level = remainder[starts[:-1]]
    classes = np.full(len(remainder), -1)
    known = []
    for start, size, value in zip(starts[:-1], length, level):
        if size < WINDOW:
            continue
        match = next(
            (k for k, other in enumerate(known) if abs(np.exp(2j * np.pi * value) - np.exp(2j * np.pi * other)) < 4e-3),
            None,
        )
        if match is None:
            known.append(value)
            match = len(known) - 1
        classes[start: start + size] = match
    if len(known) < 2 or len(known) > len(remainder) / (2 * WINDOW):
        return None
    # rows between two stretches (an average of both, say) belong to the nearest
    good = np.flatnonzero(classes >= 0)
    nearest = good[np.clip(np.searchsorted(good, np.arange(len(remainder))), 0, len(good) - 1)]
    return np.where(classes >= 0, classes, classes[nearest])
