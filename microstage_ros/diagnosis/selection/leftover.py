"""On what the size of the residual depends that is left after the causes.

The mean of a residual may depend on nothing while its size does: a force that swings in time averages out along the
stroke, bursts of friction have no sign. So the whitened residual z of the held-out records is squared, and z² compared
between classes of one coordinate after the other (one-way analysis of variance on means over `PIECE`, within which z²
is not independent); a line in time shows in the periodogram of z.
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import f as fisher

from microstage_ros.diagnosis.preprocessing.smoothing import REST_SPEED
from microstage_ros.diagnosis.residuals.evidence import free_of_nuisance
from microstage_ros.diagnosis.residuals.evidence_set import LEAST_FREEDOM, LOUDNESS_STRETCH, Evidences
from microstage_ros.diagnosis.result import Finding

# s, mean of z² taken as one number; calibrated by: validation.variation --group leftover (half and double: the same
# answers)
PIECE = 0.1
CLASSES = 12         # of a coordinate; calibrated by: the same
CHANCE = 1.0e-3      # that a coordinate stands out on which nothing depends; derived: what `Finding` promises
SLOWEST = 0.2        # Hz; derived: CLASSES/2 in half a minute, slower is a dependence on the time itself
FASTEST = 0.45       # of the rate of pieces; derived: nine tenths of the Nyquist frequency, as `lines.HIGHEST`
LEAST_PIECES = 60     # derived: five of each class
LOBE = 2             # frequencies beside a line that are its own; derived: of a line between two of them
AROUND = 2.0 / 3.0    # of a frequency, how far its neighbours reach; derived: lines from 0.35 Hz on in half a minute
LEAST_AROUND = 8      # frequencies with which one is compared; derived: their median is then known to 35 %
SAME_FREQUENCY = 2.0  # of the width 1/T of a line in a record of length T; derived: to the next zero of each line
TINY = np.finfo(float).tiny


class Remains(NamedTuple):
    """What the causes leave of the held-out records in one channel, stretch by stretch of `LOUDNESS_STRETCH`.

    ``energy`` (stretches,): χ², by the baseline's scatter [1]; ``rows`` (stretches,) [1]; ``noise``: standard deviation
    of a reading by which positions are weighed, 1 in other channels [m or 1].
    """

    energy: np.ndarray
    rows: np.ndarray
    noise: float = 1.0


def remains(collection, evidences, choices):
    """{channel: `Remains`} of the held-out records."""
    found = {}
    for channel, held in evidences.held.items():
        keys = Evidences._keys(channel, choices)
        left, rows = held.energies(keys, evidences.learn[channel].fit(keys)[0], LOUDNESS_STRETCH)
        read = [one.scatter for one in _records(collection, "held", channel)] if channel == "position" else [1.0]
        found[channel] = Remains(left / evidences.scatter[channel], rows, float(np.mean(read)))
    return found


def above(mine, floor):
    """What one record leaves above another of the same programme.

    Positions are weighed by the noise of ``mine``: read off counts, that is a twentieth smaller where the floor shakes
    the resting stage from count to count.

    Parameters
    ----------
    mine, floor : `Remains`.

    Returns
    -------
    (χ², its standard error by how stretches disagree).
    """
    more = mine.energy - floor.energy * (mine.rows / floor.rows) * (floor.noise / mine.noise) ** 2
    count = max(len(more), 1.0 + LEAST_FREEDOM)
    scatter = ((more - more.sum() * mine.rows / mine.rows.sum()) ** 2).sum() * count / (count - 1.0)
    return float(more.sum()), float(np.sqrt(scatter))


def over_twin(collection, evidences, choices):
    """How much more the causes leave of the held-out records than a machine leaves that has none of them.

    The twin is the same machine with nothing wrong on the same programme, so what it leaves is the noise floor of these
    very rows: a baseline went elsewhere, at other speeds, and leaves another χ² per row there, on a machine of another
    friction law above all. Nothing is fitted to it.

    Returns
    -------
    {channel: (χ² above what the first twin leaves, its standard error, χ² that each of the twins leaves)}; empty
    without a twin.
    """
    found = {}
    for channel, mine in remains(collection, evidences, choices).items() if collection.channels.get("twin") else ():
        forms = [form for form in evidences.forms if form.channel == channel]
        if channel == "position":
            for its in _records(collection, "twin", channel):
                its.scatter = mine.noise
        twin = collection.growing(channel, forms, "twin")
        if twin is None:
            continue
        every = twin.energies([], np.zeros(0), LOUDNESS_STRETCH)
        energy, rows = (np.split(values, len(collection.channels["twin"])) for values in every)
        floors = [Remains(one / evidences.scatter[channel], of, mine.noise) for one, of in zip(energy, rows)]
        found[channel] = (*above(mine, floors[0]), tuple(float(floor.energy.sum()) for floor in floors))
    return found


def scatter_findings(collection, evidences, choices, channels):
    """On what the size of what is left depends, channel by channel.

    Parameters
    ----------
    collection : `residuals.collection.Collection` of the records.
    evidences : `Evidences` with the fitted sizes.
    choices : the causes, as `Choice`.
    channels : names of the channels in which more is left than noise.

    Returns
    -------
    (findings, words): list of `Finding`, the strongest of each channel first, and {channel: what a note says}.
    """
    found, words = [], {}
    for channel in channels:
        table, line = _table(collection, evidences, choices, channel)
        if line is None:
            continue
        coordinates = [name for name in table if name != "z2"]
        ratios = {name: _variance_ratio(table[name], table["z2"]) for name in coordinates}
        own = [Finding(channel, name, ratio, usual, ratio) for name, (ratio, usual) in ratios.items()]
        if line.stands:
            own.append(Finding(channel, "time", line.strength, line.threshold, line.strength))
        own.sort(key=lambda finding: -finding.statistic / finding.threshold)
        found += own
        best = own[0]
        if best.significant:
            at = f" ({line.frequency:.2g} Hz)" if best.coordinate == "time" and best.statistic == line.strength else ""
            words[channel] = f"what is left in {channel} depends most on {best.coordinate}{at}"
        else:
            words[channel] = f"what is left in {channel} depends on none of the coordinates looked at"
    return found, words


def swings_in_time(collection, evidences, choices):
    """What swings in time beside the causes: a line at one frequency in every learning and held-out record, and not in
    the baseline. Its mean along every coordinate is nothing, and its size hardly more than that of friction's noise.

    Returns
    -------
    {channel: frequency [Hz]}.
    """
    found = {}
    for channel in evidences.held:
        forms, beta = _fitted(evidences, choices, channel)
        lines = [_line_of(one, collection, channel, forms, beta)
                 for group in ("learn", "held") for one in _records(collection, group, channel)]
        usual = [_line_of(one, collection, channel, [], beta) for one in _records(collection, "base", channel)]
        first = lines[0]
        if all(line.stands and line.is_at(first) for line in lines) \
                and not any(line.stands and line.is_at(first) for line in usual):
            found[channel] = float(np.mean([line.frequency for line in lines]))
    return found


def _table(collection, evidences, choices, channel):
    """(Means of z² and of every coordinate over pieces of the held-out records, their strongest `Line` in time);
    ({}, None) of too few pieces."""
    forms, beta = _fitted(evidences, choices, channel)
    rows, lines = [], []
    for one in _records(collection, "held", channel):
        z, time, piece, limit = _pieces(one, collection, channel, forms, beta)
        speed = one.speed if hasattr(one, "speed") else one.prepared.speed
        position = one.position if hasattr(one, "position") else one.prepared.position
        rows.append(
            {
                "z2": piece(np.minimum(z**2, limit)),
                "time": piece(time),
                "position": piece(position),
                "velocity": np.abs(piece(speed)),
                "direction": np.sign(piece(speed)) * (np.abs(piece(speed)) > REST_SPEED),
                "dwell": _since_motion(piece(np.abs(speed)), PIECE),
            }
        )
        lines.append(_line_of(one, collection, channel, forms, beta))
    if not rows or sum(len(r["z2"]) for r in rows) < LEAST_PIECES:
        return {}, None
    table = {name: np.concatenate([r[name] for r in rows]) for name in rows[0]}
    return table, max(lines, key=lambda line: line.strength)


def _fitted(evidences, choices, channel):
    """(the causes' forms in a channel, their sizes)."""
    forms = [form for choice in choices for form in choice.forms if form.channel == channel]
    return forms, evidences.learn[channel].fit(Evidences._keys(channel, choices))[0]


def _records(collection, group, channel):
    return [c[channel] for c in collection.channels.get(group) or () if channel in c]


def _pieces(one, collection, channel, forms, beta):
    """(whitened residual z of one record beside the forms, its time [s], function that makes means over `PIECE`, the
    largest z² that is no spike)."""
    columns = [form.columns(one, collection.frame) for form in forms]
    left = one.residual - (np.concatenate(columns, axis=1) @ beta if columns else 0.0)
    noise = {"spreads": collection.spreads} if channel == "torque" else {}
    z = free_of_nuisance(one, left[:, None], **noise)[0][:, 0]
    time = one.time if hasattr(one, "time") else one.prepared.time
    count = max(int(PIECE / float(time[1] - time[0])), 1)
    whole = len(z) // count * count
    # derived: five standard deviations; the median of χ² of one is 0.455 times its mean
    return z, time, lambda values: values[:whole].reshape(-1, count).mean(axis=1), 25.0 * np.median(z**2) / 0.455


def _line_of(one, collection, channel, forms, beta):
    """The strongest line in time of one record, as `Line`."""
    z, _, piece, limit = _pieces(one, collection, channel, forms, beta)
    return _line(piece(np.clip(z, -np.sqrt(limit), np.sqrt(limit))), PIECE)


def _since_motion(speed, step):
    """Time since the last motion [s], shape as ``speed`` [m/s]."""
    since, out = 0.0, np.empty(len(speed))
    for n, value in enumerate(speed):
        since = 0.0 if value > REST_SPEED else since + step
        out[n] = since
    return out


def _variance_ratio(values, z2):
    """Between-class over within-class variance of z², and the ratio that chance exceeds with `CHANCE`."""
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, CLASSES + 1)[1:-1]))
    number = np.searchsorted(edges, values, side="right")
    groups = [z2[number == k] for k in np.unique(number)]
    groups = [group for group in groups if len(group) > 1]
    count, total = len(groups), sum(map(len, groups))
    if count < 2:
        return 0.0, 1.0
    mean = np.concatenate(groups).mean()
    between = sum(len(g) * (g.mean() - mean) ** 2 for g in groups) / (count - 1)
    within = sum(((g - g.mean()) ** 2).sum() for g in groups) / (total - count)
    return float(between / max(within, TINY)), float(fisher.isf(CHANCE, count - 1, total - count))


