"""Accuracy and repeatability of positioning by ISO 230-2:2014, clause 2.

Deviations x_ij = P_ij - P_i of the reached from the target position, at targets i = 1 … m, approached
n times from either side (up: in the positive direction).  With the mean x̄ and the standard deviation
s (n - 1 in the denominator) at each target and side:

    reversal                    B_i = x̄_i↑ - x̄_i↓                       B = max |B_i|
    repeatability, one side     R_i↑ = 4 s_i↑                            R↑ = max R_i↑
    repeatability, both sides   R_i = max(2 s_i↑ + 2 s_i↓ + |B_i|, R_i↑, R_i↓)   R = max R_i
    systematic deviation        E↑ = max x̄_i↑ - min x̄_i↑                 E over both sides together
    mean bidirectional          x̄_i = (x̄_i↑ + x̄_i↓)/2                    M = max x̄_i - min x̄_i
    accuracy                    A↑ = max(x̄_i↑ + 2 s_i↑) - min(x̄_i↑ - 2 s_i↑)   A over both sides together

The standard asks for five cycles and five targets per metre; fewer cycles are computed all the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from microstage_ros.quantities.errors import InputError


@dataclass(frozen=True)
class Iso230:
    """The figures of ISO 230-2, in the unit of the positions (metres throughout this project).

    Attributes
    ----------
    targets : shape (m,).
    mean_up, mean_down, mean, spread_up, spread_down, reversals : x̄_i↑, x̄_i↓, x̄_i, s_i↑, s_i↓, B_i, each (m,).
    reversal, mean_reversal : B and the mean of B_i.
    repeatability_up, repeatability_down, repeatability : R↑, R↓, R.
    systematic_up, systematic_down, systematic : E↑, E↓, E.
    mean_deviation : M.
    accuracy_up, accuracy_down, accuracy : A↑, A↓, A.
    """

    targets: np.ndarray
    mean_up: np.ndarray
    mean_down: np.ndarray
    mean: np.ndarray
    spread_up: np.ndarray
    spread_down: np.ndarray
    reversals: np.ndarray
    reversal: float
    mean_reversal: float
    repeatability_up: float
    repeatability_down: float
    repeatability: float
    systematic_up: float
    systematic_down: float
    systematic: float
    mean_deviation: float
    accuracy_up: float
    accuracy_down: float
    accuracy: float


def iso230(targets: ArrayLike, up: ArrayLike, down: ArrayLike) -> Iso230:
    """The figures of a bidirectional test.

    Parameters
    ----------
    targets : target positions P_i, shape (m,).
    up, down : positions reached, shape (m, n): row i holds the n approaches of target i.

    Returns
    -------
    Iso230

    Raises
    ------
    InputError : shapes that do not fit, fewer than two cycles, values that are not finite.
    """
    targets = np.asarray(targets, dtype=float)
    up, down = _approaches("up", up, targets), _approaches("down", down, targets)
    mean_up, mean_down = up.mean(axis=1), down.mean(axis=1)
    spread_up, spread_down = up.std(axis=1, ddof=1), down.std(axis=1, ddof=1)
    reversals, mean = mean_up - mean_down, (mean_up + mean_down) / 2
    means = np.concatenate([mean_up, mean_down])
    spreads = np.concatenate([spread_up, spread_down])
    both = np.maximum.reduce([2 * spread_up + 2 * spread_down + abs(reversals), 4 * spread_up, 4 * spread_down])
    return Iso230(
        targets, mean_up, mean_down, mean, spread_up, spread_down, reversals,
        reversal=float(abs(reversals).max()), mean_reversal=float(reversals.mean()),
        repeatability_up=float(4 * spread_up.max()), repeatability_down=float(4 * spread_down.max()),
        repeatability=float(both.max()),
        systematic_up=float(np.ptp(mean_up)), systematic_down=float(np.ptp(mean_down)),
        systematic=float(np.ptp(means)), mean_deviation=float(np.ptp(mean)),
        accuracy_up=_accuracy(mean_up, spread_up), accuracy_down=_accuracy(mean_down, spread_down),
        accuracy=_accuracy(means, spreads))


def _accuracy(means: np.ndarray, spreads: np.ndarray) -> float:
    """max(x̄ + 2 s) - min(x̄ - 2 s)."""
    return float((means + 2 * spreads).max() - (means - 2 * spreads).min())


def _approaches(side: str, reached: ArrayLike, targets: np.ndarray) -> np.ndarray:
    """Deviations x_ij of one side, checked."""
    try:
        reached = np.asarray(reached, dtype=float)
    except ValueError:
        raise InputError(f"positions {side}", "rows of unequal length", "as many cycles at every target") from None
    if reached.ndim != 2 or reached.shape[0] != len(targets) or reached.shape[1] < 2:
        raise InputError(f"positions {side}: shape", reached.shape, f"({len(targets)} targets, at least 2 cycles)")
    if not np.isfinite(reached).all() or not np.isfinite(targets).all():
        raise InputError(f"positions {side}", "values that are not finite", "a position for every approach")
    return reached - targets[:, None]
