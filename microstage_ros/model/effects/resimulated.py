"""How an effect shows where records are judged by re-simulation: its sizes, and their section of an axis file."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Fitted:
    """One fitted number: name in the effect, unit, a typical step, bounds."""

    name: str
    unit: str
    step: float
    low: float = -math.inf
    high: float = math.inf


@dataclass(frozen=True)
class Candidate:
    """One form of one effect.

    Attributes
    ----------
    id : the effect's word. form : this form in plain words.
    sizes, shapes : tuples of `Fitted`; sizes are zero where the effect is absent and enter nearly linearly.
    grid : values to try for each shape.
    effect : function (values of sizes and shapes, one sequence) → the effect's section in an axis file.
    sentence : function (values) → one sentence for a technician.
    stands_for : own parameters of the axis that would take its place if they were free. of : the size of what it
    changes.
    """

    id: str
    form: str
    sizes: tuple
    effect: Callable
    sentence: Callable
    shapes: tuple = ()
    grid: tuple = ()
    stands_for: tuple = ()
    of: float = 1.0

    @property
    def fitted(self):
        """All fitted numbers, a tuple of `Fitted` of shape (k,), sizes first."""
        return self.sizes + self.shapes

    def starts(self):
        """Combinations of shape values to start from: a list of arrays, each of shape (shapes,)."""
        return [np.array(shape, float) for shape in itertools.product(*self.grid)]


def one_size(effect, form, size, sentence, **more):
    """`Candidate` of a single ``size``, a `Fitted` that is the effect's parameter of the same name."""
    return Candidate(
        effect.id, form, (size,), lambda p: {size.name: float(p[0])}, lambda p: sentence.format(p[0]), **more
    )
