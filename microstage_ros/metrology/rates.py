"""A rate counted from so many cases, with the interval that so few of them allow."""

import dataclasses

from scipy.stats import binomtest


@dataclasses.dataclass(frozen=True)
class Rate:
    """``hits`` of ``cases`` [1], with the exact two-sided interval (Clopper and Pearson 1934) at ``level``.

    Attributes
    ----------
    hits, cases : counts.
    value : hits / cases, NaN without cases.
    low, high : ends of the interval, 0 … 1.
    """

    hits: int
    cases: int
    value: float
    low: float
    high: float

    def __str__(self) -> str:
        """For people: ``19 of 20 (75 to 100 %)``."""
        return f"{self.hits} of {self.cases} ({100 * self.low:.3g} to {100 * self.high:.3g} %)"


def rate(hits: int, cases: int, level: float = 0.95) -> Rate:
    """`Rate` of ``hits`` among ``cases``, with the interval at the confidence ``level`` [1].

    Raises
    ------
    ValueError : more hits than cases, or negative counts.
    """
    if cases == 0 and hits == 0:
        return Rate(0, 0, float("nan"), 0.0, 1.0)
    interval = binomtest(int(hits), int(cases)).proportion_ci(level, method="exact")
    return Rate(int(hits), int(cases), hits / cases, float(interval.low), float(interval.high))
