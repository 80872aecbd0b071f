"""How long commands take: counts by microsecond, cheap to add to, percentiles on demand."""

import math

FINE = 20_000
"""Bins of 1 µs; longer ones count in the last."""

COARSE = 64


class ResponseTimes:
    """Counts of response times [s]."""

    def __init__(self):
        self._counts = [0] * FINE
        self.total = 0
        self.maximum = 0.0

    def add(self, seconds):
        """Count one response."""
        bin_ = int(seconds * 1e6)
        self._counts[bin_ if bin_ < FINE else FINE - 1] += 1
        self.total += 1
        if seconds > self.maximum:
            self.maximum = seconds

    def percentiles(self, *shares):
        """Times [s] that the given shares (0..1) of the responses do not exceed; NaN without responses."""
        counts = list(self._counts)  # the other thread goes on counting
        total = sum(counts)
        if not total:
            return [math.nan] * len(shares)
        found, seen, wanted = [], 0, list(shares)
        for bin_, count in enumerate(counts):
            seen += count
            while wanted and seen >= wanted[0] * total:
                found.append(min((bin_ + 1) * 1e-6, self.maximum) if bin_ < FINE - 1 else self.maximum)
                wanted.pop(0)
        return found

    def histogram(self):
        """Counts in `COARSE` bins, sixteen per decade from 10 µs on; first and last are open."""
        coarse = [0] * COARSE
        for bin_, count in enumerate(self._counts):
            if count:
                place = int(16 * (math.log10((bin_ + 0.5) * 1e-6) + 5))
                coarse[min(max(place, 0), COARSE - 1)] += count
        return coarse
