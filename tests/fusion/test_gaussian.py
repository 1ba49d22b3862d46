from __future__ import annotations

import numpy as np
from scipy.stats import multivariate_normal
from semap_ingest.fusion.gaussian import agreed, distance_squared, inverse, log_density


def some(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    roots = generator.normal(size=(count, 2, 2))
    return generator.normal(size=(count, 2)), roots @ roots.swapaxes(1, 2) + 0.1 * np.eye(2)


def test_inverse_and_distance_are_those_of_linear_algebra() -> None:
    offset, covariance = some(30, 0)
    assert np.allclose(inverse(covariance), np.linalg.inv(covariance))
    expected = [each @ np.linalg.solve(matrix, each) for each, matrix in zip(offset, covariance, strict=True)]
    assert np.allclose(distance_squared(offset, covariance), expected)


def test_log_density_is_that_of_scipy() -> None:
    offset, covariance = some(30, 1)
    expected = [
        multivariate_normal(cov=matrix).logpdf(each) for each, matrix in zip(offset, covariance, strict=True)
    ]
    assert np.allclose(log_density(offset, covariance), expected)


def test_two_estimates_agree_by_their_information() -> None:
    (one, one_cov), (other, other_cov) = some(30, 2), some(30, 3)
    mean, covariance = agreed(one, one_cov, other, other_cov)
    information, other_information = np.linalg.inv(one_cov), np.linalg.inv(other_cov)
    expected = np.linalg.inv(information + other_information)
    assert np.allclose(covariance, expected)
    weighted = (information @ one[..., None] + other_information @ other[..., None])[..., 0]
    assert np.allclose(mean, (expected @ weighted[..., None])[..., 0])
    assert np.array_equal(covariance, covariance.swapaxes(1, 2))
