"""Normal distributions on the plane, many at once: means (..., 2), covariances (..., 2, 2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def inverse(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of symmetric matrices (..., 2, 2)."""
    a, b, d = matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 1]
    adjugate = np.empty_like(matrices)
    adjugate[..., 0, 0], adjugate[..., 1, 1] = d, a
    adjugate[..., 0, 1] = adjugate[..., 1, 0] = -b
    return np.asarray(adjugate / (a * d - b * b)[..., None, None])


def distance_squared(offset: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """(...), Mahalanobis."""
    a, b, d = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    x, y = offset[..., 0], offset[..., 1]
    return np.asarray((d * x * x - 2 * b * x * y + a * y * y) / (a * d - b * b))


def log_density(offset: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """(...), natural logarithm, per square of the unit of the offset."""
    determinant = covariance[..., 0, 0] * covariance[..., 1, 1] - covariance[..., 0, 1] ** 2
    return np.asarray(-np.log(2 * np.pi) - np.log(determinant) / 2 - distance_squared(offset, covariance) / 2)


def agreed(
    mean: NDArray[np.float64],
    covariance: NDArray[np.float64],
    other_mean: NDArray[np.float64],
    other_covariance: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and covariance of two independent estimates of one thing, weighted by their information."""
    gain = covariance @ inverse(covariance + other_covariance)
    mean = mean + (gain @ (other_mean - mean)[..., None])[..., 0]
    covariance = covariance - gain @ covariance
    return mean, (covariance + covariance.swapaxes(-1, -2)) / 2
