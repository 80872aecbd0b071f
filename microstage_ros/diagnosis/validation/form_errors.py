"""Form errors: by what share of themselves sizes are off beyond the noise, as campaigns show it.

A size's stated variance is s² + (f x)²: s is the noise's standard error, x the size, f the share by which the form
itself is not known. A campaign knows the errors e. They are taken as normal of variance s² + (g x)², but for the one in
twenty that a 95 % interval leaves out: of variance s² + (g x)² + x², wrong by as much as itself, because something else
was missed. g is the maximum of that likelihood; its interval is where the likelihood falls by less than χ²(0.95; 1)/2
(Wilks, Ann. Math. Stat. 9 (1938) 60). f is the least stated share of all cases, as noise only adds to it: so cases
must come from one version of the constants, and s is rather too small than too large.

Shares that stand beside constants ("calibrated by: campaign --form-errors (low to high)") are of

    ./microstage campaign --cases 0 --form-errors --from FILE...

with the files of 390 cases at commits 8deffe3 and e3f32c9: ``--world second``, pairs of seeds 10201 (100) and 10301
(100), singles of seeds 10311 (60) and, at half the size, 10312 (40); ``--world first``, singles of seed 10321 (50),
pairs of seed 10322 (40). A constant inside its interval stays as it is; one above it is set to the upper end; one
below it, to the most likely.
"""

import collections
import dataclasses

import numpy as np
from scipy.stats import chi2

WRONG = 0.05       # derived: what a 95 % interval leaves out
FALL = chi2.isf(0.05, 1) / 2.0      # of the log likelihood; derived: 95 % (see above)
SHARES = np.geomspace(1.0e-4, 2.0, 500)      # tried; derived: steps of 2 %, up to a size that is off by twice itself
OF_ITSELF = ("drive_compliance.stiffness_factor", "drive_compliance.damping_factor")      # the search's are logarithms


@dataclasses.dataclass(frozen=True)
class FormError:
    """Of a ``parameter``'s ``count`` sizes, ``inside`` lay within 1.96 stated standard errors; ``stated`` is the share
    that was stated of the form (or less), ``share`` the most likely one, ``low`` to ``high`` its 95 % interval."""

    parameter: str
    count: int
    inside: int
    stated: float
    share: float
    low: float
    high: float


def form_errors(errors, period):
    """`FormError` of every parameter, sorted by name.

    Parameters
    ----------
    errors : of all cases, (id.parameter, error, standard error, truth) in the parameter's unit, as
        `campaign.Outcome.errors` has them. period : of the control loop [s]; a delay counts in it.
    """
    by = collections.defaultdict(list)
    for name, *numbers in errors:
        by[name].append(numbers)
    return [_of(name, np.array(by[name], dtype=float), period) for name in sorted(by)]


def _of(name, rows, period):
    error, stderr, truth = rows.T
    size = _sizes(name, truth + error, period)
    stated = float((stderr / size).min())
    noise = np.maximum((stderr / size) ** 2 - stated**2, 0.0)
    share, low, high = most_likely(error / size, noise)
    return FormError(name, len(error), int((np.abs(error) <= 1.96 * stderr).sum()), stated, share, low, high)


def _sizes(name, value, period):
    """What a share is of, shape (n,): the size; of a factor its distance from one; of a delay a period, of an angle
    around the circle a radian."""
    if name == "transport_delay.delay_s":
        return np.full(len(value), period)
    if ".phase" in name:
        return np.ones(len(value))
    return np.abs(value - (name.endswith("factor") and name not in OF_ITSELF))


def most_likely(error, noise):
    """(most likely share, low, high) [1] of sizes.

    Parameters
    ----------
    error : relative errors, shape (n,). noise : relative variances of the noise alone, shape (n,).
    """
    squares, variance = error[:, None] ** 2, noise[:, None] + SHARES**2
    normal = np.exp(-0.5 * squares / variance) / np.sqrt(variance)
    wrong = np.exp(-0.5 * squares / (variance + 1.0)) / np.sqrt(variance + 1.0)
    likelihood = np.log((1.0 - WRONG) * normal + WRONG * wrong).sum(axis=0)
    inside = SHARES[likelihood > likelihood.max() - FALL]
    return float(SHARES[likelihood.argmax()]), float(inside[0]), float(inside[-1])
