"""How long commands take: counts by microsecond, cheap to add to, percentiles on demand."""

import math

import numpy as np

FINE = 20_000
"""Bins of 1 µs; longer ones count in the last."""

COARSE = 64
_PLACES = np.clip((16 * (np.log10((np.arange(FINE) + 0.5) * 1e-6) + 5)).astype(np.int64), 0, COARSE - 1)


class ResponseTimes:
    """Counts of response times [s].

    Attributes
    ----------
    counts : int64 of shape (FINE,), by microsecond. longest : int64 of shape (1,), the longest of all [ns].
    """

    def __init__(self):
        self.counts, self.longest = np.zeros(FINE, np.int64), np.zeros(1, np.int64)

    @property
    def maximum(self):
        """Longest of all [s]."""
        return float(self.longest[0]) * 1e-9

    @property
    def total(self):
        """Responses counted."""
        return int(self.counts.sum())

    def add(self, seconds):
        """Count one response that took so many ``seconds`` [s]."""
        self.counts[min(int(seconds * 1e6), FINE - 1)] += 1
        self.longest[0] = max(self.longest[0], round(seconds * 1e9))

    def percentiles(self, *shares):
        """Times [s] that the given shares (0..1) of the responses do not exceed; NaN without responses."""
        seen = np.cumsum(self.counts)
        if not seen[-1]:
            return [math.nan] * len(shares)
        bins = np.searchsorted(seen, np.array(shares) * seen[-1])
        return [min((bin_ + 1) * 1e-6, self.maximum) if bin_ < FINE - 1 else self.maximum for bin_ in bins.tolist()]

    def histogram(self):
        """Counts [1] in `COARSE` bins, sixteen per decade from 10 µs on; first and last are open."""
        return np.bincount(_PLACES, weights=self.counts, minlength=COARSE).astype(np.int64).tolist()
