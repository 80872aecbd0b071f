"""Evidence that is gathered form by form, as forms are asked for.

Of held-out and baseline records the selection asks for few of the catalogue's forms: only those that are the best of
their effect on the learning records. Each costs a replay of the record, so none is replayed before it is needed.
"""

import numpy as np
import scipy.linalg

from microstage_ros.diagnosis.residuals.evidence import Evidence, free_of_nuisance


class Growing(Evidence):
    """`Evidence` of one channel over some records whose matrix holds the forms asked for so far.

    Parameters
    ----------
    channels : the channel of each record.
    forms : those that may be asked for, and `Form` of the model's own errors among them.
    frame : `Frame` of the case.
    systematic : {form key: standard deviation} as in `evidence.gather`.
    noise : of the channel's whitening.
    """

    def __init__(self, channels, forms, frame, systematic=None, **noise):
        self._forms = {form.key: form for form in forms}
        systematic = {key: spread for key, spread in (systematic or {}).items() if key in self._forms}
        own = [self._forms[key] for key in systematic]
        spreads = np.concatenate([np.atleast_1d(systematic[form.key]) for form in own]) if own else np.zeros(0)
        self._records = [_Record(channel, own, spreads, frame, noise) for channel in channels]
        matrix = np.array([[sum(record.matrix[0][0] for record in self._records)]])
        priors = {form.key: form.prior for form in forms if form.prior}
        super().__init__(matrix, {}, sum(record.rows for record in self._records), priors)

    def know(self, form):
        """One more ``form`` that may be asked for."""
        self._forms.setdefault(form.key, form)

    def indices(self, keys):
        """Rows of the matrix that belong to these forms, which are gathered now if they were not before."""
        for key in keys:
            if key not in self.where:
                blocks = [record.take(self._forms[key]) for record in self._records]
                at = len(self.matrix)
                new = sum(blocks)                                  # (width, all columns so far and these)
                self.where[key] = slice(at, at + len(new))
                self.matrix = np.block([[self.matrix, new[:, :at].T], [new]])
        return super().indices(keys)

    def stretches(self, keys, beta, own, length):
        """How forms with sizes ``beta`` agree with the residual, stretch by stretch of the records.

        The model's own errors in the shape of the very effects in question are not marginalised over: that would take
        most of their signal and leave what the noise model does not hold. They are an error of each record's size.

        Parameters
        ----------
        keys, beta : forms and their sizes, concatenated, shape (k,). own : mask of the sizes in question, shape (k,).
        length : of a stretch [s].

        Returns
        -------
        (u, d, variance): inner products of the questioned forms' signal with the residual that the others leave, and
        with itself, each of shape (stretches,); Σu/Σd is the factor on ``beta[own]`` that these records show beside the
        others. ``variance``: of Σu by the errors that were not marginalised over.
        """
        index = self.indices(keys) - 1       # columns of a record without its residual
        mine = np.concatenate([np.full(self.where[key].stop - self.where[key].start, key in own) for key in keys])
        effects = {effect for effect, _ in own}
        parts = [
            record.stretches(index, np.where(mine, 0.0, beta), np.where(mine, beta, 0.0), length, effects)
            for record in self._records
        ]
        u, d, variances = zip(*parts)
        return np.concatenate(u), np.concatenate(d), sum(variances)

    def between(self, keys, one, other, length):
        """How the residual lies between two fits of the same forms, stretch by stretch of ``length`` [s].

        Parameters
        ----------
        keys : forms. one, other : their sizes in either fit, concatenated, shape (k,).

        Returns
        -------
        (u, d), each of shape (stretches,): inner products of the difference of the two fits with what ``other`` leaves,
        and with itself; Σu/Σd is 1 where ``one`` is right, 0 where ``other`` is.
        """
        index = self.indices(keys) - 1
        parts = [record.stretches(index, other, one - other, length)[:2] for record in self._records]
        return tuple(np.concatenate(values) for values in zip(*parts))

    def energies(self, keys, beta, length):
        """χ² that these forms with sizes ``beta`` leave, and number of rows, stretch by stretch of ``length`` [s]: two
        arrays of shape (stretches,)."""
        index = self.indices(keys) - 1 if keys else np.zeros(0, int)
        parts = [record.energies(index, beta, length) for record in self._records]
        return tuple(np.concatenate(values) for values in zip(*parts))

    def scores(self, keys, beta, length):
        """Inner products of the forms' columns with what sizes ``beta`` (k,) of them leave, stretch by stretch of
        ``length`` [s]: shape (stretches, k). Their sum is zero at least squares."""
        index = self.indices(keys) - 1
        return np.concatenate([record.scores(index, beta, length) for record in self._records])

    def alone(self, form):
        """`Evidence` of the residual and one form, which is not kept."""
        blocks = [record.with_form(form) for record in self._records]
        return Evidence(sum(blocks), {form.key: slice(1, len(blocks[0]))}, self.rows, self.priors)


