"""Evidence gathered form by form is the evidence gathered at once."""

import types

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue.form import Form
from microstage_ros.diagnosis.residuals.evidence import gather
from microstage_ros.diagnosis.residuals.growing import Growing
from microstage_ros.diagnosis.residuals.resonance import _passed_on

ROWS = 400


class Channel:
    """A channel whose whitening is a first difference, with a nuisance."""

    def __init__(self, seed):
        self.generator = np.random.default_rng(seed)
        self.residual = self.generator.normal(size=ROWS)
        self.columns = {name: self.generator.normal(size=(ROWS, width)) for name, width in (("a", 1), ("b", 3), ("c", 2), ("d", 1))}

    def nuisance(self):
        return np.ones((ROWS, 1)) * np.arange(ROWS)[:, None]

    def whiten(self, matrix, size=1.0):
        return np.diff(matrix, axis=0, prepend=0.0) / size, 0.0


@pytest.fixture(scope="module")
def both():
    forms = [Form(name, "x", "", (lambda channel, frame, n=name: channel.columns[n])) for name in "abcd"]
    channels, frame = [Channel(seed) for seed in (1, 2)], types.SimpleNamespace()
    systematic = {("b", ""): np.array([0.1, 0.2, 0.3]), ("d", ""): 0.05, ("elsewhere", ""): 1.0}
    whole = sum((gather(c, forms, frame, systematic, size=2.0) for c in channels[1:]), gather(channels[0], forms, frame, systematic, size=2.0))
    return whole, lambda: Growing(channels, forms, frame, systematic, size=2.0)


@pytest.mark.parametrize("order", ["abcd", "dcba", "ca"])
def test_growing_is_gathering(both, order):
    """In any order of asking: energy, rows, fits and reductions by given sizes are the same to rounding."""
    whole, make = both
    part = make()
    assert part.rows == whole.rows and part.energy() == pytest.approx(whole.energy(), rel=1e-12)
    for n in range(1, len(order) + 1):
        keys = [(name, "") for name in order[:n]]
        for own, other in zip(part.fit(keys), whole.fit(keys)):
            assert own == pytest.approx(other, rel=1e-8, abs=1e-12)
        sizes = np.linspace(0.1, 0.4, len(whole.indices(keys)))
        assert part.reduction(keys, sizes) == pytest.approx(whole.reduction(keys, sizes), rel=1e-9)
    index = part.indices([("a", ""), ("c", "")]), whole.indices([("a", ""), ("c", "")])
    assert part.matrix[np.ix_(index[0], index[0])] == pytest.approx(whole.matrix[np.ix_(index[1], index[1])], rel=1e-9)


def test_a_form_alone_is_not_kept(both):
    whole, make = both
    part, form = make(), Form("c", "x", "", lambda channel, frame: channel.columns["c"])
    assert part.alone(form).fit([("c", "")])[2] == pytest.approx(whole.fit([("c", "")])[2], rel=1e-9)
    assert not part.where


def test_the_filter_is_the_difference_equation():
    """Second-order sections of two inputs against the recursion written out, from rest."""
    generator = np.random.default_rng(3)
    x, f = generator.normal(size=(2, 50))
    b, g, a = np.array([0.3, 0.2, 0.1]), np.array([0.05, -0.02, 0.01]), np.array([1.0, -1.6, 0.8])
    y = np.zeros(50)
    for n in range(50):
        y[n] = sum(b[k] * x[n - k] + g[k] * f[n - k] for k in range(3) if n >= k) - sum(a[k] * y[n - k] for k in (1, 2) if n >= k)
    assert _passed_on(x, f, b, g, a, 5) == pytest.approx(y.reshape(-1, 5).mean(axis=1), rel=1e-12)
