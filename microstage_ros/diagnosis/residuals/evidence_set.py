"""What is fitted and what it is fitted to: an effect as used, an effect on trial, the evidence of all channels
together."""

import dataclasses
import math

import numpy as np
from scipy.stats import chi2


# s; derived: between 0.25 and 2 s the standard errors change by a third at most (healthy axes of Leuven's and of
# LuGre's law), so whitened rows this far apart agree by chance only; longer stretches waste degrees of freedom
STRETCH = 0.25
# s; derived: the friction of the axis file's kind keeps its size over fractions of a second to some seconds, and
# stretches must not share it; 2 s leave ten degrees of freedom in a record of half a minute
LOUDNESS_STRETCH = 2.0
FEW = 3.0              # stretches; derived: two have one difference, and no scatter
TINY = np.finfo(float).tiny
UNTOLD = 1.0e9         # standard error of an amplitude without a baseline; derived: the inverse of `evidence.RIDGE`
LEAST_FREEDOM = 1.0    # degrees; derived: one stretch that holds all is compared with one other


@dataclasses.dataclass(frozen=True)
class Choice:
    """An effect as it is used: its form in each channel."""

    effect: str
    forms: tuple

    def keys(self, channel):
        """Keys of this effect's forms in a channel."""
        return [form.key for form in self.forms if form.channel == channel]


@dataclasses.dataclass
class Trial:
    """A choice on trial: reduction of χ² when learning, number of sizes, reduction on held-out records."""

    choice: Choice
    gain: float
    sizes: int
    held: float = 0.0

    @property
    def log_p(self):
        """ln of the probability [1] of such a gain by chance."""
        return float(chi2.logsf(max(self.gain, 0.0), self.sizes))