class Line(NamedTuple):
    """The strongest line in time of a record: frequency [Hz], power over the usual one [1], the threshold that chance
    exceeds with `CHANCE`, and the line's width 1/T [Hz]."""

    frequency: float
    strength: float
    threshold: float
    width: float

    @property
    def stands(self):
        """Whether it is more than chance."""
        return self.strength > self.threshold

    def is_at(self, other):
        """Whether another record's line has the same frequency."""
        return abs(self.frequency - other.frequency) <= SAME_FREQUENCY * max(self.width, other.width)


def _line(values, step):
    """`Line` of z's means, ``step`` [s] apart.

    The usual power is that of which half of the frequencies have more, of all or of those as far above as below, where
    these are louder: what changes slowly is loud at low frequencies, and no line.
    """
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2
    frequency = np.fft.rfftfreq(len(values), step)
    inside = (frequency > SLOWEST) & (frequency < FASTEST / step)
    if inside.sum() < LEAST_AROUND:
        return Line(0.0, 0.0, 1.0, 0.0)
    strength = np.zeros(len(power))
    for k in np.flatnonzero(inside):
        around = inside & (np.abs(frequency - frequency[k]) < AROUND * frequency[k])
        around[k - LOBE : k + LOBE + 1] = False
        if around.sum() >= LEAST_AROUND:
            strength[k] = power[k] * np.log(2.0) / max(np.median(power[inside]), np.median(power[around]), TINY)
    best = int(np.argmax(strength))
    return Line(float(frequency[best]), float(strength[best]), float(np.log(inside.sum() / CHANCE)),
                float(frequency[1]))
