"""Building blocks of the catalogue's forms (`model.effects.signature`), and splines."""

import numpy as np
from scipy.interpolate import BSpline

# the catalogue has them from here
from microstage_ros.model.effects.signature import Form, Frame, one, wave  # noqa: F401


def splines(x, low, high, pieces, degree=3):
    """B-splines of a coordinate ``x``, shape (rows,), of a ``degree`` [1].

    They stand on ``pieces`` equal pieces between ``low`` and ``high``, in the unit of x, and are constant beyond: shape
    (rows, pieces + degree).
    """
    knots = np.concatenate([[low] * degree, np.linspace(low, high, pieces + 1), [high] * degree])
    inside = np.clip(x, low, high - 1e-12 * max(abs(high), 1e-9) - 1e-15)
    return BSpline.design_matrix(inside, knots, degree, extrapolate=False).toarray()
