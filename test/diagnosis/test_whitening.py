"""The innovations of coloured noise are white, and least squares on them is generalised least squares."""

import numpy as np

from microstage_ros.diagnosis.preprocessing.whitening import whiten_states, whiten_walk
from microstage_ros.diagnosis.residuals.evidence import Evidence


def coloured(generator, rows=400):
    """A noise of one process seen through a varying gain, its dense covariance, and the filter's arguments."""
    gains = 1.0 + 0.5 * np.sin(np.arange(rows) / 30.0)[:, None]
    keeps = np.full((rows, 1), 0.97)
    spread, white = 2.0, np.full(rows, 0.3)
    lag = np.abs(np.subtract.outer(np.arange(rows), np.arange(rows)))
    covariance = spread**2 * 0.97**lag * (gains @ gains.T) + np.diag(white)
    return np.linalg.cholesky(covariance) @ generator.standard_normal(rows), covariance, (gains, keeps, (spread,), white)


def test_innovations_are_the_cholesky_whitening():
    noise, covariance, arguments = coloured(np.random.default_rng(1))
    white, log_determinant = whiten_states(noise[:, None], *arguments)
    expected = np.linalg.solve(np.linalg.cholesky(covariance), noise)
    np.testing.assert_allclose(white[:, 0], expected, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(log_determinant, np.linalg.slogdet(covariance)[1], rtol=1e-9)


def test_fit_is_generalised_least_squares():
    generator = np.random.default_rng(2)
    noise, covariance, arguments = coloured(generator)
    columns = np.stack([np.linspace(-1, 1, 400), np.cos(np.arange(400) / 50.0)], axis=1)
    y = noise + columns @ [3.0, -1.0]
    white, _ = whiten_states(np.column_stack([y, columns]), *arguments)
    evidence = Evidence(white.T @ white, {"a": slice(1, 2), "b": slice(2, 3)}, 400)
    beta, stated, gain = evidence.fit(["a", "b"])
    inverse = np.linalg.inv(covariance)
    truth = np.linalg.inv(columns.T @ inverse @ columns)
    np.testing.assert_allclose(beta, truth @ columns.T @ inverse @ y, rtol=1e-5)
    np.testing.assert_allclose(stated, truth, rtol=1e-5)
    left = y - columns @ beta
    np.testing.assert_allclose(gain, y @ inverse @ y - left @ inverse @ left, rtol=1e-6)
    np.testing.assert_allclose(evidence.reduction(["a", "b"], beta), gain, rtol=1e-6)


def test_walk_read_with_noise_becomes_white():
    generator = np.random.default_rng(3)
    walk = np.cumsum(0.1 * generator.standard_normal(50_000)) + 2.0 * generator.standard_normal(50_000)
    white = whiten_walk(walk[:, None], 0.1, 2.0)[2000:, 0]
    assert abs(white.std() - 1.0) < 0.02
    assert abs(np.mean(white[1:] * white[:-1])) < 0.02
