"""How sure a named cause is: calibrated on campaigns, where it is known what was hidden.

    logit p = a + b log10(1 + χ²) + c log10(clarity)

χ² is what the cause takes from the held-out records, clarity its part of what the other causes leave above the noise in
its channel. The three numbers are the maximum a posteriori of all causes that a campaign found, right or wrong, under a
weak prior; they stand in ``calibration.yaml`` beside this file with the campaign that gave them
(``./microstage campaign … --calibrate FILE``). A cause that rests on the learning records alone (χ² of 0) has the share
of such causes that were right. No probability goes beyond what so many cases can say, 1 − 1/(n + 2) by Laplace's rule.
"""

import dataclasses
import functools
import math
import pathlib

import numpy as np
import yaml
from scipy.optimize import minimize

from microstage_ros import __version__
from microstage_ros.diagnosis.selection.agreement import CERTAIN
from microstage_ros.quantities.errors import InputError

TINY = np.finfo(float).tiny
FILE = pathlib.Path(__file__).with_name("calibration.yaml")
# least probability of a further cause; calibrated by: microstage campaign --world second, seeds 3301, 3313, 3401, 4105,
# 6101, 6105 and 8205: the four further causes below it were wrong, of the six between it and 0.9 two
LIKELY = 0.82
# clarity below which a further cause of the torque is but what a rattle leaves there, if it holds no more of the gap's
# χ² than `RATTLED`: between 0.115 and 0.32, an asymmetry that was there; calibrated by: microstage campaign --world
# second --kind two, seeds 10301, 10322 and 10501 (right ones that hold as little: 1), and records of the shipped law on
# test/diagnosis/cases/plain_programmes.py with a gap of 1.3 to 1.7° (wrong ones: 0.031 and 0.115)
UNCLEAR = 0.25
# derived: the share that `beyond_the_known.FOLLOWED_SWUNG_SHARE` asks of shapes that a rattle feigns
RATTLED = 0.002
PRIOR = ((2.0, 2.0), (0.5, 0.5), (0.5, 0.5))     # mean and standard deviation of a, b, c: right far more often than not


@dataclasses.dataclass(frozen=True)
class Calibration:
    """The coefficients a, b, c and the number of named causes ``count``, of which ``right`` were hidden.

    ``bare``: right ones and number of those without any χ² on held-out records.
    """

    coefficients: tuple
    count: int
    right: int
    bare: tuple = (0, 0)

    def probability(self, evidence, clarity):
        """Probability [1] that a cause with this χ² on held-out records and this ``clarity`` [1] was there."""
        if evidence <= 0.0:      # Laplace's rule
            return (self.bare[0] + 1.0) / (self.bare[1] + 2.0)
        value = float(np.dot(self.coefficients, _features(evidence, clarity)))
        return float(min(1.0 / (1.0 + np.exp(-value)), 1.0 - 1.0 / (self.count + 2.0)))


def _features(evidence, clarity):
    return np.array([1.0, np.log10(1.0 + max(evidence, 0.0)), np.log10(max(clarity, TINY))])


@functools.cache
def _stored():
    tree = yaml.safe_load(FILE.read_text(encoding="utf-8"))
    return Calibration(tuple(tree["coefficients"]), tree["named"], tree["right"], tuple(tree["without_evidence"]))


def probability(evidence, clarity):
    """`Calibration.probability` by the stored calibration; ``clarity`` [1]."""
    return _stored().probability(evidence, clarity)


def calibrate(named):
    """`Calibration` from (χ² on held-out records, clarity, was it hidden) of every named cause of a campaign.

    Raises `InputError` without any.
    """
    bare = [right for evidence, _, right in named if evidence <= 0.0]
    named = [one for one in named if one[0] > 0.0]
    if not named:
        raise InputError("--calibrate", "no named cause", "a campaign in which something was named")
    x = np.array([_features(evidence, clarity) for evidence, clarity, _ in named])
    sign = np.where([right for *_, right in named], 1.0, -1.0)
    mean, spread = np.array(PRIOR).T

    def cost(c):
        return float(np.logaddexp(0.0, -sign * (x @ c)).sum() + 0.5 * (((c - mean) / spread) ** 2).sum())

    best = minimize(cost, mean, method="BFGS")
    return Calibration(tuple(float(c) for c in best.x), len(named), int((sign > 0).sum()),
                       (sum(bare), len(bare)))


def likely(causes, unsure: list | tuple = (), errors=None, rattled=0.0):
    """(``causes``, those left out): a further cause of a low calibrated probability is not named, nor one of the torque
    that neither holds much nor is clear where the loop rattles in a gap of χ² ``rattled`` [1].

    The first one stands, unless an open question (``unsure``) does: something has changed, and its probability says
    how sure its name is. So does one whose size is certain, by its relative standard ``errors`` {effect: `unsteadiness`
    [1]}: the probability knows how much stands out beside a cause, and not how alike the cause is everywhere.
    """
    doubtful = [c for c in causes[0 if unsure else 1:]
                if c.probability < LIKELY and (errors or {}).get(c.id, math.inf) >= CERTAIN
                or rattled and c.channel == "torque" and c.clarity < UNCLEAR and c.evidence < RATTLED * rattled]
    return [c for c in causes if c not in doubtful], doubtful


def write_calibration(path, calibration, command):
    """Write a calibration with the command that gave it. Raises `InputError` if the file cannot be written."""
    tree = {"made_by": command, "version": __version__, "named": calibration.count, "right": calibration.right,
            "without_evidence": list(calibration.bare),
            # derived: far below their standard errors
            "coefficients": [round(c, 4) for c in calibration.coefficients]}
    try:
        pathlib.Path(path).write_text(yaml.safe_dump(tree, sort_keys=False), encoding="utf-8")
    except OSError as error:
        raise InputError(f"--calibrate {path}", error.strerror, "a file that can be written") from None
