"""All that fitting needs to know of one channel of some records: one matrix of inner products.

Residual and candidates' columns are whitened once; after that every fit, on whichever records and
with whichever candidates, is algebra on small matrices and does not touch the samples again.
"""

import dataclasses

import numpy as np
import scipy.linalg

# of correlations, on the diagonal of a normal matrix; derived: a fifteenth of √ε = 1.5·10⁻⁸, short of which two columns
# differ by no more than the rounding ε of their squares
RIDGE = 1.0e-9
TINY = np.finfo(float).tiny


@dataclasses.dataclass
class Evidence:
    """Inner products of whitened residual (index 0) and candidate columns.

    ``matrix`` has shape (1 + k, 1 + k); ``where`` maps a form's key to its slice; ``rows`` counts samples;
    ``priors`` {key: standard deviation} keeps sizes small that the records hardly touch (splines beyond
    what was visited).
    """

    matrix: np.ndarray
    where: dict
    rows: int
    priors: dict = dataclasses.field(default_factory=dict)

    def __add__(self, other):
        return Evidence(self.matrix + other.matrix, self.where, self.rows + other.rows, self.priors)

    def indices(self, keys):
        """Rows of the matrix that belong to these forms."""
        parts = [np.arange(self.where[key].start, self.where[key].stop) for key in keys]
        return np.concatenate(parts) if parts else np.zeros(0, int)

    def _precision(self, keys):
        """1/prior² of every size of these forms, 0 where there is no prior."""
        sizes = [np.full(self.where[k].stop - self.where[k].start, self.priors.get(k, np.inf)) for k in keys]
        return 1.0 / np.concatenate(sizes) ** 2

    def energy(self):
        """χ² [1] of the residual without any candidate."""
        return float(self.matrix[0, 0])

    def fit(self, keys, ridge=RIDGE):
        """Least squares with these forms: (β, covariance, reduction of χ²).

        ``ridge``: added to the diagonal of the normal matrix in correlations [1].
        """
        index = self.indices(keys)
        if len(index) == 0:
            return np.zeros(0), np.zeros((0, 0)), 0.0
        a = self.matrix[np.ix_(index, index)]
        b = self.matrix[index, 0]
        known = a + np.diag(self._precision(keys))
        scale = np.sqrt(np.maximum(np.diag(known), TINY))
        scaled = known / np.outer(scale, scale)
        scaled[np.diag_indices_from(scaled)] += ridge + (np.diag(known) < TINY)
        factor = scipy.linalg.cho_factor(scaled + RIDGE * np.eye(len(index)))
        beta = scipy.linalg.cho_solve(factor, b / scale) / scale
        covariance = scipy.linalg.cho_solve(factor, np.eye(len(index))) / np.outer(scale, scale)
        return beta, covariance, float(2.0 * b @ beta - beta @ a @ beta)

    def sizes(self, keys):
        """{key: sizes (k,)} of the joint fit of these forms, each in the unit of its form."""
        widths = [len(self.indices([key])) for key in keys]
        return dict(zip(keys, np.split(self.fit(keys)[0], np.cumsum(widths)[:-1])))

    def reduction(self, keys, beta):
        """Reduction of χ² [1] on these records by given sizes ``beta`` (k,), negative if they make it worse."""
        index = self.indices(keys)
        if len(index) == 0:
            return 0.0
        b = self.matrix[index, 0]
        return float(2.0 * b @ beta - beta @ self.matrix[np.ix_(index, index)] @ beta)


def free_of_nuisance(channel, matrix, **noise):
    """White columns of ``matrix`` (rows, k) without the part that the channel's ``nuisance()`` columns explain, and an
    orthonormal basis (rows, j) of these, white; ``noise``: as `whiten` of the channel has it."""
    nuisance = channel.nuisance() if hasattr(channel, "nuisance") else np.zeros((len(matrix), 0))
    white = channel.whiten(np.concatenate([matrix, nuisance], axis=1), **noise)[0]
    basis = np.linalg.qr(white[:, matrix.shape[1]:])[0]
    white = white[:, :matrix.shape[1]]
    return white - basis @ (basis.T @ white), basis


def gather(channel, forms, frame, systematic=None, **noise):
    """`Evidence` of one channel of one record.

    The channel's ``nuisance()`` columns are taken out of everything. ``systematic`` {form key: spread [unit of the
    size]} adds, per record, an error of the model itself in the direction of that form's columns, with that standard
    deviation of its sizes: what a healthy axis shows although the noise would not allow it.
    """
    pieces, where, at = [channel.residual[:, None]], {}, 1
    for form in forms:
        columns = form.columns(channel, frame)
        where[form.key] = slice(at, at + columns.shape[1])
        at += columns.shape[1]
        pieces.append(columns)
    white, nuisance = free_of_nuisance(channel, np.concatenate(pieces, axis=1), **noise)
    priors = {form.key: form.prior for form in forms if form.prior}
    return _with_systematic(Evidence(white.T @ white, where, len(white) - nuisance.shape[1], priors), systematic or {})


def _with_systematic(evidence, systematic):
    """Marginalise over amplitudes N(0, spread²) of the given forms: G − G_s (G_ss + 1/spread²)⁻¹ G_s'."""
    keys = [key for key in systematic if key in evidence.where]
    if not keys:
        return evidence
    index = evidence.indices(keys)
    spreads = np.concatenate([np.atleast_1d(systematic[key]) for key in keys])
    g = evidence.matrix
    inner = np.diag(1.0 / spreads**2) + g[np.ix_(index, index)]
    scale = np.sqrt(np.diag(inner))
    solved = scipy.linalg.solve(inner / np.outer(scale, scale), g[index] / scale[:, None], assume_a="pos")
    return Evidence(g - (g[index] / scale[:, None]).T @ solved, evidence.where, evidence.rows, evidence.priors)