class Evidences:
    """Evidence of learning, held-out and baseline records by channel, with the scatter of each channel.

    ``scatter`` {channel: factor ≥ 1}: χ² per row of healthy records, by which all χ² are divided.
    ``in_rows(channel)``: a `Growing` of the learning records, for what is asked stretch by stretch.
    ``raw``: evidence of the baseline before `residuals.healthy` took out what the healthy axis does and the model not.
    ``own_profile``: relative standard deviation of the healthy friction along the stroke.
    """

    def __init__(self, learn, held, base, forms, scatter, frame, in_rows=None, raw=None,
                 own_profile=0.0):
        self.learn, self.held, self.base, self.forms = learn, held, base, forms
        self.scatter, self.frame, self.raw, self.own_profile = scatter, frame, raw or {}, own_profile
        self._in_rows, self._learn_rows = in_rows, {}

    def with_tables(self, learn, held):
        """The same with other evidence of the learning and held-out records, {channel: `Evidence`}."""
        return Evidences(learn, held, self.base, self.forms, self.scatter, self.frame, self._in_rows, self.raw,
                         self.own_profile)

    def gain(self, choices, extra=()):
        """Reduction of χ² on the learning records by these choices (and extra (channel, key) pairs)."""
        return sum(self.channel_gain(channel, choices, extra) for channel in self.learn)

    def channel_gain(self, channel, choices, extra=()):
        """The same [1] in one channel, with ``extra`` choices, `Choice` each."""
        return self.learn[channel].fit(self._keys(channel, choices, extra))[2] / self.scatter[channel]

    def held_gain(self, choices, channels=None):
        """Reduction of χ² on held-out records by the sizes learned."""
        total = 0.0
        for channel in channels or self.held:
            keys = self._keys(channel, choices)
            beta, _, _ = self.learn[channel].fit(keys)
            total += self.held[channel].reduction(keys, beta) / self.scatter[channel]
        return total

    def more(self, channel, keys, key):
        """Further reduction of χ² [1] on the learning records of one channel by one more form."""
        learn = self.learn[channel]
        return (learn.fit([*keys, key])[2] - learn.fit(keys)[2]) / self.scatter[channel]

    def held_more(self, channel, keys, key):
        """The same [1] on held-out records, by the sizes learned."""
        learn, held = self.learn[channel], self.held[channel]
        after = held.reduction([*keys, key], learn.fit([*keys, key])[0])
        return (after - held.reduction(keys, learn.fit(keys)[0])) / self.scatter[channel]

    def kept_beside(self, choice, others, form):
        """Share of its gain [1] on the learning records that a cause keeps, in its channel, beside a further ``form``,
        `Form`, that is none of the evidence's."""
        rows = self._rows_of(form.channel, "learn")
        rows.know(form)
        keys, own = self._keys(form.channel, others), choice.keys(form.channel)
        alone, beside = (rows.fit([*some, *own])[2] - rows.fit(some)[2] for some in (keys, [*keys, form.key]))
        return beside / max(alone, TINY)

    @staticmethod
    def _keys(channel, choices, extra=()):
        keys = [key for choice in choices for key in choice.keys(channel)]
        return keys + [key for where, key in extra if where == channel and key not in keys]

    def agreement(self, choice, others, group):
        """How an effect's learned sizes agree with the stretches of a group of records (``learn``, ``held`` or
        ``base``).

        The noise model's standard error knows the noise that it models; friction of another law, or that varies
        otherwise, is none of it. So the factor a on the learned signal s is fitted to all stretches, a = Σu/Σd with u =
        s·r and d = s·s, and its error is taken from how the stretches disagree, Σ(u − a d)²/(Σd)² G/(G − 1)
        (cluster-robust: Liang and Zeger, Biometrika 1986), or from the noise model, 1/Σd, if that is larger. G =
        (Σd)²/Σd² stretches carry it. What ``others`` explain is taken out first; of the baseline, which has none of
        them, nothing. The model's own error in the shape of the effect itself is a further error of each record's size.

        Returns
        -------
        (a, its standard error, degrees of freedom G − 1), or None where the rows were not kept.
        """
        u, d, variance = [], [], 0.0
        for channel in sorted({form.channel for form in choice.forms}):
            keys = self._keys(channel, [*others, choice])
            rows = self._rows_of(channel, group)
            if rows is None:
                return None
            own, beta = choice.keys(channel), self.learn[channel].fit(keys)[0]
            if group == "base":      # nothing of the others is there to be taken out
                keys, beta = own, beta[len(beta) - len(rows.indices(own)):]
            parts = rows.stretches(keys, beta, own, STRETCH)
            u.append(parts[0] / self.scatter[channel])
            d.append(parts[1] / self.scatter[channel])
            variance += parts[2] / self.scatter[channel] ** 2
        a, stderr, freedom = factor(np.concatenate(u), np.concatenate(d), scatter=group != "base")
        return a, math.hypot(stderr, math.sqrt(variance) / max(sum(map(np.sum, d)), TINY)), freedom

    def scattered_covariance(self, channel, keys):
        """Covariance (k, k) of the sizes of forms, fitted to the learning records together, by how stretches disagree.

        V Σ g g' V G/(G − 1), with V the noise model's and g the score of each of G stretches (cluster-robust: Liang and
        Zeger, Biometrika 1986); None where the rows were not kept.
        """
        rows = self._rows_of(channel, "learn")
        if rows is None:
            return None
        beta, covariance, _ = self.learn[channel].fit(keys)
        scores = rows.scores(keys, beta, STRETCH)
        return covariance @ (scores.T @ scores) @ covariance * len(scores) / max(len(scores) - 1.0, 1.0)

    def loudness(self, channel, choices, group):
        """χ² per row that the learned sizes leave in a group of records, and how sure that is.

        Returns
        -------
        (mean, its standard error from how stretches of `LOUDNESS_STRETCH` disagree, degrees of freedom), or None where
        the rows were not kept. The baseline is taken as it is, without the causes.
        """
        found = self._energies(channel, choices, group)
        if found is None:
            return None
        energy, count = found
        mean, stretches = energy.sum() / count.sum(), max(len(energy), 1.0 + LEAST_FREEDOM)
        spread = ((energy - mean * count) ** 2).sum() * stretches / (stretches - 1.0)
        return float(mean), math.sqrt(spread) / float(count.sum()), stretches - 1.0

    def mostly_louder(self, channel, choices):
        """Whether half of the stretches of the learning records, beside ``choices``, are louder than every one of the
        baseline: however much louder some are than others, that is no chance. False where the rows were not kept."""
        found, healthy = (self._energies(channel, choices, group) for group in ("learn", "base"))
        if found is None or healthy is None:
            return False
        here, there = (energy / np.maximum(count, 1.0) for energy, count in (found, healthy))
        return bool(np.median(here) > max(there.max(), 1.0))

    def _energies(self, channel, choices, group):
        rows, keys = self._rows_of(channel, group), self._keys(channel, choices) if group != "base" else []
        if rows is None or not hasattr(rows, "energies"):
            return None
        return rows.energies(keys, self.learn[channel].fit(keys)[0], LOUDNESS_STRETCH)

    def lead(self, one, other, others):
        """Where the records under test lie between the fits with one `Choice` and with another, beside ``others``.

        The factor a on the difference of the two fits is fitted to what the second leaves: 1 if the first is right, 0
        if the second is, ½ if they explain as much (the test of models that do not contain each other by Davidson and
        MacKinnon, Econometrica 1981), with its error as in `agreement`.

        Returns
        -------
        (a − ½, its standard error, degrees of freedom), or None where the rows were not kept.
        """
        found = self._between(one, other, others, "learn", "held")
        return None if found is None else (found[0] - 0.5, *found[1:])

    def lead_of_baseline(self, one, other, others):
        """How much of the difference of the two fits, ``one`` and ``other``, `Choice` each, the healthy axis shows,
        where neither is there: the same factor a on the baseline's residual, before anything was taken out of it or
        after, whichever is larger in size. Above zero where the healthy axis is nearer to the first.

        Returns
        -------
        (a, its standard error, degrees of freedom); zeros without a baseline.
        """
        found = [self._between(one, other, others, group) for group in ("base", "raw") if getattr(self, group)]
        found = [size for size in filter(None, found) if math.isfinite(size[1])]
        return max(found, key=lambda size: abs(size[0]), default=(0.0, 0.0, 0.0))

    def _between(self, one, other, others, *groups):
        """Factor on the difference of two fits, in groups of records; without one of the two in the baseline."""
        u, d = [], []
        for channel in sorted({form.channel for choice in (one, other) for form in choice.forms}):
            keys, mine, its = self._fits(channel, one, other, others)
            if groups[0] in ("base", "raw"):
                mine, its = mine - its, np.zeros_like(its)
            for group in groups:
                rows = self._rows_of(channel, group)
                if rows is None:
                    return None
                parts = rows.between(keys, mine, its, STRETCH)
                u.append(parts[0] / self.scatter[channel])
                d.append(parts[1] / self.scatter[channel])
        return factor(np.concatenate(u), np.concatenate(d))

    def _fits(self, channel, one, other, others):
        """Keys of the forms of two fits together, and the sizes of either, zero where it has none."""
        evidence, keys = self.learn[channel], self._keys(channel, [*others, one, other])
        place, at = {}, 0
        for key in keys:
            count = len(evidence.indices([key]))
            place[key], at = slice(at, at + count), at + count
        sizes = np.zeros((2, at))
        for row, choice in zip(sizes, (one, other)):
            own = self._keys(channel, [*others, choice])
            beta = evidence.fit(own)[0]
            for key in own:
                row[place[key]], beta = np.split(beta, [place[key].stop - place[key].start])
        return keys, sizes[0], sizes[1]

    def usual(self, channel, key, raw=True):
        """Reduction of χ² [1] by a form that as many rows of the healthy axis as the learning records have would show;
        with ``raw`` before anything was taken out of it; 0 without a baseline."""
        base = self.raw.get(channel, self.base.get(channel)) if raw else self.base.get(channel)
        if base is None:
            return 0.0
        return base.fit([key])[2] / self.scatter[channel] * self.learn[channel].rows / base.rows

    def _rows_of(self, channel, group):
        if group != "learn":
            rows = getattr(self, group).get(channel)
            return rows if hasattr(rows, "stretches") else None
        if channel not in self._learn_rows:
            self._learn_rows[channel] = self._in_rows(channel) if self._in_rows else None
        return self._learn_rows[channel]

    def signal(self, choice, others, group="held"):
        """χ² [1] of an effect's learned signal in a group of records: what it would take there if it is true."""
        total = 0.0
        for channel in {form.channel for form in choice.forms}:
            own, beta = choice.keys(channel), self.learn[channel].fit(self._keys(channel, [*others, choice]))[0]
            part = beta[len(beta) - len(self.learn[channel].indices(own)):]
            evidence = getattr(self, group)[channel]
            index = evidence.indices(own)
            total += part @ evidence.matrix[np.ix_(index, index)] @ part / self.scatter[channel]
        return float(total)

    def amplitude_in_base(self, choice, others, raw=False):
        """How much of the effect the baseline shows, relative to the records: (amplitude, stderr).

        ``raw``: before anything was taken out of the baseline.
        """
        if not self.base:
            return 0.0, UNTOLD
        base = {**self.base, **self.raw} if raw else self.base
        top = bottom = 0.0
        for channel in {form.channel for form in choice.forms}:
            keys = self._keys(channel, [*others, choice])
            beta, _, _ = self.learn[channel].fit(keys)
            own = choice.keys(channel)
            part = beta[len(beta) - len(self.learn[channel].indices(own)):]
            evidence = base[channel]
            index = evidence.indices(own)
            top += part @ evidence.matrix[index, 0] / self.scatter[channel]
            bottom += part @ evidence.matrix[np.ix_(index, index)] @ part / self.scatter[channel]
        return (top / bottom, 1.0 / math.sqrt(bottom)) if bottom > 0 else (0.0, UNTOLD)


def factor(u, d, scatter=True):
    """(a, standard error, degrees of freedom) of the factor a = Σu/Σd of ``u`` and ``d``, each of shape (n,), see
    `Evidences.agreement`.

    ``scatter`` False: of the baseline, where less than `FEW` stretches carry an effect of a motion that was not made
    there; how two numbers disagree says nothing, and the noise model's error stands.
    """
    total = d.sum()
    if not total > 0.0:
        return 0.0, math.inf, 1.0
    a, count = u.sum() / total, max(total**2 / (d**2).sum(), 1.0 + LEAST_FREEDOM)
    spread = ((u - a * d) ** 2).sum() * count / (count - 1.0) if scatter or count > FEW else 0.0
    return float(a), math.sqrt(max(spread, total)) / float(total), float(count - 1.0)