class _Record:
    """White columns of one record, free of its nuisance and of the model's own errors.

    Marginalising over sizes N(0, spread²) of columns S takes the inner product a'b to a'b − a'S (S'S + 1/spread²)⁻¹
    S'b.
    """

    def __init__(self, channel, own, spreads, frame, noise):
        self._channel, self._frame, self._noise = channel, frame, noise
        pieces = [channel.residual[:, None], *(form.columns(channel, frame) for form in own)]
        self._error_of = np.repeat([form.effect for form in own], [piece.shape[1] for piece in pieces[1:]])
        white, self._nuisance = free_of_nuisance(channel, np.concatenate(pieces, axis=1), **noise)
        self.rows = len(white) - self._nuisance.shape[1]
        self._errors, self._spreads = np.ascontiguousarray(white[:, 1:]), spreads
        self._solved = {}
        residual = white[:, :1]
        self._columns, self._spared_residual = [residual], self._spared(residual)
        self.matrix = residual.T @ self._spared_residual

    def _free(self, white):
        return white - self._nuisance @ (self._nuisance.T @ white)

    def _spared(self, white, effects=frozenset()):
        """The columns b − S (S'S + 1/spread²)⁻¹ S'b, but for the errors in the shape of some ``effects``."""
        kept = ~np.isin(self._error_of, list(effects))
        if not kept.any():
            return white
        errors = self._errors if kept.all() else self._errors[:, kept]
        return white - errors @ self._explained(errors, white, kept, effects)[1]

    def _explained(self, errors, white, kept, effects=frozenset()):
        """S'b and (S'S + 1/spread²)⁻¹ S'b of the ``errors`` S, `_spared`; ``kept``: which of all errors these are."""
        if effects not in self._solved:
            inner = np.diag(1.0 / self._spreads[kept] ** 2) + errors.T @ errors
            scale = np.sqrt(np.diag(inner))
            self._solved[effects] = scale, scipy.linalg.cho_factor(inner / np.outer(scale, scale))
        scale, factor = self._solved[effects]
        cross = errors.T @ white
        return cross, scipy.linalg.cho_solve(factor, cross / scale[:, None]) / scale[:, None]

    def _white(self, form):
        whiten = getattr(self._channel, "whiten_columns", self._channel.whiten)
        return self._free(whiten(form.columns(self._channel, self._frame), **self._noise)[0])

    def take(self, form):
        """Inner products (width, columns so far + width) of one more form's columns, which are kept."""
        white = self._white(form)
        self._columns.append(white)
        spared = self._spared(white)
        return np.concatenate([spared.T @ column for column in self._columns], axis=1)

    def stretches(self, index, others, mine, length, effects=()):
        """`Growing.stretches` of this record: ``others`` and ``mine`` are sizes of the columns ``index``, in the order
        of the matrix; ``effects``: whose errors are not marginalised over."""
        columns = np.concatenate(self._columns[1:], axis=1)[:, index]
        signal, left = columns @ mine, self._columns[0][:, 0] - columns @ others
        starts, effects = self._starts(length), frozenset(effects).intersection(self._error_of)
        products = [np.add.reduceat(signal * self._spared(v[:, None], effects)[:, 0], starts) for v in (left, signal)]
        own = np.isin(self._error_of, list(effects))
        errors = self._spared(self._errors[:, own], effects).T @ signal * self._spreads[own]
        return products[0], products[1], float(errors @ errors)

    def energies(self, index, beta, length):
        """`Growing.energies` of this record."""
        left, starts = self._columns[0][:, 0], self._starts(length)
        if len(index):
            left = left - np.concatenate(self._columns[1:], axis=1)[:, index] @ beta
        energy = np.add.reduceat(left * self._spared(left[:, None])[:, 0], starts)
        return energy, np.diff([*starts, len(left)]).astype(float)

    def scores(self, index, beta, length):
        """`Growing.scores` of this record."""
        columns = np.concatenate(self._columns[1:], axis=1)[:, index]
        left = self._spared((self._columns[0][:, 0] - columns @ beta)[:, None])
        return np.add.reduceat(columns * left, self._starts(length), axis=0)

    def _starts(self, length):
        """First rows of stretches of ``length`` [s]; the last one takes what is less than half of one."""
        time = self._channel.time if hasattr(self._channel, "time") else self._channel.prepared.time
        count = max(round(length / float(time[1] - time[0])), 1)
        return np.arange(0, max(len(self._columns[0]) - count // 2, 1), count)

    def with_form(self, form):
        """Matrix of the residual and a form's columns."""
        white = self._white(form)
        beside, own = self._spared_residual.T @ white, white.T @ white
        if self._errors.shape[1]:    # the inner product of `_spared`, without its columns
            cross, explained = self._explained(self._errors, white, np.ones(len(self._spreads), bool))
            own = own - cross.T @ explained
        return np.block([[self.matrix, beside], [beside.T, own]])
