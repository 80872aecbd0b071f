"""All that fitting needs to know of one channel of some records: one matrix of inner products.

Residual and candidates' columns are whitened once; after that every fit, on whichever records and
with whichever candidates, is algebra on small matrices and does not touch the samples again.
"""

import dataclasses

import numpy as np
import scipy.linalg


@dataclasses.dataclass
class Evidence:
    """Inner products of whitened residual (index 0) and candidate columns.

    ``matrix`` has shape (1 + k, 1 + k); ``where`` maps a form's key to its slice; ``rows`` counts samples.
    """

    matrix: np.ndarray
    where: dict
    rows: int

    def __add__(self, other):
        return Evidence(self.matrix + other.matrix, self.where, self.rows + other.rows)

    def indices(self, keys):
        """Rows of the matrix that belong to these forms."""
        parts = [np.arange(self.where[key].start, self.where[key].stop) for key in keys]
        return np.concatenate(parts) if parts else np.zeros(0, int)

    def energy(self):
        """χ² of the residual without any candidate."""
        return float(self.matrix[0, 0])

    def fit(self, keys, ridge=1e-9):
        """Least squares with these forms: (β, covariance, reduction of χ²)."""
        index = self.indices(keys)
        if len(index) == 0:
            return np.zeros(0), np.zeros((0, 0)), 0.0
        a = self.matrix[np.ix_(index, index)]
        b = self.matrix[index, 0]
        scale = np.sqrt(np.maximum(np.diag(a), 1e-300))
        scaled = a / np.outer(scale, scale)
        scaled[np.diag_indices_from(scaled)] += ridge + (np.diag(a) < 1e-200)
        factor = scipy.linalg.cho_factor(scaled + 1e-9 * np.eye(len(index)))
        beta = scipy.linalg.cho_solve(factor, b / scale) / scale
        covariance = scipy.linalg.cho_solve(factor, np.eye(len(index))) / np.outer(scale, scale)
        return beta, covariance, float(2.0 * b @ beta - beta @ a @ beta)

    def reduction(self, keys, beta):
        """Reduction of χ² on these records by given sizes (negative if they make it worse)."""
        index = self.indices(keys)
        if len(index) == 0:
            return 0.0
        b = self.matrix[index, 0]
        return float(2.0 * b @ beta - beta @ self.matrix[np.ix_(index, index)] @ beta)


def gather(channel, forms, frame, nuisance=None, **noise):
    """`Evidence` of one channel of one record.

    ``nuisance`` (rows, m) columns are taken out of everything, per record.
    """
    pieces, where, at = [channel.residual[:, None]], {}, 1
    for form in forms:
        columns = form.columns(channel, frame)
        where[form.key] = slice(at, at + columns.shape[1])
        at += columns.shape[1]
        pieces.append(columns)
    count = 0 if nuisance is None else nuisance.shape[1]
    if count:
        pieces.append(nuisance)
    white, _ = channel.whiten(np.concatenate(pieces, axis=1), **noise)
    if count:
        q, _ = np.linalg.qr(white[:, at:])
        white = white[:, :at] - q @ (q.T @ white[:, :at])
    return Evidence(white.T @ white, where, len(white) - count)
